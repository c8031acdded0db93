"""Same weights, same pictures: our oidnDenoise against the real Open Image Denoise 2.5.1.

    python -m bench.peer [--models w16,unet] [--modes hdr,ldr] [--keep DIRECTORY]

Every topology and feature set on pictures of three sizes, compared with OIDN's own metric: relative
error |e-a| / (|e|+|a|+0.01) of at most 0.003 in the mean, and no outlier (a value off by more than
0.02 and by more than 5 %). Prints a table; exit status 1 if a row is beyond the bar, 2 if something
is missing.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from bench import oidn, pictures
from bench.randomnet import write_random
from training import color
from training.imageio import read_pfm
from training.peer import difference

AVERAGE_LIMIT = 0.003
MODELS = ("w16", "unet_small", "unet", "unet_large")


@dataclass(frozen=True)
class Mode:
    """A feature set: the options that name its images, and the first one's transfer function."""

    name: str
    images: dict[str, Callable[[pictures.Picture], np.ndarray]]
    transfer: str
    options: tuple[str, ...] = ()
    signed: bool = False  # the main image is in [-1, 1]


def exposed(p: pictures.Picture) -> np.ndarray:
    """Low dynamic range: middle grey at 0.18, clipped."""
    return np.clip(p.color * np.float32(color.autoexposure(p.color)), 0, 1)


def direction(p: pictures.Picture) -> np.ndarray:
    """A stand-in for a directional light map: normals with the noise of the colour."""
    return np.clip(p.normal * (0.5 + exposed(p)), -1, 1)


COLOR = {"--hdr": lambda p: p.color}
ALBEDO = {"--alb": lambda p: p.albedo}
NORMAL = {"--nrm": lambda p: p.normal}
MODES = (
    Mode("hdr", COLOR, "pu"),
    Mode("hdr+alb", COLOR | ALBEDO, "pu"),
    Mode("hdr+alb+nrm", COLOR | ALBEDO | NORMAL, "pu"),
    Mode("ldr", {"--ldr": exposed}, "srgb"),
    Mode("srgb", {"--ldr": lambda p: color.srgb_forward(exposed(p))}, "linear", ("--srgb",)),
    Mode("albedo", ALBEDO, "srgb"),
    Mode("normal", NORMAL, "linear", signed=True),
    Mode("lightmap hdr", COLOR, "log", ("-f", "RTLightmap")),
    Mode("directional", {"--dir": direction}, "linear", ("-f", "RTLightmap"), signed=True),
)


def codes(mode: Mode, picture: pictures.Picture) -> torch.Tensor:
    """Network input [1,C,H,W] of a picture, for scaling random weights."""
    parts = []
    for i, (option, image) in enumerate(mode.images.items()):
        value = image(picture)
        if i == 0 and mode.transfer == "pu":
            value = value * np.float32(color.autoexposure(value))
        if (i == 0 and mode.signed) or (i > 0 and option == "--nrm"):
            value = value * 0.5 + 0.5
        if i == 0:
            value = color.TRANSFERS[mode.transfer].forward(value)
        parts.append(value)
    return torch.from_numpy(np.concatenate(parts, -1).astype(np.float32)).permute(2, 0, 1)[None]


def compare(mode: Mode, picture: pictures.Picture, weights: Path, folder: Path) -> dict[str, float]:
    """Runs both programs on one picture."""
    images = {option[2:]: image(picture) for option, image in mode.images.items()}
    arguments = [*mode.options, *pictures.write_inputs(folder, images), "-w", weights]
    out = {}
    for name, program in (("theirs", oidn.theirs()), ("ours", oidn.ours())):
        path = folder / f"{name}.pfm"
        path.unlink(missing_ok=True)
        oidn.run(program, "-d", "cpu", "--threads", "1", *arguments, "-o", path)
        out[name] = read_pfm(path)
    average, outliers = difference(out["theirs"], out["ours"])
    return {"average": average, "outliers": outliers,
            "maximum": float(np.abs(out["theirs"] - out["ours"]).max()),
            "spread": float(out["theirs"].std())}


def compare_all(models: list[str], modes: list[Mode], folder: Path) -> int:
    """Prints a row for each case; returns the number of rows beyond the bar."""
    failed = rows = 0
    sizes = pictures.sizes()
    for model in models:
        for mode in modes:
            weights = write_random(folder / "weights.tza", model, codes(mode, sizes[0]),
                                   mode.transfer)
            for picture in sizes:
                row = compare(mode, picture, weights, folder)
                good = row["average"] <= AVERAGE_LIMIT and not row["outliers"]
                good = good and row["spread"] > 1e-3  # a constant picture would prove nothing
                failed, rows = failed + (not good), rows + 1
                print(f"{'ok' if good else 'FAIL':4} {model:10} {mode.name:13} {picture.name:32}"
                      f" average {row['average']:.2e}  outliers {row['outliers']:.0f}"
                      f"  largest {row['maximum']:.2e}  spread {row['spread']:.2e}", flush=True)
    print(f"{rows - failed} passed, {failed} failed, 0 skipped")
    return failed if rows else 1


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", default=",".join(MODELS), help="names of training/configs")
    parser.add_argument("--modes", default="", help=", ".join(m.name for m in MODES))
    parser.add_argument("--keep", help="folder for the last case's files")
    args = parser.parse_args()
    modes = [m for m in MODES if not args.modes or m.name in args.modes.split(",")]
    print(oidn.cpu_line())
    try:
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(args.keep or scratch)
            folder.mkdir(parents=True, exist_ok=True)
            return 1 if compare_all(args.models.split(","), modes, folder) else 0
    except (oidn.PeerError, FileNotFoundError) as error:
        print(f"peer: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
