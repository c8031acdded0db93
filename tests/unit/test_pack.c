/* What the loader finds out about an integer model's layers: whether sums fit words (kernels.h). */
#define _POSIX_C_SOURCE 200809L
#include "pack.h"

#include <stdlib.h>

#include "check.h"

/* A small network of family K; the tests write weights of their own into it. */
static uint8_t file[1 << 20];
static size_t file_bytes;
static lull_tza tza;
static lull_graph graph;

static const lull_layer *layer_named(const char *name)
{
    for (unsigned l = 0; l < graph.layers; l++)
        if (lull_layer_is_conv(&graph.layer[l]) && !strcmp(lull_layer_name(&graph.layer[l]), name))
            return &graph.layer[l];
    printf("FAIL no layer %s\n", name);
    exit(1);
}

/* Weight of tap `tap` of an output's (of a phase's) channel. */
static int8_t *weight(const lull_tza_tensor *tensor, unsigned row, unsigned channel, unsigned tap)
{
    unsigned taps = tensor->dims[2] * tensor->dims[3];
    CHECK(row < tensor->dims[0] && channel < tensor->dims[1] && tap < taps);
    return (int8_t *)(size_t)tensor->data + ((size_t)row * tensor->dims[1] + channel) * taps + tap;
}

static void read_network(void)
{
    FILE *from = fopen("tests/golden/kernel/weights.tza", "rb");
    file_bytes = from ? fread(file, 1, sizeof file, from) : 0;
    if (from)
        fclose(from);
    if (!CHECK_EQ(lull_tza_open(&tza, file, file_bytes), LULL_OK) ||
        !CHECK_EQ(lull_graph_build(&graph, &tza), LULL_OK))
        exit(1);
    for (unsigned l = 0; l < graph.layers; l++) {
        lull_layer_tensors tensors;
        const lull_tza_tensor *both[2] = {&tensors.weight, &tensors.skip};
        if (!lull_layer_is_conv(&graph.layer[l]))
            continue;
        lull_graph_tensors(&tensors, &graph.layer[l], &tza);
        for (unsigned i = 0; i < 2; i++)
            if (both[i]->rank == 4)
                memset((uint8_t *)(size_t)both[i]->data, 0, both[i]->bytes);
    }
}

/* A layer's fits_words, which all ports agree about. */
static int fits_words(const char *name)
{
    unsigned l = (unsigned)(layer_named(name) - graph.layer);
    int found[2];
    for (unsigned i = 0; i < 2; i++) {
        uint32_t ports = i ? lull_ports_available() : LULL_PORTS_SCALAR;
        size_t bytes = lull_model_size(file, file_bytes, ports);
        lull_model *model = NULL;
        void *memory = NULL;
        if (posix_memalign(&memory, LULL_ALIGN, bytes ? bytes : 1) ||
            !CHECK_EQ(lull_model_init(&model, memory, bytes, file, file_bytes, ports), LULL_OK))
            exit(1);
        found[i] = model->layer[l].fits_words;
        CHECK(!found[i] || model->layer[l].is_small);
        free(memory);
    }
    CHECK_EQ(found[0], found[1]);
    return found[0];
}

/* In a run elements 0 and 1 of 4 share a word with those of all other dwords. */
static void words_of_a_run(void)
{
    for (int sign = -1; sign <= 1; sign += 2) {
        lull_layer_tensors tensors;
        int8_t *one;
        read_network();
        lull_graph_tensors(&tensors, layer_named("enc2b"), &tza);
        CHECK_EQ(lull_layer_inputs(&graph, layer_named("enc2b"), 0), 8);
        CHECK(fits_words("enc2b"));
        *weight(&tensors.weight, 3, 0, 3) = (int8_t)(100 * sign);
        *weight(&tensors.weight, 3, 5, 5) = (int8_t)(28 * sign);
        CHECK(fits_words("enc2b"));
        one = weight(&tensors.weight, 3, 4, 4);
        *one = (int8_t)sign;
        CHECK(!fits_words("enc2b"));
        *one = (int8_t)-sign; /* of the other sign */
        CHECK(fits_words("enc2b"));
        *one = 0;
        *weight(&tensors.weight, 3, 4, 2) = (int8_t)(127 * sign); /* another run */
        *weight(&tensors.weight, 3, 2, 4) = (int8_t)(127 * sign); /* the other word */
        *weight(&tensors.weight, 2, 0, 4) = (int8_t)(127 * sign); /* another output */
        CHECK(fits_words("enc2b"));
        *weight(&tensors.weight, 3, 7, 3) = (int8_t)(2 * sign);
        CHECK(!fits_words("enc2b"));
    }
}

/* Five channels: those of the middle column begin in the high word's second half. */
static void words_of_odd_channels(void)
{
    lull_layer_tensors tensors;
    read_network();
    lull_graph_tensors(&tensors, layer_named("enc0b"), &tza);
    CHECK_EQ(lull_layer_inputs(&graph, layer_named("enc0b"), 0), 5);
    *weight(&tensors.weight, 1, 0, 0) = 100;
    *weight(&tensors.weight, 1, 0, 1) = 100; /* element 5: low, element 6: high */
    CHECK(!fits_words("enc0b"));
    *weight(&tensors.weight, 1, 0, 1) = 0;
    *weight(&tensors.weight, 1, 1, 1) = 100;
    CHECK(fits_words("enc0b"));
    *weight(&tensors.weight, 1, 2, 0) = 29;
    CHECK(!fits_words("enc0b"));
}

/* All phases of an upsampled source count, and the taps of the skip. */
static void words_of_phases_and_skip(void)
{
    const lull_layer *layer;
    lull_layer_tensors tensors;
    read_network();
    layer = layer_named("dec3");
    lull_graph_tensors(&tensors, layer, &tza);
    for (unsigned phase = 0; phase < 4; phase++) {
        *weight(&tensors.weight, phase * layer->outputs + 1, 0, phase) = 100;
        CHECK(fits_words("dec3"));
        *weight(&tensors.weight, phase * layer->outputs + 1, 1, phase ^ 1) = 29;
        CHECK(!fits_words("dec3"));
        *weight(&tensors.weight, phase * layer->outputs + 1, 1, phase ^ 1) = 28;
    }
    *weight(&tensors.skip, 1, 4, 0) = 127;
    CHECK(fits_words("dec3"));
    *weight(&tensors.skip, 1, 1, 2) = 2;
    CHECK(!fits_words("dec3"));
}

static void words_are_for_small_sums(void)
{
    lull_layer_tensors tensors;
    static const uint8_t bias[4] = {1, 0, 0, 1}; /* 2^24 + 1 */
    read_network();
    lull_graph_tensors(&tensors, layer_named("enc2b"), &tza);
    CHECK(fits_words("enc2b"));
    memcpy((uint8_t *)(size_t)tensors.bias.data, bias, sizeof bias);
    CHECK(!fits_words("enc2b"));
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(words_of_a_run);
    RUN(words_of_odd_channels);
    RUN(words_of_phases_and_skip);
    RUN(words_are_for_small_sums);
    return check_report();
}
