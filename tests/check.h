/* What a C test program needs. A program is a list of test functions and a main:
 *
 *     static void reads_empty_file(void) { CHECK(open("") == NULL); CHECK_EQ(count(), 0); }
 *     int main(int argc, char **argv)
 *     {
 *         CHECK_MAIN(argc, argv);  // argv[1], if any: run only tests whose name contains it
 *         RUN(reads_empty_file);
 *         return check_report();
 *     }
 *
 * One test function is one counted test: it passes if it made at least one check and none failed,
 * it is skipped if it called SKIP. A failure prints one line and the function goes on. The
 * program's last line is `N passed, N failed, N skipped`; its exit status is 1 if a test failed or
 * none ran.
 *
 * A reason for a skip that starts with "optional: " is accepted everywhere; any other one counts as
 * a failure when the environment has CI=true.
 */
#ifndef LULL_TESTS_CHECK_H
#define LULL_TESTS_CHECK_H

#include <stdio.h>
#include <string.h>

static struct {
    unsigned passed, failed, skipped;
    unsigned checks, errors; /* of the running test */
    int skip;
    const char *name, *only;
} check_state;

static inline int check_that(int ok, const char *file, int line, const char *text)
{
    check_state.checks++;
    if (!ok && check_state.errors++ < 20)
        printf("FAIL %s: %s:%d: %s\n", check_state.name, file, line, text);
    return ok;
}

static inline int check_equal(long long a, long long b, const char *file, int line,
                              const char *text)
{
    check_state.checks++;
    if (a != b && check_state.errors++ < 20)
        printf("FAIL %s: %s:%d: %s: %lld, %lld\n", check_state.name, file, line, text, a, b);
    return a == b;
}

/* Each yields 1 if it holds, so that a test can leave early: `if (!CHECK(p)) return;` */
#define CHECK(condition) check_that(!!(condition), __FILE__, __LINE__, #condition)
#define CHECK_EQ(a, b) check_equal((long long)(a), (long long)(b), __FILE__, __LINE__, #a " == " #b)
#define CHECK_STR(a, b) check_that(strcmp((a), (b)) == 0, __FILE__, __LINE__, #a " is " #b)

/* Ends the running test as skipped; the reason is a complete phrase. */
#define SKIP(reason)                                                                               \
    do {                                                                                           \
        printf("SKIP %s: %s\n", check_state.name, (reason));                                       \
        check_state.skip = 1;                                                                      \
        return;                                                                                    \
    } while (0)

static inline void check_run(const char *name, void (*test)(void))
{
    if (check_state.only && !strstr(name, check_state.only))
        return;
    check_state.name = name;
    check_state.checks = check_state.errors = 0;
    check_state.skip = 0;
    test();
    if (check_state.errors) {
        check_state.failed++;
        printf("FAIL %s: %u of %u checks failed\n", name, check_state.errors, check_state.checks);
    } else if (check_state.skip) {
        check_state.skipped++;
    } else if (!check_state.checks) {
        check_state.failed++;
        printf("FAIL %s: checked nothing\n", name);
    } else {
        check_state.passed++;
    }
    fflush(stdout);
}

#define RUN(test) check_run(#test, test)
#define CHECK_MAIN(argc, argv) (check_state.only = (argc) > 1 ? (argv)[1] : NULL)

static inline int check_report(void)
{
    printf("%u passed, %u failed, %u skipped\n", check_state.passed, check_state.failed,
           check_state.skipped);
    return check_state.failed || !(check_state.passed + check_state.skipped);
}

#endif
