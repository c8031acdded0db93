#if defined(__APPLE__)
#define _DARWIN_C_SOURCE
#elif defined(__linux__)
#define _GNU_SOURCE /* sched_getaffinity, and what is named below */
#else
#define _XOPEN_SOURCE 700 /* realpath; includes POSIX 2008 */
#define _DEFAULT_SOURCE   /* madvise */
#endif

#include "platform.h"

#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/types.h>

#if defined(_WIN32)
#include <windows.h>
#include <io.h>
#include <process.h>
#else
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>
#if defined(__linux__)
#include <sched.h>
#endif
#endif

void platform_use_huge_pages(void *block, size_t bytes)
{
#if defined(MADV_HUGEPAGE)
    const size_t page = (size_t)2 << 20;
    size_t skip = (page - (uintptr_t)block % page) % page;
    if (block && bytes >= skip + page)
        madvise((char *)block + skip, (bytes - skip) / page * page, MADV_HUGEPAGE);
#else
    (void)block;
    (void)bytes;
#endif
}

/* Bytes of a path up to the name in it. */
static size_t folder_length(const char *path)
{
#if defined(_WIN32)
    static const char separators[] = "/\\:";
#else
    static const char separators[] = "/";
#endif
    size_t n = strlen(path);
    while (n && !strchr(separators, path[n - 1]))
        n--;
    return n;
}

#if defined(_WIN32)

double platform_clock(void)
{
    LARGE_INTEGER now, rate;
    QueryPerformanceCounter(&now);
    QueryPerformanceFrequency(&rate);
    return (double)now.QuadPart / (double)rate.QuadPart;
}

void platform_sleep(unsigned seconds) { Sleep(seconds * 1000); }
int platform_is_terminal(FILE *stream) { return _isatty(_fileno(stream)); }
size_t platform_peak_memory(void) { return 0; }

int platform_processors(void)
{
    SYSTEM_INFO info;
    GetSystemInfo(&info);
    return info.dwNumberOfProcessors > 0 ? (int)info.dwNumberOfProcessors : 1;
}

int platform_seek(FILE *file, int64_t offset) { return _fseeki64(file, offset, SEEK_SET); }

int64_t platform_file_size(FILE *file)
{
    int64_t here = _ftelli64(file), size;
    if (here < 0 || _fseeki64(file, 0, SEEK_END))
        return -1;
    size = _ftelli64(file);
    return _fseeki64(file, here, SEEK_SET) ? -1 : size;
}

void platform_hold_standard(void) {}

static int create_new(const char *path)
{
    return _open(path, _O_WRONLY | _O_CREAT | _O_EXCL | _O_BINARY, _S_IREAD | _S_IWRITE);
}

static char *resolve(const char *path) { return _strdup(path); }
static int is_writable(const char *path) { return _access(path, 2) == 0; }
static int may_fill(const char *folder) { return _access(folder, 0) == 0; }
static int copy_descriptor(int descriptor) { return _dup(descriptor); }
static int put_descriptor(int from, int to) { return _dup2(from, to); }
static int process_id(void) { return _getpid(); }
static FILE *stream_of(int descriptor) { return _fdopen(descriptor, "wb"); }
static void close_descriptor(int descriptor) { _close(descriptor); }

static void inherit(FILE *stream, const struct stat *old)
{
    (void)stream;
    (void)old;
}

static int replace(const char *from, const char *to)
{
    return MoveFileExA(from, to, MOVEFILE_REPLACE_EXISTING) ? 0 : EACCES;
}

#else

double platform_clock(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

void platform_sleep(unsigned seconds) { sleep(seconds); }
int platform_is_terminal(FILE *stream) { return isatty(fileno(stream)); }

int platform_processors(void)
{
#if defined(__linux__)
    cpu_set_t mask;
    if (!sched_getaffinity(0, sizeof mask, &mask))
        return CPU_COUNT(&mask);
#endif
#if defined(_SC_NPROCESSORS_ONLN)
    long n = sysconf(_SC_NPROCESSORS_ONLN);
    return n > 0 && n < 65536 ? (int)n : 1;
#else
    return 1;
#endif
}

size_t platform_peak_memory(void)
{
    struct rusage usage;
    if (getrusage(RUSAGE_SELF, &usage))
        return 0;
#if defined(__APPLE__)
    return (size_t)usage.ru_maxrss; /* bytes there, kilobytes elsewhere */
#else
    return (size_t)usage.ru_maxrss * 1024;
#endif
}

int platform_seek(FILE *file, int64_t offset) { return fseeko(file, (off_t)offset, SEEK_SET); }

int64_t platform_file_size(FILE *file)
{
    off_t here = ftello(file), size;
    if (here < 0 || fseeko(file, 0, SEEK_END))
        return -1;
    size = ftello(file);
    return fseeko(file, here, SEEK_SET) ? -1 : (int64_t)size;
}

void platform_hold_standard(void)
{
    int descriptor;
    do
        descriptor = open("/dev/null", O_RDONLY); /* writing to them fails as before */
    while (descriptor >= 0 && descriptor <= 2);
    if (descriptor > 2)
        close(descriptor);
}

static int create_new(const char *path) { return open(path, O_WRONLY | O_CREAT | O_EXCL, 0666); }

/* What a link points to, from where the link is; NULL if the path is none. */
static char *target_of(const char *path)
{
    char target[4096];
    ssize_t n = readlink(path, target, sizeof target);
    size_t folder = folder_length(path);
    char *whole;
    if (n < 0 || (size_t)n == sizeof target)
        return NULL;
    if (target[0] == '/')
        folder = 0;
    whole = malloc(folder + (size_t)n + 1);
    if (whole) {
        memcpy(whole, path, folder);
        memcpy(whole + folder, target, (size_t)n);
        whole[folder + (size_t)n] = 0;
    }
    return whole;
}

/* The file that a write would reach: links are followed, to files that do not exist yet, too. */
static char *resolve(const char *path)
{
    char *real = realpath(path, NULL), *next;
    if (real)
        return real;
    real = strdup(path);
    for (int links = 0; real && links < 40 && (next = target_of(real)) != NULL; links++) {
        free(real);
        real = next;
    }
    return real;
}

static int is_writable(const char *path) { return access(path, W_OK) == 0; }
static int may_fill(const char *folder) { return access(folder, W_OK | X_OK) == 0; }

static int copy_descriptor(int descriptor) { return dup(descriptor); }
static int put_descriptor(int from, int to) { return dup2(from, to); }
static int process_id(void) { return (int)getpid(); }
static FILE *stream_of(int descriptor) { return fdopen(descriptor, "wb"); }
static void close_descriptor(int descriptor) { close(descriptor); }

/* A new file is that of the owner and group of the one that it replaces, as far as this process may
 * give it away: of another user's file they would lose it. */
static void inherit(FILE *stream, const struct stat *old)
{
    int descriptor = fileno(stream);
    if (fchown(descriptor, old->st_uid, old->st_gid))
        (void)!fchown(descriptor, (uid_t)-1, old->st_gid);
    (void)!fchmod(descriptor, old->st_mode & 0777);
}

static int replace(const char *from, const char *to) { return rename(from, to) ? errno : 0; }

#endif

FILE *platform_divert_stdout(void)
{
    int descriptor = copy_descriptor(1);
    FILE *stream = descriptor < 0 ? NULL : stream_of(descriptor);
    if (!stream && descriptor >= 0)
        close_descriptor(descriptor);
    if (!stream || put_descriptor(2, 1) >= 0)
        return stream;
    fclose(stream);
    return NULL;
}

/* ---- Signals --------------------------------------------------------------------------------- */

#if defined(_WIN32)

static void guard(const char *temporary) { (void)temporary; }

static void on_end(int number)
{
    signal(number, SIG_DFL);
    raise(number);
}

#else

/* What is being written, for signals that end the process: a static copy, always whole. */
static char unfinished[4096];
static volatile sig_atomic_t is_unfinished;

static void on_end(int number)
{
    if (is_unfinished)
        unlink(unfinished);
    signal(number, SIG_DFL);
    raise(number);
}

/* From here on a signal that ends the process removes this file; NULL: none. Files that grow too
 * large are errors, as full disks are. */
static void guard(const char *temporary)
{
    /* Farms and limits warn by some, which end who does not know them; the last are crashes. */
    static const int ends[] = {SIGTERM, SIGHUP,  SIGQUIT, SIGPIPE, SIGALRM, SIGVTALRM, SIGPROF,
                               SIGUSR1, SIGUSR2, SIGXCPU, SIGABRT, SIGBUS,  SIGFPE,    SIGILL,
                               SIGSEGV};
    struct sigaction now = {0};
    is_unfinished = 0;
    if (!temporary || strlen(temporary) >= sizeof unfinished)
        return;
    memcpy(unfinished, temporary, strlen(temporary) + 1);
    is_unfinished = 1;
    for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++)
        if (!sigaction(ends[i], NULL, &now) && now.sa_handler == SIG_DFL)
            signal(ends[i], on_end);
    signal(SIGXFSZ, SIG_IGN);
}

#endif

static volatile sig_atomic_t interrupted;

static void on_interrupt(int number)
{
    interrupted = 1;
    signal(number, on_end);
}

void platform_catch_interrupt(void)
{
    /* A shell's background jobs ignore it: it is for those in the foreground. */
    if (signal(SIGINT, SIG_IGN) != SIG_IGN)
        signal(SIGINT, on_interrupt);
}

int platform_interrupted(void) { return interrupted != 0; }

/* ---- Outputs --------------------------------------------------------------------------------- */

int platform_is_directory(const char *path)
{
    struct stat info = {0}; /* the memory sanitizer does not know of stat */
    return stat(path, &info) == 0 && (info.st_mode & S_IFMT) == S_IFDIR;
}

static void output_forget(output_file *out)
{
    guard(NULL);
    free(out->path);
    free(out->temporary);
    memset(out, 0, sizeof *out);
}

/* Creates lull-<process>-<n>.tmp beside the target, whose name may be as long as names can be;
 * returns 0 or an errno value. */
static int open_temporary(output_file *out)
{
    size_t folder = folder_length(out->path), room = folder + 48;
    int descriptor = -1;
    out->temporary = malloc(room);
    if (!out->temporary)
        return ENOMEM;
    for (unsigned n = 0; n < 100 && descriptor < 0; n++) {
        memcpy(out->temporary, out->path, folder);
        snprintf(out->temporary + folder, room - folder, "lull-%d-%u.tmp", process_id(), n);
        descriptor = create_new(out->temporary);
        if (descriptor < 0 && errno != EEXIST)
            return errno;
    }
    if (descriptor < 0)
        return EEXIST;
    guard(out->temporary);
    out->stream = stream_of(descriptor);
    if (!out->stream) {
        close_descriptor(descriptor);
        remove(out->temporary);
        return ENOMEM;
    }
    return 0;
}

/* Whether a file can be made where the path is: 0 or an errno value. */
static int check_folder(const char *path)
{
    size_t n = folder_length(path);
    char *folder = malloc(n + 2);
    int error = 0;
    if (!folder)
        return ENOMEM;
    memcpy(folder, n ? path : ".", n ? n : 1);
    folder[n ? n : 1] = 0;
    if (!may_fill(folder))
        error = errno;
    free(folder);
    return error;
}

/* Whether the target may be written, and what it is (st_mode 0: nothing yet). */
static int check_target(const char *path, const char *resolved, struct stat *info)
{
    if (platform_is_directory(resolved))
        return EISDIR;
    if (stat(path, info)) {
        info->st_mode = 0;
        return errno == ENOENT ? check_folder(resolved) : errno;
    }
    if (!is_writable((info->st_mode & S_IFMT) == S_IFREG ? resolved : path))
        return errno; /* a file could be replaced, but somebody protected it */
    return (info->st_mode & S_IFMT) == S_IFREG ? check_folder(resolved) : 0;
}

int output_check(const char *path)
{
    struct stat info = {0};
    char *resolved = resolve(path);
    int error = resolved ? check_target(path, resolved, &info) : ENOMEM;
    free(resolved);
    return error;
}

int output_open(output_file *out, const char *path)
{
    struct stat info = {0};
    int error;
    memset(out, 0, sizeof *out);
    out->path = resolve(path);
    if (!out->path)
        return ENOMEM;
    error = check_target(path, out->path, &info);
    if (!error && info.st_mode && (info.st_mode & S_IFMT) != S_IFREG) {
        out->stream = fopen(path, "wb"); /* a link to /dev/stdout leads to a pipe without name */
        error = out->stream ? 0 : errno;
    } else if (!error) {
        error = open_temporary(out);
    }
    if (error)
        output_forget(out);
    return error;
}

int output_close(output_file *out)
{
    struct stat info = {0};
    int error = 0;
    if (fflush(out->stream) || ferror(out->stream))
        error = errno ? errno : EIO;
    if (out->temporary && stat(out->path, &info) == 0)
        inherit(out->stream, &info);
    if (fclose(out->stream) && !error)
        error = errno ? errno : EIO;
    if (out->temporary) {
        if (!error)
            error = replace(out->temporary, out->path);
        if (error)
            remove(out->temporary);
    }
    output_forget(out);
    return error;
}

void output_discard(output_file *out)
{
    if (out->stream)
        fclose(out->stream);
    if (out->temporary)
        remove(out->temporary);
    output_forget(out);
}
