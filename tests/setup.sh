#!/bin/sh
# Gets what a make target needs. On Debian and Ubuntu, as root, missing packages are installed; elsewhere
# they are named.
#
#   tests/setup.sh build          headers of OpenEXR and libpng, pkg-config (for `make demo`)
#   tests/setup.sh check VENV     these, Python 3.10, and in the virtual environment VENV the packages
#                                 of tests/requirements.txt and training/requirements.txt, and, where
#                                 they can be had, those of training/scenes/requirements.txt and LLVM
#   tests/setup.sh peer VENV      these, and bench/requirements.txt (the real Open Image Denoise)
#
# Environment: PYTHON (default python3), LULL_NO_INSTALL=1 never installs Debian packages, CI=true makes
# it fail where something of these is missing (else the tests in question count as skipped) and
# installs, where it can, also what optional tests use: other compilers, emulators, valgrind, Cargo,
# Conan, the real Open Image Denoise.
set -eu

what=$1
root=$(cd "$(dirname "$0")/.." && pwd)
python=${PYTHON:-python3}
missing=

need() { # need PACKAGE TEST...: adds the package to $missing unless the test succeeds
    package=$1
    shift
    "$@" >/dev/null 2>&1 || missing="$missing $package"
}

find_missing() {
    missing=
    need pkg-config command -v pkg-config
    need libopenexr-dev pkg-config --exists 'OpenEXR >= 3.1'
    need libpng-dev pkg-config --exists libpng
    if [ "$what" != build ]; then
        need python3 "$python" -c 'import sys; assert sys.version_info >= (3, 10)'
        need python3-venv "$python" -c 'import venv, ensurepip'
    fi
}

# LLVM's shared library, new enough to render the scenes.
llvm_is_there() {
    (cd "$root" && "$python" -c 'from training.scenes.backend import find_llvm; assert find_llvm()')
}

llvm_package() { # the newest one that the distribution has
    for version in 19 20 21 18 17; do
        if apt-cache show "libllvm$version" >/dev/null 2>&1; then
            echo "libllvm$version"
            return
        fi
    done
    echo libllvm19
}

# Some driver of OpenCL, and the library that finds it.
has_opencl() {
    "$python" -c 'import ctypes; ctypes.CDLL("libOpenCL.so.1")' &&
        [ -n "$(ls /etc/OpenCL/vendors/*.icd)" ]
}

# Exit status of this Python program: whether C++ operations of training can be compiled.
has_headers='import os, sysconfig; assert os.path.exists(sysconfig.get_path("include") + "/Python.h")'

# Of use to some tests, and left alone where they cannot be had.
find_wanted() {
    missing=
    [ "$what" = check ] || return 0
    need g++ command -v c++
    need python3-dev "$python" -c "$has_headers"
    need "pocl-opencl-icd ocl-icd-libopencl1" has_opencl
    need libsimde-dev [ -e /usr/include/simde ]
    need "$(llvm_package)" llvm_is_there
    [ "${CI:-}" = true ] || return 0
    need clang command -v clang
    need cmake command -v cmake
    need meson command -v meson
    need ninja-build command -v ninja
    need cargo command -v cargo
    need valgrind command -v valgrind
    need qemu-user command -v qemu-aarch64
    need "gcc-aarch64-linux-gnu libc6-dev-arm64-cross" command -v aarch64-linux-gnu-gcc
    need "gcc-arm-linux-gnueabihf libc6-dev-armhf-cross" command -v arm-linux-gnueabihf-gcc
    need "gcc-s390x-linux-gnu libc6-dev-s390x-cross" command -v s390x-linux-gnu-gcc
    need gcc-mingw-w64-x86-64 command -v x86_64-w64-mingw32-gcc
    need lld command -v wasm-ld
    need llvm command -v "$(clang -print-prog-name=llvm-ar 2>/dev/null)"
    need "wasi-libc libclang-rt-dev-wasm32" [ -e /usr/include/wasm32-wasi ]
    need nodejs command -v node
}

can_install() {
    [ "${LULL_NO_INSTALL:-0}" != 1 ] && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1
}

install_packages() { # installs $missing
    echo "installing Debian packages:$missing"
    export DEBIAN_FRONTEND=noninteractive
    # shellcheck disable=SC2086
    apt-get install -qq -y --no-install-recommends $missing >/dev/null 2>&1 && return
    apt-get update -qq || true
    apt-get install -qq -y --no-install-recommends $missing >/dev/null 2>&1 && return
    for package in $missing; do # one that is unknown here must not keep the others out
        apt-get install -qq -y --no-install-recommends "$package" >/dev/null ||
            echo "setup: apt-get could not install $package" >&2
    done
}

find_missing
if [ -n "$missing" ] && can_install; then
    install_packages
    find_missing
fi
if [ -n "$missing" ]; then
    echo "setup: missing (Debian package names):$missing" >&2
    case " $missing " in *" python3 "* | *" python3-venv "*) exit 1 ;; esac
    [ "${CI:-}" != true ] || exit 1
fi
[ "$what" != build ] || exit 0
find_wanted
[ -z "$missing" ] || ! can_install || install_packages

# The virtual environment. Each list is installed once, and again when it changes.
venv=$2
[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
lists="tests/requirements.txt training/requirements.txt"
wanted=training/scenes/requirements.txt
if [ "$what" = peer ] || [ "${CI:-}" = true ]; then
    lists="$lists bench/requirements.txt"
fi
[ "$what:${CI:-}" != check:true ] || wanted="$wanted tests/packages/requirements.txt"
for list in $lists $wanted; do
    stamp=$venv/$(echo "$list" | tr / -).done
    ! cmp -s "$root/$list" "$stamp" || continue
    echo "installing $list into $venv (this can take minutes)"
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check -r "$root/$list" || {
        echo "setup: pip could not install the packages of $list" >&2
        case " $wanted " in *" $list "*) continue ;; esac # the tests that use them are skipped
        exit 1
    }
    cp "$root/$list" "$stamp"
done
