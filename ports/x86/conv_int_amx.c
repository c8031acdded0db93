/* Integer convolution with AMX. A tile of sums is 12 pixels by 16 outputs: up to 16 dwords of the
 * runs of 12 pixels (one row each, a step apart) by as many rows of a weight block, which has just
 * that layout. The bytes of wide elements are multiplied apart and have tiles of sums of their own.
 * Vectors cannot read tiles: sums pass through a buffer (12 pixels, not 16, keep it small), while
 * the next tiles are multiplied. */
#include "port_amx.h"

#if LULL_HAS_TILES
#include "finish_512.h"

#define ROWS 12u   /* pixels of a tile */
#define DWORDS 16u /* of runs, at most */
#define SHORT 8u   /* dwords of sums that are left to vectors */

/* Tiles: sums 0 to 3; of runs 4 with weights 5, and, for segments cut into pieces of another
 * length, 6 with 7. */
typedef struct tile_config {
    uint8_t palette, start, reserved[14];
    uint16_t bytes[16]; /* of a row */
    uint8_t rows[16];
} tile_config;

typedef struct amx_part {
    const uint8_t *x, *w;    /* the run of pixel 0, the weights of the first 16 outputs */
    size_t step, block;      /* bytes from pixel to pixel, and from 16 outputs to the next */
    size_t low;              /* from wide weights for high bytes to those for low bytes */
    unsigned pieces, dwords; /* the run is cut into so many pieces of so many dwords */
    unsigned is_other;       /* piece length is the second one */
} amx_part;

typedef struct amx_conv {
    amx_part part[LULL_MAX_SEGMENTS];
    const amx_part *narrow, *end;
    unsigned rows; /* pixels of a tile */
} amx_conv;

/* Dwords of a run that are multiplied at once: as many as fit and divide it. */
static unsigned piece_of(unsigned length)
{
    unsigned pieces = (length + DWORDS - 1) / DWORDS;
    while (length % pieces)
        pieces++;
    return length / pieces;
}

/* Not inlined: its registers would be saved in the frame that holds *a. */
static LULL_NOINLINE void describe(amx_conv *a, const lull_conv *conv)
{
    tile_config config;
    unsigned first = piece_of(conv->segment[0].length), other = first;
    for (unsigned s = 1; s < conv->segments; s++) {
        unsigned piece = piece_of(conv->segment[s].length);
        if (conv->segment[s].length % first == 0 || piece == other)
            continue;
        other = other == first ? piece : 1; /* three different ones: single dwords fit all */
    }
    a->rows = lull_min_u(conv->pixels, ROWS);
    for (unsigned s = 0; s < conv->segments; s++) {
        const lull_segment *segment = &conv->segment[s];
        amx_part *part = &a->part[s];
        part->x = (const uint8_t *)segment->row;
        part->w = (const uint8_t *)segment->weights;
        part->step = segment->step * (size_t)(s < conv->wide ? 2 : 1);
        part->block = (size_t)64 * segment->length;
        part->low = part->block * ((conv->outputs + LANES - 1) / LANES);
        part->is_other = segment->length % first != 0;
        part->dwords = part->is_other ? other : first;
        part->pieces = segment->length / part->dwords;
    }
    a->narrow = a->part + conv->wide;
    a->end = a->part + conv->segments;
    memset(&config, 0, sizeof config);
    config.palette = 1;
    for (unsigned t = 0; t < 8; t++) {
        unsigned dwords = t < 6 ? first : other;
        int is_weights = t == 5 || t == 7;
        config.bytes[t] = (uint16_t)(t < 4 || is_weights ? 64 : 4 * dwords);
        config.rows[t] = (uint8_t)(is_weights ? dwords : a->rows);
    }
#if LULL_X86_ASM /* gcc's intrinsic names the first 8 bytes only, so others might not be there */
    __asm__ volatile("" : : "r"(&config) : "memory");
#endif
    _tile_loadconfig(&config);
}

/* One piece after the other of a part: narrow ones of two tiles of pixels, from x and from y on, or
 * of four; wide ones, the high bytes into tile 0 and the low bytes into tile 1, or of two tiles,
 * also into 2 and 3. */
#define NARROW(X, W, SUM0, SUM1)                                                                   \
    for (unsigned k = part->pieces; k; k--, x += bytes, y += bytes, w += 16 * bytes) {             \
        _tile_loadd(W, w, 64);                                                                     \
        _tile_loadd(X, x, part->step);                                                             \
        _tile_dpbusd(SUM0, X, W);                                                                  \
        _tile_loadd(X, y, part->step);                                                             \
        _tile_dpbusd(SUM1, X, W);                                                                  \
    }
#define NARROW_FOUR(X, W)                                                                          \
    for (unsigned k = part->pieces; k; k--, w += 16 * bytes) {                                     \
        _tile_loadd(W, w, 64);                                                                     \
        _tile_loadd(X, x, part->step);                                                             \
        _tile_dpbusd(0, X, W);                                                                     \
        _tile_loadd(X, y, part->step);                                                             \
        _tile_dpbusd(1, X, W);                                                                     \
        _tile_loadd(X, z, part->step);                                                             \
        _tile_dpbusd(2, X, W);                                                                     \
        _tile_loadd(X, t, part->step);                                                             \
        _tile_dpbusd(3, X, W);                                                                     \
        x += bytes, y += bytes, z += bytes, t += bytes;                                            \
    }
#define WIDE(X, W)                                                                                 \
    for (unsigned k = part->pieces; k; k--, x += bytes, w += 16 * bytes) {                         \
        _tile_loadd(W, w, 64);                                                                     \
        _tile_loadd(X, x, part->step);                                                             \
        _tile_dpbusd(0, X, W);                                                                     \
        _tile_loadd(W, w + low, 64);                                                               \
        _tile_dpbusd(1, X, W);                                                                     \
    }
#define WIDE_TWO(X, W)                                                                             \
    for (unsigned k = part->pieces; k; k--, x += bytes, y += bytes, w += 16 * bytes) {             \
        _tile_loadd(W, w, 64);                                                                     \
        _tile_loadd(X, x, part->step);                                                             \
        _tile_dpbusd(0, X, W);                                                                     \
        _tile_loadd(X, y, part->step);                                                             \
        _tile_dpbusd(2, X, W);                                                                     \
        _tile_loadd(W, w + low, 64);                                                               \
        _tile_dpbusd(3, X, W);                                                                     \
        _tile_loadd(X, x, part->step);                                                             \
        _tile_dpbusd(1, X, W);                                                                     \
    }

/* The sums of a group of outputs at the pixels from p and from q on, in tiles 2 and 3. */
static LULL_NOINLINE void multiply_two(const amx_conv *a, const int32_t *bias, unsigned group,
                                       unsigned p, unsigned q)
{
    _tile_loadd(2, bias, 0);
    _tile_loadd(3, bias, 0);
    for (const amx_part *part = a->narrow; part < a->end; part++) {
        const uint8_t *x = part->x + p * part->step, *y = part->x + q * part->step;
        const uint8_t *w = part->w + group * part->block;
        size_t bytes = 4 * (size_t)part->dwords;
        if (part->is_other)
            NARROW(6, 7, 2, 3)
        else
            NARROW(4, 5, 2, 3)
    }
}

/* The same at the pixels at[0] to at[3], in tiles 0 to 3. */
static LULL_NOINLINE void multiply_four(const amx_conv *a, const int32_t *bias, unsigned group,
                                        const unsigned *at)
{
    _tile_loadd(0, bias, 0);
    _tile_loadd(1, bias, 0);
    _tile_loadd(2, bias, 0);
    _tile_loadd(3, bias, 0);
    for (const amx_part *part = a->narrow; part < a->end; part++) {
        const uint8_t *x = part->x + at[0] * part->step, *y = part->x + at[1] * part->step;
        const uint8_t *z = part->x + at[2] * part->step, *t = part->x + at[3] * part->step;
        const uint8_t *w = part->w + group * part->block;
        size_t bytes = 4 * (size_t)part->dwords;
        if (part->is_other)
            NARROW_FOUR(6, 7)
        else
            NARROW_FOUR(4, 5)
    }
}

/* The sums of the wide parts of a group, of high bytes and of low ones. */
static void multiply_wide(const amx_conv *a, unsigned group, unsigned p)
{
    _tile_zero(0);
    _tile_zero(1);
    for (const amx_part *part = a->part; part < a->narrow; part++) {
        const uint8_t *x = part->x + p * part->step, *w = part->w + group * part->block;
        size_t bytes = 4 * (size_t)part->dwords, low = part->low;
        if (part->is_other)
            WIDE(6, 7)
        else
            WIDE(4, 5)
    }
}

static void multiply_wide_two(const amx_conv *a, unsigned group, unsigned p, unsigned q)
{
    _tile_zero(0);
    _tile_zero(1);
    _tile_zero(2);
    _tile_zero(3);
    for (const amx_part *part = a->part; part < a->narrow; part++) {
        const uint8_t *x = part->x + p * part->step, *y = part->x + q * part->step;
        const uint8_t *w = part->w + group * part->block;
        size_t bytes = 4 * (size_t)part->dwords, low = part->low;
        if (part->is_other)
            WIDE_TWO(6, 7)
        else
            WIDE_TWO(4, 5)
    }
}

/* Stores one of the tiles of sums. */
LULL_INLINE void store_tile(int32_t *sums, unsigned tile)
{
    if (tile == 0)
        _tile_stored(0, sums, 64);
    else if (tile == 1)
        _tile_stored(1, sums, 64);
    else if (tile == 2)
        _tile_stored(2, sums, 64);
    else
        _tile_stored(3, sums, 64);
}

/* Sums of a tile in buffers: of narrow parts with the bias, or of wide parts, low and high bytes.
 */
typedef struct amx_sums {
    const int32_t *narrow, *low, *high; /* narrow or the others may be NULL */
    vec half, bias;
    unsigned shift;
} amx_sums;

LULL_INLINE vec sum_of(const amx_sums *sums, unsigned i)
{
    vec a;
    if (!sums->low)
        return load(sums->narrow + LANES * i);
    a = add(_mm512_slli_epi32(load(sums->high + LANES * i), 8), load(sums->low + LANES * i));
    a = shift(add(a, sums->half), sums->shift);
    return add(a, sums->narrow ? load(sums->narrow + LANES * i) : sums->bias);
}

LULL_INLINE void finish_as(finish *f, const tile_row *row, const amx_sums *sums, unsigned p,
                           unsigned rows, int how)
{
    unsigned i = 0;
    finish_tile(f, row, p);
    for (; i + 4 <= rows; i += 4)
        finish_four(f, how, i, sum_of(sums, i), sum_of(sums, i + 1), sum_of(sums, i + 2),
                    sum_of(sums, i + 3));
    for (; i < rows; i++)
        finish_1(f, how, i, i, sum_of(sums, i), zero());
}

/* Requantises and stores sums. */
LULL_INLINE void finish_rows(finish *f, const tile_row *row, const amx_sums *sums, unsigned p,
                             unsigned rows)
{
    if (f->size == 1 && row->conv->is_small)
        finish_as(f, row, sums, p, rows, BYTES | SMALL);
    else if (f->size == 1)
        finish_as(f, row, sums, p, rows, BYTES);
    else if (row->conv->is_small)
        finish_as(f, row, sums, p, rows, SMALL);
    else
        finish_as(f, row, sums, p, rows, 0);
}

/* The rest of finish_wide: each buffer is in a function of its own. */
static LULL_NOINLINE void finish_high(finish *f, const tile_row *row, const int32_t *narrow,
                                      const int32_t *low, unsigned tile, unsigned p, unsigned rows)
{
    int32_t buffer[LANES * ROWS];
    amx_sums sums = {narrow, low, buffer, zero(), zero(), row->conv->wide_shift};
    sums.half = splat_int(1 << sums.shift >> 1);
    sums.bias = load((const int32_t *)row->conv->bias + row->first);
    store_tile(buffer, tile);
    finish_rows(f, row, &sums, p, rows);
}

/* tile: that of sums of high bytes, before that of low bytes. narrow: NULL, or the other sums. */
static LULL_NOINLINE void finish_wide(finish *f, const tile_row *row, const int32_t *narrow,
                                      unsigned tile, unsigned p, unsigned rows)
{
    int32_t low[LANES * ROWS];
    store_tile(low, tile + 1);
    finish_high(f, row, narrow, low, tile, p, rows);
}

static void finish_mixed(finish *f, const tile_row *row, unsigned tile, unsigned p, unsigned rows)
{
    int32_t narrow[LANES * ROWS];
    store_tile(narrow, tile);
    finish_wide(f, row, narrow, 0, p, rows);
}

/* A group of outputs: what run_narrow needs, with buffers for the sums of FOUR tiles. */
#define FOUR 4u
typedef struct amx_run {
    const amx_conv *conv;
    const tile_row *row;
    finish *f;
    int32_t *sums[FOUR];
    unsigned buffers;
} amx_run;

/* The pixels of a group of outputs, where all parts are narrow: up to four tiles at a time. Their
 * sums are finished while the next ones are multiplied. */
static void run_narrow_in(const amx_run *run)
{
    const amx_conv *a = run->conv;
    const lull_conv *conv = run->row->conv;
    const int32_t *bias = (const int32_t *)conv->bias + run->row->first;
    unsigned group = run->row->first / LANES, last = conv->pixels - a->rows;
    unsigned at[FOUR], before[FOUR], first = FOUR; /* tiles in use: from `first` on */
    for (unsigned p = 0;; p += FOUR * a->rows) {
        unsigned was = first;
        for (unsigned i = 0; i < FOUR; i++)
            before[i] = at[i];
        first = p >= conv->pixels ? FOUR : conv->pixels - p > 2 * a->rows ? 0 : 2;
        for (unsigned i = first; i < FOUR; i++)
            at[i] = lull_min_u(p + (i - first) * a->rows, last);
        if (first == 0)
            multiply_four(a, bias, group, at);
        else if (first == 2)
            multiply_two(a, bias, group, at[2], at[3]);
        for (unsigned i = was; i < FOUR; i++) {
            amx_sums sums = {run->sums[i], NULL, NULL, zero(), zero(), 0};
            finish_rows(run->f, run->row, &sums, before[i], a->rows);
        }
        if (first == FOUR)
            return;
        for (unsigned i = first; i < FOUR; i++)
            store_tile(run->sums[i], i);
    }
}

/* Adds a buffer, then the others: each is in a frame of its own. */
static LULL_NOINLINE void run_with_buffers(amx_run *run)
{
    int32_t buffer[LANES * ROWS];
    run->sums[run->buffers++] = buffer;
    if (run->buffers < FOUR)
        run_with_buffers(run);
    else
        run_narrow_in(run);
}

static void run_narrow(const amx_conv *a, const tile_row *row, finish *f)
{
    amx_run run;
    run.conv = a;
    run.row = row;
    run.f = f;
    run.buffers = 0;
    run_with_buffers(&run);
}

/* The same where all are wide. */
static void run_wide(const amx_conv *a, const tile_row *row, finish *f)
{
    unsigned group = row->first / LANES, last = row->conv->pixels - a->rows;
    for (unsigned at = 0; at < row->conv->pixels; at += 2 * a->rows) {
        unsigned p = lull_min_u(at, last), q = lull_min_u(at + a->rows, last);
        multiply_wide_two(a, group, p, q);
        finish_wide(f, row, NULL, 0, p, a->rows);
        finish_wide(f, row, NULL, 2, q, a->rows);
    }
}

/* The same where both are. */
static void run_mixed(const amx_conv *a, const tile_row *row, finish *f)
{
    const int32_t *bias = (const int32_t *)row->conv->bias + row->first;
    unsigned group = row->first / LANES, last = row->conv->pixels - a->rows;
    for (unsigned at = 0; at < row->conv->pixels; at += 2 * a->rows) {
        unsigned p = lull_min_u(at, last), q = lull_min_u(at + a->rows, last);
        multiply_two(a, bias, group, p, q);
        multiply_wide(a, group, p);
        finish_mixed(f, row, 2, p, a->rows);
        multiply_wide(a, group, q);
        finish_mixed(f, row, 3, q, a->rows);
    }
}

static LULL_NOINLINE void run_group(const amx_conv *a, const tile_row *row)
{
    const lull_conv *conv = row->conv;
    finish f;
    finish_init(&f, row, 1, conv->is_small);
    (!conv->wide ? run_narrow : conv->wide == conv->segments ? run_wide : run_mixed)(a, row, &f);
}

/* 1 if the sums have so few products that vectors are faster: tiles take their time to be loaded
 * and stored. */
static int is_short(const lull_conv *conv)
{
    unsigned dwords = 0;
    for (unsigned s = 0; s < conv->segments; s++)
        dwords += conv->segment[s].length;
    return !conv->wide && dwords < SHORT;
}

void lull_conv_int_amx(const lull_conv *conv)
{
    amx_conv a;
    tile_row row;
    if (is_short(conv)) {
        lull_conv_int_vnni(conv);
        return;
    }
    row.conv = conv;
    describe(&a, conv);
    for (row.first = 0; row.first < conv->outputs; row.first += LANES) {
        row.n = lull_min_u(conv->outputs - row.first, LANES);
        run_group(&a, &row);
    }
    _tile_release();
}
#endif
