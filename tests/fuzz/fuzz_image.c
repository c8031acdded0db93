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

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (!size)
        return 0;
    for (int role = 0; role < 3; role++) {
        image_request request = {(image_role)role, NULL, role == 2, (image_type)role, MEMORY,
                                 NULL,               1 + role};
        image img;
        image_error error;
        FILE *file = fmemopen((void *)(uintptr_t)data, size, "rb");
        image_status status;
        volatile float sum = 0;
        require(file != NULL);
        status = image_read_stream(&img, file, &request, &error);
        if (status) {
            require(!img.pixels && error.status == status && error.text[0]);
        } else {
            require(img.width && img.height && img.channels >= 1 && img.channels <= 3);
            require(image_bytes(&img) <= MEMORY);
            for (size_t i = 0, n = image_count(&img); i < n; i++)
                sum += image_get(&img, i); /* the memory sanitizer notices what was not written */
            (void)sum;
            image_destroy(&img);
        }
        fclose(file);
    }
    return 0;
}
