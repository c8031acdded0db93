"""Fixtures for the tests of training/ and export/."""

from __future__ import annotations

import functools
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import hypothesis
import pytest
import torch

from export import quantize
from tests.training.tools import make_raw
from training.errors import ToolError

torch.set_num_threads(1)
# How long an example takes says nothing: the machine may be slow or busy.
hypothesis.settings.register_profile("any speed", deadline=None,
                                     suppress_health_check=[hypothesis.HealthCheck.too_slow])
hypothesis.settings.load_profile("any speed")


@pytest.fixture(scope="session")
def raw(tmp_path_factory) -> Path:
    """A data folder with the raw data sets `train` (5 groups) and `valid` (2 groups)."""
    data = tmp_path_factory.mktemp("data")
    make_raw(data / "train")
    make_raw(data / "valid", 2)
    return data


@pytest.fixture(scope="session")
def int8_of(root, tmp_path_factory) -> Callable[[str], Path]:
    """What export.quantize makes of a U-Net in weights/, once for all: int8_of(name)."""
    @functools.cache
    def made(name: str) -> Path:
        path = tmp_path_factory.mktemp("int8") / f"{name}.tza"
        quantize.main([str(root / "weights" / f"{name}.tza"), str(path)])
        return path
    return made


@pytest.fixture
def work(tmp_path, monkeypatch) -> Path:
    """An empty working folder that the scripts run in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def fails() -> Callable:
    """Runs a script's main that must fail: fails(main, argv) -> (exit code, message)."""
    def run(main: Callable, argv: list[str]) -> tuple[int, str]:
        with pytest.raises(ToolError) as caught:
            main(argv)
        assert "\n" not in str(caught.value), "an error is one line"
        return caught.value.code, str(caught.value)
    return run


@pytest.fixture(scope="session")
def script(root) -> Callable:
    """Runs a script as a process: script("train", args...) -> CompletedProcess with text."""
    def run(name: str, *args: str, cwd: Path | None = None, **kwargs):
        return subprocess.run([sys.executable, str(root / "training" / f"{name}.py"), *args],
                              cwd=cwd, capture_output=True, text=True, **kwargs)
    return run
