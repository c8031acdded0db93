#include "identity.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

typedef struct layer {
    const char *name;
    unsigned in, out; /* in units: I inputs, W width, 3 */
    int pass;         /* channels 0..2 come from: -1 nowhere, else the first channel of the skip */
} layer;

enum { I = 1000, W = 1001, WI = 1002, WW = 1003 };

static const layer unet[] = {
    {"enc_conv0", I, W, -1},   {"enc_conv1", W, W, -1},   {"enc_conv2", W, W, -1},
    {"enc_conv3", W, W, -1},   {"enc_conv4", W, W, -1},   {"enc_conv5a", W, W, -1},
    {"enc_conv5b", W, W, -1},  {"dec_conv4a", WW, W, -1}, {"dec_conv4b", W, W, -1},
    {"dec_conv3a", WW, W, -1}, {"dec_conv3b", W, W, -1},  {"dec_conv2a", WW, W, -1},
    {"dec_conv2b", W, W, -1},  {"dec_conv1a", WI, W, W},  {"dec_conv1b", W, W, 0},
    {"dec_conv0", W, 3, 0},    {NULL, 0, 0, 0},
};

static const layer unet_large[] = {
    {"enc_conv1a", I, W, -1},  {"enc_conv1b", W, W, -1},  {"enc_conv2a", W, W, -1},
    {"enc_conv2b", W, W, -1},  {"enc_conv3a", W, W, -1},  {"enc_conv3b", W, W, -1},
    {"enc_conv4a", W, W, -1},  {"enc_conv4b", W, W, -1},  {"enc_conv5a", W, W, -1},
    {"enc_conv5b", W, W, -1},  {"dec_conv4a", WW, W, -1}, {"dec_conv4b", W, W, -1},
    {"dec_conv3a", WW, W, -1}, {"dec_conv3b", W, W, -1},  {"dec_conv2a", WW, W, -1},
    {"dec_conv2b", W, W, -1},  {"dec_conv1a", WI, W, W},  {"dec_conv1b", W, W, 0},
    {"dec_conv1c", W, 3, 0},   {NULL, 0, 0, 0},
};

static unsigned channels(unsigned code, unsigned inputs, unsigned width)
{
    switch (code) {
    case I:
        return inputs;
    case W:
        return width;
    case WI:
        return width + inputs;
    case WW:
        return 2 * width;
    default:
        return code;
    }
}

/* A growing file. */
typedef struct file {
    unsigned char *bytes;
    size_t size, room;
    int failed;
} file;

static void put(file *f, const void *data, size_t n)
{
    if (f->size + n > f->room && !f->failed) {
        size_t room = 2 * (f->size + n);
        unsigned char *bytes = realloc(f->bytes, room);

        if (!bytes)
            f->failed = 1;
        else {
            f->bytes = bytes;
            f->room = room;
        }
    }
    if (f->failed)
        return;
    memcpy(f->bytes + f->size, data, n);
    f->size += n;
}

static void put_number(file *f, uint64_t value, unsigned bytes)
{
    unsigned char b[8];
    unsigned i;

    for (i = 0; i < bytes; i++)
        b[i] = (unsigned char)(value >> 8 * i);
    put(f, b, bytes);
}

static void align(file *f)
{
    while (f->size % 64 && !f->failed)
        put(f, "", 1);
}

/* Table entry of a tensor whose payload is at `offset`. */
static void put_entry(file *table, const char *prefix, const char *suffix, const unsigned *dims,
                      unsigned rank, uint64_t offset)
{
    unsigned i;

    put_number(table, strlen(prefix) + strlen(suffix), 2);
    put(table, prefix, strlen(prefix));
    put(table, suffix, strlen(suffix));
    put_number(table, rank, 1);
    for (i = 0; i < rank; i++)
        put_number(table, dims[i], 4);
    put(table, rank == 4 ? "oihw" : "x", rank == 4 ? 4 : 1);
    put(table, "h", 1);
    put_number(table, offset, 8);
}

static void put_layer(file *f, file *table, const layer *l, unsigned inputs, unsigned width)
{
    const unsigned dims[4] = {channels(l->out, inputs, width), channels(l->in, inputs, width), 3,
                              3};
    const unsigned first = l->pass < 0 ? 0 : channels((unsigned)l->pass, inputs, width);
    unsigned o, i, k;

    align(f);
    put_entry(table, l->name, ".weight", dims, 4, f->size);
    for (o = 0; o < dims[0]; o++)
        for (i = 0; i < dims[1]; i++)
            for (k = 0; k < 9; k++) /* 0x3c00 is 1.0 */
                put_number(f, l->pass >= 0 && o < 3 && i == first + o && k == 4 ? 0x3c00 : 0, 2);
    align(f);
    put_entry(table, l->name, ".bias", dims, 1, f->size);
    for (o = 0; o < dims[0]; o++)
        put_number(f, 0, 2);
}

void *identity_weights(unsigned inputs, unsigned width, int large, size_t *bytes)
{
    const layer *l, *layers = large ? unet_large : unet;
    file f = {0}, table = {0};
    uint64_t at;
    unsigned i;

    put_number(&f, 0x41d7, 2);
    put_number(&f, 2, 1);
    put_number(&f, 0, 1);
    put_number(&f, 0, 8);
    for (l = layers; l->name; l++)
        put_layer(&f, &table, l, inputs, width);
    align(&f);
    at = f.size;
    put_number(&f, 2 * (uint64_t)(l - layers), 4);
    put(&f, table.bytes, table.size);
    free(table.bytes);
    if (f.failed || table.failed) {
        free(f.bytes);
        return NULL;
    }
    for (i = 0; i < 8; i++)
        f.bytes[4 + i] = (unsigned char)(at >> 8 * i);
    *bytes = f.size;
    return f.bytes;
}
