#include "guard.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(__unix__) || defined(__APPLE__)
#define GUARD_PAGES 1
#include <fcntl.h>
#include <signal.h>
#include <sys/mman.h>
#include <unistd.h>
#else
#define GUARD_PAGES 0
#endif

#define CAPACITY ((size_t)1 << 20)

char guard_case[160];
static uint8_t *start[GUARD_COUNT];
static uint64_t state;

#if GUARD_PAGES
static void on_fault(int number)
{
    static const char text[] = ": touched memory outside its buffers\n"
                               "0 passed, 1 failed, 0 skipped\n";
    ssize_t done = write(1, "FAIL ", 5);
    (void)number;
    done += write(1, guard_case, strlen(guard_case));
    done += write(1, text, sizeof text - 1);
    _exit(done ? 1 : 2);
}
#endif

int guard_init(void)
{
    for (unsigned i = 0; i < GUARD_COUNT; i++) {
#if GUARD_PAGES
        size_t page = (size_t)sysconf(_SC_PAGESIZE);
        int zero = open("/dev/zero", O_RDWR);
        void *at = mmap(NULL, CAPACITY + 2 * page, PROT_NONE, MAP_PRIVATE, zero, 0);
        close(zero);
        if (at == MAP_FAILED || mprotect((uint8_t *)at + page, CAPACITY, PROT_READ | PROT_WRITE)) {
            fprintf(stderr, "conform: no memory\n");
            exit(2);
        }
        start[i] = (uint8_t *)at + page;
#else
        start[i] = malloc(CAPACITY);
        if (!start[i]) {
            fprintf(stderr, "conform: no memory\n");
            exit(2);
        }
#endif
    }
#if GUARD_PAGES
    signal(SIGSEGV, on_fault);
    signal(SIGBUS, on_fault);
#endif
    return GUARD_PAGES;
}

void *guard_place(unsigned buffer, size_t bytes, int at_end)
{
    if (bytes > CAPACITY) {
        fprintf(stderr, "conform: a case needs %lu bytes\n", (unsigned long)bytes);
        exit(2);
    }
    return start[buffer] + (at_end ? CAPACITY - bytes : 0);
}

void guard_seed(uint64_t seed) { state = seed; }

/* splitmix64 */
static uint64_t next(void)
{
    uint64_t z = state += 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

uint32_t guard_below(uint32_t n) { return (uint32_t)((next() >> 32) * n >> 32); }

int32_t guard_between(int32_t low, int32_t high)
{
    return (int32_t)(low + (int64_t)guard_below((uint32_t)((int64_t)high - low) + 1));
}
