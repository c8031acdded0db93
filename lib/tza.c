/* Outline: one parser reads a table entry; open() runs it over the whole table and compares
 * names, find() runs it again. Offsets and sizes are 64-bit and checked by subtraction, so
 * nothing overflows. */
#include "tza.h"

#include "image.h"

#define MAX_NAME 4096u /* longer than any name we look for */
#define MAGIC 0x41d7u
#define VERSION_MAJOR 2
#define HEADER_BYTES 12u /* magic, version, offset of the table */
#define MAX_TENSORS 1024u /* 16 times the largest known network; bounds the time of open() */

static float load_f32(const uint8_t *p) { return lull_float(lull_load_u32(p)); }
static float load_f16(const uint8_t *p) { return lull_half_to_float(lull_load_u16(p)); }
static float load_i8(const uint8_t *p) { return (float)(int8_t)*p; }
static float load_u8(const uint8_t *p) { return (float)*p; }
static float load_i32(const uint8_t *p) { return (float)(int32_t)lull_load_u32(p); }

typedef struct element_type {
    char dtype;
    uint8_t bytes;
    float (*load)(const uint8_t *p);
} element_type;

static const element_type types[] = {
    {'f', 4, load_f32}, {'h', 2, load_f16}, {'b', 1, load_i8},
    {'B', 1, load_u8},  {'i', 4, load_i32}};

static const struct {
    unsigned rank;
    char text[5];
} layouts[] = {{1, "x"}, {4, "oihw"}};

/* The type with this letter, or NULL. */
static const element_type *find_type(char dtype)
{
    size_t i;
    for (i = 0; i < sizeof types / sizeof *types; ++i)
        if (types[i].dtype == dtype)
            return types + i;
    return NULL;
}

static int is_layout(const uint8_t *text, unsigned rank)
{
    size_t i;
    for (i = 0; i < sizeof layouts / sizeof *layouts; ++i)
        if (layouts[i].rank == rank && memcmp(layouts[i].text, text, rank) == 0)
            return 1;
    return 0;
}

/* Reads the shape at `p`: dims, layout and type of a known rank. 0 if it is not valid. */
static int read_shape(lull_tza_tensor *tensor, const uint8_t *p, size_t file_bytes)
{
    const uint8_t *text = p + 4u * tensor->rank;
    const element_type *type;
    uint64_t bytes;
    unsigned i;
    if (!is_layout(text, tensor->rank))
        return 0;
    memcpy(tensor->layout, text, tensor->rank);
    tensor->dtype = (char)text[tensor->rank];
    type = find_type(tensor->dtype);
    if (type == NULL)
        return 0;
    bytes = type->bytes;
    for (i = 0; i < tensor->rank; ++i) {
        tensor->dims[i] = lull_load_u32(p + 4u * i);
        if (tensor->dims[i] == 0 || tensor->dims[i] > file_bytes / bytes)
            return 0;
        bytes *= tensor->dims[i];
    }
    tensor->bytes = (size_t)bytes;
    return 1;
}

/* Reads the entry at *position and moves *position behind it. 0 if it is not valid. */
static int read_entry(lull_tza_tensor *tensor, size_t *position, const uint8_t *file, size_t size)
{
    size_t at = *position, shape_bytes;
    uint64_t offset;
    memset(tensor, 0, sizeof *tensor);
    if (size - at < 2)
        return 0;
    tensor->name_length = lull_load_u16(file + at);
    at += 2;
    if (tensor->name_length == 0 || size - at < tensor->name_length + 1)
        return 0;
    tensor->name = (const char *)(file + at);
    at += tensor->name_length;
    tensor->rank = file[at++];
    if (tensor->rank < 1 || tensor->rank > 4)
        return 0;
    shape_bytes = 5u * tensor->rank + 1u;
    if (size - at < shape_bytes + 8u || !read_shape(tensor, file + at, size))
        return 0;
    offset = lull_load_u64(file + at + shape_bytes);
    if (offset > size || tensor->bytes > size - (size_t)offset)
        return 0;
    tensor->data = file + (size_t)offset;
    *position = at + shape_bytes + 8u;
    return 1;
}

static int is_name(const lull_tza_tensor *tensor, const char *head, size_t head_length,
                   const char *tail, size_t tail_length)
{
    return tensor->name_length == head_length + tail_length
           && memcmp(tensor->name, head, head_length) == 0
           && memcmp(tensor->name + head_length, tail, tail_length) == 0;
}

/* 1 if one of the first `count` entries (already found valid) has this tensor's name. */
static int is_duplicate(const lull_tza *tza, const lull_tza_tensor *tensor, unsigned count)
{
    lull_tza_tensor other;
    size_t position = tza->table;
    unsigned i;
    for (i = 0; i < count; ++i)
        if (read_entry(&other, &position, tza->bytes, tza->size)
            && is_name(&other, tensor->name, tensor->name_length, "", 0))
            return 1;
    return 0;
}

lull_status lull_tza_open(lull_tza *tza, const void *bytes, size_t size)
{
    lull_tza_tensor tensor;
    const uint8_t *file = bytes;
    uint64_t table;
    uint32_t count;
    size_t position;
    memset(tza, 0, sizeof *tza);
    if (bytes == NULL || size < HEADER_BYTES || lull_load_u16(file) != MAGIC)
        return LULL_ERROR_WEIGHTS;
    if (file[2] != VERSION_MAJOR)
        return LULL_ERROR_VERSION;
    table = lull_load_u64(file + 4);
    if (table < HEADER_BYTES || table > size || size - (size_t)table < 4)
        return LULL_ERROR_WEIGHTS;
    count = lull_load_u32(file + (size_t)table);
    if (count > MAX_TENSORS)
        return LULL_ERROR_WEIGHTS;
    tza->bytes = file;
    tza->size = size;
    tza->table = (size_t)table + 4;
    position = tza->table;
    for (; tza->count < count; ++tza->count)
        if (!read_entry(&tensor, &position, file, size) || is_duplicate(tza, &tensor, tza->count))
            return LULL_ERROR_WEIGHTS;
    return LULL_OK;
}

static size_t text_length(const char *text)
{
    size_t n = 0;
    while (n < MAX_NAME && text[n]) /* without the bound, compilers make a call of strlen of it */
        ++n;
    return n;
}

int lull_tza_find(const lull_tza *tza, const char *prefix, const char *suffix,
                  lull_tza_tensor *tensor)
{
    size_t prefix_length = text_length(prefix), suffix_length = text_length(suffix);
    size_t position = tza->table;
    unsigned i;
    for (i = 0; i < tza->count && read_entry(tensor, &position, tza->bytes, tza->size); ++i)
        if (is_name(tensor, prefix, prefix_length, suffix, suffix_length))
            return 1;
    memset(tensor, 0, sizeof *tensor);
    return 0;
}

float lull_tza_float(const lull_tza_tensor *tensor, size_t index)
{
    const element_type *type = find_type(tensor->dtype);
    return type->load(tensor->data + index * type->bytes);
}

int32_t lull_tza_int(const lull_tza_tensor *tensor, size_t index)
{
    uint32_t bits = lull_load_u32(tensor->data + 4 * index);
    int32_t value;
    memcpy(&value, &bits, sizeof value);
    return value;
}
