#!/usr/bin/env python3
"""Split a multichannel EXR into one file per feature, as preprocessing reads them.

    python -m training.split_exr render_0004spp.exr [--layer ViewLayer]

Writes <stem>.<feature>.exr beside the input. Features without channels are named.
"""
from __future__ import annotations

if __name__ == "__main__" and not __package__:  # run as a file: go on as a module
    import runpy
    import sys
    sys.path[0] = __file__.rpartition("training")[0] or ".."
    sys.exit(runpy.run_module("training.split_exr", run_name="__main__", alter_sys=True))

from pathlib import Path

from training import errors
from training.errors import DATA, ToolError
from training.exr_channels import Channels
from training.imageio import read_exr_channels, replacing, stack, write_exr
from training.layers import find_images
from training.settings import parse

FEATURES = ("hdr", "a", "alb", "nrm", "z")


def main(argv: list[str]) -> None:
    settings = parse("split_exr", argv, __doc__)
    path = Path(settings.input)
    if path.suffix.lower() not in (".exr", ".cxr"):
        raise ToolError(f"{path}: the image must be an EXR", DATA)
    channels = read_exr_channels(path)
    layer = settings.layer
    if layer:
        prefix = layer.rstrip(".") + "."
        names = {n: n for n in channels} | channels.plain
        chosen = {n[len(prefix):]: full for n, full in names.items() if n.startswith(prefix)}
        channels = channels.called(chosen)
        if not channels:
            raise ToolError(f"{path}: no channels in layer '{layer}'", DATA)
    print("Channels: " + " ".join(channels))
    written = [f for f in FEATURES if split(path, channels, f)]
    missing = [f for f in FEATURES if f not in written]
    if not written:
        raise ToolError(f"{path}: no known channels (--layer chooses one)", DATA)
    if missing:
        print("Not found: " + " ".join(missing))


def split(path: Path, channels: Channels, feature: str) -> bool:
    """Write one feature if its channels are there."""
    names = find_images(feature, channels)
    if names is None:
        return False
    out = path.with_name(f"{path.stem}.{feature}.exr")
    with replacing(out) as tmp:
        write_exr(tmp, stack(path, channels, names), None, channels.origins[names[0]],
                  channels.display)
    print(f"{out} <- {' '.join(names)}")
    return True


if __name__ == "__main__":
    errors.run(main)
