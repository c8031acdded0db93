"""Conan's recipe: `conan create`, whose test package finds the CMake package and denoises."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest


def conan_program() -> str | None:
    beside = Path(sys.executable).parent / "conan"
    return str(beside) if beside.exists() else shutil.which("conan")


CONAN = conan_program()
pytestmark = pytest.mark.skipif(not CONAN or not shutil.which("cmake"), reason=(
    f"optional: {'cmake' if CONAN else 'conan'} is not installed"))


def conan(*arguments: str | Path, cwd: Path, home: Path) -> subprocess.CompletedProcess:
    env = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "CFLAGS")}
    return subprocess.run([CONAN, *arguments], cwd=cwd, capture_output=True, text=True,
                          env={**env, "CONAN_HOME": str(home)})


@pytest.mark.parametrize("shared", [False, True])
def test_create(root: Path, version: str, tmp_path: Path, shared: bool):
    home = tmp_path / "home"
    detected = conan("profile", "detect", cwd=tmp_path, home=home)
    assert detected.returncode == 0, detected.stderr
    if not conan("--version", cwd=tmp_path, home=home).stdout.startswith("Conan version 2"):
        pytest.skip("optional: conan is not version 2")
    shutil.copytree(root / "test_package", tmp_path / "test_package",
                    ignore=shutil.ignore_patterns("build", "CMakeUserPresets.json"))
    # Without the kernels of the processor, which take most of the time.
    portable = "tools.cmake.cmaketoolchain:extra_variables={'LULL_IS__x86_64__': 'OFF'}"
    done = conan("create", root, "-o", f"lull/*:shared={shared}", "-s", "build_type=MinSizeRel",
                 "-c", portable, "-c", "tools.build:jobs=2", "-tf", tmp_path / "test_package",
                 "--format", "json", cwd=tmp_path, home=home)
    assert done.returncode == 0, done.stderr
    assert re.search(r"lull \d+\.\d+\.\d+: denoised", done.stderr), done.stderr
    nodes = json.loads(done.stdout)["graph"]["nodes"].values()
    (node,) = (n for n in nodes if n["name"] == "lull")
    assert node["version"] == version
    files = {p.name for p in Path(node["package_folder"]).rglob("*")}
    assert {"lull.h", "liblull.a", "LICENSE", "OpenImageDenoiseConfig.cmake"} <= files
    libraries = {"libOpenImageDenoise.a"} if not shared else {
        "libOpenImageDenoise.so", "libOpenImageDenoise.so.2"}
    assert {f for f in files if f.startswith("libOpenImageDenoise")} == libraries
