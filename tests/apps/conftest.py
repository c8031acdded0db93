"""Fixtures: the programs, weights that change nothing, and a working folder."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.apps.tools import (identity_weights, noise, planes, write_exr, write_png,
                              write_scene)


@dataclass(frozen=True)
class Run:
    """A finished program."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> dict:
        return json.loads(self.out)

    @property
    def error(self) -> str:
        """The one error line."""
        lines = self.err.splitlines()
        assert len(lines) == 1 and lines[0].startswith("Error: "), self.err
        return lines[0]


def runner(program: Path) -> Callable[..., Run]:
    def run(*arguments: object, cwd: Path | None = None) -> Run:
        done = subprocess.run(
            [program, *map(str, arguments)],
            cwd=cwd,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=600,
        )
        assert done.returncode >= 0, f"ended by signal {-done.returncode}: {done.stderr}"
        return Run(done.returncode, done.stdout, done.stderr)

    return run


@pytest.fixture(scope="session")
def denoise(build: Path) -> Callable[..., Run]:
    """Runs oidnDenoise."""
    return runner(build / "bin" / "oidnDenoise")


@pytest.fixture(scope="session")
def benchmark(build: Path) -> Callable[..., Run]:
    """Runs oidnBenchmark."""
    return runner(build / "bin" / "oidnBenchmark")


@pytest.fixture(scope="session")
def info(build: Path) -> Callable[..., Run]:
    """Runs lullInfo."""
    return runner(build / "bin" / "lullInfo")


@pytest.fixture(scope="session")
def identity(tmp_path_factory) -> dict[int, Path]:
    """Weights for 3, 6 and 9 inputs that give back the main image."""
    folder = tmp_path_factory.mktemp("weights")
    return {n: identity_weights(folder / f"identity{n}.tza", n) for n in (3, 6, 9)}


@pytest.fixture
def work(tmp_path: Path, monkeypatch) -> Path:
    """An empty working folder that the programs run in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def frame(work: Path) -> dict:
    """color.pfm, albedo.pfm, normal.pfm, clean.pfm, 64x48 pixels, in the working folder."""
    return write_scene(work, 48, 64)



@pytest.fixture(scope="session")
def formats(build: Path, tmp_path_factory) -> frozenset[str]:
    """Optional formats that the programs were built with: exr, png."""
    folder = tmp_path_factory.mktemp("formats")
    run = runner(build / "bin" / "lullInfo")
    files = {
        "exr": write_exr(folder / "a.exr", planes("", noise(2, 2))),
        "png": write_png(folder / "a.png", (noise(2, 2) * 255).astype(int)),
    }
    return frozenset(name for name, path in files.items() if run(path).code == 0)


@pytest.fixture
def exr(formats) -> None:
    """Skips the test if the programs were built without OpenEXR."""
    if "exr" not in formats:
        pytest.skip("optional: the programs were built without OpenEXR")


@pytest.fixture
def png(formats) -> None:
    """Skips the test if the programs were built without libpng."""
    if "png" not in formats:
        pytest.skip("optional: the programs were built without libpng")
