/* libFuzzer target: any bytes are read as an image file, as each of the roles. Built by
 *
 *     tests/fuzz/fuzz_image.sh
 *
 * replay_image (replay.c) runs seeds and damaged copies of them with any compiler. */
#define _XOPEN_SOURCE 700 /* fmemopen */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include "imageio.h"

#define MEMORY (4u << 20) /* of one image; what is larger must be refused */

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void require(int condition)
{
    if (!condition)
        abort();
}

/* What was read is whole; what was not says why. */
static void check(image *img, image_status status, const image_error *error)
{
    volatile float sum = 0;
    if (status) {
        require(!img->pixels && error->status == status && error->text[0]);
        return;
    }
    require(img->width && img->height && img->channels >= 1 && img->channels <= 3);
    require(image_bytes(img) <= MEMORY);
    for (size_t i = 0, n = image_count(img); i < n; i++)
        sum += image_get(img, i); /* the memory sanitizer notices what was not written */
    (void)sum;
    image_destroy(img);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (!size)
        return 0;
    for (int role = 0; role < 3; role++) {
        image images[3] = {{0}};
        image_beside beside[2] = {{0}};
        image_request request = {(image_role)role, NULL, role == 2, (image_type)role, MEMORY,
                                 1 + role,         NULL, 0};
        image_error error;
        FILE *file = fmemopen((void *)(uintptr_t)data, size, "rb");
        image_status status;
        int is_layered;
        for (int i = 0; i < 2; i++) {
            beside[i].out = &images[1 + i];
            beside[i].request = request;
            beside[i].request.role = (image_role)(1 + i);
        }
        request.beside = beside;
        request.beside_count = role ? 0 : 2;
        require(file != NULL);
        status = image_read_stream(&images[0], file, &request, &error);
        is_layered = images[0].is_layered;
        check(&images[0], status, &error);
        for (unsigned i = 0; i < request.beside_count && is_layered; i++)
            check(beside[i].out, beside[i].status, &beside[i].error);
        require(!images[1].pixels && !images[2].pixels);
        fclose(file);
    }
    return 0;
}
