#!/bin/sh
# Builds lull for WebAssembly, with its vectors and without, and runs C tests and those of lull.mjs in
# Node: the same bits as here.
#
# Environment: LULL_BUILD (default build) is the folder below which wasm/ and wasm-scalar/ are built;
# JOBS (default: number of processors); NODE (default node).
set -u
cd "$(dirname "$0")/../.." || exit 1
build=${LULL_BUILD:-build}
jobs=${JOBS:-$(getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2)}
node=${NODE:-node}
compiler="clang --target=wasm32-wasi"
programs="conform test_golden test_schedules test_transfer test_image test_exposure test_tza test_pack test_difference"
. tests/counts.sh

without() { # without WHAT: ends the script
    skip all "optional: $1"
    finish
}
run() { # run NAME COMMAND...: a program, and its counts
    name=$1
    shift
    "$@" >"$folder/$name.log" 2>&1
    count "$name" "$folder/$name.log"
}

command -v clang >/dev/null 2>&1 || without "clang is missing (Debian: clang)"
command -v wasm-ld >/dev/null 2>&1 || without "wasm-ld is missing (Debian: lld)"
command -v "$(clang -print-prog-name=llvm-ar)" >/dev/null 2>&1 ||
    without "llvm-ar is missing (Debian: llvm)"
command -v "$node" >/dev/null 2>&1 || without "$node is missing (Debian: nodejs)"
"$node" -e 'import("node:wasi")' >/dev/null 2>&1 || without "$node has no node:wasi"
printf '#include <string.h>\nint main(void) { return (int)strlen(""); }\n' |
    $compiler -x c - -o /dev/null 2>/dev/null ||
    without "the C library is missing (Debian: wasi-libc libclang-rt-dev-wasm32)"

for folder in "$build/wasm" "$build/wasm-scalar"; do
    mkdir -p "$folder"
    targets=all
    for program in $programs; do targets="$targets $folder/test/$program"; done
    case $folder in *scalar) ports="PORT_SIMD128_ARCH=none" ;; *) ports= ;; esac
    # shellcheck disable=SC2086
    if ! make -j"$jobs" CC="$compiler" BUILD="$folder" SAN= WERROR=1 CFLAGS= LDFLAGS= $ports \
        $targets >"$folder/make.log" 2>&1; then
        bad "build of $folder"
        tail -20 "$folder/make.log"
        continue
    fi
    for program in $programs; do
        [ "$program" != test_schedules ] || [ $ports ] || continue # slow, and once is enough
        run "$program" "$node" --no-warnings tests/conform/run_wasi.mjs "$folder/test/$program"
    done
    for program in web web_threads web_async; do
        run "$program" "$node" tests/apps/$program.mjs "$folder/bin" "$build/bin/oidnDenoise" \
            weights/kernel5_8.tza "$folder"
    done
done
finish
