#!/bin/sh
# The C++ wrapper in two standards, warnings being errors; two copies of the library in one process,
# one of them renamed with OIDN_API_NAMESPACE; the old names from C.
set -eu
root=${LULL_ROOT:-$(cd "$(dirname "$0")/../.." && pwd)}
build=${LULL_BUILD:-$root/build}
CC=${CC:-cc}
CXX=${CXX:-c++}
if ! command -v "$CXX" >/dev/null 2>&1; then
    echo "optional: no C++ compiler"
    exit 77
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
passed=0
cd "$root"

warnings="-Wall -Wextra -pedantic -Wundef -Wshadow -Werror"
includes="-Ioidn/include -Itests/api"
$CC -std=c99 -O1 -Itests/api -c tests/api/identity.c -o "$work/identity.o"

# $1 name, $2 flags, $3 library: compiles, runs, and counts the program as one test
program() {
    # shellcheck disable=SC2086
    $CXX $warnings $includes $2 tests/api/test_cpp.cpp "$work/identity.o" "$3" -pthread \
        -o "$work/$1"
    "$work/$1" >"$work/$1.log" || { cat "$work/$1.log"; echo "FAIL $1"; exit 1; }
    passed=$((passed + 1))
}
program cpp11 -std=c++11 "$build/lib/libOpenImageDenoise.a"
program cpp20 -std=c++20 "$build/lib/libOpenImageDenoise.a"

# A second library with other names: the facade again with OIDN_API_NAMESPACE, the core as it is, in
# a shared library, so that only prefixed names are left outside.
mkdir "$work/obj"
for source in oidn/*.c; do
    $CC -std=c99 -O1 -fPIC -fvisibility=hidden -D_POSIX_C_SOURCE=200809L -DLULL_WITH_THREADS=1 \
        -DOIDN_API_NAMESPACE=other -Ilib -Iweights -c "$source" \
        -o "$work/obj/$(basename "$source" .c).o"
done
# shellcheck disable=SC2086
$CC -shared -o "$work/libother.so" "$work"/obj/*.o "$build/obj/weights.o" \
    "$build/lib/liblull.a" -pthread
names=$(nm -D --defined-only "$work/libother.so" |
    awk '$3 !~ /^other_(oidn|lull_)/ && $2 ~ /[A-Z]/ { print $3 }')
if [ -n "$names" ]; then
    echo "FAIL namespace: exported without the prefix: $names"
    exit 1
fi
passed=$((passed + 1))
program namespaced "-std=c++11 -DOIDN_API_NAMESPACE=other -Wl,-rpath,$work" "$work/libother.so"

cat >"$work/plain.c" <<'END'
#include "OpenImageDenoise/oidn.h"
int plain(void);
int plain(void)
{
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    int version = oidnGetDeviceInt(device, "version");
    oidnReleaseDevice(device);
    return version;
}
END
cat >"$work/both.cpp" <<'END'
#define OIDN_API_NAMESPACE other
#include "OpenImageDenoise/oidn.hpp"
extern "C" int plain(void);
int main()
{
    other::OIDNDevice device = other::oidnNewDevice(other::OIDN_DEVICE_TYPE_CPU);
    other::oidn::DeviceRef ref(device);
    other::oidnNewDeviceByID(-1); // an error there is none here
    const bool ok = plain() == OIDN_VERSION && ref.get<int>("version") == OIDN_VERSION;
    return !(ok && other::oidn::getError() == other::oidn::Error::InvalidArgument);
}
END
# shellcheck disable=SC2086
$CC -std=c99 $includes -c "$work/plain.c" -o "$work/plain.o"
# shellcheck disable=SC2086
$CXX -std=c++11 $warnings $includes "$work/both.cpp" "$work/plain.o" \
    "$build/lib/libOpenImageDenoise.so.2" "$work/libother.so" -Wl,-rpath,"$build/lib:$work" \
    -pthread -o "$work/both"
if ! "$work/both"; then
    echo "FAIL both: two copies in one process"
    exit 1
fi
passed=$((passed + 1))

# C callers: every name links without optimisation, the deprecated ones with a warning only.
cat >"$work/names.c" <<'END'
#define OIDN_LEGACY_1X
#include "OpenImageDenoise/oidn.h"
int main(void)
{
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    OIDNFilter filter;
    OIDNBuffer buffer;
    oidnSetDevice1b(device, "setAffinity", false);
    oidnSetDevice1i(device, "numThreads", 1);
    oidnSetDeviceUInt(device, "verbose", 0);
    oidnCommitDevice(device);
    filter = oidnNewFilter(device, "RT");
    buffer = oidnNewBuffer(device, 8);
    oidnSetFilter1b(filter, "hdr", true);
    oidnSetFilter1i(filter, "quality", 4);
    oidnSetFilter1f(filter, "inputScale", 2);
    oidnRemoveFilterImage(filter, "albedo");
    oidnRemoveFilterData(filter, "weights");
    oidnUnmapBuffer(buffer, oidnMapBuffer(buffer, OIDN_ACCESS_READ, 0, 8));
    if (oidnGetDevice1b(device, "setAffinity") || oidnGetDevice1i(device, "numThreads") != 1 ||
        oidnGetDeviceUInt(device, "verbose") || oidnGetPhysicalDeviceUInt(0, "type") != 1 ||
        !oidnGetFilter1b(filter, "hdr") || oidnGetFilter1i(filter, "quality") != 4 ||
        oidnGetFilter1f(filter, "inputScale") != 2 || oidnGetDeviceError(device, 0))
        return 1;
    oidnReleaseBuffer(buffer);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    return 0;
}
END
for standard in c99 c11; do
    # shellcheck disable=SC2086
    $CC -std=$standard -O0 $warnings -Wno-deprecated-declarations $includes "$work/names.c" \
        "$build/lib/libOpenImageDenoise.a" -pthread -o "$work/names"
    "$work/names" || { echo "FAIL names: $standard"; exit 1; }
    passed=$((passed + 1))
done

# The inlines are exported, too, for those who look names up.
for name in oidnGetPhysicalDeviceUInt oidnSetDevice1b oidnSetFilter1f oidnRemoveFilterImage \
    oidnMapBuffer; do
    nm -D --defined-only "$build/lib/libOpenImageDenoise.so.2" | grep -q " T $name\$" ||
        { echo "FAIL exports: $name"; exit 1; }
done
passed=$((passed + 1))
echo "$passed passed, 0 failed, 0 skipped"
