#!/bin/sh
# Gets what a make target needs. On Debian and Ubuntu, as root, missing packages are installed; elsewhere
# they are named.
#
#   tests/setup.sh build          headers of OpenEXR and libpng, pkg-config (for `make demo`)
#   tests/setup.sh check VENV     these, Python 3.10 and the Python packages of tests/requirements.txt
#
# Environment: PYTHON (default python3), LULL_NO_INSTALL=1 never installs Debian packages,
# CI=true makes it fail where something is missing (else the tests in question count as skipped).
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
    if [ "$what" = check ]; then
        need python3 "$python" -c 'import sys; assert sys.version_info >= (3, 10)'
        need python3-venv "$python" -c 'import venv, ensurepip'
    fi
}

find_missing
if [ -n "$missing" ] && [ "${LULL_NO_INSTALL:-0}" != 1 ] && [ "$(id -u)" = 0 ] \
    && command -v apt-get >/dev/null 2>&1; then
    echo "installing Debian packages:$missing"
    export DEBIAN_FRONTEND=noninteractive
    # shellcheck disable=SC2086
    { apt-get install -qq -y --no-install-recommends $missing >/dev/null 2>&1 ||
        { apt-get update -qq && apt-get install -qq -y --no-install-recommends $missing >/dev/null; }; } ||
        echo "setup: apt-get could not install:$missing" >&2
    find_missing
fi
if [ -n "$missing" ]; then
    echo "setup: missing (Debian package names):$missing" >&2
    case " $missing " in *" python3 "* | *" python3-venv "*) exit 1 ;; esac
    [ "${CI:-}" != true ] || exit 1
fi
[ "$what" = check ] || exit 0

# The virtual environment, made anew when the lists of requirements change.
venv=$2
lists=$root/tests/requirements.txt
[ ! -f "$root/training/requirements.txt" ] || lists="$lists $root/training/requirements.txt"
# shellcheck disable=SC2086
stamp=$(cat $lists | cksum)
if [ "$(cat "$venv/stamp" 2>/dev/null)" != "$stamp" ]; then
    echo "setting up $venv (PyTorch is large: this takes a few minutes)"
    rm -rf "$venv"
    "$python" -m venv "$venv"
    for list in $lists; do
        "$venv/bin/python" -m pip install --quiet --disable-pip-version-check -r "$list" || {
            echo "setup: pip could not install the packages of ${list#"$root"/}" >&2
            exit 1
        }
    done
    echo "$stamp" >"$venv/stamp"
fi
