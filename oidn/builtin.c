/* Built-in weights and which of them suits a frame. */
#include "internal.h"

#include <string.h>

/* Enough memory for lull_model_init to say what is wrong with weights. */
#define FAILED_MODEL ((size_t)64 << 10)

/* The files, as arrays made by the build. */
#define BUILTIN(id, file, content, features, clean_aux, qualities)                                 \
    extern const unsigned char lull_weights_##id[];                                                \
    extern const size_t lull_weights_##id##_bytes;
#include "builtin.def"
#undef BUILTIN

enum { FAST = 1, BALANCED = 2, HIGH = 4 };
enum { NOISY_AUX = 1, CLEAN_AUX = 2 };
enum {
    COLOR = LULL_HAS_COLOR,
    ALBEDO = LULL_HAS_ALBEDO,
    NORMAL = LULL_HAS_NORMAL,
    ANY_FEATURES = 8
};
enum {
    HDR = 1 << LULL_HDR,
    LDR = 1 << LULL_LDR | 1 << LULL_SRGB,
    LIGHTMAP_HDR = 1 << LULL_LIGHTMAP_HDR,
    LIGHTMAP_DIR = 1 << LULL_LIGHTMAP_DIR
};

typedef struct builtin {
    const unsigned char *data;
    const size_t *bytes;
    unsigned contents, features, clean_aux, qualities;
} builtin;

static const builtin builtins[] = {
#define BUILTIN(id, file, contents, features, clean_aux, qualities)                                \
    {lull_weights_##id, &lull_weights_##id##_bytes, contents, features, clean_aux, qualities},
#include "builtin.def"
#undef BUILTIN
    {NULL, NULL, 0, 0, 0, 0},
};
#define BUILTIN_ROWS (sizeof builtins / sizeof *builtins) /* the empty last one included */

/* Compile-time check: the device's cache has a place for each. */
typedef char lull_enough_places[BUILTIN_ROWS - 1 <= LULL_MAX_BUILTIN ? 1 : -1];

static unsigned count_bits(unsigned x)
{
    unsigned n = 0;

    for (; x; x &= x - 1)
        n++;
    return n;
}

static unsigned first_bit(unsigned x)
{
    unsigned n = 0;

    while (x && !(x >> n & 1))
        n++;
    return n;
}

/* Inputs that the model would take from a frame with `features`; 0 if it cannot be used. */
static unsigned usable_features(const builtin *b, unsigned features)
{
    if (b->features == ANY_FEATURES)
        return features;
    if (b->features == COLOR && !(features & COLOR))
        return features; /* the only image there is, in place of the colour */
    return (b->features & ~features) || ((features & COLOR) && !(b->features & COLOR))
               ? 0
               : b->features;
}

/* How well a model suits, by what matters most: images used, then content, then the state of the
 * auxiliary images, then quality, then whether it is for just these images. 0: not at all. */
static unsigned rate(const builtin *b, const lull_frame *frame, unsigned quality)
{
    const unsigned used = usable_features(b, frame->features);
    unsigned score = 0;

    if (!used)
        return 0;
    score += 1000 * count_bits(used);
    if (b->contents >> frame->content & 1)
        score += 200;
    else if (b->contents & HDR)
        score += 100; /* the next best for everything */
    if (b->clean_aux & (frame->clean_aux ? CLEAN_AUX : NOISY_AUX))
        score += 20;
    if (b->qualities & quality)
        score += 10;
    else if (quality != BALANCED && (b->qualities & BALANCED))
        score += 5;
    if (b->features == used)
        score += 1; /* trained for just these images */
    return score;
}

bool lull_builtin_select(OIDNDevice device, lull_frame *frame, OIDNQuality quality,
                         const lull_model **model, size_t *bytes, lull_fault *fault)
{
    const unsigned bit = quality == OIDN_QUALITY_FAST       ? FAST
                         : quality == OIDN_QUALITY_BALANCED ? BALANCED
                                                            : HIGH;
    unsigned best = 0, best_score = 0, i;
    lull_weights *weights;

    for (i = 0; i + 1 < BUILTIN_ROWS; i++) {
        const unsigned score = rate(&builtins[i], frame, bit);

        if (score > best_score) {
            best_score = score;
            best = i;
        }
    }
    if (!best_score)
        return lull_fail(fault, OIDN_ERROR_INVALID_OPERATION,
                         "unsupported combination of inputs: no built-in weights for it");
    weights = &device->builtin[best];
    if (!weights->model && !lull_weights_load(weights, builtins[best].data, *builtins[best].bytes,
                                              device->ports, fault))
        return false;
    frame->features = usable_features(&builtins[best], frame->features);
    if (!(builtins[best].contents >> frame->content & 1))
        frame->trained_for = 1 + first_bit(builtins[best].contents);
    *model = weights->model;
    *bytes = weights->bytes;
    return true;
}

/* ---- Unpacking ------------------------------------------------------------------------------- */

bool lull_weights_load(lull_weights *weights, const void *data, size_t bytes, uint32_t ports,
                       lull_fault *fault)
{
    const size_t size = lull_model_size(data, bytes, ports);
    const size_t need = size ? size : FAILED_MODEL;
    lull_status status;

    memset(weights, 0, sizeof *weights);
    weights->memory = lull_os_alloc(need);
    if (!weights->memory)
        return lull_fail(fault, OIDN_ERROR_OUT_OF_MEMORY, "out of memory: weights of %llu bytes",
                         (unsigned long long)need);
    status = lull_model_init(&weights->model, weights->memory, need, data, bytes, ports);
    if (status != LULL_OK) {
        lull_os_free(weights->memory);
        memset(weights, 0, sizeof *weights);
        return lull_fail_status(fault, status, "weights");
    }
    weights->bytes = need;
    return true;
}

void lull_weights_free(lull_weights *weights)
{
    lull_os_free(weights->memory);
    memset(weights, 0, sizeof *weights);
}
