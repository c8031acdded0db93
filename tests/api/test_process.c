/* Threads and processes: thread counts, shared devices, environment variables, forks. */
#if !defined(_GNU_SOURCE)
#define _GNU_SOURCE /* setenv, fork, usleep, feenableexcept */
#endif
#include "api.h"
#include "threads.h"

#include <errno.h>
#include <fenv.h>
#include <limits.h>
#include <stddef.h>
#include <sys/wait.h>
#if defined(__linux__)
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sched.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#endif

#if defined(__SANITIZE_THREAD__)
#define UNDER_TSAN 1
#elif defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define UNDER_TSAN 1
#endif
#endif
#ifndef UNDER_TSAN
#define UNDER_TSAN 0
#endif

enum { W = 93, H = 61, N = 3 * W * H }; /* odd on purpose */

/* ---- Threads --------------------------------------------------------------------------------- */

static void thread_counts(void)
{
    float *in = noise_image(N, 26), *first = noise_image(N, 27), *out = noise_image(N, 28);
    int threads;

    for (threads = 1; threads <= 4; threads++) {
        OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
        OIDNFilter filter;

        oidnSetDeviceInt(device, "numThreads", threads);
        oidnSetDeviceBool(device, "setAffinity", threads == 2);
        oidnCommitDevice(device);
        filter = new_identity(device, in, threads == 1 ? first : out, W, H);
        oidnExecuteFilter(filter);
        ERROR(device, NONE);
        CHECK(threads == 1 || !memcmp(first, out, N * sizeof(float)));
        oidnReleaseFilter(filter);
        oidnReleaseDevice(device);
    }
    free(in);
    free(first);
    free(out);
}

/* The result for an image of HDR noise, by weights that are not whole numbers. */
static void denoise_noise(float *out)
{
    float *in = noise_image(N, 31);
    OIDNDevice device = new_device();
    OIDNFilter filter = oidnNewFilter(device, "RT");

    oidnSetFilterBool(filter, "hdr", true);
    commit_tight(device, filter, in, out, W, H);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    free(in);
}

/* Hosts round as they like, and some have divisions by zero raise a signal, to find their own. */
static void modes_of_floating_point(void)
{
#if (defined(__SSE__) || defined(__aarch64__)) && defined(FE_UPWARD)
    float expected[N], out[N];

    OURS_ALONE("computes in the mode of its host");
    denoise_noise(expected);
    CHECK(!fesetround(FE_UPWARD));
    denoise_noise(out);
    CHECK_EQ(fegetround(), FE_UPWARD);
    CHECK(!fesetround(FE_TONEAREST));
    CHECK(!memcmp(expected, out, sizeof out));
#if defined(__GLIBC__)
    feclearexcept(FE_ALL_EXCEPT);
    feenableexcept(FE_DIVBYZERO | FE_INVALID | FE_OVERFLOW);
    denoise_noise(out);
    fedisableexcept(FE_ALL_EXCEPT);
    CHECK(!memcmp(expected, out, sizeof out));
#endif
#else
    SKIP("optional: the library keeps the host's mode on this processor");
#endif
}

#if LULL_WITH_THREADS

/* Threads need room for thread-local data of the host in their stacks. */
static void large_thread_data(void)
{
#if defined(__linux__) && defined(CPU_COUNT)
    static __thread volatile char large[1 << 20];
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    cpu_set_t set;

    CHECK_EQ(large[0], 0);
    CHECK(!sched_getaffinity(0, sizeof set, &set));
    oidnSetDeviceInt(device, "numThreads", 2);
    oidnCommitDevice(device);
    ERROR(device, NONE);
    CHECK_EQ(oidnGetDeviceInt(device, "numThreads"), CPU_COUNT(&set) > 1 ? 2 : 1);
    oidnReleaseDevice(device);
#else
    SKIP("optional: how many processors there are is only known on Linux");
#endif
}

typedef struct job {
    OIDNDevice device;
    unsigned seed, failed;
} job;

/* Errors of this thread only; then some work on the shared device. */
static void *work_beside(void *user)
{
    job *j = user;
    float *in = noise_image(N, j->seed), *out = noise_image(N, j->seed + 1);
    OIDNFilter filter;
    int i;

    j->failed += oidnGetDeviceError(j->device, NULL) != NONE;
    oidnNewDeviceByID(-1);
    j->failed += oidnGetDeviceError(NULL, NULL) != ARGUMENT;
    filter = oidnNewFilter(j->device, "RT");
    use_identity(filter, 3);
    oidnSetFilterBool(filter, "srgb", true);
    for (i = 0; i < 6; i++) {
        const size_t height = H - (unsigned)i % 3;

        oidnSetSharedFilterImage(filter, "color", in, F3, W, height, 0, 0, 0);
        oidnSetSharedFilterImage(filter, "output", out, F3, W, height, 0, 0, 0);
        oidnCommitFilter(filter);
        (i % 2 ? oidnExecuteFilterAsync : oidnExecuteFilter)(filter);
        oidnNewFilter(j->device, "*");
        oidnSyncDevice(j->device);
        j->failed += oidnGetDeviceError(j->device, NULL) != ARGUMENT;
        j->failed += oidnGetDeviceError(j->device, NULL) != NONE;
        j->failed += !(difference(in, out, 3 * W * height) < 1e-3f);
    }
    oidnReleaseFilter(filter);
    oidnNewFilter(j->device, "*"); /* left behind unread, for nobody else to see */
    free(in);
    free(out);
    return NULL;
}

static void threads_share_a_device(void)
{
    OIDNDevice device = new_device();
    pthread_t threads[4];
    job jobs[4];
    int i;

    identity(3);
    oidnNewFilter(device, "*");
    for (i = 0; i < 4; i++) {
        jobs[i].device = device;
        jobs[i].seed = 100 + 2 * (unsigned)i;
        jobs[i].failed = 0;
        pthread_create(&threads[i], NULL, work_beside, &jobs[i]);
    }
    for (i = 0; i < 4; i++) {
        pthread_join(threads[i], NULL);
        CHECK_EQ(jobs[i].failed, 0);
    }
    ERROR(device, ARGUMENT);
    oidnReleaseDevice(device);
}

static void *own_device(void *user)
{
    job *j = user;

    j->device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    oidnSetDeviceInt(j->device, "numThreads", 2);
    oidnCommitDevice(j->device);
    work_beside(j);
    oidnReleaseDevice(j->device);
    return NULL;
}

static void devices_side_by_side(void)
{
    pthread_t threads[3];
    job jobs[3];
    int i;

    identity(3);
    for (i = 0; i < 3; i++) {
        jobs[i].seed = 200 + 2 * (unsigned)i;
        jobs[i].failed = 0;
        pthread_create(&threads[i], NULL, own_device, &jobs[i]);
    }
    for (i = 0; i < 3; i++) {
        pthread_join(threads[i], NULL);
        CHECK_EQ(jobs[i].failed, 0);
    }
}

/* More threads with unread errors than a device keeps. */
static void *leave_error(void *user)
{
    oidnNewFilter(user, "*");
    return NULL;
}

static void errors_of_many_threads(void)
{
    OIDNDevice device = new_device();
    pthread_t thread;
    int i;

    for (i = 0; i < 600; i++) {
        pthread_create(&thread, NULL, leave_error, device);
        pthread_join(thread, NULL);
    }
    ERROR(device, NONE);
    leave_error(device);
    ERROR(device, ARGUMENT);
    oidnReleaseDevice(device);
}

#endif

/* ---- Environment and processes --------------------------------------------------------------- */

/* Runs a check in a child process with a variable set. Returns its exit status, 0 if all
 * is well. */
static int in_child(const char *name, const char *value, int (*check)(void))
{
    int status = -1;
    pid_t pid;

    fflush(stdout);
    pid = fork();
    if (pid == 0) {
        if (name)
            setenv(name, value, 1);
        _exit(check());
    }
    if (pid < 0 || waitpid(pid, &status, 0) != pid || !WIFEXITED(status))
        return -1;
    return WEXITSTATUS(status);
}

#if defined(__linux__) && LULL_WITH_THREADS
/* From here on the process cannot ask which CPUs it may use: a sandbox may forbid it, and the
 * answer of a machine of more than 1024 CPUs does not fit. (ENOSYS: threads of sanitizers take no
 * other error.) 0: the system has no such filters. */
static int hide_cpus(void)
{
    struct sock_filter steps[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_sched_getaffinity, 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | ENOSYS),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW)};
    struct sock_fprog program = {sizeof steps / sizeof *steps, steps};

    return !prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) &&
           !prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program);
}

static int default_threads(void)
{
    OIDNDevice device = new_device();
    const int threads = oidnGetDeviceInt(device, "numThreads");

    oidnReleaseDevice(device);
    return threads;
}

static int threads_of_known_cpus;

/* 2: they cannot be hidden. */
static int as_many_threads(void)
{
    return !hide_cpus() ? 2 : default_threads() < threads_of_known_cpus;
}

static void threads_where_cpus_are_hidden(void)
{
    int status;

    OURS_ALONE("has rules of its own");
    threads_of_known_cpus = default_threads();
    status = in_child(NULL, NULL, as_many_threads);
    if (status == 2)
        SKIP("optional: this system has no filters of system calls");
    CHECK_EQ(status, 0);
}
#endif

static int one_thread(void)
{
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    int ok = oidnGetDeviceInt(device, "numThreads") == 1;

    oidnSetDeviceInt(device, "numThreads", 2);
    ok &= oidnGetDeviceInt(device, "numThreads") == 1;
    oidnCommitDevice(device);
    ok &= oidnGetDeviceInt(device, "numThreads") == 1;
    ok &= oidnGetDeviceError(device, NULL) == NONE;
    oidnReleaseDevice(device);
    return !ok;
}

static int any_threads(void)
{
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    int ok;

    oidnSetDeviceInt(device, "numThreads", 1);
    ok = oidnGetDeviceInt(device, "numThreads") == 0;
    oidnReleaseDevice(device);
    return !ok;
}

static int no_affinity(void)
{
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    int ok = !oidnGetDeviceBool(device, "setAffinity");

    oidnSetDeviceBool(device, "setAffinity", true);
    ok &= !oidnGetDeviceBool(device, "setAffinity");
    oidnReleaseDevice(device);
    return !ok;
}

/* What a device has before anything is set. */
static int initial_value(const char *name)
{
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    const int value = oidnGetDeviceInt(device, name);

    oidnReleaseDevice(device);
    return value;
}

static int affinity_is_one(void) { return initial_value("setAffinity") != 1; }
static int most_threads(void) { return initial_value("numThreads") != INT_MAX; }

static int verbose_two(void)
{
    OIDNDevice device;
    int ok;

    if (!freopen("/dev/null", "w", stdout))
        return 2;
    device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    ok = oidnGetDeviceInt(device, "verbose") == 2;
    oidnSetDeviceInt(device, "verbose", 0);
    ok &= oidnGetDeviceInt(device, "verbose") == 2;
    oidnCommitDevice(device);
    ok &= oidnGetDeviceError(device, NULL) == NONE;
    oidnReleaseDevice(device);
    return !ok;
}

static int no_cpu(void)
{
    int ok = oidnGetNumPhysicalDevices() == 0 && !oidnIsCPUDeviceSupported();

    ok &= !oidnNewDevice(OIDN_DEVICE_TYPE_DEFAULT) && oidnGetDeviceError(NULL, NULL) == HARDWARE;
    ok &= !oidnNewDevice(OIDN_DEVICE_TYPE_CPU) && oidnGetDeviceError(NULL, NULL) == HARDWARE;
    ok &= !oidnNewDeviceByID(0) && oidnGetDeviceError(NULL, NULL) == ARGUMENT;
    return !ok;
}

static int default_device(void)
{
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_DEFAULT);
    int ok = device && oidnGetDeviceInt(device, "type") == OIDN_DEVICE_TYPE_CPU;

    if (device)
        oidnReleaseDevice(device);
    return !ok;
}

static void environment(void)
{
    static const char *const defaults[] = {"cpu", "CPU", "0", "cuda", "7", "nonsense", ""};
    size_t i;

    CHECK_EQ(in_child("OIDN_NUM_THREADS", "1", one_thread), 0);
    CHECK_EQ(in_child("OIDN_NUM_THREADS", "", any_threads), 0); /* set, to 0 */
    CHECK_EQ(in_child("OIDN_SET_AFFINITY", "", no_affinity), 0);
    CHECK_EQ(in_child("OIDN_SET_AFFINITY", "0", no_affinity), 0);
    CHECK_EQ(in_child("OIDN_SET_AFFINITY", "false", no_affinity), 0);
    CHECK_EQ(in_child("OIDN_SET_AFFINITY", "8", affinity_is_one), 0);
    CHECK_EQ(in_child("OIDN_NUM_THREADS", "4294967297", most_threads), 0);
    CHECK_EQ(in_child("OIDN_VERBOSE", "2", verbose_two), 0);
    for (i = 0; i < COUNT(defaults); i++)
        CHECK_EQ(in_child("OIDN_DEFAULT_DEVICE", defaults[i], default_device), 0);
    if (is_peer())
        return; /* reads this once per process, which is too late here */
    CHECK_EQ(in_child("OIDN_DEVICE_CPU", "0", no_cpu), 0);
    CHECK_EQ(in_child("OIDN_DEVICE_CPU", "off", no_cpu), 0);
    CHECK_EQ(in_child("OIDN_DEVICE_CPU", "", no_cpu), 0);
}

/* A device made before a fork works in the child, too, and in the parent afterwards. */
static struct {
    OIDNDevice device;
    OIDNFilter filter;
    float *in, *out;
} forked;

static int run_forked(void)
{
    int ok;

    memset(forked.out, 0, N * sizeof(float));
    oidnExecuteFilterAsync(forked.filter);
    oidnExecuteFilter(forked.filter);
    ok = oidnGetDeviceError(forked.device, NULL) == NONE;
    ok &= difference(forked.in, forked.out, N) < 1e-3f;
    return !ok;
}

static int release_forked(void)
{
    oidnReleaseFilter(forked.filter);
    oidnReleaseDevice(forked.device);
    return 0;
}

static int run_and_release_forked(void) { return run_forked() || release_forked(); }

/* Why children cannot go on, or NULL. */
static const char *no_fork(void)
{
    if (is_peer())
        return "optional: Open Image Denoise hangs in forked children";
    if (UNDER_TSAN)
        return "optional: the thread sanitizer allows no threads in forked children";
    return NULL;
}

#if defined(__linux__) && LULL_WITH_THREADS

/* An image that the host brings into memory when it is first touched. */
static struct {
    unsigned char *memory;
    size_t bytes;
} lazy;

static void bring(int number)
{
    (void)number;
    mprotect(lazy.memory, lazy.bytes, PROT_READ | PROT_WRITE);
}

static int run_lazily(void)
{
    OIDNDevice device = new_device();
    float *out = noise_image(N, 31);
    OIDNFilter filter;

    lazy.bytes = N * sizeof(float);
    lazy.memory =
        mmap(NULL, lazy.bytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    filter = new_identity(device, (float *)(void *)lazy.memory, out, W, H);
    signal(SIGSEGV, bring);
    oidnExecuteFilter(filter);
    return oidnGetDeviceError(device, NULL) != NONE || out[N / 2] > 1e-3f;
}

static void faults_are_the_hosts(void)
{
    if (no_fork())
        SKIP(no_fork());
    CHECK_EQ(in_child(NULL, NULL, run_lazily), 0);
}

#endif

static void make_forked(unsigned seed)
{
    forked.device = new_device();
    forked.in = noise_image(N, seed);
    forked.out = noise_image(N, seed + 1);
    forked.filter = new_identity(forked.device, forked.in, forked.out, W, H);
}

static void fork_and_go_on(void)
{
    if (no_fork())
        SKIP(no_fork());
    make_forked(29);
    CHECK_EQ(run_forked(), 0);
    CHECK_EQ(in_child(NULL, NULL, run_and_release_forked), 0);
    CHECK_EQ(in_child(NULL, NULL, release_forked), 0);
    CHECK_EQ(run_forked(), 0);
    release_forked();
    free(forked.in);
    free(forked.out);
}

#if LULL_WITH_THREADS

/* Work that is not over before the test says so. */
static struct {
    gate gate;
    OIDNBuffer buffer;
} busy = {GATE_CLOSED, NULL};

static bool wait_until_open(void *user, double n)
{
    (void)user;
    while (n == 0 && !is_open(&busy.gate))
        usleep(1000);
    return true;
}

static int release_busy(void)
{
    alarm(60);
    oidnReleaseBuffer(busy.buffer);
    return release_forked();
}

static int run_busy(void)
{
    alarm(60);
    oidnSetFilterProgressMonitorFunction(forked.filter, NULL, NULL);
    return run_forked() || release_busy();
}

/* A child neither waits for work that its parent had queued, nor does it. */
static void fork_with_work_queued(void)
{
    char byte = 1;

    if (no_fork())
        SKIP(no_fork());
    make_forked(31);
    busy.buffer = oidnNewBuffer(forked.device, 1);
    *(char *)oidnGetBufferData(busy.buffer) = 7;
    oidnSetFilterProgressMonitorFunction(forked.filter, wait_until_open, NULL);
    oidnExecuteFilterAsync(forked.filter);
    oidnReadBufferAsync(busy.buffer, 0, 1, &byte);
    CHECK_EQ(in_child(NULL, NULL, release_busy), 0);
    CHECK_EQ(in_child(NULL, NULL, run_busy), 0);
    open_gate(&busy.gate);
    release_busy();
    CHECK_EQ(byte, 7);
    CHECK(difference(forked.in, forked.out, N) < 1e-3f);
    free(forked.in);
    free(forked.out);
    alarm(0);
}

#endif

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(thread_counts);
#if defined(__linux__) && LULL_WITH_THREADS
    RUN(threads_where_cpus_are_hidden);
#endif
    RUN(modes_of_floating_point);
#if LULL_WITH_THREADS
    RUN(large_thread_data);
    RUN(threads_share_a_device);
    RUN(devices_side_by_side);
    RUN(errors_of_many_threads);
#endif
    RUN(environment);
#if defined(__linux__) && LULL_WITH_THREADS
    RUN(faults_are_the_hosts);
#endif
    RUN(fork_and_go_on);
#if LULL_WITH_THREADS
    RUN(fork_with_work_queued);
#endif
    free_identity();
    return check_report();
}
