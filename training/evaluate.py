#!/usr/bin/env python3
"""Measure weights files on pictures with references, beside the noisy input and the real OIDN.

    python -m training.evaluate weights/a.tza=hdr weights/b.tza=hdr,alb,nrm --images pictures \\
        --held_out data/train:12 --report docs/models.md

Cases are the groups of the naming scheme and folders with noisy.exr and ref.exr; what was held out
is found as `train --raw --hold_out N` finds it among the groups with the model's features. All
metrics are taken on tone-mapped sRGB (docs/training.md) at the auto-exposure of the reference. For
ldr the pictures and their references are multiplied by that exposure and clipped to [0,1]. OIDN
(quality high, its own weights) is run where the package pyoidn is installed; it also runs our
weights, and the difference to ours must be within its own tolerance. The tables go between the
marks `<!-- scores -->` and `<!-- /scores -->` of the report.
"""
from __future__ import annotations

if __name__ == "__main__" and not __package__:  # run as a file: go on as a module
    import runpy
    import sys
    sys.path[0] = __file__.rpartition("training")[0] or ".."
    sys.exit(runpy.run_module("training.evaluate", run_name="__main__", alter_sys=True))

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from export.tza import Reader
from training import color, errors, metrics, nets, peer
from training.errors import DATA, DEPENDENCY, STATE, USAGE, ToolError
from training.features import check_beside, holds, load
from training.imageio import replacing
from training.infer import Denoiser
from training.nets import from_tensors
from training.result import read_weights
from training.scan import Group, Version, hold_out, list_files, list_versions, scan
from training.settings import derive

NAMES = ("psnr", "ssim", "flip")
MARKS = ("<!-- scores -->", "<!-- /scores -->")


@dataclass
class Case:
    """One noisy picture and its reference."""

    name: str
    source: Version
    target: Version


def find_cases(root: Path) -> list[Case]:
    """Pairs below a folder: the naming scheme, and noisy.exr beside ref.exr."""
    cases = [Case(v.name, v, g.target) for g in _groups(root) for v in g.inputs]
    for noisy in sorted(p for p in list_files(root) if p.name == "noisy.exr"):
        ref = noisy.with_name("ref.exr")
        if ref.exists():
            name = noisy.parent.relative_to(root).as_posix()
            cases.append(Case(name, Version(name, None, None, 0, {"*": noisy}),
                              Version(name, None, "ref", 0, {"*": ref})))
    if not cases:
        raise ToolError(f"{root}: no pictures with a reference", DATA)
    return sorted(cases, key=lambda c: c.name)


def _groups(root: Path) -> list[Group]:
    return scan(root, ["hdr"]).groups if list_versions(root) else []


def held_out_cases(folder: Path, count: int, features: list[str]) -> list[Case]:
    """Pairs of the groups that `train --hold_out count` leaves out of a training on `features`, of
    the radiance where the data set has no ldr."""
    groups = scan(folder, features, features[:1]).groups
    if not groups and features[0] == "ldr":
        groups = scan(folder, ["hdr", *features[1:]], ["hdr"]).groups
    held = hold_out([g.name for g in groups], count)
    return [Case(v.name, v, g.target) for g in groups if g.name in held for v in g.inputs]


def readable(cases: list[Case], features: list[str]) -> list[Case]:
    """The cases that can be read; says which cannot, which train left out as well."""
    found = []
    for case in cases:
        try:
            if has_features(case.source, features) and has_features(case.target, ["hdr"]):
                check_beside(case.source, load(case.source, _files_of(features)),
                             load(case.target, ["hdr"]))
                found.append(case)
        except ToolError as e:
            print(f"left out {case.name}: {e}")
    return found


def parse_held_out(text: str) -> tuple[Path, int]:
    """DIR:N of --held_out."""
    folder, _, count = text.rpartition(":")
    if not folder or not count.isdecimal() or int(count) < 1:
        raise ToolError(f"--held_out {text}: not DIR:N with N groups", USAGE)
    return Path(folder), int(count)


def _files_of(features: list[str]) -> list[str]:
    """The features that are read: ldr is made of hdr, see evaluate."""
    return ["hdr" if f == "ldr" else f for f in features]


def has_features(version: Version, features: list[str]) -> bool:
    return holds(version, _files_of(features))


class Program:
    """A weights file that only the C core runs (integer models): our own oidnDenoise does it."""

    def __init__(self, path: Path, features: list[str]):
        self.path, self.features = path.resolve(), features
        self.binary = nets.ROOT / "build" / "bin" / "oidnDenoise"
        if not self.binary.exists():
            raise ToolError(f"{self.binary}: missing; run make first", DEPENDENCY)

    def run(self, images: dict[str, np.ndarray]) -> np.ndarray:
        return peer.denoise(self.binary, images, self.path)


def parse_model(text: str) -> tuple[Path, list[str]]:
    """FILE=FEATURE,FEATURE,...: the file, and its features in the order in which networks get them,
    the main one, hdr or ldr, first."""
    file, equals, names = text.partition("=")
    if not equals:
        raise ToolError(f"{text}: say which images it takes, as in {text}=hdr,alb,nrm", USAGE)
    features = derive("evaluate", {"features": names.split(",")})["features"]
    if features[0] not in ("hdr", "ldr"):
        raise ToolError(f"{text}: only results for hdr and ldr are measured", USAGE)
    return Path(file), features


def trained_features(path: Path, features: list[str]) -> list[str]:
    """Those that a training had where the model is measured with `features`: all, if it is of
    family K, which learns to do without."""
    with errors.reading(path):
        is_kernel = nets.identify(list(Reader(path))).family == "K"
    return [features[0], "alb", "nrm"] if is_kernel else features


def load_denoiser(path: Path, features: list[str]) -> Denoiser | Program:
    """Our network of a weights file, as torch runs it; integer models as the C core does.

    features: as of parse_model. The transfer function is the one that trainings have by default."""
    with errors.reading(path):
        is_integer = any(t.dtype == np.int8 for t in Reader(path).values())
    if is_integer:
        return Program(path, features)
    derived = derive("evaluate", {"features": features, "transfer": None})
    model = from_tensors(read_weights(path)).eval()
    if model.net.family == "U" and model.inputs != 3 * len(features):
        raise ToolError(f"{path}: has {model.inputs} input channels, {','.join(features)} are "
                        f"{3 * len(features)}", USAGE)
    if model.net.family == "K":
        model.transfer = derived["transfer"]
    return Denoiser(model, features, features[0], derived["transfer"], [])


def noise_of_reference(case: Case, error: float) -> float:
    """The mean squared error that the reference has by itself, from that of the noisy input. With n
    samples for each of the input's, of other paths, it has 1 / n of the input's variance, and
    1 / (n + 1) of that of their difference."""
    spp, target = case.source.spp, case.target.spp
    if not spp or not target or target <= spp:
        raise ToolError(f"{case.name}: --less_reference needs sample counts in the names of input "
                        "and reference, and more in the latter", DATA)
    return error / (target / spp + 1)


def evaluate(case: Case, path: Path, denoiser: Denoiser | Program, binary: Path | None,
             names: list[str], less_reference: bool = False) -> dict:
    """Scores of one case: by method and metric, and the agreement with OIDN running our weights.

    less_reference: PSNR as a reference without noise would give it."""
    main, *others = denoiser.features
    images, reference = load(case.source, ["hdr", *others]), load(case.target, ["hdr"])
    check_beside(case.source, images, reference)
    noisy, target = images.pop("hdr"), reference["hdr"]
    exposure = color.autoexposure(target)
    if main == "ldr":
        noisy, target = (np.clip(image * exposure, 0, 1) for image in (noisy, target))
    images = {main: noisy, **images}
    shown = metrics.to_display(target, main, exposure)
    outputs = {"noisy": noisy, "lull": denoiser.run(images)}
    row: dict = {"case": case.name, "spp": case.source.spp}
    if binary:
        outputs["oidn"] = peer.denoise(binary, images)
        if not isinstance(denoiser, Program) and denoiser.model.net.family == "U":
            theirs = peer.denoise(binary, images, path.resolve())
            row["agreement"] = peer.difference(outputs["lull"], theirs)
    displays = {m: metrics.to_display(image, main, exposure) for m, image in outputs.items()}
    row |= {m: metrics.limited(metrics.measure(image, shown, names, f"{case.name} ({m})"))
            for m, image in displays.items()}
    if less_reference:
        noise = noise_of_reference(case, metrics.mse(displays["noisy"], shown))
        for method, image in displays.items():
            left = max(metrics.mse(image, shown) - noise, 1e-10)
            row[method]["psnr"] = metrics.decibels(left)
    return row


def table(rows: list[dict], pictures: list[dict]) -> list[str]:
    """Markdown: one line per row, then the means over all pictures."""
    oidn = all("oidn" in r for r in rows)
    methods = ["noisy", "lull"] + (["oidn"] if oidn else [])
    metric = list(rows[0]["lull"])
    titles = {"noisy": "noisy", "lull": "lull", "oidn": "OIDN 2.5.1"}
    head = [f"{n.upper()} {titles[m]}" for n in metric for m in methods]
    lines = ["| picture | " + " | ".join(head) + " |", "|---|" + "---:|" * len(head)]
    mean = {"case": f"**mean of {len(pictures)}**"} | {
        m: {n: float(np.mean([r[m][n] for r in pictures])) for n in metric} for m in methods}
    for r in [*rows, mean]:
        cells = [f"{r[m][n]:.2f}" if n == "psnr" else f"{r[m][n]:.4f}"
                 for n in metric for m in methods]
        lines.append(f"| {r['case']} | " + " | ".join(cells) + " |")
    return lines


def verdict(rows: list[dict]) -> str:
    """How many cases improve, in words."""
    names = [n for n in rows[0]["lull"] if n in ("psnr", "ssim")]
    worse = [r["case"] for r in rows if any(r["lull"][n] <= r["noisy"][n] for n in names)]
    better = len(rows) - len(worse)
    text = f"{better} of {len(rows)} pictures are better than their input"
    text += f" in {' and '.join(names).upper().replace('AND', 'and')}" if names else ""
    text += f" (not: {', '.join(worse)})." if worse else "."
    far = [r["case"] for r in rows if "agreement" in r
           and (r["agreement"][0] > 0.003 or r["agreement"][1])]
    if "agreement" in rows[0]:
        mean = float(np.mean([r["agreement"][0] for r in rows]))
        text += f" OIDN 2.5.1 running the same weights differs by {mean:.1e} on average" \
                f" ({len(far)} pictures beyond its tolerance of 3e-3)."
    return text


def check_gain(title: str, rows: list[dict], least: float | None) -> None:
    """Says what the mean PSNR gains; ToolError if that is less than wanted."""
    if "psnr" not in rows[0]["lull"]:
        return
    gain = float(np.mean([r["lull"]["psnr"] - r["noisy"]["psnr"] for r in rows]))
    print(f"{title}: {gain:+.2f} dB on average")
    if least is not None and gain < least:
        raise ToolError(f"{title}: {gain:.2f} dB gained, {least:g} wanted", STATE)


def by_spp(rows: list[dict]) -> list[dict]:
    """Means per sample count, as rows."""
    merged = []
    for spp in sorted({r["spp"] or 0 for r in rows}):  # names may have none
        part = [r for r in rows if (r["spp"] or 0) == spp]
        row = {"case": f"{spp or '?'} spp ({len(part)})"}
        for m in ("noisy", "lull", "oidn"):
            if all(m in r for r in part):
                row[m] = {n: float(np.mean([r[m][n] for r in part])) for n in part[0][m]}
        merged.append(row)
    return merged


def write_report(path: Path, text: str) -> None:
    """Replace what stands between the marks; a new file gets them."""
    old = path.read_text() if path.exists() else "\n".join(MARKS) + "\n"
    if not all(m in old for m in MARKS):
        raise ToolError(f"{path}: has no marks {MARKS[0]} and {MARKS[1]}", DATA)
    before, _, rest = old.partition(MARKS[0])
    after = rest.partition(MARKS[1])[2]
    with replacing(path) as tmp:
        tmp.write_text(f"{before}{MARKS[0]}\n{text}\n{MARKS[1]}{after}")


def main(argv: list[str]) -> None:
    parser = errors.Parser(prog="python -m training.evaluate", description=__doc__)
    parser.add_argument("weights", nargs="+", help="file.tza=feature,feature,...")
    parser.add_argument("--images", action="append", default=[], help="folder with references")
    parser.add_argument("--held_out", action="append", default=[], metavar="DIR:N",
                        help="the N groups of a data set that train --hold_out N leaves out")
    parser.add_argument("--report", type=Path, help="Markdown file to put the tables into")
    parser.add_argument("--json", type=Path, help="all figures")
    parser.add_argument("--metric", nargs="*", default=NAMES, choices=tuple(metrics.METRICS))
    parser.add_argument("--spp", type=int, nargs="*", help="only pictures of these sample counts")
    parser.add_argument("--less_reference", action="store_true",
                        help="PSNR less the noise of references, which have to be renders of their "
                             "own: for inputs of nearly as many samples")
    parser.add_argument("--least_gain", type=float, metavar="DB",
                        help="status 4 if the mean PSNR of a set gains less than this")
    parser.add_argument("--no_oidn", action="store_true", help="do not run the real OIDN")
    args = parser.parse_args(argv)
    if not args.images and not args.held_out:
        raise ToolError("nothing to measure: --images or --held_out is missing", USAGE)
    models = [parse_model(text) for text in args.weights]
    held_out = [parse_held_out(text) for text in args.held_out]
    if args.less_reference and "psnr" not in args.metric:
        raise ToolError("--less_reference: is about psnr, which --metric leaves out", USAGE)
    models = [(path, features, load_denoiser(path, features)) for path, features in models]
    torch.set_num_threads(1)
    binary = None if args.no_oidn else peer.find_binary()
    print(f"OIDN: {'oidnDenoise of pyoidn' if binary else 'not run'}")
    images = [(Path(d).name, find_cases(Path(d))) for d in args.images]
    lines, figures = [], []
    for path, features, denoiser in models:
        if binary and not peer.takes(features):
            print(f"{path.stem}: OIDN takes normals beside an albedo only, and is left out")
        trained = trained_features(path, features) if held_out else features
        sets = images + [(f"held out of {folder.name}",
                          readable(held_out_cases(folder, count, trained), features))
                         for folder, count in held_out]
        lines += [f"### {path.stem}", ""]
        before = len(figures)
        for title, cases in sets:
            rows = []
            for case in (c for c in cases if has_features(c.source, features)
                         and (not args.spp or c.source.spp in args.spp)):
                rows.append(evaluate(case, path, denoiser,
                                     binary if peer.takes(features) else None, list(args.metric),
                                     args.less_reference))
                r = rows[-1]
                print(f"{path.stem} {case.name}: " + ", ".join(
                    m + " " + "/".join(f"{v:.4g}" for v in r[m].values())
                    for m in ("noisy", "lull", "oidn") if m in r), flush=True)
            if not rows:
                continue
            print(verdict(rows))
            check_gain(title, rows, args.least_gain)
            short = by_spp(rows) if title.startswith("held out") else rows
            lines += [f"**{title}** ({len(rows)} pictures)", "", *table(short, rows), "",
                      verdict(rows)]
            lines += [""]
            figures += [{"weights": path.name, "set": title, **r} for r in rows]
        if len(figures) == before:
            raise ToolError(f"{path}: no picture has {','.join(_files_of(features))}", DATA)
    try:
        if args.report:
            write_report(args.report, "\n".join(lines))
    finally:  # what was measured is kept where the report cannot be
        if args.json:
            with replacing(args.json) as tmp:
                tmp.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    errors.run(main)
