"""Runs the built-in models on arrays."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.apps import tools
from tests.apps.conftest import runner


@pytest.fixture
def clean_up(build: Path, tmp_path: Path) -> Callable[..., np.ndarray]:
    """clean_up(images, quality, *more options) -> the denoised colour; images by name: color,
    albedo, normal."""
    run = runner(build / "bin" / "oidnDenoise")
    options = {"color": "--hdr", "albedo": "--alb", "normal": "--nrm"}

    def denoise(images: dict[str, np.ndarray], quality: str = "high",
                *more: str) -> np.ndarray:
        arguments: list[object] = ["-q", quality, "-o", tmp_path / "out.pfm", *more]
        for name, option in options.items():
            if name in images:
                image = np.asarray(images[name], np.float32)
                arguments += [option, tools.write_pfm(tmp_path / f"{name}.pfm", image)]
        done = run(*arguments)
        assert done.code == 0, done.err
        return tools.read_pfm(tmp_path / "out.pfm").astype(np.float64)

    return denoise
