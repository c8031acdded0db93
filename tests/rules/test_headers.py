"""Each header compiles alone, without a warning."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.rules.sources import ROOT, compile_text, files_of, name_of

STRICT = ("-Wall", "-Wextra", "-Wundef", "-Wshadow", "-pedantic", "-Werror", "-Ilib",
          "-Ioidn/include", "-Iweights")
CXX = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
# Public headers with the languages they promise; the others are C99.
PUBLIC = {
    "lib/lull.h": ("c99", "c11", "c++11", "c++20"),
    "oidn/include/OpenImageDenoise/oidn.h": ("c99", "c11", "c++11", "c++20"),
    "oidn/include/OpenImageDenoise/config.h": ("c99", "c11", "c++11", "c++20"),
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


def test_internal_headers_compile_alone():
    headers = [p for p in files_of("lib", "ports", "oidn", suffixes=(".h",))
               if name_of(p) not in PUBLIC]
    assert headers
    for path in headers:
        flags = ("-D_POSIX_C_SOURCE=200809L",) if path.parent.name == "oidn" else ()
        errors = compile_text(f'#include "{path}"\ntypedef int lull_not_empty;\n', *STRICT, *flags,
                              "-Wno-unused-function", "-std=c99", "-x", "c")
        assert not errors, errors
