"""Every compiler at every level of optimisation makes the bytes that test_schedules.c has written
down, on every port."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent.parent


def make(target: str, compiler: str, level: str, folder: Path) -> Path:
    # Not the settings of the make that may have called this test.
    env = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "CFLAGS")}
    subprocess.run(["make", "-s", f"-j{os.cpu_count()}", f"CC={compiler}", f"OPT={level}",
                    f"BUILD={folder}", "SAN=", folder / target],
                   cwd=ROOT, env=env, check=True, stdout=subprocess.DEVNULL)
    return folder / target


def is_built(build: Path, compiler: str, level: str, folder: Path) -> bool:
    """Whether the build folder's core was compiled so: its compiler is this one by any name."""
    settings = (build / "settings.txt").read_text()
    name = settings.split(" compiler ")[1].split()[0]
    if os.path.realpath(shutil.which(name) or name) != os.path.realpath(shutil.which(compiler)):
        return False
    return make("settings.txt", name, level, folder).read_text() == settings


@pytest.mark.parametrize("level", ["-O0", "-O1", "-O2", "-O3"])
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_same_bytes(compiler: str, level: str, build: Path, tmp_path: Path):
    if not shutil.which(compiler):
        pytest.skip(f"optional: {compiler} is not installed")
    core, program = build / "lib" / "liblull.a", tmp_path / "test_schedules"
    if not (core.exists() and is_built(build, compiler, level, tmp_path)):
        core = make("lib/liblull.a", compiler, level, tmp_path)
    subprocess.run([compiler, "-std=c99", level, "-ffp-contract=off", "-Ilib",
                    "tests/golden/test_schedules.c", core, "-lm", "-o", program],
                   cwd=ROOT, check=True)
    done = subprocess.run([program], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
