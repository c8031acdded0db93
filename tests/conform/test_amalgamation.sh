#!/bin/sh
# The core as one file, as strangers compile it: by gcc, clang and cross compilers, in a folder that
# holds nothing else, without flags that it would need. It has no externals but lull.h's functions,
# and makes the bytes of liblull.a on every port.
#
# Environment: LULL_BUILD (default build) has liblull.a; CC (default cc) made it.
set -u
root=${LULL_ROOT:-$(cd "$(dirname "$0")/../.." && pwd)}
build=${LULL_BUILD:-$root/build}
CC=${CC:-cc}
cd "$root" || exit 1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
. tests/counts.sh
weights="weights/rt_hdr_alb_nrm_w16.tza tests/golden/int_unet_9_aux/weights.tza
tests/golden/unet_3_narrow/weights.tza"

# $1 test, the rest a command
try() {
    name=$1
    shift
    if "$@" >"$work/log" 2>&1; then ok; else bad "$name"; return 1; fi
}

# Links the program of fingerprints: link PROGRAM COMPILER OBJECT FLAGS...
link() {
    program=$1 compiler=$2 object=$3 models=$work/weights-${2##*/}.o
    shift 3
    [ -f "$models" ] || "$compiler" -Wall -Wextra -Werror -c "$work/one/lull_weights.c" \
        -o "$models" || return
    "$compiler" -std=c99 -Wall -Wextra -Werror -O1 -I"$work/one" -o "$program" \
        tests/conform/amalgamation.c "$object" "$models" "$@" -lm
}

# Compiles lull.c in its folder with what the test names: compile OBJECT COMPILER FLAGS...
compile() (
    object=$1 compiler=$2
    shift 2
    cd "$work/alone" || exit
    "$compiler" -O2 "$@" -Wall -Wextra -Wundef -Wshadow -Werror -c lull.c -o "$object"
)

# Fingerprints of a program: run FILE COMMAND...
run() {
    file=$1
    shift
    # shellcheck disable=SC2086
    "$@" $weights >"$file"
}

# What direct networks of floats make depends on the port, other results do not: of the scalar port
# all lines, of others those, without the port's name.
anywhere() {
    sed -n -e 's/ scalar / /p' -e '/^weights\|unet_3_/!s/ [a-z0-9]* no error/ no error/p' "$1" | sort -u
}

try "make amalgamation" "${MAKE:-make}" -s amalgamation BUILD="$build" || finish
mkdir "$work/one" "$work/alone"
cp "$build/amalgamation/"*.[ch] "$work/one/"
cp "$work/one/lull.c" "$work/one/lull.h" "$work/alone/"
try "written anew" "${PYTHON:-python3}" -m lib.amalgamate "$work/again"
try "the same text again" cmp "$work/one/lull.c" "$work/again/lull.c"

try "liblull.a" link "$work/whole" "$CC" "$build/lib/liblull.a" &&
    try "liblull.a runs" run "$work/expected" "$work/whole" || finish
anywhere "$work/expected" >"$work/expected.anywhere"
sed -n 's/^[a-z].*[ *]\(lull_[a-z_]*\)(.*/T \1/p' "$work/one/lull.h" | sort >"$work/interface"

for compiler in gcc clang; do
    if ! command -v "$compiler" >/dev/null 2>&1; then
        skip "$compiler" "optional: it is not installed"
        continue
    fi
    for standard in "" "-std=c99 -O1"; do
        # shellcheck disable=SC2086
        try "$compiler $standard" compile "$work/lull.o" "$compiler" $standard || continue
        nm -P -g --defined-only "$work/lull.o" | awk '{ print $2, $1 }' | sort >"$work/defined"
        try "interface of $compiler $standard" diff "$work/interface" "$work/defined"
        try "program of $compiler $standard" link "$work/program" "$compiler" "$work/lull.o" &&
            try "$compiler $standard runs" run "$work/found" "$work/program" &&
            try "bytes of $compiler $standard" diff "$work/expected" "$work/found"
    done
    compile "$work/lull.o" "$compiler" -ffast-math 2>"$work/why" && bad "$compiler -ffast-math"
    try "why not -ffast-math" grep 'lull needs IEEE arithmetic' "$work/why"
done

# Targets whose gcc would contract products and sums, and ports that need flags there.
while read -r compiler emulator package ports; do
    if ! command -v "$compiler" >/dev/null 2>&1; then
        skip "$compiler" "optional: it is missing (Debian: $package)"
    elif ! command -v "$emulator" >/dev/null 2>&1; then
        skip "$compiler" "optional: $emulator is missing (Debian: qemu-user)"
    elif try "$compiler" compile "$work/lull.o" "$compiler"; then
        try "program of $compiler" link "$work/program" "$compiler" "$work/lull.o" -static \
            -Wl,-u,getauxval && try "$emulator" run "$work/found" "$emulator" "$work/program" ||
            continue
        anywhere "$work/found" >"$work/found.anywhere"
        try "bytes of $compiler" diff "$work/expected.anywhere" "$work/found.anywhere"
        for port in $ports; do try "$compiler: $port" grep " $port " "$work/found"; done
        [ "$compiler" = aarch64-linux-gnu-gcc ] || continue
        for cpu in -mcpu=neoverse-n1 -march=armv8-a+crypto; do # with more than the ports' own
            try "$compiler $cpu" compile "$work/lull.o" "$compiler" -O0 $cpu
        done
    fi
done <<END
aarch64-linux-gnu-gcc qemu-aarch64 gcc-aarch64-linux-gnu neon dotprod i8mm
arm-linux-gnueabihf-gcc qemu-arm gcc-arm-linux-gnueabihf neon
END
finish
