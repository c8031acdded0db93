/* Work by several threads whose pieces come and go in order, and EXR files by it. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "imageio.h"
#include "ordered.h"

#define PIECES 500

typedef struct line {
    platform_lock *lock;
    unsigned taken, put, stop; /* stop: the piece whose put says so */
    unsigned at_work, most;    /* pieces that are worked on; so many are waited for */
    int is_wrong;
} line;

typedef struct piece {
    unsigned number, square;
} piece;

static int take(void *user, void *slot)
{
    line *l = user;
    ((piece *)slot)->number = l->taken;
    return l->taken < PIECES && ++l->taken;
}

static void square(void *user, void *slot)
{
    line *l = user;
    piece *p = slot;
    platform_lock_enter(l->lock);
    if (++l->at_work >= l->most)
        l->most = 0; /* met */
    platform_lock_wake(l->lock);
    while (l->most)
        platform_lock_wait(l->lock);
    platform_lock_leave(l->lock);
    p->square = p->number * p->number;
}

static int put(void *user, void *slot)
{
    line *l = user;
    const piece *p = slot;
    l->is_wrong |= p->number != l->put || p->square != l->put * l->put;
    return l->put++ != l->stop;
}

/* Runs with so many threads, of which so many must work at the same time. */
static line run(unsigned threads, unsigned meeting, unsigned stop)
{
    const ordered_work work = {NULL, take, square, put};
    ordered_work mine = work;
    piece slots[2 * ORDERED_MAX_THREADS];
    line l = {0};
    l.lock = threads > 1 ? platform_lock_new() : NULL;
    l.stop = stop;
    l.most = l.lock ? meeting : 0;
    mine.user = &l;
    ordered_run(&mine, slots, sizeof *slots, threads, l.lock);
    platform_lock_free(l.lock);
    return l;
}

static void pieces_are_put_in_order(void)
{
    static const unsigned threads[] = {1, 2, 3, 8, ORDERED_MAX_THREADS};
    for (size_t i = 0; i < sizeof threads / sizeof *threads; i++) {
        line l = run(threads[i], 0, PIECES);
        CHECK(!l.is_wrong);
        CHECK_EQ(l.put, PIECES);
    }
}

static void threads_work_at_the_same_time(void)
{
    line l = run(4, 4, PIECES);
    CHECK(!l.is_wrong);
    CHECK_EQ(l.put, PIECES);
}

static void the_first_failure_stops(void)
{
    for (unsigned threads = 1; threads < 9; threads++)
        for (unsigned stop = 0; stop < PIECES; stop += 99) {
            line l = run(threads, 0, stop);
            CHECK(!l.is_wrong);
            CHECK_EQ(l.put, stop + 1);
            CHECK(l.taken <= stop + 1 + ordered_slots(threads));
        }
}

static void threads_have_two_pieces_each(void)
{
    CHECK_EQ(ordered_threads(4, 8), 4);
    CHECK_EQ(ordered_threads(4, 7), 3);
    CHECK_EQ(ordered_threads(4, 3), 1);
    CHECK_EQ(ordered_threads(4, 0), 1);
    CHECK_EQ(ordered_threads(1, 99), 1);
    CHECK_EQ(ordered_threads(9999, 9999), ORDERED_MAX_THREADS);
    CHECK(ordered_threads(0, 9999) >= 1 && ordered_threads(0, 9999) <= ORDERED_FEW_THREADS);
}

#if LULL_WITH_OPENEXR

#define SIZE 192 /* twelve chunks */

static void damage(const char *path, long at)
{
    FILE *file = fopen(path, "r+b");
    if (!CHECK(file != NULL))
        return;
    CHECK_EQ(fseek(file, 0, SEEK_END), 0);
    CHECK_EQ(fseek(file, ftell(file) * at / 100, SEEK_SET), 0);
    for (int i = 0; i < 300; i++)
        fputc(0x55 ^ i, file);
    fclose(file);
}

/* A file that is damaged when its layers are to be kept: the same message by any number of threads,
 * and nothing is left behind. */
static void sources_of_layers_may_break(void)
{
    const char *source = "test_ordered_source.exr", *result = "test_ordered_result.exr";
    image_request request = {.role = IMAGE_COLOR, .layer = "R", .threads = 1};
    image_target target = {source, 1, NULL, 0};
    image_error first, error;
    image img, red;
    FILE *file;

    if (!CHECK_EQ(image_create(&img, SIZE, SIZE, 3, IMAGE_HALF, &error), IMAGE_OK))
        return;
    for (size_t i = 0; i < image_count(&img); i++)
        image_set(&img, i, (float)((i * 7919 + i / 7) % 1009));
    CHECK_EQ(image_write(source, &img, NULL, &error), IMAGE_OK);
    CHECK_EQ(image_read(&red, source, &request, &error), IMAGE_OK);
    remove(result);
    for (long at = 90; at > 20; at -= 20) { /* more and more, from the end */
        damage(source, at);
        target.threads = 1;
        CHECK_EQ(image_write(result, &red, &target, &first), IMAGE_ERROR_WRITE);
        for (int threads = 2; threads < 6; threads++) {
            target.threads = threads;
            CHECK_EQ(image_write(result, &red, &target, &error), IMAGE_ERROR_WRITE);
            CHECK_STR(error.text, first.text);
        }
        file = fopen(result, "rb");
        CHECK(!file);
    }
    remove(source);
    image_destroy(&red);
    image_destroy(&img);
}

#endif

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(pieces_are_put_in_order);
    RUN(threads_work_at_the_same_time);
    RUN(the_first_failure_stops);
    RUN(threads_have_two_pieces_each);
#if LULL_WITH_OPENEXR
    RUN(sources_of_layers_may_break);
#endif
    return check_report();
}
