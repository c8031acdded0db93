#!/bin/sh
# Builds the C tests for other processors with cross compilers and runs them in qemu-user: 64-bit ARM,
# 32-bit ARM, and s390x, which is big endian. Their results must be the same bits as here.
#
#   tests/conform/test_cross.sh [TARGET...]        aarch64 armhf s390x; all without an argument
#
# A missing tool skips its target. Environment: LULL_BUILD (default build) is the folder below which
# cross-TARGET/ is built; JOBS (default: number of processors).
set -u

cd "$(dirname "$0")/../.." || exit 1
build=${LULL_BUILD:-build}
jobs=${JOBS:-$(getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2)}
. tests/counts.sh
built= # TARGET:EMULATOR ...

# Names of the test programs of the folders whose tests are quick enough for an emulator, those that take
# longest first.
programs=$(cat tests/conform/sources.mk tests/golden/sources.mk tests/unit/sources.mk 2>/dev/null |
    sed -n 's/^TEST_\([a-z0-9_]*\)_SOURCES.*/\1/p' |
    grep -v '^conform_emulated$') # that one emulates x86: once is enough

# Adds the counts of a program, which has run, to ours; its lines are shown with the target's name.
count_program() { # count_program TARGET PROGRAM
    log=$build/cross-$1/$2.log
    status=$(cat "$log.status" 2>/dev/null || echo unknown)
    counts=$(tail -1 "$log" |
        sed -n 's/^\([0-9]*\) passed, \([0-9]*\) failed, \([0-9]*\) skipped$/\1 \2 \3/p')
    if [ -z "$counts" ]; then
        bad "$1 $2: exit status $status, no closing line of counts"
        tail -5 "$log"
        return
    fi
    # shellcheck disable=SC2086
    set -- "$1" "$2" $counts
    passed=$((passed + $3)) failed=$((failed + $4)) skipped=$((skipped + $5))
    echo "$1 $2: $3 passed, $4 failed, $5 skipped"
    sed -n "s/^\(FAIL\|SKIP\) /\1 $1 $2 /p" "$log"
    [ "$status" = 0 ] || [ "$4" -gt 0 ] || bad "$1 $2: exit status $status, but no test failed"
}

build_target() { # build_target TARGET COMPILER EMULATOR PACKAGE
    why="optional: $2 is missing (Debian: $4)"
    command -v "$2" >/dev/null 2>&1 || { skip "$1" "$why"; return; }
    why="optional: $3 is missing (Debian: qemu-user)"
    command -v "$3" >/dev/null 2>&1 || { skip "$1" "$why"; return; }
    folder=$build/cross-$1
    targets=
    for program in $programs; do targets="$targets $folder/test/$program"; done
    mkdir -p "$folder"
    # The core asks a weak getauxval for the CPU: static programs must be told to hold it.
    # shellcheck disable=SC2086
    if ! make -j"$jobs" CC="$2" AR="${2%gcc}ar" BUILD="$folder" OPENEXR=0 PNG=0 SAN= WERROR=1 \
        CFLAGS= OPT=-O2 LDFLAGS="-static -Wl,-u,getauxval" $targets >"$folder/make.log" 2>&1; then
        bad "$1 does not build"
        tail -20 "$folder/make.log"
        return
    fi
    built="$built $1:$3"
}

[ $# -gt 0 ] || set -- aarch64 armhf s390x
for target; do
    case $target in
    aarch64) build_target aarch64 aarch64-linux-gnu-gcc qemu-aarch64 gcc-aarch64-linux-gnu ;;
    armhf) build_target armhf arm-linux-gnueabihf-gcc qemu-arm gcc-arm-linux-gnueabihf ;;
    s390x) build_target s390x s390x-linux-gnu-gcc qemu-s390x gcc-s390x-linux-gnu ;;
    *) bad "$target: no such target" ;;
    esac
done

# As many at once as there are processors.
for program in $programs; do
    for target in $built; do
        log=$build/cross-${target%%:*}/$program.log
        rm -f "$log.status"
        echo "${target#*:} $build/cross-${target%%:*}/test/$program $log"
    done
done | xargs -r -n 3 -P "$jobs" sh -c '"$1" "$2" >"$3" 2>&1; echo $? >"$3.status"' run
for target in $built; do
    for program in $programs; do count_program "${target%%:*}" "$program"; done
done
finish
