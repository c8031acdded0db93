#!/usr/bin/env python3
"""Convert an image between features and formats; the double extension says what is in it.

    python -m training.convert_image render.hdr.exr render.srgb.png [-E exposure]
"""
from __future__ import annotations

if __name__ == "__main__" and not __package__:  # run as a file: go on as a module
    import runpy
    import sys
    sys.path[0] = __file__.rpartition("training")[0] or ".."
    sys.exit(runpy.run_module("training.convert_image", run_name="__main__", alter_sys=True))

from pathlib import Path

import numpy as np

from training import color, errors, metrics
from training.errors import USAGE, ToolError
from training.imageio import (LINEAR_FORMATS, WRITERS, read_display, read_image, read_placed,
                              write_image)
from training.settings import parse

KINDS = ("hdr", "ldr", "srgb", "sh1", "sh1x", "sh1y", "sh1z", "alb", "nrm", "z", "a")


def feature_of(path: Path) -> str:
    """The feature in a name like x.alb.exr; without one, hdr for float formats, else srgb."""
    kind = Path(path.stem).suffix[1:].lower()
    if kind in KINDS:
        return "sh1" if kind.startswith("sh1") else kind
    return "hdr" if path.suffix[1:].lower() in LINEAR_FORMATS else "srgb"


def load_as(path: Path) -> tuple[np.ndarray, str]:
    """(values in the range of the feature, feature). PNG holds sRGB codes, of normals too."""
    image, feature = read_image(path), feature_of(path)
    if path.suffix[1:].lower() not in LINEAR_FORMATS:
        if feature in ("nrm", "sh1"):
            raise ToolError(f"{path}: {feature} cannot be taken from a display picture", USAGE)
        if feature != "srgb":
            image = color.srgb_inverse(image)
    return image, feature


def convert(image: np.ndarray, source: str, target: str, exposure: float) -> np.ndarray:
    """Values of one feature as another; HDR is tone mapped where the target is not HDR."""
    with np.errstate(over="ignore"):  # radiance may become infinite
        exposed = image * np.float32(exposure) if source == "hdr" else image
    if source == target:
        return exposed
    if target == "srgb":
        return metrics.to_display(image, source, exposure)
    if source == "hdr" and target in ("ldr", "alb"):
        return color.tonemap(exposed)
    if source == "srgb" and target in ("hdr", "ldr", "alb"):
        return color.srgb_inverse(image)
    if {source, target} <= {"hdr", "ldr", "alb"}:
        return image
    raise ToolError(f"cannot convert {source} to {target}", USAGE)


def main(argv: list[str]) -> None:
    settings = parse("convert_image", argv, __doc__)
    source, target = (Path(p) for p in settings.images)
    if target.suffix[1:].lower() not in WRITERS:
        raise ToolError(f"{target}: unknown format (known: {' '.join(WRITERS)})", USAGE)
    image, feature = load_as(source)
    wanted = feature_of(target)
    result = convert(image, feature, wanted, settings.exposure)
    if target.suffix[1:].lower() not in LINEAR_FORMATS and wanted != "srgb":
        result = metrics.to_codes(result, wanted)
    place = {}
    if source.suffix.lower() == target.suffix.lower() == ".exr":
        place = {"origin": read_placed(source)[1], "display": read_display(source)}
    write_image(target, result, **place)


if __name__ == "__main__":
    errors.run(main)
