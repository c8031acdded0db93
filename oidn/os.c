/* Operating system layer: memory, locks, threads, clock. See os.h. */
#if !defined(_GNU_SOURCE)
#define _GNU_SOURCE /* pthread_setaffinity_np */
#endif
#include "os.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

#if LULL_WITH_OPENCL && !defined(_WIN32)
#include <dlfcn.h>
#endif
#if !defined(_WIN32)
#include <sched.h>
#include <unistd.h>
#if LULL_WITH_THREADS
#include <signal.h>
#endif
#if defined(__linux__)
#include <sys/mman.h>
#endif
#endif

/* ---- Memory ---------------------------------------------------------------------------------- */

#define LARGE ((size_t)2 << 20) /* a huge page of x86 and most others */

/* Asks for huge pages: a run walks through many rows at once, and every row of small pages is an
 * entry of its own in the address translation (twice as slow, where an emulated machine's are). */
static void use_huge_pages(void *block, size_t size)
{
#if defined(MADV_HUGEPAGE)
    madvise(block, size - size % LARGE, MADV_HUGEPAGE); /* a wish: failing does not matter */
#else
    (void)block;
    (void)size;
#endif
}

/* The address that malloc returned lies just before each block. */
void *lull_os_alloc(size_t size)
{
    const size_t align = size >= LARGE ? LARGE : LULL_OS_ALIGN, extra = align + sizeof(void *);
    char *raw, *block;

    if (size > SIZE_MAX / 2 - extra)
        return NULL;
    raw = malloc(size + extra);
    if (!raw)
        return NULL;
    block = raw + sizeof(void *);
    block += (align - (uintptr_t)block % align) % align;
    memcpy(block - sizeof(void *), &raw, sizeof(void *));
    if (align == LARGE)
        use_huge_pages(block, size);
    return block;
}

void *lull_os_alloc_zero(size_t size)
{
    void *block = lull_os_alloc(size);

    if (block)
        memset(block, 0, size);
    return block;
}

void lull_os_free(void *block)
{
    void *raw;

    if (!block)
        return;
    memcpy(&raw, (char *)block - sizeof(void *), sizeof(void *));
    free(raw);
}

/* ---- Floating point -------------------------------------------------------------------------- */

#if defined(__GNUC__) && defined(__SSE__)

void lull_floats_restore(uint64_t had)
{
    const uint32_t mode = (uint32_t)had;

    __asm__ __volatile__("ldmxcsr %0" ::"m"(mode) : "memory");
}

uint64_t lull_floats_default(void)
{
    uint32_t had;

    __asm__ __volatile__("stmxcsr %0" : "=m"(had)::"memory");
    lull_floats_restore(0x1f80); /* no traps, nearest */
    return had;
}

#elif defined(__GNUC__) && defined(__aarch64__)

void lull_floats_restore(uint64_t had)
{
    __asm__ __volatile__("msr fpcr, %0" ::"r"(had) : "memory");
}

uint64_t lull_floats_default(void)
{
    uint64_t had;

    __asm__ __volatile__("mrs %0, fpcr" : "=r"(had)::"memory");
    lull_floats_restore(0);
    return had;
}

#else

void lull_floats_restore(uint64_t had) { (void)had; }
uint64_t lull_floats_default(void) { return 0; }

#endif

/* ---- Threads: none --------------------------------------------------------------------------- */

#if !LULL_WITH_THREADS

void lull_mutex_init(lull_mutex *m) { *m = 0; }
void lull_mutex_destroy(lull_mutex *m) { (void)m; }
void lull_mutex_lock(lull_mutex *m) { (void)m; }
void lull_mutex_unlock(lull_mutex *m) { (void)m; }
void lull_cond_init(lull_cond *c) { *c = 0; }
void lull_cond_destroy(lull_cond *c) { (void)c; }
void lull_cond_wait(lull_cond *c, lull_mutex *m)
{
    (void)c;
    (void)m;
}
void lull_cond_signal(lull_cond *c) { (void)c; }
void lull_cond_broadcast(lull_cond *c) { (void)c; }

int lull_thread_start(lull_thread *t, size_t stack, void (*run)(void *arg), void *arg)
{
    (void)t;
    (void)stack;
    (void)run;
    (void)arg;
    return 0;
}
void lull_thread_join(lull_thread *t) { (void)t; }
void lull_thread_detach(lull_thread *t) { (void)t; }
int lull_thread_is_self(const lull_thread *t)
{
    (void)t;
    return 0;
}
int lull_thread_pin(int cpu)
{
    (void)cpu;
    return 0;
}
size_t lull_thread_number(void) { return 1; }

#else

#if defined(_MSC_VER)
static __declspec(thread) size_t thread_number;
#else
static __thread size_t thread_number;
#endif

size_t lull_thread_number(void)
{
    static lull_atomic last;

    if (!thread_number)
        thread_number = (size_t)lull_atomic_add(&last, 1) + 1;
    return thread_number;
}

typedef struct thread_start {
    void (*run)(void *arg);
    void *arg;
} thread_start;

/* Windows */
#if defined(_WIN32)

void lull_mutex_init(lull_mutex *m) { InitializeSRWLock(m); }
void lull_mutex_destroy(lull_mutex *m) { (void)m; }
void lull_mutex_lock(lull_mutex *m) { AcquireSRWLockExclusive(m); }
void lull_mutex_unlock(lull_mutex *m) { ReleaseSRWLockExclusive(m); }
void lull_cond_init(lull_cond *c) { InitializeConditionVariable(c); }
void lull_cond_destroy(lull_cond *c) { (void)c; }
void lull_cond_wait(lull_cond *c, lull_mutex *m) { SleepConditionVariableSRW(c, m, INFINITE, 0); }
void lull_cond_signal(lull_cond *c) { WakeConditionVariable(c); }
void lull_cond_broadcast(lull_cond *c) { WakeAllConditionVariable(c); }

static DWORD WINAPI thread_main(void *p)
{
    thread_start start = *(thread_start *)p;

    lull_os_free(p);
    lull_floats_default();
    start.run(start.arg);
    return 0;
}

int lull_thread_start(lull_thread *t, size_t stack, void (*run)(void *arg), void *arg)
{
    thread_start *start = lull_os_alloc(sizeof *start);

    if (!start)
        return 0;
    start->run = run;
    start->arg = arg;
    t->handle = CreateThread(NULL, stack, thread_main, start, 0, &t->id);
    if (!t->handle)
        lull_os_free(start);
    return t->handle != NULL;
}

void lull_thread_join(lull_thread *t)
{
    WaitForSingleObject(t->handle, INFINITE);
    CloseHandle(t->handle);
}

void lull_thread_detach(lull_thread *t) { CloseHandle(t->handle); }
int lull_thread_is_self(const lull_thread *t) { return t->id == GetCurrentThreadId(); }

int lull_thread_pin(int cpu)
{
    return cpu < (int)(8 * sizeof(DWORD_PTR)) &&
           SetThreadAffinityMask(GetCurrentThread(), (DWORD_PTR)1 << cpu) != 0;
}

/* POSIX */
#else

void lull_mutex_init(lull_mutex *m) { pthread_mutex_init(m, NULL); }
void lull_mutex_destroy(lull_mutex *m) { pthread_mutex_destroy(m); }
void lull_mutex_lock(lull_mutex *m) { pthread_mutex_lock(m); }
void lull_mutex_unlock(lull_mutex *m) { pthread_mutex_unlock(m); }
void lull_cond_init(lull_cond *c) { pthread_cond_init(c, NULL); }
void lull_cond_destroy(lull_cond *c) { pthread_cond_destroy(c); }
void lull_cond_wait(lull_cond *c, lull_mutex *m) { pthread_cond_wait(c, m); }
void lull_cond_signal(lull_cond *c) { pthread_cond_signal(c); }
void lull_cond_broadcast(lull_cond *c) { pthread_cond_broadcast(c); }

static void *thread_main(void *p)
{
    thread_start start = *(thread_start *)p;

    lull_os_free(p);
    lull_floats_default();
    start.run(start.arg);
    return NULL;
}

int lull_thread_start(lull_thread *t, size_t stack, void (*run)(void *arg), void *arg)
{
    /* Where these are blocked, a fault ends the process without the host's handler. */
    static const unsigned char faults[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGTRAP, SIGABRT,
                                           SIGSYS};
    thread_start *start = lull_os_alloc(sizeof *start);
    pthread_attr_t attr;
    sigset_t others, old;
    int failed;
    unsigned i;

    if (!start)
        return 0;
    start->run = run;
    start->arg = arg;
    pthread_attr_init(&attr);
    if (stack)
        pthread_attr_setstacksize(&attr, stack);
    sigfillset(&others); /* they are for the host's own threads */
    for (i = 0; i < sizeof faults; i++)
        sigdelset(&others, faults[i]);
    pthread_sigmask(SIG_BLOCK, &others, &old);
    failed = pthread_create(t, &attr, thread_main, start);
    if (failed && stack) /* the host's thread-local data come out of it, and may be larger */
        failed = pthread_create(t, NULL, thread_main, start);
    pthread_sigmask(SIG_SETMASK, &old, NULL);
    pthread_attr_destroy(&attr);
    if (failed)
        lull_os_free(start);
    return !failed;
}

void lull_thread_join(lull_thread *t) { pthread_join(*t, NULL); }
void lull_thread_detach(lull_thread *t) { pthread_detach(*t); }
int lull_thread_is_self(const lull_thread *t) { return pthread_equal(*t, pthread_self()); }

int lull_thread_pin(int cpu)
{
#if defined(__linux__) && defined(CPU_SET)
    cpu_set_t set;

    CPU_ZERO(&set);
    CPU_SET(cpu, &set);
    return sched_setaffinity(0, sizeof set, &set) == 0;
#else
    (void)cpu;
    return 0;
#endif
}

#endif /* POSIX */
#endif /* LULL_WITH_THREADS */

/* ---- Libraries ------------------------------------------------------------------------------- */

#if LULL_WITH_OPENCL && defined(_WIN32)

void *lull_library_open(const char *name) { return (void *)LoadLibraryA(name); }

int lull_library_find(void *library, const char *name, void *function, size_t bytes)
{
    FARPROC found = GetProcAddress((HMODULE)library, name);

    memcpy(function, &found, bytes);
    return found != NULL;
}

#elif LULL_WITH_OPENCL

void *lull_library_open(const char *name) { return dlopen(name, RTLD_NOW | RTLD_LOCAL); }

int lull_library_find(void *library, const char *name, void *function, size_t bytes)
{
    void *found = dlsym(library, name);

    memcpy(function, &found, bytes);
    return found != NULL;
}

#endif

/* ---- Clock and process ----------------------------------------------------------------------- */

#if defined(_WIN32)

uint64_t lull_clock_ns(void)
{
    LARGE_INTEGER now, rate;

    QueryPerformanceCounter(&now);
    QueryPerformanceFrequency(&rate);
    return (uint64_t)((double)now.QuadPart * 1e9 / (double)rate.QuadPart);
}

long lull_process_id(void) { return 0; } /* no fork */

#else

uint64_t lull_clock_ns(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

#if defined(__wasi__)
long lull_process_id(void) { return 0; } /* no fork */
#else
long lull_process_id(void) { return (long)getpid(); }
#endif

#endif
