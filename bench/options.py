"""What options of oidnDenoise bring, on EXR files with references.

    python -m bench.options FOLDER... --with=--split --with="-q balanced --split" [--oidn]

Pictures as training.evaluate finds them, each in one file, which the program reads as it is: PSNR,
SSIM and FLIP on tone-mapped sRGB at the auto-exposure of the reference, means by sample count,
without options and with each set of them; --oidn adds Open Image Denoise high, without.
"""

from __future__ import annotations

import argparse
import shlex
import sys
import tempfile
from pathlib import Path

import numpy as np

from bench import oidn
from training import color, metrics, peer
from training.errors import ToolError
from training.evaluate import Case, find_cases
from training.features import load
from training.imageio import read_image

NAMES = ["psnr", "ssim", "flip"]
FEATURES = ["hdr", "alb", "nrm"]
PEER = "OIDN high"


def denoise(case: Case, options: str) -> np.ndarray:
    """What our program makes of the file of a case."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.pfm"
        oidn.run(oidn.ours(), case.source.files["*"], *shlex.split(options), "-o", out)
        return read_image(out)


def measure(case: Case, sets: list[str], with_peer: bool) -> dict[str, dict[str, float]]:
    """Scores by set of options."""
    target = load(case.target, ["hdr"])["hdr"]
    exposure = color.autoexposure(target)
    shown = metrics.to_display(target, "hdr", exposure)
    results = {options: denoise(case, options) for options in sets}
    if with_peer:
        results[PEER] = peer.denoise(oidn.theirs(), load(case.source, FEATURES))
    return {name: metrics.measure(metrics.to_display(image, "hdr", exposure), shown, NAMES,
                                  case.name) for name, image in results.items()}


def table(scores: dict[int, list[dict[str, dict[str, float]]]]) -> list[str]:
    """Scores by sample count and case: a row for each count and set, with what the set gains on
    average and in the worst case."""
    lines = ["| samples | pictures | options | PSNR | SSIM | FLIP | gain, dB | least |",
             "|---:|---:|---|---:|---:|---:|---:|---:|"]
    for spp, cases in sorted(scores.items()):
        for name in cases[0]:
            mean = {m: np.mean([c[name][m] for c in cases]) for m in NAMES}
            gains = [c[name]["psnr"] - c[""]["psnr"] for c in cases]
            lines.append(f"| {spp} | {len(cases)} | {name or '-'} | {mean['psnr']:.2f} "
                         f"| {mean['ssim']:.4f} | {mean['flip']:.4f} | {np.mean(gains):+.2f} "
                         f"| {min(gains):+.2f} |")
    return lines


def main(argv: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.options", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--with", dest="sets", action="append", default=[], metavar="OPTIONS",
                        help="a set of options; may be given several times")
    parser.add_argument("--oidn", action="store_true", help="Open Image Denoise high, too")
    args = parser.parse_args(argv)
    for folder in args.folders:
        cases = [c for c in find_cases(folder) if "*" in c.source.files]
        if not cases:
            raise ToolError(f"{folder}: no EXR files of several layers with a reference")
        scores: dict[int, list] = {}
        for case in cases:
            scores.setdefault(case.source.spp or 0, []).append(
                measure(case, ["", *args.sets], args.oidn))
        print("\n".join([f"**{folder.name}**", "", *table(scores), ""]), flush=True)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except (oidn.PeerError, ToolError) as err:
        print(f"error: {err}", file=sys.stderr)
        sys.exit(1)
