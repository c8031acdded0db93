#!/bin/sh
# make install into an empty place, then programs that find the library as strangers do: by
# pkg-config (shared and static), by CMake in a tree that was moved, as a meson subproject.
set -eu
root=${LULL_ROOT:-$(cd "$(dirname "$0")/../.." && pwd)}
build=${LULL_BUILD:-$root/build}
CC=${CC:-cc}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
. "$root/tests/counts.sh"

cat >"$work/main.c" <<'END'
#include <OpenImageDenoise/oidn.h>
#include <stdio.h>
int main(void)
{
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_DEFAULT);
    const char *text = NULL;
    oidnCommitDevice(device);
    if (oidnGetDeviceError(device, &text) != OIDN_ERROR_NONE ||
        oidnGetDeviceInt(device, "version") != OIDN_VERSION)
        return 1;
    oidnReleaseDevice(device);
    puts("denoiser found");
    return 0;
}
END
cat >"$work/native.c" <<'END'
#include <lull.h>
int main(void) { return !(lull_ports_available() & LULL_PORTS_SCALAR); }
END

prefix=/opt/some/place
try "make install" "${MAKE:-make}" -C "$root" --no-print-directory install BUILD="$build" \
    DESTDIR="$work/stage" prefix="$prefix"
[ "$failed" = 0 ] || finish
tree=$work/stage$prefix
for file in include/lull.h include/OpenImageDenoise/oidn.h include/OpenImageDenoise/oidn.hpp \
    include/OpenImageDenoise/config.h include/OpenImageDenoise/namespace.h \
    include/OpenImageDenoise/lull_device.h include/OpenImageDenoise/lull_quality.h lib/liblull.a \
    lib/libOpenImageDenoise.a lib/libOpenImageDenoise.so.2 lib/libOpenImageDenoise.so \
    lib/pkgconfig/lull.pc lib/pkgconfig/OpenImageDenoise.pc; do
    if [ -e "$tree/$file" ]; then ok; else bad "installed: $file"; fi
done
if grep -rq '@[A-Z_]*@' "$tree/lib/pkgconfig" "$tree/lib/cmake"; then bad placeholders; else ok; fi

# ---- pkg-config --------------------------------------------------------------------------------
if command -v pkg-config >/dev/null 2>&1; then
    export PKG_CONFIG_PATH="$tree/lib/pkgconfig"
    export PKG_CONFIG_SYSROOT_DIR="$work/stage"
    for module in OpenImageDenoise lull; do
        try "pkg-config $module" pkg-config --exists "$module"
    done
    try "version of OpenImageDenoise.pc" pkg-config --exact-version=2.5.1 OpenImageDenoise
    # shellcheck disable=SC2046
    try "pkg-config: shared" $CC -std=c99 "$work/main.c" -o "$work/shared" \
        $(pkg-config --cflags --libs OpenImageDenoise) -Wl,-rpath,"$tree/lib"
    try "pkg-config: runs" "$work/shared"
    # shellcheck disable=SC2046
    try "pkg-config: static" $CC -std=c99 "$work/main.c" -o "$work/static" $(pkg-config --cflags \
        OpenImageDenoise) "$tree/lib/libOpenImageDenoise.a" -pthread
    try "pkg-config: static runs" "$work/static"
    # shellcheck disable=SC2046
    try "pkg-config: lull" $CC -std=c99 "$work/native.c" -o "$work/native" \
        $(pkg-config --cflags --libs lull)
    try "pkg-config: lull runs" "$work/native"
    unset PKG_CONFIG_SYSROOT_DIR
    try "a prefix with a space" "${MAKE:-make}" -C "$root" --no-print-directory install \
        BUILD="$build" prefix="$work/my place"
    for place in "my place" moved; do # .pc files are found wherever the tree lies
        [ "$place" != moved ] || mv "$work/my place" "$work/moved"
        try "pkg-config: $place" sh -c "flags=\$(PKG_CONFIG_PATH='$work/$place/lib/pkgconfig' \
            pkg-config $([ "$place" != moved ] || echo --define-prefix) --cflags --libs lull) &&
            eval \"$CC -std=c99 '$work/native.c' -o '$work/native' \$flags\" && '$work/native'"
    done
    rm -r "$work/moved"
else
    skip pkg-config "pkg-config is not installed"
fi

# ---- CMake -------------------------------------------------------------------------------------
if command -v cmake >/dev/null 2>&1; then
    mkdir "$work/cmake"
    cat >"$work/cmake/CMakeLists.txt" <<'END'
cmake_minimum_required(VERSION 3.13)
project(consumer C)
find_package(OpenImageDenoise 2.4 REQUIRED)
if(NOT OpenImageDenoise_VERSION VERSION_EQUAL 2.5.1 OR NOT OIDN_DEVICE_CPU OR OIDN_DEVICE_CUDA
   OR NOT OIDN_FILTER_RT OR NOT OIDN_FILTER_RTLIGHTMAP OR OIDN_STATIC_LIB)
  message(FATAL_ERROR "variables: version ${OpenImageDenoise_VERSION}")
endif()
find_package(OpenImageDenoise 3 QUIET)
if(OpenImageDenoise_FOUND)
  message(FATAL_ERROR "taken for version 3")
endif()
find_package(OpenImageDenoise 2.6 QUIET)
if(OpenImageDenoise_FOUND)
  message(FATAL_ERROR "taken for version 2.6")
endif()
# Where hosts that ship the libraries they use look for the file (OSPRay's redistribution does).
get_target_property(configurations OpenImageDenoise IMPORTED_CONFIGURATIONS)
list(GET configurations 0 configuration)
get_target_property(file OpenImageDenoise IMPORTED_LOCATION_${configuration})
get_target_property(soname OpenImageDenoise IMPORTED_SONAME_${configuration})
if(NOT EXISTS "${file}" OR NOT soname)
  message(FATAL_ERROR "${configurations}: ${file}, ${soname}")
endif()
add_executable(shared ../main.c)
target_link_libraries(shared OpenImageDenoise)
add_executable(static ../main.c)
target_link_libraries(static OpenImageDenoise_static)
END
    mv "$tree" "$work/moved" # the package is found wherever the tree lies
    try "cmake: configures" cmake -S "$work/cmake" -B "$work/cmake/build" \
        -DCMAKE_PREFIX_PATH="$work/moved"
    try "cmake: builds" cmake --build "$work/cmake/build"
    try "cmake: shared runs" "$work/cmake/build/shared"
    try "cmake: static runs" "$work/cmake/build/static"
    mkdir "$work/alone" # where the static library is the only one
    cat >"$work/alone/CMakeLists.txt" <<'END'
cmake_minimum_required(VERSION 3.13)
project(consumer C)
find_package(OpenImageDenoise 2 REQUIRED)
if(NOT OIDN_STATIC_LIB)
  message(FATAL_ERROR "OIDN_STATIC_LIB is ${OIDN_STATIC_LIB}")
endif()
add_executable(alone ../main.c)
target_link_libraries(alone OpenImageDenoise)
END
    mv "$work/moved/lib/libOpenImageDenoise.so.2" "$work/alone"
    try "cmake: configures with the static library" cmake -S "$work/alone" -B "$work/alone/build" \
        -DCMAKE_PREFIX_PATH="$work/moved"
    try "cmake: builds with the static library" cmake --build "$work/alone/build"
    try "cmake: runs with the static library" "$work/alone/build/alone"
    mv "$work/alone/libOpenImageDenoise.so.2" "$work/moved/lib"
    mv "$work/moved" "$tree"
    try "make install for a multiarch system" "${MAKE:-make}" -C "$root" --no-print-directory \
        install BUILD="$build" prefix="$work/multi" libdir="$work/multi/lib/x86_64-linux-gnu"
    mv "$work/multi" "$work/moved"
    rm -r "$work/cmake/build"
    try "cmake: finds a multiarch tree that was moved" cmake -S "$work/cmake" \
        -B "$work/cmake/build" \
        -DOpenImageDenoise_ROOT="$work/moved/lib/x86_64-linux-gnu/cmake/OpenImageDenoise-2.5.1"
    rm -r "$work/moved"

    # The tree as a part of a project, in a debug build with fast arithmetic, and installed by CMake.
    mkdir "$work/part"
    cat >"$work/part/CMakeLists.txt" <<END
cmake_minimum_required(VERSION 3.16)
project(consumer C)
add_subdirectory("$root" lull)
add_executable(shared ../main.c)
target_link_libraries(shared OpenImageDenoise)
add_executable(static ../main.c)
target_link_libraries(static OpenImageDenoise_static)
add_executable(native ../native.c)
target_link_libraries(native lull)
END
    try "cmake: configures with the tree" cmake -S "$work/part" -B "$work/part/build" \
        -DCMAKE_C_COMPILER="$CC" -DCMAKE_BUILD_TYPE=Debug -DCMAKE_C_FLAGS=-ffast-math \
        -DCMAKE_UNITY_BUILD=ON -DLULL_APPS=ON -DLULL_INSTALL=ON -DCMAKE_INSTALL_LIBDIR=lib
    try "cmake: builds the tree" cmake --build "$work/part/build" -j 2
    for program in shared static native; do
        try "cmake: $program of the tree runs" "$work/part/build/$program"
    done
    { printf 'P6 64 64 255\n' && head -c 12288 "$root/weights/kernel5_8.tza"; } >"$work/in.ppm"
    for bin in "$build/bin" "$work/part/build/lull"; do # as fast, and the same bytes
        "$bin/lullInfo" && "$bin/oidnDenoise" --ldr "$work/in.ppm" -d cpu | grep -o 'hash=.*'
    done >"$work/log" 2>&1 || bad "cmake: its programs"
    lines=$(($(wc -l <"$work/log") / 2))
    head -n "$lines" "$work/log" >"$work/made"
    if [ "$lines" -gt 5 ] && tail -n "$lines" "$work/log" | cmp - "$work/made"; then ok
    else bad "cmake: its programs"; fi
    if command -v clang >/dev/null 2>&1; then
        try "cmake: clang with a flag of gcc's" cmake -S "$work/part" -B "$work/part/clang" \
            -DCMAKE_C_COMPILER=clang -DCMAKE_C_FLAGS=-Wno-maybe-uninitialized
        try "cmake: clang has its ports" grep LULL_TAKES_SCALAR:INTERNAL=1 \
            "$work/part/clang/CMakeCache.txt"
    else
        skip "cmake with clang" "optional: clang is not installed"
    fi
    try "cmake: installs" cmake --install "$work/part/build" --prefix "$work/moved"
    try "cmake: its package is found" cmake -S "$work/cmake" -B "$work/cmake/again" \
        -DCMAKE_PREFIX_PATH="$work/moved"
    try "cmake: its package builds" cmake --build "$work/cmake/again"
    try "cmake: its package runs" "$work/cmake/again/shared"
    if command -v pkg-config >/dev/null 2>&1; then
        # shellcheck disable=SC2046
        try "cmake: its .pc files" $CC -std=c99 "$work/native.c" -o "$work/native" \
            $(PKG_CONFIG_PATH="$work/moved/lib/pkgconfig" pkg-config --cflags --libs lull)
    fi
    rm -r "$work/moved"
else
    skip cmake "optional: cmake is not installed"
fi

# ---- meson subproject --------------------------------------------------------------------------
if command -v meson >/dev/null 2>&1 && command -v ninja >/dev/null 2>&1; then
    mkdir -p "$work/meson/subprojects"
    ln -s "$root" "$work/meson/subprojects/lull"
    cp "$work/main.c" "$work/meson/"
    cat >"$work/meson/meson.build" <<'END'
project('consumer', 'c', default_options: ['c_std=c99'])
subproject('lull')
executable('consumer', 'main.c', dependencies: dependency('OpenImageDenoise'))
END
    try "meson: configures" meson setup "$work/meson/build" "$work/meson" \
        -Dunity=on -Dc_args=-ffast-math
    try "meson: builds" ninja -C "$work/meson/build" consumer
    try "meson: runs" "$work/meson/build/consumer"
    try "meson: configures the tree itself" meson setup "$work/meson/tree" "$root"
    try "meson: builds a test that links in a way of its own" ninja -C "$work/meson/tree" test_memory
    if command -v clang >/dev/null 2>&1; then # it warns of this flag
        try "meson: finds the ports of clang" sh -c 'CC=clang meson setup "$1/meson/clang" "$2" \
            -Dc_args=-Wformat-truncation | grep -q "ports.*SCALAR"' - "$work" "$root"
    fi
else
    skip meson "optional: meson or ninja is not installed"
fi

# ---- make uninstall ----------------------------------------------------------------------------
touch "$tree/lib/of-somebody-else"
try "make uninstall" "${MAKE:-make}" -C "$root" --no-print-directory uninstall BUILD="$build" \
    DESTDIR="$work/stage" prefix="$prefix"
left=$(find "$work/stage" ! -type d)
if [ "$left" = "$tree/lib/of-somebody-else" ]; then ok; else bad "uninstall left: $left"; fi
try "uninstall twice" "${MAKE:-make}" -C "$root" --no-print-directory uninstall BUILD="$build" \
    DESTDIR="$work/stage" prefix="$prefix"

finish
