"""Each header compiles alone, without a warning."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.read_lists import read_lists
from tests.rules.sources import CC, ROOT, compile_text, files_of, name_of

STRICT = ("-Wall", "-Wextra", "-Wundef", "-Wshadow", "-pedantic", "-Werror", "-Ilib",
          "-Ioidn/include", "-Iweights")
CXX = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
MACHINE = subprocess.run([CC, "-dumpmachine"], capture_output=True, text=True).stdout
# Folder of ports/ -> target that its headers are for, and its name in ports/sources.mk.
PORTS = {"x86": ("x86_64", "x86"), "arm": ("aarch64", "arm64"), "wasm": ("wasm32", "wasm32")}
# Public headers with the languages they promise; the others are C99.
PUBLIC = {
    "lib/lull.h": ("c99", "c11", "c++11", "c++20"),
    "oidn/include/OpenImageDenoise/oidn.h": ("c99", "c11", "c++11", "c++20"),
    "oidn/include/OpenImageDenoise/config.h": ("c99", "c11", "c++11", "c++20"),
    "oidn/include/OpenImageDenoise/lull_device.h": ("c99", "c11", "c++11", "c++20"),
    "oidn/include/OpenImageDenoise/lull_quality.h": ("c99", "c11", "c++11", "c++20"),
    "oidn/include/OpenImageDenoise/oidn.hpp": ("c++11", "c++20"),
}


def check(path: Path, standard: str) -> None:
    text = f'#include "{path}"\ntypedef int lull_not_empty;\n'
    if standard.startswith("c++"):
        if not CXX:
            pytest.skip("optional: no C++ compiler")
        errors = compile_text(text, *STRICT, f"-std={standard}", "-x", "c++", compiler=CXX)
    else:
        errors = compile_text(text, *STRICT, f"-std={standard}", "-x", "c")
    assert not errors, errors


@pytest.mark.parametrize("name,standard", [(n, s) for n, all_ in PUBLIC.items() for s in all_])
def test_public_header_compiles_alone(name: str, standard: str):
    check(ROOT / name, standard)


def instruction_flags(arch: str) -> tuple[str, ...]:
    """Flags of all groups of ports/sources.mk for an architecture."""
    lists = read_lists(ROOT)
    return tuple(flag for group in lists["PORT_GROUPS"] if arch in lists[f"PORT_{group}_ARCH"]
                 for name in ("FLAGS", f"FLAGS_{arch}")
                 for flag in lists.get(f"PORT_{group}_{name}", []))


def test_internal_headers_compile_alone():
    """A header without an include guard is a template, made to be included several times."""
    headers = [p for p in files_of("lib", "ports", "oidn", "apps", suffixes=(".h",))
               if name_of(p) not in PUBLIC and "#ifndef LULL_" in p.read_text()]
    assert headers
    for path in headers:
        hosted = path.parent.name in ("oidn", "apps")
        flags = ("-D_POSIX_C_SOURCE=200809L",) if hosted else ()
        target, arch = PORTS.get(path.parent.name, ("", ""))
        if not MACHINE.startswith(target):
            continue
        flags += instruction_flags(arch)
        errors = compile_text(f'#include "{path}"\ntypedef int lull_not_empty;\n', *STRICT, *flags,
                              "-Wno-unused-function", "-std=c99", "-x", "c")
        assert not errors, errors
