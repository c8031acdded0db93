"""What `-q auto` takes, what that costs against `high`, and what work it saves.

    python -m bench.auto FOLDER... [--features hdr,alb,nrm] [--size 640] [--json FILE]

Pictures with references, found as training.evaluate finds them. Smaller ones than --size are
repeated, every second copy mirrored, because `auto` samples large frames only. PSNR on tone-mapped
sRGB at the auto-exposure of the reference. Work is multiply-adds of the networks: of the model
taken and of the whole sample, as if it never ended early, in parts of the work of `high`.
"""

from __future__ import annotations

import argparse
import functools
import json
import re
import sys
import tempfile
from pathlib import Path

import numpy as np

from bench import oidn
from export import manifest
from training import color, metrics
from training.evaluate import Case, find_cases, has_features
from training.features import load
from training.imageio import read_image, write_image
from training.peer import OPTION

QUALITIES = ("fast", "balanced", "high")
TAKEN = re.compile(r"^  quality=(\w+)$", re.MULTILINE)


def built_in() -> dict[str, str]:
    """Files in weights/ by quality, those that are built in for a colour."""
    text = (manifest.FOLDER / "builtin.def").read_text()
    found = {quality.lower(): file for file, quality in re.findall(
        r'^BUILTIN\(\w+, "([^"]+)"[^)]*ANY_FEATURES[^)]*?(\w+)\)$', text, re.MULTILINE)}
    return {quality: found[quality] for quality in QUALITIES}


@functools.cache
def multiply_adds() -> dict[str, float]:
    """Thousands per pixel that the built-in model of each quality takes for a colour, from
    weights/MANIFEST."""
    nets = {row["file"]: row["net"] for row in manifest.read(manifest.FOLDER / "MANIFEST")}
    return {quality: float(re.search(r"([\d.]+) kMAC/px", nets[file])[1])
            for quality, file in built_in().items()}


def enlarge(image: np.ndarray, size: int) -> np.ndarray:
    """Repeated and mirrored to `size` rows and columns, where there are fewer."""
    more = [(0, max(0, size - n)) for n in image.shape[:2]]
    return np.ascontiguousarray(np.pad(image, (*more, (0, 0)), "symmetric"))


def defined(name: str) -> int:
    """A size of the sample, from the source that takes it."""
    text = (oidn.ROOT / "oidn" / "auto.c").read_text()
    return int(re.search(rf"^#define {name} (\d+)u", text, re.MULTILINE)[1])


def sampled(height: int, width: int) -> float:
    """Part of the frame's pixels that the windows are."""
    space = defined("SPACE")
    rows, columns = (min(defined("MOST"), (n + space // 2) // space) for n in (height, width))
    return rows * columns * defined("WINDOW") ** 2 / (height * width)


def denoise(images: dict[str, np.ndarray], quality: str, folder: Path) -> tuple[np.ndarray, str]:
    """The result, and the quality that it says it has."""
    options: list[str | Path] = []
    for feature, image in images.items():
        write_image(folder / f"{feature}.pfm", image)
        options += [OPTION[feature], folder / f"{feature}.pfm"]
    run = oidn.run(oidn.ours(), *options, "-q", quality, "-o", folder / "out.pfm")
    taken = TAKEN.search(run.output)
    return read_image(folder / "out.pfm"), taken[1] if taken else quality


def measure(case: Case, features: list[str], size: int) -> dict:
    images = {f: enlarge(i, size) for f, i in load(case.source, features).items()}
    target = enlarge(load(case.target, ["hdr"])["hdr"], size)
    exposure = color.autoexposure(target)
    shown = metrics.to_display(target, "hdr", exposure)
    with tempfile.TemporaryDirectory() as scratch:
        found = {q: denoise(images, q, Path(scratch)) for q in (*QUALITIES, "auto")}
    score = {q: metrics.psnr(metrics.to_display(image, "hdr", exposure), shown)
             for q, (image, _) in found.items()}
    taken = found["auto"][1]
    if not np.array_equal(found["auto"][0], found[taken][0]):
        raise oidn.PeerError(f"{case.name}: auto took {taken}, but its result is another one")
    work = multiply_adds()
    sample = sum(work.values()) * sampled(*target.shape[:2])
    return {"case": case.name, "spp": case.source.spp or 0, "taken": taken, **score,
            "lost": score["high"] - score["auto"],
            "work": (work[taken] + sample) / work["high"]}


def line(row: dict) -> str:
    cells = [f"{row[k]:.2f}" for k in (*QUALITIES, "lost")]
    return f"| {row['case']} | {row['taken']} | {' | '.join(cells)} | {row['work']:.0%} |"


def summary(rows: list[dict]) -> str:
    if not rows:
        return "no pictures"
    counts = ", ".join(f"{q} {sum(r['taken'] == q for r in rows)}" for q in QUALITIES)
    lost = [r["lost"] for r in rows]
    return (f"{len(rows)} pictures: {counts}; lost {np.mean(lost):.3f} dB on average, "
            f"{max(lost):.2f} at most; work {np.mean([r['work'] for r in rows]):.0%} of high")


def main(argv: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.auto", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--features", default="hdr,alb,nrm")
    parser.add_argument("--size", type=int, default=640)
    parser.add_argument("--every", type=int, default=1, metavar="N", help="each N-th picture only")
    parser.add_argument("--json", type=Path, help="all figures")
    args = parser.parse_args(argv)
    features = args.features.split(",")
    figures = []
    for folder in args.folders:
        print(f"**{folder.name}**, {args.features}\n")
        print("| picture | taken | fast | balanced | high | lost, dB | work |")
        print("|---|---|---:|---:|---:|---:|---:|")
        rows = []
        cases = [c for c in find_cases(folder) if has_features(c.source, features)]
        for case in cases[::args.every]:
            rows.append(measure(case, features, args.size))
            print(line(rows[-1]), flush=True)
        print(f"\n{summary(rows)}")
        for low, high in ((1, 4), (5, 16), (17, 64)):
            print(f"{low} to {high} samples: "
                  f"{summary([r for r in rows if low <= r['spp'] <= high])}")
        print()
        figures += rows
    if args.json:
        args.json.write_text(json.dumps(figures, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except (oidn.PeerError, OSError) as error:
        print(f"auto: {error}", file=sys.stderr)
        sys.exit(1)
