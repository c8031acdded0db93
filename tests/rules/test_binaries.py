"""What the built libraries contain: symbols, undefined references, exports, size, stack."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.rules.sources import CC, ROOT

MEMORY = {"memcpy", "memmove", "memset", "memcmp"}
# Helpers of the compiler itself (libgcc, compiler-rt): integer division, soft float, ARM's names.
RUNTIME = re.compile(r"^(__(aeabi|gnu|u?div|u?mod|float|fix|mul|add|sub|cmp|lt|gt|le|ge|eq|ne|ash|"
                     r"lsh|extend|trunc|clz|ctz|popcount|bswap|cpu_)\w*|_GLOBAL_OFFSET_TABLE_)$")
STACK_LIMIT = 1024  # bytes of one function of lib/ and ports/
SIZE_LIMIT = 1_592_000  # bytes of the stripped shared library, weights included


def tool(name: str) -> str:
    """A binary utility, the cross one where CC is a cross compiler."""
    prefix = CC.rsplit("-", 1)[0] + "-" if re.search(r"-(gcc|clang|cc)$", CC) else ""
    found = shutil.which(prefix + name) or shutil.which(name)
    if not found:
        pytest.skip(f"{name} is not installed")
    return found


def symbols(path: Path, *flags: str) -> list[tuple[str, str]]:
    """(type letter, name) from nm."""
    out = subprocess.run([tool("nm"), "-P", *flags, str(path)], capture_output=True, text=True,
                         check=True).stdout
    rows = [line.split() for line in out.splitlines() if not line.endswith(":")]
    return [(row[1], row[0]) for row in rows if len(row) >= 2]


def exported(path: Path) -> set[str]:
    return {name for kind, name in symbols(path, "-D", "--defined-only") if kind.isupper()}


@pytest.fixture(scope="module")
def plain(build: Path) -> Path:
    if "san" in build.name:
        pytest.skip("optional: sanitized builds hold the sanitizer's own symbols")
    return build


@pytest.fixture(scope="module")
def facade(plain: Path) -> Path:
    return plain / "lib" / "libOpenImageDenoise.so.2"


def documented() -> set[str]:
    text = (ROOT / "tests" / "rules" / "exported_symbols.txt").read_text()
    return {line for line in text.split("\n") if line and not line.startswith("#")}


def test_core_symbols_have_the_prefix(plain: Path):
    names = [n for kind, n in symbols(plain / "lib/liblull.a", "--defined-only") if kind.isupper()]
    assert len(names) > 10
    assert not [n for n in names if not n.startswith("lull_")]


def test_static_facade_symbols_have_the_prefixes(plain: Path):
    names = [n for kind, n in symbols(plain / "lib/libOpenImageDenoise.a", "--defined-only")
             if kind.isupper()]
    assert len(names) > 70
    assert not [n for n in names if not n.startswith(("lull_", "oidn"))]


def test_core_needs_only_four_functions(plain: Path, tmp_path: Path):
    """The whole archive links into one object; open references: mem* and the compiler's own."""
    one = tmp_path / "lull.o"
    subprocess.run([CC, "-nostdlib", "-r", "-o", one, "-Wl,--whole-archive",
                    plain / "lib/liblull.a"], check=True)
    undefined = {name for kind, name in symbols(one) if kind == "U"}
    assert MEMORY & undefined, "no reference at all: is the archive empty?"
    assert not {n for n in undefined - MEMORY if not RUNTIME.match(n)}


def test_core_has_no_writable_globals(plain: Path):
    writable = [n for kind, n in symbols(plain / "lib/liblull.a", "--defined-only")
                if kind in "BbCSs" or (kind in "Dd" and not relocated(plain, n))]
    assert not writable


def relocated(plain: Path, name: str) -> bool:
    """True if a datum is constant but holds addresses (.data.rel.ro)."""
    out = subprocess.run([tool("objdump"), "-t", plain / "lib/liblull.a"], capture_output=True,
                         text=True, check=True).stdout
    return bool(re.search(rf"\.data\.rel\.ro\S*\s+\S+\s+{re.escape(name)}$", out, re.MULTILINE))


def test_stack_of_core_functions(plain: Path):
    reports = [p for folder in ("lib", "ports") for p in (plain / "obj" / folder).rglob("*.su")]
    if not reports:
        pytest.skip("optional: this compiler has no -fstack-usage")
    rows = [line.split("\t") for p in reports for line in p.read_text().splitlines()]
    assert len(rows) > 50
    # An inlined variable-length block would be "dynamic" without "bounded".
    large = [f"{where} uses {size} bytes ({kind})" for where, size, kind in rows
             if int(size) > STACK_LIMIT or kind == "dynamic"]
    assert not large, "\n".join(large)


def test_exports_are_the_documented_ones(facade: Path):
    found = exported(facade)
    assert not found - documented(), "exported but not documented"
    assert not documented() - found, "documented but not exported"


def test_shared_library_needs_libc_alone(facade: Path):
    out = subprocess.run([tool("objdump"), "-p", facade], capture_output=True, text=True,
                         check=True).stdout
    assert re.search(r"SONAME\s+libOpenImageDenoise\.so\.2$", out, re.MULTILINE)
    needed = set(re.findall(r"NEEDED\s+(\S+)", out))
    libc = {n for n in needed if n.startswith("ld-linux")}  # thread-local storage of glibc
    assert needed - libc <= {"libc.so.6", "libpthread.so.0", "libc.musl-x86_64.so.1"}, needed


def test_stripped_size(facade: Path, tmp_path: Path):
    stripped = tmp_path / facade.name
    subprocess.run([tool("strip"), "-o", stripped, facade], check=True)
    assert os.path.getsize(stripped) <= SIZE_LIMIT


def test_unloading_it_under_a_device_is_harmless(facade: Path):
    """Hosts that forget to release one, and unload what uses it, live on with the original."""
    code = ("import _ctypes, ctypes, sys, time\n"
            "for _ in range(20):\n"
            "    lib = ctypes.CDLL(sys.argv[1])\n"
            "    lib.oidnNewDevice.restype = ctypes.c_void_p\n"
            "    lib.oidnCommitDevice(ctypes.c_void_p(lib.oidnNewDevice(1)))\n"
            "    _ctypes.dlclose(lib._handle)\n"
            "time.sleep(0.3)\n")
    assert subprocess.run([sys.executable, "-c", code, facade], timeout=60).returncode == 0
