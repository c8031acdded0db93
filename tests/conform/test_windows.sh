#!/bin/sh
# Builds the libraries, the tools and C tests for Windows with MinGW, and, where wine is, runs the
# tests there and compares a denoised picture with the one made here: the same bytes.
#
# Environment: LULL_BUILD (default build) is the folder below which cross-windows/ is built; JOBS
# (default: number of processors).
set -eu
cd "$(dirname "$0")/../.."
build=${LULL_BUILD:-build}
jobs=${JOBS:-$(getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2)}
folder=$build/cross-windows
prefix=x86_64-w64-mingw32
programs="test_transfer test_image test_exposure test_tza test_device test_buffer test_filter
test_images test_async test_release"
. tests/counts.sh

if ! command -v $prefix-gcc >/dev/null 2>&1; then
    skip build "optional: $prefix-gcc is missing (Debian: gcc-mingw-w64-x86-64)"
    finish
fi
mkdir -p "$folder"
targets=all
for program in $programs; do targets="$targets $folder/test/$program.exe"; done
# shellcheck disable=SC2086
if make -j"$jobs" CC=$prefix-gcc AR=$prefix-ar BUILD="$folder" SAN= WERROR=1 $targets \
    >"$folder/build.log" 2>&1; then ok; else
    bad build
    tail -20 "$folder/build.log"
    finish
fi
needs=$($prefix-objdump -p "$folder/lib/OpenImageDenoise.dll" | sed -n 's/.*DLL Name: //p' |
    tr 'A-Z\n' 'a-z ')
case " $needs" in *lib*) bad "the library needs $needs" ;; *) ok ;; esac

wine=
for name in wine64 wine /usr/lib/wine/wine64; do
    if command -v "$name" >/dev/null 2>&1; then
        wine=$name
        break
    fi
done
if [ -z "$wine" ]; then
    skip run "optional: wine is not installed (Debian: wine64)"
    finish
fi
WINEPREFIX=$(cd "$folder" && pwd)/wine
WINEDEBUG=-all
export WINEPREFIX WINEDEBUG
mkdir -p "$WINEPREFIX"
# Wine's server ends seconds after the last program, and one that starts in that moment fails with
# "Connection reset by peer": it shall outlive the pauses.
for name in wineserver /usr/lib/wine/wineserver64 /usr/lib/wine/wineserver; do
    if command -v "$name" >/dev/null 2>&1; then
        "$name" -p60 || true
        break
    fi
done
for program in $programs; do
    "$wine" "$folder/test/$program.exe" >"$folder/$program.log" 2>&1 || true
    count "$program" "$folder/$program.log"
done
# Any bytes will do as a picture: these are floats from 0.01 to 0.8.
printf 'PF\n64 32\n-1.0\n' >"$folder/in.pfm"
awk 'BEGIN { for (i = 0; i < 6144; i++) printf "%d%d%d%s", i % 7, i * i % 10,
    i * 3 % 10, substr("<=>?", i * i % 5 % 4 + 1, 1) }' \
    >>"$folder/in.pfm"
"$build/bin/oidnDenoise" --hdr "$folder/in.pfm" -o "$folder/here.pfm" >/dev/null
"$wine" "$folder/bin/oidnDenoise.exe" --hdr "$folder/in.pfm" -o "$folder/there.pfm" >/dev/null ||
    bad "oidnDenoise.exe"
if cmp -s "$folder/here.pfm" "$folder/there.pfm"; then ok; else bad "other bytes"; fi
finish
