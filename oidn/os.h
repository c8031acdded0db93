/* What the facade needs of an operating system: memory, locks, threads, atomics, a clock. POSIX,
 * Windows, or nothing at all (LULL_WITH_THREADS=0: locks do nothing and work runs on the calling
 * thread). */
#ifndef LULL_OIDN_OS_H
#define LULL_OIDN_OS_H

#include <stddef.h>
#include <stdint.h>

#ifndef LULL_WITH_THREADS
#define LULL_WITH_THREADS 1
#endif

#ifndef LULL_WITH_OPENCL
#define LULL_WITH_OPENCL 0 /* it needs a source file that the build makes */
#endif

#if LULL_WITH_THREADS && defined(_WIN32)
#ifndef WIN32_LEAN_AND_MEAN
#define WIN32_LEAN_AND_MEAN
#endif
#include <windows.h>
#elif LULL_WITH_THREADS
#include <pthread.h>
#endif

/* ---- Memory ---------------------------------------------------------------------------------- */

/* Alignment of every block from lull_os_alloc. */
#define LULL_OS_ALIGN 256u

/* A block of `size` bytes, or NULL. The only two places where the facade reaches malloc
 * and free. */
void *lull_os_alloc(size_t size);
void *lull_os_alloc_zero(size_t size);
void lull_os_free(void *block);

/* ---- Locks and threads ----------------------------------------------------------------------- */

#if !LULL_WITH_THREADS
typedef int lull_mutex;
typedef int lull_cond;
typedef int lull_thread;
#elif defined(_WIN32)
typedef SRWLOCK lull_mutex;
typedef CONDITION_VARIABLE lull_cond;
typedef struct lull_thread {
    HANDLE handle;
    DWORD id;
} lull_thread;
#else
typedef pthread_mutex_t lull_mutex;
typedef pthread_cond_t lull_cond;
typedef pthread_t lull_thread;
#endif

void lull_mutex_init(lull_mutex *m);
void lull_mutex_destroy(lull_mutex *m);
void lull_mutex_lock(lull_mutex *m);
void lull_mutex_unlock(lull_mutex *m);

void lull_cond_init(lull_cond *c);
void lull_cond_destroy(lull_cond *c);
void lull_cond_wait(lull_cond *c, lull_mutex *m);
void lull_cond_signal(lull_cond *c);
void lull_cond_broadcast(lull_cond *c);

/* Starts a thread with a stack of `stack` bytes (0: the system's default). Returns 0 on failure,
 * and always without threads. */
int lull_thread_start(lull_thread *t, size_t stack, void (*run)(void *arg), void *arg);
void lull_thread_join(lull_thread *t);
void lull_thread_detach(lull_thread *t);
int lull_thread_is_self(const lull_thread *t);

/* Binds the calling thread to one logical CPU. Returns 0 where that is impossible. */
int lull_thread_pin(int cpu);

/* A number other than 0 that no other thread of this process has or had. */
size_t lull_thread_number(void);

/* Gives the calling thread the rounding, traps and treatment of subnormal numbers that C begins
 * with: threads start with those of the thread that made them, which is the host's. Returns what it
 * had, for lull_floats_restore. Processors other than x86 and 64-bit ARM keep what they have. */
uint64_t lull_floats_default(void);
void lull_floats_restore(uint64_t had);

/* Identifies the process, to notice a fork. */
long lull_process_id(void);

/* Monotonic nanoseconds. */
uint64_t lull_clock_ns(void);

/* ---- Libraries ------------------------------------------------------------------------------- */

#if LULL_WITH_OPENCL
/* A shared library, loaded at run time and for good; NULL if it cannot be. */
void *lull_library_open(const char *name);

/* Stores the address of a function of it in a pointer of `bytes` bytes; 0 if it has none of that
 * name. */
int lull_library_find(void *library, const char *name, void *function, size_t bytes);
#endif

/* ---- Atomics --------------------------------------------------------------------------------- */

/* Sequentially consistent operations on 32-bit words. Add returns the old value; swap replaces
 * `from` by `to` and returns whether it did. Release is a store that only waits to be seen until
 * what was stored before it is: of several, none waits for the others. */
typedef uint32_t lull_atomic;

#if !LULL_WITH_THREADS
static inline uint32_t lull_atomic_load(const lull_atomic *a) { return *a; }
static inline void lull_atomic_store(lull_atomic *a, uint32_t v) { *a = v; }
static inline void lull_atomic_release(lull_atomic *a, uint32_t v) { *a = v; }
static inline uint32_t lull_atomic_add(lull_atomic *a, uint32_t v)
{
    *a += v;
    return *a - v;
}
static inline int lull_atomic_swap(lull_atomic *a, uint32_t from, uint32_t to)
{
    return *a == from ? (*a = to, 1) : 0;
}
static inline void lull_cpu_relax(void) {}
#elif defined(_MSC_VER)
static inline uint32_t lull_atomic_add(lull_atomic *a, uint32_t v)
{
    return (uint32_t)InterlockedExchangeAdd((volatile LONG *)a, (LONG)v);
}
static inline uint32_t lull_atomic_load(const lull_atomic *a)
{
    return lull_atomic_add((lull_atomic *)a, 0);
}
static inline void lull_atomic_store(lull_atomic *a, uint32_t v)
{
    InterlockedExchange((volatile LONG *)a, (LONG)v);
}
static inline void lull_atomic_release(lull_atomic *a, uint32_t v) { lull_atomic_store(a, v); }
static inline int lull_atomic_swap(lull_atomic *a, uint32_t from, uint32_t to)
{
    return (uint32_t)InterlockedCompareExchange((volatile LONG *)a, (LONG)to, (LONG)from) == from;
}
static inline void lull_cpu_relax(void) { YieldProcessor(); }
#else
static inline uint32_t lull_atomic_load(const lull_atomic *a)
{
    return __atomic_load_n(a, __ATOMIC_SEQ_CST);
}
static inline void lull_atomic_store(lull_atomic *a, uint32_t v)
{
    __atomic_store_n(a, v, __ATOMIC_SEQ_CST);
}
static inline void lull_atomic_release(lull_atomic *a, uint32_t v)
{
    __atomic_store_n(a, v, __ATOMIC_RELEASE);
}
static inline uint32_t lull_atomic_add(lull_atomic *a, uint32_t v)
{
    return __atomic_fetch_add(a, v, __ATOMIC_SEQ_CST);
}
static inline int lull_atomic_swap(lull_atomic *a, uint32_t from, uint32_t to)
{
    return __atomic_compare_exchange_n(a, &from, to, 0, __ATOMIC_SEQ_CST, __ATOMIC_SEQ_CST);
}
#if defined(__x86_64__) || defined(__i386__)
static inline void lull_cpu_relax(void) { __asm__ __volatile__("pause"); }
#elif defined(__aarch64__) || (defined(__ARM_ARCH) && __ARM_ARCH >= 7)
static inline void lull_cpu_relax(void) { __asm__ __volatile__("yield"); }
#else
static inline void lull_cpu_relax(void) { __asm__ __volatile__("" ::: "memory"); }
#endif
#endif

/* ---- Processors ------------------------------------------------------------------------------ */

#define LULL_OS_MAX_CPUS 1024

/* Logical CPUs to run on: at most one per physical core, within the process's affinity mask and its
 * container's CPU quota. */
typedef struct lull_cpus {
    unsigned count;     /* threads to start by default, at least 1 */
    unsigned available; /* the most that makes sense: logical CPUs of the mask */
    unsigned listed;    /* entries of `cpu`; 0 where unknown: then threads cannot be pinned */
    short cpu[LULL_OS_MAX_CPUS];
} lull_cpus;

void lull_cpus_detect(lull_cpus *cpus);

/* Brand of the processor ("AMD EPYC ..."), or "CPU". */
void lull_cpu_brand(char *text, size_t size);

#endif
