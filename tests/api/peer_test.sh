#!/bin/sh
# Programs made for Open Image Denoise, run on our library: the official oidnTest, oidnDenoise and
# oidnBenchmark of the Python package pyoidn, and its Python module.
#
#   peer_test.sh             all of them, then memcheck on the [minimal] cases, with valgrind
#   peer_test.sh --sanitize  oidnTest on the library built with address and undefined sanitizers; our
#                            own cases of threads, queues and devices with the thread sanitizer
#
# Environment: LULL_BUILD (default build), PYTHON (one that has pyoidn and numpy; default
# build/venv/bin/python). Reports `N passed, N failed, N skipped`.
set -eu
root=$(cd "$(dirname "$0")/../.." && pwd)
build=${LULL_BUILD:-$root/build}
python=${PYTHON:-$build/venv/bin/python}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
. "$root/tests/counts.sh"

ok() { # is told of, too: this takes minutes
    echo "ok   $1"
    passed=$((passed + 1))
}

package=$("$python" -c 'import importlib.util as u
spec = u.find_spec("pyoidn")
print(spec.submodule_search_locations[0] if spec else "")' 2>/dev/null) || package=
if [ -z "$package" ]; then
    echo "peer_test: $python has no package pyoidn (make peer-test installs it)" >&2
    exit 1
fi

# Their binaries look for libraries in ../lib: ours, and nothing else.
mkdir "$work/bin" "$work/lib"
for program in oidnTest oidnDenoise oidnBenchmark; do
    cp "$package/oidn/bin/$program" "$work/bin"
done

# All cases of oidnTest, one by one, so that each counts. $1: prefix of their names; the rest:
# environment
official_test() {
    label=$1
    shift
    env "$@" "$work/bin/oidnTest" --list-test-names-only >"$work/cases" || true # status: the count
    [ "$(wc -l <"$work/cases")" -ge 20 ] || bad "$label: fewer than 20 cases"
    while IFS= read -r case; do
        try "$label: $case" env "$@" "$work/bin/oidnTest" "$case" -s
        if ! grep -q '^All tests passed ([1-9][0-9]* assertions' "$work/log"; then
            bad "$label: $case asserted nothing"
        fi
    done <"$work/cases"
}

if [ "${1:-}" = --sanitize ]; then
    make -C "$root" --no-print-directory SAN=address,undefined \
        build/san-address-undefined/lib/libOpenImageDenoise.so.2
    cp "$root/build/san-address-undefined/lib/libOpenImageDenoise.so.2" "$work/lib"
    # The programs' own deliberate INTPTR_MAX allocation is refused before it reaches malloc.
    official_test "oidnTest, sanitized" LD_PRELOAD="$(${CC:-cc} -print-file-name=libasan.so)" \
        ASAN_OPTIONS=detect_leaks=0:allocator_may_return_null=1 UBSAN_OPTIONS=halt_on_error=1
    # The thread sanitizer wants the whole program built with it.
    races="test_async test_release test_device test_process test_fuzz_api"
    for program in $races; do
        make -C "$root" --no-print-directory SAN=thread "build/san-thread/test/$program"
        try "thread sanitizer: $program" env TSAN_OPTIONS=halt_on_error=1 \
            "$root/build/san-thread/test/$program"
    done
    finish
fi

cp "$build/lib/libOpenImageDenoise.so.2" "$work/lib"
official_test oidnTest OIDN_VERBOSE=0

# ---- oidnDenoise: runs on our library, and gives the bytes of our own program ------------------
"$python" - "$work" <<'END'
import sys
import numpy as np
rng = np.random.default_rng(5)
y, x = np.mgrid[0:150, 0:203]
def save(name, image):
    with open(f"{sys.argv[1]}/{name}.pfm", "wb") as f:
        f.write(f"PF\n{image.shape[1]} {image.shape[0]}\n-1.0\n".encode())
        f.write(image[::-1].astype("<f4").tobytes())
albedo = np.stack([(x // 20 % 2) * 0.6 + 0.2, (y // 15 % 2) * 0.5 + 0.3, 0 * x + 0.4], -1)
normal = np.stack([np.sin(x / 30), np.cos(y / 25), 0 * x + 0.5], -1)
normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
color = albedo * (0.5 + 2 * y / 150)[..., None] * rng.gamma(2, 0.5, y.shape)[..., None]
save("color", color)
save("color16", color.astype(np.float16)) # ties, which the programs round differently, avoided
save("ldr", color.clip(0, 1))
save("albedo", albedo)
save("normal", normal)
END
same_output() { # NAME OPTION...
    mode=$1
    shift
    rm -f "$work/theirs.pfm" "$work/ours.pfm"
    try "oidnDenoise $mode" "$work/bin/oidnDenoise" "$@" -o "$work/theirs.pfm"
    "$build/bin/oidnDenoise" "$@" -o "$work/ours.pfm" >"$work/log" 2>&1 ||
        bad "our oidnDenoise $mode"
    if cmp -s "$work/theirs.pfm" "$work/ours.pfm"; then ok "oidnDenoise $mode: same output"; else
        bad "oidnDenoise $mode: other output than our program's"
    fi
}
cd "$work"
same_output "hdr" --hdr color.pfm
same_output "hdr alb nrm" --hdr color.pfm --alb albedo.pfm --nrm normal.pfm
same_output "ldr" --ldr ldr.pfm
same_output "ldr srgb" --ldr ldr.pfm --srgb
same_output "ldr alb" --ldr ldr.pfm --alb albedo.pfm
same_output "albedo" --alb albedo.pfm
same_output "normal" --nrm normal.pfm
same_output "lightmap" -f RTLightmap --hdr color.pfm
same_output "directional" -f RTLightmap --dir normal.pfm
same_output "clean_aux" --hdr color.pfm --alb albedo.pfm --nrm normal.pfm --clean_aux
same_output "half" --hdr color16.pfm -t half
same_output "input scale" --hdr color.pfm --is 0.7
same_output "in place" --hdr color.pfm --inplace
same_output "fast, one thread" --hdr color.pfm -q fast --threads 1 --affinity 0
same_output "little memory" --hdr color.pfm --maxmem 0
same_output "buffers" --hdr color.pfm --buffer device
same_output "repeated" --hdr color.pfm -n 3
same_output "weights" --hdr color.pfm -w "$root/weights/rt_hdr_w16.tza"
try "oidnDenoise --ref" bin/oidnDenoise --hdr color.pfm -w "$root/weights/rt_hdr_w16.tza" \
    --ref ours.pfm
try "oidnDenoise --ld" bin/oidnDenoise --ld

# ---- oidnBenchmark -----------------------------------------------------------------------------
try "oidnBenchmark --list" bin/oidnBenchmark --list
try "oidnBenchmark" bin/oidnBenchmark -s 320 180 -n 2
lines=$(grep -c 'msec/image' log || true)
try "oidnBenchmark: results" [ "$lines" -ge 5 ]
for buffer in host device managed hostcopy devicecopy managedcopy; do
    try "oidnBenchmark --buffer $buffer" bin/oidnBenchmark -r 'RT.hdr_alb_nrm.*' -s 160 90 -n 2 \
        --buffer "$buffer"
done
try "oidnBenchmark half in place" bin/oidnBenchmark -r 'RT.hdr_alb_nrm.*' -s 160 90 -n 2 -t half \
    --inplace

# ---- The Python module: its own copy with our library in it ------------------------------------
mkdir -p module/pyoidn/oidn/lib
cp "$package"/*.py module/pyoidn
cp lib/libOpenImageDenoise.so.2 module/pyoidn/oidn/lib/libOpenImageDenoise.so
cat >module/run.py <<'END'
import numpy as np
import pyoidn
assert "module" in pyoidn.__file__
rng = np.random.default_rng(1)
color = (0.5 + 0.2 * rng.standard_normal((90, 120, 3))).clip(0, None).astype(np.float32)
with pyoidn.Device() as device:
    device.set_int("numThreads", 2)
    device.commit()
    assert device.get_int("version") == 20501 and device.get_uint("versionMajor") == 2
    result = np.zeros_like(color)
    with pyoidn.Filter(device, "RT") as rt:
        rt.set_image("color", color, pyoidn.OIDN_FORMAT_FLOAT3)
        rt.set_image("output", result, pyoidn.OIDN_FORMAT_FLOAT3)
        rt.set_bool("hdr", True)
        rt.commit()
        rt.execute()
    assert device.get_error() is None
assert np.isfinite(result).all() and result.std() < color.std() / 2, result.std()
aux = np.full_like(color, 0.5)
for kwargs in ({}, {"hdr": True}, {"albedo": aux, "normal": aux, "hdr": True, "clean_aux": True},
               {"filter_type": "RTLightmap"}, {"quality": "fast"}):
    assert pyoidn.denoise(color, **kwargs).shape == color.shape
assert pyoidn.denoise(color.astype(np.float16), hdr=True).dtype == np.float16
assert np.isfinite(pyoidn.denoise(color, normal=aux)).all()  # for which OIDN has no model
rough = np.where(np.arange(90)[:, None, None] == 40, np.nan, color)
assert np.isfinite(pyoidn.denoise(rough, hdr=True)).all()
with pyoidn.Device() as device:
    device.commit()
    with pyoidn.Filter(device, "RT") as rt:
        for name in ("albedo", "normal", "output"):
            rt.set_image(name, np.array(aux), pyoidn.OIDN_FORMAT_FLOAT3)
        rt.commit()
        assert "color" in device.get_error()
END
try "Python module" env PYTHONPATH="$work/module" PYTHONDONTWRITEBYTECODE=1 "$python" module/run.py

# ---- Memcheck ----------------------------------------------------------------------------------
if command -v valgrind >/dev/null 2>&1; then
    try "memcheck on [minimal]" env LULL_PORTS=avx2 valgrind --quiet --error-exitcode=9 \
        --leak-check=full --errors-for-leak-kinds=definite,indirect,possible \
        bin/oidnTest '[minimal]'
else
    skip memcheck "optional: valgrind is not installed"
fi
finish
