#!/usr/bin/env python3
"""Compare an image with a reference of the same feature, as a viewer would see them.

    python -m training.compare_image output.hdr.exr reference.hdr.exr -M psnr ssim flip
"""
from __future__ import annotations

if __name__ == "__main__" and not __package__:  # run as a file: go on as a module
    import runpy
    import sys
    sys.path[0] = __file__.rpartition("training")[0] or ".."
    sys.exit(runpy.run_module("training.compare_image", run_name="__main__", alter_sys=True))

from pathlib import Path

from training import errors, metrics
from training.convert_image import load_as
from training.errors import DATA, USAGE, ToolError
from training.settings import parse


def main(argv: list[str]) -> None:
    settings = parse("compare_image", argv, __doc__)
    loaded = [load_as(Path(p)) for p in settings.images]
    (a, feature), (b, other) = loaded
    if feature != other:
        raise ToolError(f"cannot compare different features ({feature}, {other})", USAGE)
    if a.shape[:2] != b.shape[:2]:
        raise ToolError("the images have different sizes "
                        f"({a.shape[1]}x{a.shape[0]}, {b.shape[1]}x{b.shape[0]})", DATA)
    if a.shape[2] != b.shape[2]:
        raise ToolError(f"the images have {a.shape[2]} and {b.shape[2]} channels", DATA)
    for path, image in zip(settings.images, (a, b), strict=True):
        metrics.require_numbers(image, path)
    shown = [metrics.to_display(i, feature, settings.exposure) for i in (a, b)]
    values = metrics.measure(shown[0], shown[1], settings.metric, settings.images[0])
    print(", ".join(f"{k} = {v:.4f}" for k, v in values.items()))


if __name__ == "__main__":
    errors.run(main)
