/* The TZA reader: good files, every kind of malformed file, truncation and corruption. */
#include "tza.h"

#include <stdlib.h>

#include "check.h"
#include "hash.h"

/* ---- A writer of files, right or wrong ------------------------------------------------------- */

typedef struct entry {
    const char *name;
    unsigned rank;
    uint32_t dims[5];
    const char *layout;
    char dtype;
    uint64_t offset; /* 0: the payload is laid out behind the previous one */
} entry;

typedef struct file {
    uint8_t bytes[32768];
    size_t size, table; /* table: offset of the count */
} file;

static void append(file *f, uint64_t value, unsigned bytes)
{
    unsigned i;
    for (i = 0; i < bytes; ++i)
        f->bytes[f->size++] = (uint8_t)(value >> 8 * i);
}

static void append_text(file *f, const char *text, size_t n)
{
    memcpy(f->bytes + f->size, text, n);
    f->size += n;
}

static size_t type_bytes(char dtype)
{
    return dtype == 'f' || dtype == 'i' ? 4 : dtype == 'h' ? 2 : 1;
}

/* The payload bytes count up; entries with an offset of their own get no payload. */
static void write_file(file *f, const entry *entries, unsigned n)
{
    uint64_t offsets[8] = {0};
    unsigned i, d;
    memset(f, 0, sizeof *f);
    append(f, 0x41d7, 2);
    append(f, 2, 1);
    append(f, 0, 1);
    append(f, 0, 8);
    for (i = 0; i < n; ++i) {
        size_t elements = 1, b;
        offsets[i] = entries[i].offset;
        if (offsets[i])
            continue;
        for (d = 0; d < entries[i].rank; ++d)
            elements *= entries[i].dims[d];
        f->size = (f->size + 63) / 64 * 64;
        offsets[i] = f->size;
        for (b = 0; b < elements * type_bytes(entries[i].dtype); ++b)
            append(f, b + i, 1);
    }
    f->size = f->table = (f->size + 63) / 64 * 64;
    append(f, n, 4);
    for (i = 0; i < n; ++i) {
        append(f, strlen(entries[i].name), 2);
        append_text(f, entries[i].name, strlen(entries[i].name));
        append(f, entries[i].rank, 1);
        for (d = 0; d < entries[i].rank; ++d)
            append(f, entries[i].dims[d], 4);
        append_text(f, entries[i].layout, strlen(entries[i].layout));
        append(f, (uint8_t)entries[i].dtype, 1);
        append(f, offsets[i], 8);
    }
    for (i = 0; i < 8; ++i)
        f->bytes[4 + i] = (uint8_t)((uint64_t)f->table >> 8 * i);
}

/* Opens a copy that ends where its memory ends, so that sanitizers see every byte beyond, and
 * reads the first and last element of all its tensors. */
static lull_status open_copy(const uint8_t *bytes, size_t size)
{
    uint8_t *copy = malloc(size ? size : 1);
    lull_tza tza;
    lull_tza_tensor tensor;
    lull_status status;
    memcpy(copy, bytes, size);
    status = lull_tza_open(&tza, copy, size);
    if (status == LULL_OK) {
        static const char *const names[] = {"a.weight", "a.bias", "a.scale", "b", "c"};
        volatile float sink = 0;
        size_t i, elements, d;
        for (i = 0; i < sizeof names / sizeof *names; ++i)
            if (lull_tza_find(&tza, names[i], "", &tensor)) {
                for (elements = 1, d = 0; d < tensor.rank; ++d)
                    elements *= tensor.dims[d];
                CHECK(elements * type_bytes(tensor.dtype) == tensor.bytes);
                CHECK(tensor.data >= copy && tensor.data + tensor.bytes <= copy + size);
                sink = lull_tza_float(&tensor, 0) + lull_tza_float(&tensor, elements - 1);
            }
        (void)sink;
    }
    free(copy);
    return status;
}

/* ---- Good files ------------------------------------------------------------------------------ */

static const entry good[] = {
    {"a.weight", 4, {2, 3, 3, 3}, "oihw", 'h', 0}, {"a.bias", 1, {2}, "x", 'f', 0},
    {"a.scale", 1, {2}, "x", 'i', 0},              {"b", 4, {2, 1, 3, 3}, "oihw", 'b', 0},
    {"c", 1, {5}, "x", 'B', 0},
};
#define GOOD (sizeof good / sizeof *good)

static void reads_a_good_file(void)
{
    static file f;
    lull_tza tza;
    lull_tza_tensor t;
    unsigned i;
    write_file(&f, good, GOOD);
    if (!CHECK_EQ(lull_tza_open(&tza, f.bytes, f.size), LULL_OK))
        return;
    CHECK_EQ(tza.count, GOOD);
    for (i = 0; i < GOOD; ++i) {
        CHECK(lull_tza_find(&tza, good[i].name, "", &t));
        CHECK_EQ(t.rank, good[i].rank);
        CHECK_EQ(t.dtype, good[i].dtype);
        CHECK(memcmp(t.dims, good[i].dims, good[i].rank * sizeof *t.dims) == 0);
        CHECK(memcmp(t.layout, good[i].layout, good[i].rank) == 0);
        CHECK(t.name_length == strlen(good[i].name)
              && memcmp(t.name, good[i].name, t.name_length) == 0);
        CHECK_EQ(t.data[0], i);
        CHECK_EQ((t.data - f.bytes) % 64, 0);
    }
    CHECK(lull_tza_find(&tza, "a", ".bias", &t) && t.dtype == 'f');
    CHECK(lull_tza_find(&tza, "", "c", &t) && t.dtype == 'B');
    CHECK(!lull_tza_find(&tza, "a", ".bia", &t));
    CHECK(!lull_tza_find(&tza, "a", "", &t));
    CHECK(!lull_tza_find(&tza, "a.bias", "x", &t));
    CHECK(!lull_tza_find(&tza, "", "", &t));
}

static void accepts_an_empty_table_and_any_alignment(void)
{
    static file f;
    static uint8_t shifted[sizeof f.bytes + 1];
    write_file(&f, NULL, 0);
    CHECK_EQ(open_copy(f.bytes, f.size), LULL_OK);
    write_file(&f, good, GOOD);
    memcpy(shifted + 1, f.bytes, f.size);
    {
        lull_tza tza;
        lull_tza_tensor t;
        CHECK_EQ(lull_tza_open(&tza, shifted + 1, f.size), LULL_OK);
        CHECK(lull_tza_find(&tza, "a", ".scale", &t));
        CHECK(lull_tza_float(&t, 1) == (float)0x09080706);
    }
    f.bytes[3] = 9; /* the minor version does not matter, nor do bytes behind the table */
    CHECK_EQ(open_copy(f.bytes, f.size + 10), LULL_OK);
}

static void decodes_every_type(void)
{
    static const uint8_t data[] = {0, 0, 0x80, 0xbf, 0x01, 0xfe, 0xff, 0xff};
    lull_tza_tensor t = {0};
    t.data = data;
    t.dtype = 'f';
    CHECK(lull_tza_float(&t, 0) == -1.0f);
    t.dtype = 'h';
    CHECK(lull_tza_float(&t, 1) == -1.875f);
    t.dtype = 'b';
    CHECK(lull_tza_float(&t, 2) == -128.0f);
    CHECK(lull_tza_float(&t, 4) == 1.0f);
    t.dtype = 'B';
    CHECK(lull_tza_float(&t, 2) == 128.0f);
    t.dtype = 'i';
    CHECK(lull_tza_float(&t, 1) == -511.0f);
}

/* ---- Bad files ------------------------------------------------------------------------------- */

static void rejects_bad_entries(void)
{
    static const struct {
        const char *what;
        entry e;
    } bad[] = {
        {"no name", {"", 1, {2}, "x", 'f', 0}},
        {"rank 0", {"n", 0, {0}, "", 'f', 64}},
        {"rank 2", {"n", 2, {2, 2}, "oi", 'f', 0}},
        {"rank 3", {"n", 3, {2, 2, 2}, "chw", 'f', 0}},
        {"rank 5", {"n", 5, {1, 1, 1, 1, 1}, "oidhw", 'f', 0}},
        {"layout for another rank", {"n", 4, {1, 1, 1, 1}, "x   ", 'f', 0}},
        {"layout hwio", {"n", 4, {1, 1, 1, 1}, "hwio", 'f', 0}},
        {"layout y", {"n", 1, {1}, "y", 'f', 0}},
        {"layout of capitals", {"n", 1, {1}, "X", 'f', 0}},
        {"type d", {"n", 1, {1}, "x", 'd', 0}},
        {"type NUL", {"n", 1, {1}, "x", 0, 0}},
        {"first dimension 0", {"n", 4, {0, 1, 1, 1}, "oihw", 'h', 64}},
        {"last dimension 0", {"n", 4, {1, 1, 1, 0}, "oihw", 'h', 64}},
        {"too many elements", {"n", 1, {4000}, "x", 'f', 64}},
        {"product overflows to 0", {"n", 4, {65536, 65536, 65536, 65536}, "oihw", 'b', 64}},
        {"product overflows to 2", {"n", 4, {0x80000001u, 2, 1, 0x80000001u}, "oihw", 'b', 64}},
        {"bytes overflow", {"n", 4, {0x40000000u, 0x40000000u, 4, 1}, "oihw", 'f', 64}},
        {"largest dimensions", {"n", 4, {~0u, ~0u, ~0u, ~0u}, "oihw", 'i', 64}},
        {"payload behind the file", {"n", 1, {1}, "x", 'f', 100000}},
        {"payload across the end", {"n", 1, {64}, "x", 'f', 64}},
        {"largest offset", {"n", 1, {1}, "x", 'f', UINT64_MAX}},
        {"offset that wraps", {"n", 1, {4}, "x", 'f', UINT64_MAX - 3}},
        {"offset of 2^32", {"n", 1, {1}, "x", 'f', UINT64_C(1) << 32}},
    };
    static file f;
    size_t i;
    for (i = 0; i < sizeof bad / sizeof *bad; ++i) {
        entry entries[2];
        entries[0] = good[1];
        entries[1] = bad[i].e;
        write_file(&f, entries, 2);
        if (!CHECK_EQ(open_copy(f.bytes, f.size), LULL_ERROR_WEIGHTS))
            printf("     %s\n", bad[i].what);
    }
}

static void rejects_duplicate_names(void)
{
    static file f;
    entry entries[3];
    entries[0] = good[0];
    entries[1] = good[1];
    entries[2] = good[2];
    entries[2].name = entries[0].name;
    write_file(&f, entries, 3);
    CHECK_EQ(open_copy(f.bytes, f.size), LULL_ERROR_WEIGHTS);
    entries[2].name = "a.weigh";
    write_file(&f, entries, 3);
    CHECK_EQ(open_copy(f.bytes, f.size), LULL_OK);
}

static void set(file *f, size_t at, uint64_t value, unsigned bytes)
{
    unsigned i;
    for (i = 0; i < bytes; ++i)
        f->bytes[at + i] = (uint8_t)(value >> 8 * i);
}

static void rejects_bad_headers(void)
{
    static const struct {
        size_t at;
        uint64_t value;
        unsigned bytes;
        lull_status status;
    } bad[] = {
        {0, 0xd741, 2, LULL_ERROR_WEIGHTS},          {0, 0, 2, LULL_ERROR_WEIGHTS},
        {2, 1, 1, LULL_ERROR_VERSION},               {2, 3, 1, LULL_ERROR_VERSION},
        {2, 0, 1, LULL_ERROR_VERSION},               {4, 0, 8, LULL_ERROR_WEIGHTS},
        {4, 11, 8, LULL_ERROR_WEIGHTS},              {4, UINT64_MAX, 8, LULL_ERROR_WEIGHTS},
        {4, UINT64_MAX - 3, 8, LULL_ERROR_WEIGHTS},  {4, UINT64_C(1) << 32, 8, LULL_ERROR_WEIGHTS},
        {4, sizeof((file *)0)->bytes, 8, LULL_ERROR_WEIGHTS},
    };
    static file f;
    size_t i;
    for (i = 0; i < sizeof bad / sizeof *bad; ++i) {
        write_file(&f, good, GOOD);
        set(&f, bad[i].at, bad[i].value, bad[i].bytes);
        if (!CHECK_EQ(open_copy(f.bytes, f.size), bad[i].status))
            printf("     variant %u\n", (unsigned)i);
    }
    write_file(&f, good, GOOD);
    for (i = 0; i < 4; ++i) { /* the count needs four bytes */
        set(&f, 4, f.size - i, 8);
        CHECK_EQ(open_copy(f.bytes, f.size), LULL_ERROR_WEIGHTS);
    }
}

static void rejects_bad_counts(void)
{
    static const uint32_t counts[] = {GOOD + 1, 1025, 65536, 0x80000000u, 0xffffffffu};
    static file f;
    size_t i;
    for (i = 0; i < sizeof counts / sizeof *counts; ++i) {
        write_file(&f, good, GOOD);
        set(&f, f.table, counts[i], 4);
        CHECK_EQ(open_copy(f.bytes, f.size), LULL_ERROR_WEIGHTS);
    }
}

/* 1024 tensors are the most: the reader's time grows with the square of their number. */
static void limits_the_number_of_tensors(void)
{
    static file f;
    unsigned n, i;
    for (n = 1024; n <= 1025; ++n) {
        write_file(&f, NULL, 0);
        set(&f, f.table, n, 4);
        for (i = 0; i < n; ++i) {
            append(&f, 2, 2);
            append(&f, 0x4000 + i, 2); /* name */
            append(&f, 1, 1);
            append(&f, 1, 4);
            append_text(&f, "xb", 2);
            append(&f, 64, 8);
        }
        CHECK_EQ(open_copy(f.bytes, f.size), n > 1024 ? LULL_ERROR_WEIGHTS : LULL_OK);
    }
}

static void rejects_nothing_at_all(void)
{
    lull_tza tza;
    uint8_t byte = 0xd7;
    CHECK_EQ(lull_tza_open(&tza, NULL, 100), LULL_ERROR_WEIGHTS);
    CHECK_EQ(lull_tza_open(&tza, NULL, 0), LULL_ERROR_WEIGHTS);
    CHECK_EQ(lull_tza_open(&tza, &byte, 1), LULL_ERROR_WEIGHTS);
}

/* ---- Damage ---------------------------------------------------------------------------------- */

/* The table stands last, so whatever is cut off belongs to it. */
static void rejects_every_truncation(void)
{
    static file f;
    size_t size;
    write_file(&f, good, GOOD);
    CHECK_EQ(open_copy(f.bytes, f.size), LULL_OK);
    for (size = 0; size < f.size; ++size)
        if (!CHECK_EQ(open_copy(f.bytes, size), LULL_ERROR_WEIGHTS))
            return;
}

/* Every value of every byte of header and table: a clear status, and no access outside the file. */
static void survives_every_corruption(void)
{
    static file f;
    size_t at;
    unsigned value, accepted = 0, rejected = 0;
    write_file(&f, good, GOOD);
    for (at = 0; at < f.size; at = at == 11 ? f.table : at + 1)
        for (value = 0; value < 256; ++value) {
            uint8_t old = f.bytes[at];
            lull_status status;
            f.bytes[at] = (uint8_t)value;
            status = open_copy(f.bytes, f.size);
            CHECK(status == LULL_OK || status == LULL_ERROR_WEIGHTS
                  || (status == LULL_ERROR_VERSION && at == 2));
            accepted += status == LULL_OK;
            rejected += status != LULL_OK;
            f.bytes[at] = old;
        }
    printf("     %u damaged files rejected, %u valid still\n", rejected, accepted);
    CHECK(rejected > accepted);
}

static void survives_random_corruption(void)
{
    static file f;
    uint32_t seed = 1;
    int round;
    for (round = 0; round < 20000; ++round) {
        uint32_t changes = 1 + random_bits(&seed) % 6;
        lull_status status;
        write_file(&f, good, GOOD);
        while (changes-- > 0) {
            size_t table_bytes = f.size - f.table, at = random_bits(&seed) % (table_bytes + 12);
            f.bytes[at < 12 ? at : f.table + at - 12] = (uint8_t)random_bits(&seed);
        }
        status = open_copy(f.bytes, f.size - (round & 1 ? random_bits(&seed) % 20 : 0));
        CHECK(status == LULL_OK || status == LULL_ERROR_WEIGHTS || status == LULL_ERROR_VERSION);
    }
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(reads_a_good_file);
    RUN(accepts_an_empty_table_and_any_alignment);
    RUN(decodes_every_type);
    RUN(rejects_bad_entries);
    RUN(rejects_duplicate_names);
    RUN(rejects_bad_headers);
    RUN(rejects_bad_counts);
    RUN(limits_the_number_of_tensors);
    RUN(rejects_nothing_at_all);
    RUN(rejects_every_truncation);
    RUN(survives_every_corruption);
    RUN(survives_random_corruption);
    return check_report();
}
