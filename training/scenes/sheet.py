"""Contact sheet of a data set: python -m training.scenes.sheet FOLDER SHEET.png

For each scene: the target, the noisiest image, its albedo and its normal.
"""

from __future__ import annotations

import argparse
import glob
import os
import sys

import numpy as np

from . import exr
from .backend import SceneError


def tile(folder: str, size: int) -> np.ndarray:
    """uint8 (size, 4 size, 3) of one scene."""
    found = sorted(glob.glob(os.path.join(folder, "*spp.hdr.exr")),
                   key=lambda p: int(p[:-len("spp.hdr.exr")].rsplit("_", 1)[1]))
    if len(found) < 2:
        raise SceneError(f"{folder}: no pair of *spp.hdr.exr files", 4)
    low, high = exr.read_exr(found[0]), exr.read_exr(found[-1])
    white = float(np.percentile(high.max(-1), 97))
    parts = [exr.tonemap(high, white), exr.tonemap(low, white)]
    for kind in ("alb", "nrm"):
        path = found[0].replace(".hdr.exr", f".{kind}.exr")
        if os.path.exists(path):
            a = exr.read_exr(path)
            a = exr.tonemap(a, 0.8) if kind == "alb" else np.uint8(np.clip(a * 127 + 128, 0, 255))
        else:
            a = np.zeros_like(parts[0])
        parts.append(a)
    h, w, _ = parts[0].shape
    y, x = np.arange(size) * h // size, np.arange(size) * w // size
    return np.concatenate([p[y][:, x] for p in parts], 1)


def sheet(folders: list[str], size: int, columns: int) -> np.ndarray:
    tiles = [tile(f, size) for f in folders]
    while len(tiles) % columns:
        tiles.append(np.zeros_like(tiles[0]))
    rows = [np.concatenate(tiles[k:k + columns], 1) for k in range(0, len(tiles), columns)]
    return np.concatenate(rows, 0)


def main(argv: list[str] | None = None) -> int:
    p = argparse.ArgumentParser(prog="training.scenes.sheet", description=__doc__,
                                formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("folder", help="data set: scenes in subfolders")
    p.add_argument("png", help="picture to write")
    p.add_argument("--first", type=int, default=0, help="skip so many scenes")
    p.add_argument("--count", type=int, default=60)
    p.add_argument("--size", type=int, default=128, help="pixels of one image")
    p.add_argument("--columns", type=int, default=3)
    args = p.parse_args(argv)
    try:
        folders = sorted({os.path.dirname(x) for x in
                          glob.glob(os.path.join(args.folder, "*", "*spp.hdr.exr"))})
        folders = folders[args.first: args.first + args.count]
        if not folders:
            raise SceneError(f"{args.folder}: no scene to show", 2)
        exr.write_png(args.png, sheet(folders, args.size, args.columns))
        print(f"{args.png}: {len(folders)} scenes, "
              f"{os.path.basename(folders[0])} to {os.path.basename(folders[-1])}")
        return 0
    except SceneError as err:
        print(f"error: {err}", file=sys.stderr)
        return err.code
    except OSError as err:
        print(f"error: {err.filename or args.png}: {err.strerror}", file=sys.stderr)
        return 4


if __name__ == "__main__":
    sys.exit(main())
