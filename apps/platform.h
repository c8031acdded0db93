/* What the programs need of the operating system: time, terminals, the interrupt key, memory
 * figures, threads and output files that appear all at once. POSIX, with Windows behind the same
 * functions. */
#ifndef LULL_APPS_PLATFORM_H
#define LULL_APPS_PLATFORM_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

/* Seconds on a clock that never goes back; only differences mean something. */
double platform_clock(void);

void platform_sleep(unsigned seconds);

/* 1 if the stream is shown to a person. */
int platform_is_terminal(FILE *stream);

/* Keeps the numbers of standard streams that are closed from files that are opened later: a report
 * or a picture would hold what is printed. Printing fails as before. */
void platform_hold_standard(void);

/* Sends stdout to stderr from here on and returns a stream to what it was; NULL, and stdout stays,
 * if one of them is closed. */
FILE *platform_divert_stdout(void);

/* Processors that this process may use, 1 at least. */
int platform_processors(void);

/* A lock with a condition (platform_threads.c): wait leaves it until somebody wakes those that
 * wait, or for no reason. NULL, which platform_lock_new returns if it can make none, does nothing.
 */
typedef struct platform_lock platform_lock;

platform_lock *platform_lock_new(void);
void platform_lock_free(platform_lock *lock);
void platform_lock_enter(platform_lock *lock);
void platform_lock_leave(platform_lock *lock);
void platform_lock_wait(platform_lock *lock);
void platform_lock_wake(platform_lock *lock);

/* Runs the function in a thread of its own, to be joined; NULL if there can be none. */
typedef struct platform_thread platform_thread;

platform_thread *platform_thread_start(void (*run)(void *arg), void *arg);
void platform_thread_join(platform_thread *thread);

/* Asks for large pages where a large block is: rows of images are far apart. */
void platform_use_huge_pages(void *block, size_t bytes);

/* Most memory in bytes that this process has had resident so far; 0 if the system does not say. */
size_t platform_peak_memory(void);

/* From this call on, the first interrupt (SIGINT) only makes platform_interrupted() true; a second
 * one ends the process as usual. */
void platform_catch_interrupt(void);
int platform_interrupted(void);

/* Size in bytes of an open file, or -1 if it has none (a pipe). Leaves the position where it was.
 */
int64_t platform_file_size(FILE *file);
int platform_seek(FILE *file, int64_t offset);

/* 1 if path is a directory (reading one gives no useful error text on every system). */
int platform_is_directory(const char *path);

/* A file that takes its name only when it is complete: written beside the target under a temporary
 * name, and renamed by output_close. Until then an existing file of that name is untouched. Targets
 * that are not regular files (/dev/null, a pipe) are written directly. Symbolic links are followed,
 * write-protected files refused. Where the process is ended by a signal that can be caught, the
 * temporary file goes; of several at a time only the one opened last. */
typedef struct output_file {
    FILE *stream;
    char *path;      /* target, links resolved */
    char *temporary; /* NULL if written directly */
} output_file;

/* Each returns 0 or an errno value; after a failure of either nothing is left behind. */
int output_open(output_file *out, const char *path);

/* Whether output_open would be allowed to, as far as can be told without trying: 0 or an errno
 * value. */
int output_check(const char *path);
int output_close(output_file *out);

/* Gives up: removes what was written. */
void output_discard(output_file *out);

#endif
