/* AMX: eight tiles of up to 16 rows of 64 bytes. What a CPU would not do ends the program. */
#ifndef LULL_TESTS_EMULATE_TILES_H
#define LULL_TESTS_EMULATE_TILES_H

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define TILES 8u

typedef struct emulate_tile {
    unsigned rows, bytes; /* of a row */
    uint8_t row[16][64];
} emulate_tile;

/* The tiles; all have no rows where none are configured. */
static inline emulate_tile *emulate_tile_at(unsigned index)
{
    static emulate_tile tiles[TILES];
    return &tiles[index];
}

static inline void emulate_tile_must(int holds, const char *what)
{
    if (holds)
        return;
    fprintf(stderr, "AMX: %s\n", what);
    abort();
}

static inline void emulate_tile_loadconfig(const void *config)
{
    const uint8_t *p = (const uint8_t *)config;
    emulate_tile_must(p[0] == 1, "unknown palette");
    for (unsigned t = 0; t < TILES; t++) {
        emulate_tile *tile = emulate_tile_at(t);
        memset(tile, 0, sizeof *tile);
        tile->bytes = p[16 + 2 * t] | (unsigned)p[17 + 2 * t] << 8;
        tile->rows = p[48 + t];
        emulate_tile_must(tile->bytes <= 64 && tile->rows <= 16, "tiles have 16 rows of 64 bytes");
    }
}

static inline void emulate_tile_release(void)
{
    for (unsigned t = 0; t < TILES; t++)
        memset(emulate_tile_at(t), 0, sizeof(emulate_tile));
}

static inline emulate_tile *emulate_tile_get(unsigned index)
{
    emulate_tile *tile = emulate_tile_at(index);
    emulate_tile_must(index < TILES && tile->rows && tile->bytes, "a tile that is not configured");
    return tile;
}

static inline void emulate_tile_zero(unsigned index)
{
    emulate_tile *tile = emulate_tile_get(index);
    memset(tile->row, 0, sizeof tile->row);
}

static inline void emulate_tile_loadd(unsigned index, const void *from, size_t step)
{
    emulate_tile *tile = emulate_tile_get(index);
    memset(tile->row, 0, sizeof tile->row);
    for (unsigned i = 0; i < tile->rows; i++)
        memcpy(tile->row[i], (const uint8_t *)from + i * step, tile->bytes);
}

static inline void emulate_tile_stored(unsigned index, void *to, size_t step)
{
    emulate_tile *tile = emulate_tile_get(index);
    for (unsigned i = 0; i < tile->rows; i++)
        memcpy((uint8_t *)to + i * step, tile->row[i], tile->bytes);
}

/* sums += unsigned bytes of a by signed bytes of b, four at a time. */
static inline void emulate_tile_dpbusd(unsigned sums, unsigned left, unsigned right)
{
    emulate_tile *c = emulate_tile_get(sums), *a = emulate_tile_get(left);
    emulate_tile *b = emulate_tile_get(right);
    emulate_tile_must(sums != left && sums != right && left != right, "the same tile twice");
    emulate_tile_must(c->rows == a->rows && c->bytes == b->bytes && a->bytes == 4 * b->rows,
                      "tiles of other sizes");
    for (unsigned m = 0; m < c->rows; m++)
        for (unsigned n = 0; n < c->bytes / 4; n++) {
            uint32_t sum;
            memcpy(&sum, c->row[m] + 4 * n, sizeof sum);
            for (unsigned k = 0; k < a->bytes; k++)
                sum += (uint32_t)(a->row[m][k] * (int8_t)b->row[k / 4][4 * n + k % 4]);
            memcpy(c->row[m] + 4 * n, &sum, sizeof sum);
        }
}

#define _tile_loadconfig(config) emulate_tile_loadconfig(config)
#define _tile_release() emulate_tile_release()
#define _tile_zero(tile) emulate_tile_zero(tile)
#define _tile_loadd(tile, from, step) emulate_tile_loadd(tile, from, (size_t)(step))
#define _tile_stored(tile, to, step) emulate_tile_stored(tile, to, (size_t)(step))
#define _tile_dpbusd(sums, left, right) emulate_tile_dpbusd(sums, left, right)

#endif
