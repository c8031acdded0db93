"""The real Open Image Denoise (PyPI package pyoidn), as a peer to compare with. Optional."""
from __future__ import annotations

import importlib.util
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from training.errors import STATE, ToolError
from training.imageio import read_image, write_image

OPTION = {"hdr": "--hdr", "ldr": "--ldr", "sh1": "--dir", "alb": "--alb", "nrm": "--nrm"}


def find_binary() -> Path | None:
    """oidnDenoise of an installed pyoidn, or None."""
    spec = importlib.util.find_spec("pyoidn")
    for place in (spec.submodule_search_locations or []) if spec else []:
        path = Path(place) / "oidn" / "bin" / "oidnDenoise"
        if path.exists():
            return path
    return None


def takes(features: list[str]) -> bool:
    """Whether it denoises with these: normals go with an albedo only."""
    return "alb" in features or "nrm" not in features


def denoise(binary: Path, images: dict[str, np.ndarray], weights: Path | None = None,
            quality: str = "high", threads: int = 1) -> np.ndarray:
    """Denoise features of one picture ([H,W,3] by name) with its own or with given weights."""
    with tempfile.TemporaryDirectory() as tmp:
        command = [str(binary), "-d", "cpu", "-q", quality, "-o", f"{tmp}/out.pfm", "--threads",
                   str(threads)]
        for feature, image in images.items():
            write_image(Path(tmp) / f"{feature}.pfm", image)
            command += [OPTION[feature], f"{tmp}/{feature}.pfm"]
        if weights:
            command += ["-w", str(weights)]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode or not Path(f"{tmp}/out.pfm").exists():
            text = (done.stderr or done.stdout).strip().splitlines()
            raise ToolError(f"oidnDenoise failed: {text[-1] if text else done.returncode}", STATE)
        return read_image(Path(tmp) / "out.pfm")


def difference(a: np.ndarray, b: np.ndarray) -> tuple[float, int]:
    """(mean relative error, outliers) as Open Image Denoise compares images."""
    error = np.abs(a - b)
    relative = error / (np.abs(a) + np.abs(b) + 0.01)
    return float(relative.mean()), int((~((error <= 0.02) | (relative <= 0.05))).sum())
