"""What the Makefile makes of settings that people give it."""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.rules.sources import CC, ROOT

X86 = "gcc" if platform.machine() == "x86_64" else "x86_64-linux-gnu-gcc"


@pytest.mark.parametrize(("compiler", "flags", "port"), [
    (X86, "-mno-avx2 -mno-avx512f", "x86/port_avx2"),
    (X86, "-march=x86-64 -mno-avx512f", "x86/port_avx512"),
    ("aarch64-linux-gnu-gcc", "-march=armv8-a", "arm/port_dotprod"),
    ("arm-linux-gnueabihf-gcc", "-march=armv7-a -mfpu=vfpv3-d16", "arm/port_neon")])
def test_ports_have_their_instructions_under_any_cflags(compiler: str, flags: str, port: str,
                                                        tmp_path: Path):
    if not shutil.which(compiler):
        pytest.skip(f"optional: {compiler} is not installed")
    env = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "CFLAGS")}
    made = subprocess.run(["make", "-s", f"CC={compiler}", f"HOSTCC={CC}", f"CFLAGS={flags}",
                           f"BUILD={tmp_path}", "SAN=", f"{tmp_path}/obj/ports/{port}.o"],
                          cwd=ROOT, env=env, capture_output=True, text=True)
    assert made.returncode == 0, made.stdout + made.stderr


def test_cflags_that_the_compiler_warns_of_lose_no_port(tmp_path: Path):
    """A flag of another compiler's, or a macro that it defines already."""
    env = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "CFLAGS")}
    for folder, flags in (("plain", ""), ("warned", "-DTWICE=1 -DTWICE=2")):
        subprocess.run(["make", "-s", f"CFLAGS={flags}", f"BUILD={tmp_path / folder}", "SAN=",
                        tmp_path / folder / "settings.txt"],
                       cwd=ROOT, env=env, check=True, capture_output=True)
    plain, warned = (re.findall(r"^  ports .*", (tmp_path / folder / "settings.txt").read_text(),
                                re.MULTILINE) for folder in ("plain", "warned"))
    assert warned == plain


@pytest.mark.parametrize("build", ["", "with blanks"])
def test_build_names_a_folder(build: str):
    said = subprocess.run(["make", "-n", "SAN=", f"BUILD={build}"], cwd=ROOT, capture_output=True,
                          text=True)
    assert said.returncode and f"BUILD='{build}'" in said.stderr


def test_windows_gets_its_import_library(tmp_path: Path):
    """The CMake package names it; without it -lOpenImageDenoise means the static library."""
    if not shutil.which("x86_64-w64-mingw32-gcc"):
        pytest.skip("optional: x86_64-w64-mingw32-gcc is not installed")
    env = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "CFLAGS")}
    for goal in ("install", "uninstall"):
        said = subprocess.run(["make", "-n", goal, "CC=x86_64-w64-mingw32-gcc", f"HOSTCC={CC}",
                               f"BUILD={tmp_path}", "SAN=", "prefix=/usr"],
                              cwd=ROOT, env=env, capture_output=True, text=True, check=True).stdout
        lines = [line for line in said.splitlines() if "OpenImageDenoise.dll.a" in line]
        assert [line for line in lines if "install" in line or "/usr/lib" in line], goal


def test_wasm_is_installed_without_a_shared_library(tmp_path: Path):
    if not shutil.which("clang"):
        pytest.skip("optional: clang is not installed")
    env = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "CFLAGS")}
    said = subprocess.run(["make", "-n", "install", "CC=clang --target=wasm32-wasi",
                           f"HOSTCC={CC}", f"BUILD={tmp_path}", "SAN=", "prefix=/usr"],
                          cwd=ROOT, env=env, capture_output=True, text=True, check=True).stdout
    assert re.search(r"^install .*libOpenImageDenoise\.a", said, re.MULTILINE)
    (programs,) = re.findall(r"^install -m 755 (.*)", said, re.MULTILINE)
    web = {p.name for p in (ROOT / "apps/web").glob("*.mjs")}
    assert web | {"lull.wasm", "lull-threads.wasm"} <= {p.split("/")[-1] for p in programs.split()}
    assert not re.search(r"^(install|ln) .*\.so|\.cmake\.in", said, re.MULTILINE)


def test_clang_calls_no_more_than_gcc(tmp_path: Path):
    """It makes bcmp, which a host need not have, of a memcmp for equality."""
    if not shutil.which("clang"):
        pytest.skip("optional: clang is not installed")
    env = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "CFLAGS")}
    made = tmp_path / "obj" / "lib" / "tza.o"
    subprocess.run(["make", "-s", "CC=clang", f"HOSTCC={CC}", f"BUILD={tmp_path}", "SAN=", made],
                   cwd=ROOT, env=env, check=True, stdout=subprocess.DEVNULL)
    called = subprocess.run(["nm", "-u", made], capture_output=True, text=True, check=True).stdout
    assert set(re.findall(r"U (mem\w+|bcmp)", called)) <= {"memcmp", "memcpy", "memset"}
    assert "memcmp" in called


@pytest.mark.parametrize("flags", ["-ffast-math", "-ffinite-math-only"])
def test_arithmetic_that_is_not_ieee_is_refused(flags: str, tmp_path: Path):
    """It would compile, and denoise to other pixels."""
    env = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "CFLAGS")}
    made = subprocess.run(["make", "-s", f"CFLAGS={flags}", f"BUILD={tmp_path}", "SAN=",
                           f"{tmp_path}/obj/lib/exposure.o"],
                          cwd=ROOT, env=env, capture_output=True, text=True)
    assert made.returncode != 0 and "compile it without -ffast-math" in made.stderr
