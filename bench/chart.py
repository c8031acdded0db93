"""Speed against accuracy: docs/chart.svg and docs/chart.md, from one run.

    python -m bench.chart [--images DIR] [--held_out DIR:N] [--size 1920x1080] [--rounds 3]

The real Open Image Denoise 2.5.1 (fast, balanced, high), lull's built-in models, every file of
weights/ for the same inputs (fp16 and, where it can be quantised, int8), a joint bilateral filter
with the same auxiliary images, and the noisy input. Accuracy: pictures with a reference and with
albedo and normal, through the programs themselves. Speed and memory: one frame of --size,
alternating.
"""

from __future__ import annotations

import argparse
import datetime
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bench import oidn, pictures, speed
from bench.bilateral import joint_bilateral
from bench.svg import Point, chart
from export import manifest
from training import color, metrics
from training.errors import ToolError
from training.evaluate import Case, find_cases, has_features, held_out_cases, parse_held_out
from training.features import load
from training.imageio import read_pfm

FEATURES = ["hdr", "alb", "nrm"]
NAMES = ("psnr", "ssim", "flip", "relmse")
DOCS = oidn.ROOT / "docs"


@dataclass
class Method:
    """One point of the chart: a program (or none), its scores by case, and its cost."""

    name: str
    kind: str  # lull, oidn, classic, input
    entry: speed.Entry | None = None
    bytes: int = 0  # of its weights; 0: unknown or none
    ms_per_mp: float = 0.0
    scores: dict[str, dict[str, float]] = field(default_factory=dict)  # case -> metric -> value

    def mean(self, metric: str, cases: list[str]) -> float:
        return float(np.mean([self.scores[c][metric] for c in cases]))


def methods(folder: Path) -> list[Method]:
    """Everything that is compared."""
    found = [Method("noisy", "input"), Method("joint bilateral", "classic")]
    for quality in ("fast", "balanced", "high"):
        found.append(Method(f"OIDN {quality}", "oidn",
                            speed.Entry("", oidn.theirs(), ("-q", quality))))
        found.append(Method(f"lull {quality}", "lull",
                            speed.Entry("", oidn.ours(), ("-q", quality))))
    for n in speed.ENSEMBLES:
        found.append(Method(f"lull high, mean of {n}", "lull",
                            speed.Entry("", oidn.ours(), ("--ensemble", n))))
    built_in = (oidn.ROOT / "weights" / "builtin.def").read_text()
    for row in manifest.read(manifest.FOLDER / "MANIFEST"):
        path, features = manifest.FOLDER / row["file"], row["features"]
        if features not in (",".join(FEATURES), "any") or f'"{path.name}"' in built_in:
            continue
        found.append(Method(path.stem, "lull", speed.Entry("", oidn.ours(), ("-w", path)),
                            path.stat().st_size))
        int8 = folder / f"{path.stem}_int8.tza"
        done = subprocess.run([sys.executable, "-m", "export.quantize", path, int8],
                              cwd=oidn.ROOT, capture_output=True, text=True)
        if done.returncode == 0:
            found.append(Method(f"{path.stem} int8", "lull",
                                speed.Entry("", oidn.ours(), ("-w", int8)), int8.stat().st_size))
    return found


def find_all_cases(folders: list[str], held_out: list[str]) -> list[Case]:
    """Pictures that have a reference and all features."""
    cases = [c for folder in folders for c in find_cases(Path(folder))]
    for text in held_out:
        cases += held_out_cases(*parse_held_out(text), FEATURES)
    return [c for c in cases if has_features(c.source, FEATURES)]


def relative_mse(image: np.ndarray, reference: np.ndarray) -> float:
    """Mean of (a-b)^2 / (b^2 + 0.01) of exposed radiance."""
    return float(np.mean((image - reference) ** 2 / (reference**2 + 0.01)))


def score(method: Method, case: Case, images: dict[str, np.ndarray], target: np.ndarray,
          folder: Path) -> None:
    """Denoises one picture and notes its metrics."""
    if method.kind == "input":
        out = images["hdr"]
    elif method.kind == "classic":
        start = time.perf_counter()
        out = joint_bilateral(images["hdr"], images["alb"], images["nrm"])
        method.ms_per_mp = (time.perf_counter() - start) * 1e9 / out[..., 0].size
    else:
        options = pictures.write_inputs(folder, images)
        oidn.run(method.entry.program, "-d", "cpu", *options, *method.entry.options,
                 "-o", folder / "out.pfm")
        out = read_pfm(folder / "out.pfm")
    exposure = np.float32(color.autoexposure(target))
    shown = metrics.to_display(target, "hdr", exposure)
    row = metrics.measure(metrics.to_display(out, "hdr", exposure), shown, list(NAMES[:3]))
    method.scores[case.name] = row | {"relmse": relative_mse(out * exposure, target * exposure)}


def measure_speed(found: list[Method], folder: Path, width: int, height: int, rounds: int,
                  threads: int) -> None:
    """Medians over alternating rounds."""
    inputs = speed.write_inputs(folder, width, height)
    for _ in range(rounds):
        for method in found:
            if method.entry:
                speed.measure(method.entry, inputs, width * height, height, threads, 3)
    for method in found:
        if method.entry:
            if method.entry.error:
                raise oidn.PeerError(method.entry.error)
            method.ms_per_mp = statistics.median(method.entry.msec) / (width * height / 1e6)


def spp_text(cases: list[Case]) -> str:
    counts = sorted({c.source.spp for c in cases if c.source.spp})
    return ", ".join(map(str, counts)) + " and unstated" if counts else "unstated"


def write_report(found: list[Method], cases: list[Case], height: int, head: list[str]) -> None:
    names = [c.name for c in cases]
    ours = {m.name: m for m in found}
    base = ours["OIDN balanced"].ms_per_mp
    lines = ["# Speed and accuracy", "", "![chart](chart.svg)", "", *head, "",
             "| | ms/MP | speed | memory, MB | weights, kB | PSNR | SSIM | FLIP | relMSE |",
             "|---|---:|---:|---:|---:|---:|---:|---:|---:|"]
    for m in sorted(found, key=lambda m: m.mean("psnr", names)):
        ratio = f"{base / m.ms_per_mp:.1f}x" if m.ms_per_mp else ""
        memory = f"{m.entry.working[height] / 1e6:.0f}" if m.entry else ""
        lines.append(f"| {m.name} | {m.ms_per_mp:.0f} | {ratio} | {memory} | "
                     f"{m.bytes / 1000:.0f} | " .replace(" 0 |", " |") +
                     f"{m.mean('psnr', names):.2f} | {m.mean('ssim', names):.4f} | "
                     f"{m.mean('flip', names):.4f} | {m.mean('relmse', names):.4f} |")
    lines += ["", "Speed is relative to OIDN balanced. Memory is the peak resident set above the "
              "image buffers; where", "a field is empty, it does not apply or is not known "
              "(built-in weights are part of the library).", ""]
    by_case = ["## PSNR of each picture", "", "| | " + " | ".join(m.name for m in found) + " |",
               "|---|" + "---:|" * len(found)]
    by_case += [f"| {c} | " + " | ".join(f"{m.scores[c]['psnr']:.2f}" for m in found) + " |"
                for c in names]
    (DOCS / "chart.md").write_text("\n".join([*lines, *by_case, ""]))
    panels = []
    for metric, title in (("psnr", "PSNR, dB (up is better)"), ("ssim", "SSIM (up is better)"),
                          ("flip", "FLIP (down is better)")):
        points = [Point(m.name, m.kind, m.ms_per_mp, m.mean(metric, names))
                  for m in found if m.ms_per_mp]
        panels.append((title, metric.upper(), points))
    (DOCS / "chart.svg").write_text(chart(panels, "milliseconds per megapixel"))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", action="append", default=[], help="folder with references")
    parser.add_argument("--held_out", action="append", default=[], metavar="DIR:N")
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    width, height = map(int, args.size.split("x"))
    shared = pictures.SHARED
    images = args.images or [str(shared if shared.is_dir() else oidn.ROOT / "demo")]
    try:
        cases = find_all_cases(images, args.held_out)
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            found = methods(folder)
            for case in cases:
                features = load(case.source, FEATURES)
                target = load(case.target, ["hdr"])["hdr"]
                for method in found:
                    score(method, case, features, target, folder)
                print(case.name, ", ".join(f"{m.name} {m.scores[case.name]['psnr']:.2f}"
                                           for m in found), flush=True)
            measure_speed(found, folder, width, height, args.rounds, args.threads)
    except (oidn.PeerError, ToolError, FileNotFoundError) as error:
        print(f"chart: {error}", file=sys.stderr)
        return 2
    head = [f"Measured {datetime.date.today()} on {oidn.cpu_line()}.",
            f"Accuracy: means over {len(cases)} pictures ({spp_text(cases)} samples per pixel), "
            "colour with albedo and normal,", "tone-mapped sRGB at the reference's exposure. "
            f"Speed: {width}x{height}, {args.threads} threads, median of {args.rounds} rounds; the",
            "bilateral filter is plain numpy on one thread. `make chart` repeats it."]
    write_report(found, cases, height, head)
    print(f"written: {DOCS / 'chart.svg'}, {DOCS / 'chart.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
