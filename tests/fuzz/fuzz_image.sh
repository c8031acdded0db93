#!/bin/sh
# Fuzzes the image readers with libFuzzer: tests/fuzz/fuzz_image.sh [SECONDS [CORPUS]]
# Needs clang with its runtime (Debian: clang libclang-rt-dev), OpenEXR and libpng.
set -eu
cd "$(dirname "$0")/../.."
seconds=${1:-600}
corpus=${2:-build/fuzz/image}
mkdir -p "$corpus" build/fuzz
# shellcheck disable=SC2046
clang -g -O1 -std=c99 -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=all -Iapps \
    -DLULL_WITH_OPENEXR=1 -DLULL_WITH_PNG=1 $(pkg-config --cflags OpenEXR libpng) \
    tests/fuzz/fuzz_image.c apps/imageio.c apps/imageio_*.c apps/exr_*.c \
    apps/layers.c apps/platform.c -o build/fuzz/fuzz_image \
    $(pkg-config --libs-only-L OpenEXR) -lOpenEXRCore $(pkg-config --libs libpng) -lm
exec build/fuzz/fuzz_image -max_total_time="$seconds" -max_len=65536 -timeout=20 \
    -rss_limit_mb=4096 -print_final_stats=1 -artifact_prefix=build/fuzz/ "$corpus" tests/fuzz/seeds/image
