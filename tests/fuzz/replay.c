/* Runs a fuzz target without a fuzzer: on every file of its seed folder, and on damaged copies
 * of each. Link it with one fuzz_NAME.c and call the program replay_NAME.
 *
 *     replay_NAME [FOLDER]        default: tests/fuzz/seeds/NAME
 *
 * A crash stops the program and so fails the test; run it under sanitizers to see all errors. */
#include <dirent.h>
#include <stdint.h>
#include <stdlib.h>

#include "check.h"
#include "unit/hash.h"

#define COPIES 150 /* damaged copies of a seed */

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static char path[1024]; /* of the seed that replay_seed runs */

/* A copy whose memory ends with the file. */
static void run_copy(const uint8_t *data, size_t size)
{
    uint8_t *copy = malloc(size ? size : 1);
    memcpy(copy, data, size);
    LLVMFuzzerTestOneInput(copy, size);
    free(copy);
}

/* One to eight changes: a byte, a bit, or a run of bytes copied from elsewhere; some are cut
 * short. */
static void run_damaged(const uint8_t *data, size_t size, uint32_t *seed)
{
    uint8_t *copy = malloc(size);
    uint32_t changes = 1 + random_bits(seed) % 8;
    memcpy(copy, data, size);
    while (changes-- > 0) {
        size_t at = random_bits(seed) % size, from = random_bits(seed) % size;
        size_t run = 1 + random_bits(seed) % 8;
        uint32_t kind = random_bits(seed) % 3;
        if (random_bits(seed) % 2) /* headers and tables stand at the ends of files */
            at = at % 2 ? at % 64 % size : size - 1 - at % (size < 800 ? size : 800);
        if (kind == 0)
            copy[at] = (uint8_t)random_bits(seed);
        else if (kind == 1)
            copy[at] ^= (uint8_t)(1u << random_bits(seed) % 8);
        else if (at + run <= size && from + run <= size)
            memmove(copy + at, copy + from, run);
    }
    run_copy(copy, random_bits(seed) % 4 ? size : random_bits(seed) % size);
    free(copy);
}

static uint8_t *read_file(const char *name, size_t *size)
{
    FILE *f = fopen(name, "rb");
    uint8_t *data = NULL;
    long n = -1;
    *size = 0;
    if (f && fseek(f, 0, SEEK_END) == 0)
        n = ftell(f);
    if (n >= 0 && (data = malloc((size_t)n + 1)) != NULL) {
        rewind(f);
        *size = fread(data, 1, (size_t)n, f);
        if (*size != (size_t)n) {
            free(data);
            data = NULL;
        }
    }
    if (f)
        fclose(f);
    return data;
}

static void replay_seed(void)
{
    uint32_t seed = 1;
    size_t size;
    uint8_t *data = read_file(path, &size);
    int i;
    if (!CHECK(data != NULL))
        return;
    run_copy(data, size);
    for (i = 0; size > 0 && i < COPIES; ++i)
        run_damaged(data, size, &seed);
    free(data);
}

int main(int argc, char **argv)
{
    const char *name = strstr(argv[0], "replay_");
    char folder[512];
    const struct dirent *entry;
    DIR *dir;
    if (argc > 1 && strlen(argv[1]) < sizeof folder)
        strcpy(folder, argv[1]);
    else
        sprintf(folder, "tests/fuzz/seeds/%.100s", name ? name + strlen("replay_") : "");
    if (strstr(folder, ".exe"))
        *strstr(folder, ".exe") = 0;
    dir = opendir(folder);
    if (!dir) {
        fprintf(stderr, "%s: cannot read the folder %s\n", argv[0], folder);
        return 2;
    }
    while ((entry = readdir(dir)) != NULL)
        if (entry->d_name[0] != '.' && strlen(entry->d_name) < 400) {
            sprintf(path, "%s/%s", folder, entry->d_name);
            printf("%s\n", path);
            fflush(stdout);
            check_run(entry->d_name, replay_seed);
        }
    closedir(dir);
    return check_report();
}
