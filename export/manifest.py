#!/usr/bin/env python3
"""weights/MANIFEST: what each weights file is, one row per file, fields separated by tabs.

    python -m export.manifest --check
    python -m export.manifest --add rt_hdr_w16.tza --features hdr --data ... --config ... \\
        --scores ... [--licence Apache-2.0]

Fields: file, sha256, net, features, data, config, scores, licence. `net` (topology, widths, cost)
is read from the file; --add replaces the row of a file that is listed already.
"""
from __future__ import annotations

import hashlib
import sys
from pathlib import Path

from export.kernel import IntTrunk, int_trunk
from export.tza import Reader, TzaError
from training import errors
from training.errors import USAGE, ToolError
from training.imageio import replacing

FOLDER = Path(__file__).resolve().parent.parent / "weights"
FIELDS = ("file", "sha256", "net", "features", "data", "config", "scores", "licence")
TEXT = """# Weights files: one row each, fields separated by tabs. Written by export/manifest.py.
# """ + "\t".join(FIELDS) + "\n"


def read(path: Path) -> list[dict[str, str]]:
    """Rows of a MANIFEST."""
    rows = []
    for number, line in enumerate(path.read_text().splitlines(), 1):
        if not line or line.startswith("#"):
            continue
        fields = line.split("\t")
        if len(fields) != len(FIELDS):
            raise ValueError(f"{path}:{number}: {len(fields)} fields instead of {len(FIELDS)}")
        rows.append(dict(zip(FIELDS, fields)))
    return rows


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def macs_per_pixel(model: IntTrunk) -> float:
    """Multiply-adds per full-resolution pixel, of the 3x3 kernels before folding and the heads."""
    total = 0.0
    for x, area in zip(model.layers, model.net.areas(), strict=True):
        inputs = x.weight.shape[1] + (x.skip.shape[1] if x.skip is not None else 0)
        taps = 1 if x.weight.shape[2] == 3 and not x.weight[:, :, 0].any() else 9
        total += area * taps * inputs * x.outputs
    return total


def describe(path: Path) -> str:
    """Topology, widths and cost of a weights file."""
    from training.nets import from_tensors, identify
    tensors = Reader(path)
    net = identify(list(tensors))
    if net.family == "K":
        trunk = int_trunk(tensors, str(path))
        widths = ",".join(str(x.outputs) for x in trunk.layers[:len(net.layers)])
        return f"{net.name} {widths} {macs_per_pixel(trunk) / 1000:.1f} kMAC/px, int8"
    model = from_tensors(tensors)
    widths = [getattr(model, layer.name).out_channels for layer in model.net.layers]
    macs = model.macs_per_pixel() / 1000
    return f"{model.net.name} {','.join(map(str, widths))} {macs:.1f} kMAC/px"


def check(folder: Path) -> list[str]:
    """What is wrong: files without a row, rows without a file, wrong sums, unreadable files."""
    problems = []
    try:
        rows = read(folder / "MANIFEST")
    except (OSError, ValueError) as e:
        return [str(e)]
    listed = [r["file"] for r in rows]
    problems += [f"{f}: listed twice" for f in sorted(set(listed)) if listed.count(f) > 1]
    there = sorted(p.name for p in folder.glob("*.tza"))
    problems += [f"{f}: has no row" for f in there if f not in listed]
    for row in rows:
        path = folder / row["file"]
        if not path.exists():
            problems.append(f"{row['file']}: is missing")
            continue
        if digest(path) != row["sha256"]:
            problems.append(f"{row['file']}: sha256 differs")
        try:
            Reader(path)
        except TzaError as e:
            problems.append(str(e))
        problems += [f"{row['file']}: no {k}" for k in FIELDS if not row[k].strip()]
    return problems


def add(folder: Path, row: dict[str, str]) -> None:
    """Adds a row to a MANIFEST, or replaces that of its file. ToolError if it does not fit into
    one; ValueError if the MANIFEST cannot be read."""
    for field in FIELDS:
        if "\t" in row[field] or len(f"{row[field]}|".splitlines()) > 1:
            raise ToolError(f"--{field}: tabs and line breaks end a field", USAGE)
        if not row[field].strip():
            raise ToolError(f"--{field}: says nothing", USAGE)
    path = folder / "MANIFEST"
    rows = [r for r in (read(path) if path.exists() else []) if r["file"] != row["file"]]
    rows = sorted([*rows, row], key=lambda r: r["file"])
    with replacing(path) as tmp:
        tmp.write_text(TEXT + "".join("\t".join(r[f] for f in FIELDS) + "\n" for r in rows))


def main(argv: list[str]) -> None:
    parser = errors.Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=FOLDER)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--add", metavar="FILE")
    parser.add_argument("--net", help="description of the network (default: read from the file)")
    for field in ("features", "data", "config", "scores"):
        parser.add_argument(f"--{field}", default="")
    parser.add_argument("--licence", default="Apache-2.0")
    args = parser.parse_args(argv)
    if args.add:
        path = args.folder / args.add
        with errors.reading(path):
            add(args.folder, {"file": args.add, "sha256": digest(path),
                              "net": args.net or describe(path), "features": args.features,
                              "data": args.data, "config": args.config, "scores": args.scores,
                              "licence": args.licence})
    problems = check(args.folder)
    print("\n".join(problems) or f"{len(read(args.folder / 'MANIFEST'))} weights files as listed",
          file=sys.stderr if problems else sys.stdout)
    if problems:
        sys.exit(1)


if __name__ == "__main__":
    errors.run(main)
