#!/bin/sh
# The facade without threads (THREADS=0): the API tests pass, nothing of pthread is linked, and the
# images are the same bytes as with threads. The core, which has none, is taken from the build.
set -eu
root=${LULL_ROOT:-$(cd "$(dirname "$0")/../.." && pwd)}
build=${LULL_BUILD:-$root/build}
CC=${CC:-cc}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$root"
. tests/counts.sh

flags="-std=c99 -O1 -Wall -Wextra -Werror -D_POSIX_C_SOURCE=200809L -DLULL_WITH_THREADS=0 -Ilib
-Ioidn/include -Iweights -Itests -I."
mkdir "$work/oidn"
for source in oidn/*.c tests/api/identity.c; do
    # shellcheck disable=SC2086
    $CC $flags -c "$source" -o "$work/oidn/$(basename "$source" .c).o"
done
if nm -u "$work"/oidn/*.o | grep -E 'pthread_|sem_'; then
    bad "symbols: threads are referred to"
else ok; fi
for program in test_device test_buffer test_filter test_commit test_async test_release \
    test_images test_process test_memory test_auto; do
    wrap=
    if [ $program = test_memory ]; then wrap="-Wl,--wrap=malloc,--wrap=free"; fi
    # shellcheck disable=SC2086
    $CC $flags "tests/api/$program.c" "$work"/oidn/*.o "$build/obj/weights.o" \
        "$build/lib/liblull.a" $wrap -lm -o "$work/$program"
    "$work/$program" >"$work/log" 2>&1 || true
    count $program "$work/log"
done

# The bytes of a picture, from a program linked with either facade.
cat >"$work/hash.c" <<'END'
#include "OpenImageDenoise/oidn.h"
#include <stdio.h>
static float in[3 * 97 * 61], out[3 * 97 * 61];
int main(void)
{
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    unsigned hash = 2166136261u;
    OIDNFilter filter;
    size_t i;

    for (i = 0; i < sizeof in / sizeof *in; i++)
        in[i] = (float)(i * 7919 % 1009) / 500;
    oidnCommitDevice(device);
    filter = oidnNewFilter(device, "RT");
    oidnSetSharedFilterImage(filter, "color", in, OIDN_FORMAT_FLOAT3, 97, 61, 0, 0, 0);
    oidnSetSharedFilterImage(filter, "output", out, OIDN_FORMAT_FLOAT3, 97, 61, 0, 0, 0);
    oidnSetFilterBool(filter, "hdr", true);
    oidnCommitFilter(filter);
    oidnExecuteFilterAsync(filter);
    oidnSyncDevice(device);
    for (i = 0; i < sizeof out; i++)
        hash = (hash ^ ((unsigned char *)out)[i]) * 16777619u;
    printf("%08x %d\n", hash, oidnGetDeviceError(device, NULL));
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    return 0;
}
END
# shellcheck disable=SC2086
$CC $flags "$work/hash.c" "$work"/oidn/*.o "$build/obj/weights.o" "$build/lib/liblull.a" \
    -o "$work/without"
# shellcheck disable=SC2086
$CC $flags "$work/hash.c" "$build/lib/libOpenImageDenoise.a" -pthread -o "$work/with"
if [ "$("$work/without")" = "$("$work/with")" ]; then ok; else
    bad "bytes: $("$work/without") without threads, $("$work/with") with"
fi
finish
