"""Contact sheet of a data set: python -m training.scenes.sheet FOLDER SHEET.png

For each scene: the target, the noisiest image, its albedo and its normal.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from training import errors, features
from training.errors import DATA, USAGE, ToolError
from training.imageio import write_image
from training.scan import Group, scan

from .files import tonemap


def tile(group: Group, size: int) -> np.ndarray:
    """(size, 4 size, 3) of one scene, values in [0, 1]."""
    version, opened = group.inputs[0], {}
    low = features.load(version, ["hdr"], None, opened)["hdr"]
    high = features.load(group.target, ["hdr"])["hdr"]
    white = float(np.percentile(high.max(-1), 97))
    parts = [tonemap(high, white), tonemap(low, white)]
    for kind in ("alb", "nrm"):
        held = features.holds(version, [kind], None, opened)
        image = (features.load(version, [kind], None, opened)[kind] if held
                 else np.zeros_like(low))
        parts.append(tonemap(image, 0.8) if kind == "alb" else np.clip(image / 2 + 0.5, 0, 1))
    h, w, _ = low.shape
    y, x = np.arange(size) * h // size, np.arange(size) * w // size
    return np.concatenate([p[y][:, x] for p in parts], 1)


def sheet(groups: list[Group], size: int, columns: int) -> np.ndarray:
    """All tiles in rows of so many columns."""
    tiles = [tile(g, size) for g in groups]
    while len(tiles) % columns:
        tiles.append(np.zeros_like(tiles[0]))
    rows = [np.concatenate(tiles[k:k + columns], 1) for k in range(0, len(tiles), columns)]
    return np.concatenate(rows, 0)


def main(argv: list[str] | None = None) -> None:
    p = errors.Parser(prog="training.scenes.sheet", description=__doc__)
    p.add_argument("folder", type=Path, help="data set")
    p.add_argument("png", type=Path, help="picture to write")
    p.add_argument("--first", type=int, default=0, help="skip so many scenes")
    p.add_argument("--count", type=int, default=60, help="scenes to show")
    p.add_argument("--size", type=int, default=128, help="pixels of one image")
    p.add_argument("--columns", type=int, default=3)
    args = p.parse_args(argv)
    if min(args.count, args.size, args.columns) < 1 or args.first < 0:
        raise ToolError("--count, --size and --columns must be >= 1, --first >= 0", USAGE)
    groups = scan(args.folder, ["hdr"]).groups[args.first: args.first + args.count]
    if not groups:
        raise ToolError(f"{args.folder}: no scene to show", DATA)
    write_image(args.png, sheet(groups, args.size, args.columns))
    print(f"{args.png}: {len(groups)} scenes, {groups[0].name} to {groups[-1].name}")


if __name__ == "__main__":
    errors.run(main)
