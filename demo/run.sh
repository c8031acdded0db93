#!/bin/sh
# Denoises the demo image with the programs in a build folder: demo/run.sh [BUILD]
set -eu

build=${1:-build}
here=$(cd "$(dirname "$0")" && pwd)
out=$build/demo
noisy=$here/house_0004spp.exr
reference=$here/house_ref.exr

for program in oidnDenoise lullInfo; do
    if [ ! -x "$build/bin/$program" ]; then
        echo "demo: $build/bin/$program is missing: run make first" >&2
        exit 1
    fi
done
mkdir -p "$out"

# A build without OpenEXR or libpng says so itself; it must not look like a success.
echo "\$ oidnDenoise demo/house_0004spp.exr -o $out/house.exr -o $out/house.png"
"$build/bin/oidnDenoise" "$noisy" -o "$out/house.exr" -o "$out/house.png"
memory=$("$build/bin/oidnDenoise" "$noisy" --json |
    sed -n 's/.*"peak_memory_bytes": \([0-9]*\).*/\1/p')
echo
echo "memory: $((memory / 1000000)) MB at most, images and library included"
echo "distance from the reference at 1024 samples per pixel, before and after:"
"$build/bin/lullInfo" --compare "$reference" "$noisy" "$out/house.exr"
echo "written: $out/house.exr (other layers and metadata kept), $out/house.png"
