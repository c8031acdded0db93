"""The crate of rust/: its own tests, its example, what a package holds, other targets."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tarfile
from pathlib import Path

import numpy as np
import pytest

from tests.apps.tools import read_pfm, scene, write_pfm

pytestmark = pytest.mark.skipif(not shutil.which("cargo"),
                                reason="optional: cargo is not installed")

# Without the kernels of the processor, which take most of the time; the bytes are the same.
SETTINGS = {"LULL_MAKEFLAGS": "ARCH=other OPT=-O1", "CARGO_NET_OFFLINE": "true"}
CLEARED = ("MAKEFLAGS", "MFLAGS", "CFLAGS", "OPT", "MAKE")


def run(folder: Path, *command: str | Path, **env: str | Path) -> subprocess.CompletedProcess:
    kept = {k: v for k, v in os.environ.items() if k not in CLEARED}
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace",
                          env={**kept, **SETTINGS, **{k: str(v) for k, v in env.items()}})


@pytest.fixture(scope="module")
def target(build: Path) -> Path:
    """Where Cargo builds: below the build under test, so that the next time it has less to do."""
    return build.resolve() / "rust"


@pytest.fixture(scope="module")
def crate(root: Path) -> Path:
    return root / "rust"


def test_its_own_tests(crate, target):
    done = run(crate, "cargo", "test", "--release", CARGO_TARGET_DIR=target)
    assert done.returncode == 0, done.stdout + done.stderr
    passed = [int(n) for n in re.findall(r"test result: ok\. (\d+) passed", done.stdout)]
    assert len(passed) >= 2 and sum(passed) >= 11, done.stdout
    assert "warning" not in done.stderr, done.stderr


def test_example_gives_the_bytes_of_the_program(crate, target, build, tmp_path):
    done = run(crate, "cargo", "build", "--release", "--example", "denoise",
               CARGO_TARGET_DIR=target)
    assert done.returncode == 0, done.stderr
    example = target / "release" / "examples" / "denoise"
    for name, image in scene(70, 90).items():
        write_pfm(tmp_path / f"{name}.pfm", image)
    made = run(tmp_path, example, "color.pfm", "clean.pfm", "albedo.pfm", "normal.pfm")
    assert made.returncode == 0, made.stderr
    run(tmp_path, build / "bin" / "oidnDenoise", "--hdr", "color.pfm", "--alb", "albedo.pfm",
        "--nrm", "normal.pfm", "-o", "program.pfm")
    clean = read_pfm(tmp_path / "clean.pfm")
    assert np.array_equal(clean, read_pfm(tmp_path / "program.pfm"))
    write_pfm(tmp_path / "albedo.pfm", scene(8, 8)["albedo"])
    for files, text in ((["color.pfm"], "usage"), (["none.pfm", "o.pfm"], "none.pfm: "),
                        (["color.pfm", "o.pfm", "albedo.pfm"], "albedo.pfm: not of the size")):
        refused = run(tmp_path, example, *files)
        assert refused.returncode == 1 and text in refused.stderr
    (symbols,) = target.glob("release/build/lull-*/out/liblull_rs.a")
    names = subprocess.run(["nm", "-g", symbols], capture_output=True, text=True).stdout
    assert "T lull_rs_oidnNewDevice" in names
    assert not re.search(r" T oidn", names), "Open Image Denoise has these names, too"


def test_version_is_the_library_s(crate, version):
    assert f'\nversion = "{version}"' in (crate / "Cargo.toml").read_text()


def test_a_package_holds_what_the_library_is_made_from(crate, tmp_path):
    """Made for nothing but the list of commands, which names every file that it wants."""
    done = run(crate, "cargo", "package", "--no-verify", "--allow-dirty", "--quiet",
               CARGO_TARGET_DIR=tmp_path)
    assert done.returncode == 0, done.stderr
    (package,) = (tmp_path / "package").glob("lull-*.crate")
    with tarfile.open(package) as tar:
        assert not [m.name for m in tar.getmembers() if not m.isfile()]
    shutil.unpack_archive(package, tmp_path, "gztar")
    tree = tmp_path / package.stem / "tree"
    library = tmp_path / "build" / "lib" / "libOpenImageDenoise.a"
    made = run(tree, "make", "-n", f"BUILD={tmp_path / 'build'}", "OPENCL=0", library)
    assert made.returncode == 0, made.stderr
    assert made.stdout.count("conv_int") > 1
    headers = {name for p in tree.rglob("*.[ch]")
               for name in re.findall(r'^#include "([^"]+)"', p.read_text(), re.MULTILINE)}
    there = {p.name for p in tree.rglob("*")}
    assert not {n for n in headers if Path(n).name not in there} - {"weights.h"}
    assert package.stat().st_size < 2_000_000


@pytest.fixture(scope="module")
def build_script(crate, tmp_path_factory) -> Path:
    script = tmp_path_factory.mktemp("build_script") / "build_script"
    subprocess.run(["rustc", "--edition", "2021", "-o", script, crate / "build.rs"], check=True)
    return script


def told(script: Path, crate: Path, out: Path, target: str, **env: str | Path) -> tuple[str, str]:
    """What the build script tells make, one argument a line, and its messages."""
    make = out / "make"
    make.write_text(f'#!/bin/sh\nprintf "%s\\n" "MAKEFLAGS=$MAKEFLAGS" "$@" >{out}/told\n'
                    'for last; do :; done\nmkdir -p "${last%/*}" && echo >"$last"\n')
    make.chmod(0o755)
    done = run(crate, script, TARGET=target, HOST="x86_64-unknown-linux-gnu", OUT_DIR=out / "out",
               CARGO_MANIFEST_DIR=crate, NUM_JOBS="3", MAKE=make,
               **{"DEBUG": "false", "OPT_LEVEL": "3", **env})
    said = (out / "told").read_text() if done.returncode == 0 else ""
    return said, done.stdout + done.stderr


def test_settings_of_make(build_script, crate, tmp_path):
    (tmp_path / "out").mkdir()
    said, messages = told(build_script, crate, tmp_path, "x86_64-unknown-linux-gnu")
    assert "-j3" in said and "OPT=-Os" not in said and " -g" not in said and "CC=" not in said
    assert "cargo:rustc-link-lib=static=lull_rs" in messages
    said, _ = told(build_script, crate, tmp_path, "x86_64-unknown-linux-gnu", CC="clang",
                   CFLAGS="-pipe", DEBUG="true", OPT_LEVEL="z", CARGO_MAKEFLAGS="-j --jobs=4")
    assert {"CC=clang", "OPT=-Os", "MAKEFLAGS=-j --jobs=4"} <= set(said.splitlines())
    assert "CFLAGS=-pipe -DOIDN_API_NAMESPACE=lull_rs -g" in said
    assert "-j3" not in said and said.splitlines()[-3:-1] == ["ARCH=other", "OPT=-O1"]
    said, _ = told(build_script, crate, tmp_path, "aarch64-unknown-linux-gnu", CC="gcc",
                   CC_aarch64_unknown_linux_gnu="clang --target=aarch64", HOST_CC="tcc")
    assert {"CC=clang --target=aarch64", "HOSTCC=tcc"} <= set(said.splitlines())


@pytest.mark.parametrize(("target", "compiler"), [
    ("aarch64-unknown-linux-gnu", "aarch64-linux-gnu-gcc"),
    ("armv7-unknown-linux-gnueabihf", "arm-linux-gnueabihf-gcc"),
    ("x86_64-pc-windows-gnu", "x86_64-w64-mingw32-gcc")])
def test_compilers_of_other_machines(build_script, crate, tmp_path, target, compiler):
    if not shutil.which(compiler):
        pytest.skip(f"optional: {compiler} is not installed")
    (tmp_path / "out").mkdir()
    said, _ = told(build_script, crate, tmp_path, target)
    assert f"CC={compiler}" in said.splitlines()
    (archiver,) = re.findall(r"^AR=(.*)", said, re.MULTILINE)
    assert shutil.which(archiver)


@pytest.mark.parametrize(("target", "text", "env"), [
    ("x86_64-pc-windows-msvc", "use a -gnu target", {}),
    ("sparc64-unknown-netbsd", "no C compiler for sparc64-unknown-netbsd: set CC_sparc64_", {}),
    ("x86_64-unknown-linux-gnu", "no-such-make: ", {"MAKE": "no-such-make"}),
    ("x86_64-unknown-linux-gnu", "set CARGO_TARGET_DIR", {"OUT_DIR": "my target"})])
def test_errors_of_the_build_script(build_script, crate, tmp_path, target, text, env):
    done = run(crate, build_script, **{
        "TARGET": target, "HOST": "x86_64-unknown-linux-gnu", "OUT_DIR": tmp_path,
        "CARGO_MANIFEST_DIR": crate, "NUM_JOBS": "1", "DEBUG": "false", "OPT_LEVEL": "3", **env})
    assert done.returncode != 0 and text in done.stderr
