"""Contact sheet of a data set: python -m training.scenes.sheet FOLDER SHEET.png

For each scene: the target, the noisiest image, its albedo and its normal.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from training import errors
from training.errors import DATA, USAGE, ToolError
from training.imageio import read_image, write_image

from .files import tonemap

END = "spp.hdr.exr"


def _read(path: Path) -> np.ndarray:
    """(h, w, 3)"""
    image = read_image(path)
    return image if image.shape[-1] == 3 else np.repeat(image[..., :1], 3, -1)


def tile(folder: Path, size: int) -> np.ndarray:
    """(size, 4 size, 3) of one scene, values in [0, 1]."""
    found = sorted(folder.glob(f"*{END}"), key=lambda p: int(p.name[:-len(END)].rsplit("_", 1)[1]))
    if len(found) < 2:
        raise ToolError(f"{folder}: no pair of *{END} files", DATA)
    low, high = _read(found[0]), _read(found[-1])
    white = float(np.percentile(high.max(-1), 97))
    parts = [tonemap(high, white), tonemap(low, white)]
    for kind in ("alb", "nrm"):
        path = found[0].with_name(found[0].name.replace(".hdr.exr", f".{kind}.exr"))
        image = _read(path) if path.exists() else np.zeros_like(low)
        parts.append(tonemap(image, 0.8) if kind == "alb" else np.clip(image / 2 + 0.5, 0, 1))
    h, w, _ = low.shape
    y, x = np.arange(size) * h // size, np.arange(size) * w // size
    return np.concatenate([p[y][:, x] for p in parts], 1)


def sheet(folders: list[Path], size: int, columns: int) -> np.ndarray:
    """All tiles in rows of so many columns."""
    tiles = [tile(f, size) for f in folders]
    while len(tiles) % columns:
        tiles.append(np.zeros_like(tiles[0]))
    rows = [np.concatenate(tiles[k:k + columns], 1) for k in range(0, len(tiles), columns)]
    return np.concatenate(rows, 0)


def main(argv: list[str] | None = None) -> None:
    p = errors.Parser(prog="training.scenes.sheet", description=__doc__)
    p.add_argument("folder", type=Path, help="data set: scenes in subfolders")
    p.add_argument("png", type=Path, help="picture to write")
    p.add_argument("--first", type=int, default=0, help="skip so many scenes")
    p.add_argument("--count", type=int, default=60, help="scenes to show")
    p.add_argument("--size", type=int, default=128, help="pixels of one image")
    p.add_argument("--columns", type=int, default=3)
    args = p.parse_args(argv)
    if min(args.count, args.size, args.columns) < 1 or args.first < 0:
        raise ToolError("--count, --size and --columns must be >= 1, --first >= 0", USAGE)
    folders = sorted({f.parent for f in args.folder.glob(f"[!.]*/*{END}")})
    folders = folders[args.first: args.first + args.count]
    if not folders:
        raise ToolError(f"{args.folder}: no scene to show", DATA)
    write_image(args.png, sheet(folders, args.size, args.columns))
    print(f"{args.png}: {len(folders)} scenes, {folders[0].name} to {folders[-1].name}")


if __name__ == "__main__":
    errors.run(main)
