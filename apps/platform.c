#if defined(__APPLE__)
#define _DARWIN_C_SOURCE
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

static int create_new(const char *path)
{
    return _open(path, _O_WRONLY | _O_CREAT | _O_EXCL | _O_BINARY, _S_IREAD | _S_IWRITE);
}

static char *resolve(const char *path) { return _strdup(path); }
static int process_id(void) { return _getpid(); }
static FILE *stream_of(int descriptor) { return _fdopen(descriptor, "wb"); }
static void close_descriptor(int descriptor) { _close(descriptor); }

static int replace(const char *from, const char *to, int mode)
{
    (void)mode;
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

static int create_new(const char *path) { return open(path, O_WRONLY | O_CREAT | O_EXCL, 0666); }

/* The file that a write would reach; a copy of the path itself if there is none yet. */
static char *resolve(const char *path)
{
    char *real = realpath(path, NULL);
    return real ? real : strdup(path);
}

static int process_id(void) { return (int)getpid(); }
static FILE *stream_of(int descriptor) { return fdopen(descriptor, "wb"); }
static void close_descriptor(int descriptor) { close(descriptor); }

static int replace(const char *from, const char *to, int mode)
{
    if (mode)
        (void)!chmod(from, (mode_t)mode);
    return rename(from, to) ? errno : 0;
}

#endif

static volatile sig_atomic_t interrupted;

static void on_interrupt(int number)
{
    interrupted = 1;
    signal(number, SIG_DFL);
}

void platform_catch_interrupt(void) { signal(SIGINT, on_interrupt); }
int platform_interrupted(void) { return interrupted != 0; }

int platform_is_directory(const char *path)
{
    struct stat info = {0}; /* the memory sanitizer does not know of stat */
    return stat(path, &info) == 0 && (info.st_mode & S_IFMT) == S_IFDIR;
}

static void output_forget(output_file *out)
{
    free(out->path);
    free(out->temporary);
    memset(out, 0, sizeof *out);
}

/* Creates <path>.<process>.<n>.tmp; returns 0 or an errno value. */
static int open_temporary(output_file *out)
{
    size_t room = strlen(out->path) + 48;
    int descriptor = -1;
    out->temporary = malloc(room);
    if (!out->temporary)
        return ENOMEM;
    for (unsigned n = 0; n < 100 && descriptor < 0; n++) {
        snprintf(out->temporary, room, "%s.%d.%u.tmp", out->path, process_id(), n);
        descriptor = create_new(out->temporary);
        if (descriptor < 0 && errno != EEXIST)
            return errno;
    }
    if (descriptor < 0)
        return EEXIST;
    out->stream = stream_of(descriptor);
    if (!out->stream) {
        close_descriptor(descriptor);
        remove(out->temporary);
        return ENOMEM;
    }
    return 0;
}

int output_open(output_file *out, const char *path)
{
    struct stat info = {0};
    int error = 0;
    memset(out, 0, sizeof *out);
    out->path = resolve(path);
    if (!out->path)
        return ENOMEM;
    if (platform_is_directory(out->path)) {
        error = EISDIR;
    } else if (stat(out->path, &info) == 0 && (info.st_mode & S_IFMT) != S_IFREG) {
        out->stream = fopen(out->path, "wb");
        error = out->stream ? 0 : errno;
    } else {
        error = open_temporary(out);
    }
    if (error)
        output_forget(out);
    return error;
}

int output_close(output_file *out)
{
    struct stat info = {0};
    int mode = stat(out->path, &info) == 0 ? (int)(info.st_mode & 0777) : 0;
    int error = 0;
    if (fflush(out->stream) || ferror(out->stream))
        error = errno ? errno : EIO;
    if (fclose(out->stream) && !error)
        error = errno ? errno : EIO;
    if (out->temporary) {
        if (!error)
            error = replace(out->temporary, out->path, mode);
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
