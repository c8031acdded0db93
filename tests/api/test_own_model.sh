#!/bin/sh
# A model of one's own in the library (docs/training.md, "Embedding a model"): a row of builtin.def
# for three images at quality high is chosen for these, and for nothing else.
set -eu
root=${LULL_ROOT:-$(cd "$(dirname "$0")/../.." && pwd)}
build=${LULL_BUILD:-$root/build}
CC=${CC:-cc}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$root"
. tests/counts.sh

# The smallest built-in model stands in for one's own: its results tell which was chosen.
{
    cat weights/builtin.def
    echo 'BUILTIN(own, "kernel5_8.tza", HDR, COLOR | ALBEDO | NORMAL, NOISY_AUX | CLEAN_AUX, HIGH)'
} >"$work/builtin.def"
cat >"$work/main.c" <<'END'
#include "OpenImageDenoise/oidn.h"
#include <stdio.h>
#include <string.h>

enum { SIDE = 48, VALUES = 3 * SIDE * SIDE };
static float images[3][VALUES], output[VALUES];

/* The output of a noisy frame at a quality, with as many of its images. */
static void denoise(float *result, OIDNQuality quality, int count)
{
    static const char *const names[] = {"color", "albedo", "normal"};
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    OIDNFilter filter;
    int i;

    oidnCommitDevice(device);
    filter = oidnNewFilter(device, "RT");
    for (i = 0; i < count; i++)
        oidnSetSharedFilterImage(filter, names[i], images[i], OIDN_FORMAT_FLOAT3, SIDE, SIDE, 0, 0,
                                 0);
    oidnSetSharedFilterImage(filter, "output", result, OIDN_FORMAT_FLOAT3, SIDE, SIDE, 0, 0, 0);
    oidnSetFilterBool(filter, "hdr", 1);
    oidnSetFilterInt(filter, "quality", quality);
    oidnCommitFilter(filter);
    oidnExecuteFilter(filter);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

int main(void)
{
    static const OIDNQuality qualities[] = {OIDN_QUALITY_HIGH, OIDN_QUALITY_BALANCED};
    static float small[VALUES];
    unsigned seed = 1;
    int i, q, count;

    for (i = 0; i < 3 * VALUES; i++) {
        seed = seed * 1664525 + 1013904223;
        images[i / VALUES][i % VALUES] = 0.2f + (float)(seed >> 8) / 4e7f;
    }
    for (q = 0; q < 2; q++)
        for (count = 1; count <= 3; count += 2) {
            denoise(output, qualities[q], count);
            denoise(small, OIDN_QUALITY_FAST, count);
            printf("%s\n", memcmp(small, output, sizeof output) ? "other" : "own");
        }
    return output[0] == 0;
}
END
# shellcheck disable=SC2086
{
    flags="-std=c99 -O1 -D_POSIX_C_SOURCE=200809L -D_FILE_OFFSET_BITS=64 -DLULL_WITH_THREADS=0
-Ilib -Ioidn/include -I$work -Iweights"
    cp weights/embed.c "$work" # where it finds that table, not the one beside it
    $CC $flags "$work/embed.c" -o "$work/embed"
    "$work/embed" weights "$work/weights.c"
    $CC $flags "$work/main.c" "$work/weights.c" oidn/*.c "$build/lib/liblull.a" -lm -o "$work/main"
}
"$work/main" >"$work/chosen"
i=0
for expected in other own other other; do # high with one and with three images, balanced alike
    i=$((i + 1))
    if [ "$(sed -n ${i}p "$work/chosen")" = $expected ]; then ok; else
        bad "choice $i: not $expected"
    fi
done
finish
