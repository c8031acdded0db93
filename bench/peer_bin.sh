#!/bin/sh
# Puts Open Image Denoise's own programs beside our library, where their RPATH ($ORIGIN/../lib) finds it:
#
#   bench/peer_bin.sh DIRECTORY [LIBRARY]
#
# leaves DIRECTORY/bin/{oidnTest,oidnDenoise,oidnBenchmark} (copies from the package pyoidn of $PYTHON)
# and DIRECTORY/lib/libOpenImageDenoise.so.2, a link to LIBRARY (default build/lib/...). Exit status 77
# where pyoidn is not installed.
set -eu
[ $# -ge 1 ] || { echo "usage: peer_bin.sh DIRECTORY [LIBRARY]" >&2; exit 2; }
root=$(cd "$(dirname "$0")/.." && pwd)
library=${2:-${LULL_BUILD:-$root/build}/lib/libOpenImageDenoise.so.2}
case $library in /*) ;; *) library=$PWD/$library ;; esac
[ -f "$library" ] || { echo "peer_bin: $library is missing: run make" >&2; exit 2; }
theirs=$("${PYTHON:-python3}" -c '
import importlib.util, pathlib
spec = importlib.util.find_spec("pyoidn")
print(pathlib.Path(spec.origin).parent / "oidn" / "bin" if spec else "")')
[ -d "$theirs" ] || { echo "the package pyoidn (Open Image Denoise) is not installed"; exit 77; }
mkdir -p "$1/bin" "$1/lib"
cp -f "$theirs"/oidn* "$1/bin/"
chmod +x "$1"/bin/oidn*
ln -sf "$library" "$1/lib/libOpenImageDenoise.so.2"
