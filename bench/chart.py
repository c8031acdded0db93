"""Speed against accuracy: docs/chart.svg and docs/chart.md, from one run.

    python -m bench.chart [--images [NAME=]DIR] [--held_out [NAME=]DIR:N] [--size 1920x1080]
                          [--rounds 3]

The real Open Image Denoise 2.5.1 (fast, balanced, high), lull's built-in models in integers and,
by PyTorch, in floating point, every other file of weights/ for the same inputs (fp16 and, where it
can be quantised, int8), a joint bilateral filter with the same auxiliary images, and the noisy
input. Accuracy: sets of pictures with a reference and with albedo and normal, one set for every
--images or --held_out, through the programs themselves. Speed and memory: one frame of --size,
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

from bench import auto, oidn, pictures, speed
from bench.bilateral import joint_bilateral
from bench.svg import Point, chart
from export import manifest
from training import color, metrics
from training.errors import ToolError
from training.evaluate import Case, find_cases, has_features, held_out_cases, parse_held_out
from training.features import load
from training.imageio import read_pfm
from training.infer import Denoiser
from training.result import read_network

FEATURES = ["hdr", "alb", "nrm"]
NAMES = ("psnr", "ssim", "flip", "relmse")
DOCS = oidn.ROOT / "docs"


@dataclass
class PictureSet:
    """One set of pictures that means are taken over."""

    name: str
    cases: list[Case]

    def counts(self) -> list[int]:
        """Samples per pixel; none if some pictures do not state them."""
        found = {c.source.spp for c in self.cases}
        return sorted(found) if all(found) else []


@dataclass
class Method:
    """One point of the chart: a program or a network, its scores by case, and its cost."""

    name: str
    kind: str  # lull, oidn, classic, input
    entry: speed.Entry | None = None
    denoiser: Denoiser | None = None  # in the place of a program; its time is not measured
    bytes: int = 0  # of its weights; 0: unknown or none
    ms_per_mp: float = 0.0
    scores: dict[int, dict[str, float]] = field(default_factory=dict)  # id of a case -> metric

    def mean(self, metric: str, cases: list[Case]) -> float:
        return float(np.mean([self.scores[id(c)][metric] for c in cases]))


def in_floats(path: Path) -> Denoiser:
    """A built-in model without the rounding of what goes from layer to layer."""
    model = read_network(path)
    return Denoiser(model, FEATURES, FEATURES[0], model.transfer, [])


def methods(folder: Path) -> list[Method]:
    """Everything that is compared."""
    found = [Method("noisy", "input"), Method("joint bilateral", "classic")]
    for quality, file in auto.built_in().items():
        found.append(Method(f"OIDN {quality}", "oidn",
                            speed.Entry("", oidn.theirs(), ("-q", quality))))
        path = manifest.FOLDER / file
        found.append(Method(f"lull {quality}", "lull",
                            speed.Entry("", oidn.ours(), ("-q", quality)),
                            bytes=path.stat().st_size))
        found.append(Method(f"lull {quality}, floats", "lull", denoiser=in_floats(path)))
    for n in speed.ENSEMBLES:
        found.append(Method(f"lull high, mean of {n}", "lull",
                            speed.Entry("", oidn.ours(), ("--ensemble", n))))
    built_in = (oidn.ROOT / "weights" / "builtin.def").read_text()
    for row in manifest.read(manifest.FOLDER / "MANIFEST"):
        path, features = manifest.FOLDER / row["file"], row["features"]
        if features not in (",".join(FEATURES), "any") or f'"{path.name}"' in built_in:
            continue
        found.append(Method(path.stem, "lull", speed.Entry("", oidn.ours(), ("-w", path)),
                            bytes=path.stat().st_size))
        int8 = folder / f"{path.stem}_int8.tza"
        done = subprocess.run([sys.executable, "-m", "export.quantize", path, int8],
                              cwd=oidn.ROOT, capture_output=True, text=True)
        if done.returncode == 0:
            found.append(Method(f"{path.stem} int8", "lull",
                                speed.Entry("", oidn.ours(), ("-w", int8)),
                                bytes=int8.stat().st_size))
    return found


def find_sets(folders: list[str], held_out: list[str]) -> list[PictureSet]:
    """Those pictures that have a reference and all features."""
    found = []
    for text in folders:
        name, folder = named(text)
        found.append(PictureSet(name or Path(folder).name, find_cases(Path(folder))))
    for text in held_out:
        name, rest = named(text)
        folder, count = parse_held_out(rest)
        found.append(PictureSet(name or folder.name, held_out_cases(folder, count, FEATURES)))
    for group in found:
        group.cases = [c for c in group.cases if has_features(c.source, FEATURES)]
        if not group.cases:
            raise ToolError(f"{group.name}: no picture with a reference, albedo and normal")
    return found


def relative_mse(image: np.ndarray, reference: np.ndarray) -> float:
    """Mean of (a-b)^2 / (b^2 + 0.01) of exposed radiance."""
    return float(np.mean((image - reference) ** 2 / (reference**2 + 0.01)))


def named(text: str) -> tuple[str, str]:
    """NAME and REST of [NAME=]REST."""
    name, _, rest = text.rpartition("=")
    return name, rest


def score(method: Method, case: Case, images: dict[str, np.ndarray], target: np.ndarray,
          folder: Path) -> None:
    """Denoises one picture and notes its metrics."""
    if method.kind == "input":
        out = images["hdr"]
    elif method.kind == "classic":
        start = time.perf_counter()
        out = joint_bilateral(images["hdr"], images["alb"], images["nrm"])
        method.ms_per_mp = (time.perf_counter() - start) * 1e9 / out[..., 0].size
    elif method.denoiser:
        out = method.denoiser.run(images)
    else:
        options = pictures.write_inputs(folder, images)
        oidn.run(method.entry.program, "-d", "cpu", *options, *method.entry.options,
                 "-o", folder / "out.pfm")
        out = read_pfm(folder / "out.pfm")
    exposure = np.float32(color.autoexposure(target))
    shown = metrics.to_display(target, "hdr", exposure)
    row = metrics.measure(metrics.to_display(out, "hdr", exposure), shown, list(NAMES[:3]))
    method.scores[id(case)] = row | {"relmse": relative_mse(out * exposure, target * exposure)}


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


def set_table(found: list[Method], group: PictureSet) -> list[str]:
    """Means over one set, best last, and PSNR by samples per pixel."""
    counts = group.counts()
    of = {n: [c for c in group.cases if c.source.spp == n] for n in counts}
    lines = [f"## {group.name}", "",
             f"{len(group.cases)} pictures" +
             (f", PSNR also of those of {', '.join(map(str, counts))} samples per pixel."
              if counts else "."), "",
             "| | ms/MP | PSNR | SSIM | FLIP | relMSE |" + "".join(f" {n} spp |" for n in counts),
             "|---|" + "---:|" * (5 + len(counts))]
    for m in sorted(found, key=lambda m: m.mean("psnr", group.cases)):
        means = {n: m.mean(n, group.cases) for n in NAMES}
        lines.append(f"| {m.name} | {cost(m)} | {means['psnr']:.2f} | {means['ssim']:.4f} | "
                     f"{means['flip']:.4f} | {means['relmse']:.4f} |" +
                     "".join(f" {m.mean('psnr', of[n]):.2f} |" for n in counts))
    if not counts:
        lines += ["", "PSNR of each:", "", "| | " + " | ".join(m.name for m in found) + " |",
                  "|---|" + "---:|" * len(found)]
        lines += [f"| {c.name} | " +
                  " | ".join(f"{m.scores[id(c)]['psnr']:.2f}" for m in found) + " |"
                  for c in group.cases]
    return [*lines, ""]


def cost(method: Method) -> str:
    return f"{method.ms_per_mp:.0f}" if method.ms_per_mp else ""


def write_report(found: list[Method], sets: list[PictureSet], height: int, head: list[str]) -> None:
    base = next(m for m in found if m.name == "OIDN balanced").ms_per_mp
    lines = ["# Speed and accuracy", "", "![chart](chart.svg)", "", *head, "",
             "| | ms/MP | speed | memory, MB | weights, kB |", "|---|---:|---:|---:|---:|"]
    for m in sorted((m for m in found if m.ms_per_mp), key=lambda m: -m.ms_per_mp):
        memory = f"{m.entry.working[height] / 1e6:.0f}" if m.entry else ""
        size = f"{m.bytes / 1000:.0f}" if m.bytes else ""
        lines.append(f"| {m.name} | {cost(m)} | {base / m.ms_per_mp:.1f}x | {memory} | {size} |")
    lines += ["", "Speed is relative to OIDN balanced. Memory is the peak resident set above the "
              "image buffers. *floats*: by PyTorch,", "without the rounding between layers; what "
              "integers lose is the difference.", ""]
    rows = []
    for group in sets:
        lines += set_table(found, group)
        rows.append([(f"{group.name}: {title}", metric.upper(),
                      [Point(m.name, m.kind, m.ms_per_mp, m.mean(metric, group.cases))
                       for m in found if m.ms_per_mp])
                     for metric, title in (("psnr", "PSNR, dB (up is better)"),
                                           ("ssim", "SSIM (up is better)"),
                                           ("flip", "FLIP (down is better)"))])
    (DOCS / "chart.md").write_text("\n".join(lines))
    (DOCS / "chart.svg").write_text(chart(rows, "milliseconds per megapixel"))


def main(argv: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", action="append", default=[], metavar="[NAME=]DIR",
                        help="folder of pictures with references (default: the shared renders "
                             "where they are, else the demo's)")
    parser.add_argument("--held_out", action="append", default=[], metavar="[NAME=]DIR:N",
                        help="the N groups that train --hold_out N leaves out")
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args(argv)
    width, height = map(int, args.size.split("x"))
    shared = pictures.SHARED
    images = args.images or [str(shared if shared.is_dir() else oidn.ROOT / "demo")]
    try:
        sets = find_sets(images, args.held_out)
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            found = methods(folder)
            for case in (c for s in sets for c in s.cases):
                features = load(case.source, FEATURES)
                target = load(case.target, ["hdr"])["hdr"]
                for method in found:
                    score(method, case, features, target, folder)
                print(case.name, ", ".join(f"{m.name} {m.scores[id(case)]['psnr']:.2f}"
                                           for m in found), flush=True)
            measure_speed(found, folder, width, height, args.rounds, args.threads)
    except (oidn.PeerError, ToolError, FileNotFoundError) as error:
        print(f"chart: {error}", file=sys.stderr)
        return 2
    head = [f"Measured {datetime.date.today()} on {oidn.cpu_line()}.",
            "Accuracy: means over pictures, colour with albedo and normal, tone-mapped sRGB at the "
            "reference's exposure.",
            f"Speed: {width}x{height}, {args.threads} threads, median of {args.rounds} rounds; the "
            "bilateral filter is plain numpy", "on one thread. `make chart` repeats it."]
    write_report(found, sets, height, head)
    print(f"written: {DOCS / 'chart.svg'}, {DOCS / 'chart.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
