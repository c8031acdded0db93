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
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch

from export.tza import Reader
from training import color, errors, metrics, nets, peer
from training.errors import DATA, DEPENDENCY, STATE, USAGE, ToolError
from training.features import Images, add_layers, check_beside, holds, load, parse_layers
from training.imageio import replacing
from training.infer import Denoiser
from training.result import read_network
from training.scan import Group, Version, hold_out, list_files, list_versions, scan
from training.settings import derive
from training.tables import by_spp, table, verdict, write_report

NAMES = ("psnr", "ssim", "flip")


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


@dataclass
class Pictures:
    """Reads cases, and keeps the names of those that cannot be read."""

    layers: dict[str, str]
    unread: set[str] = field(default_factory=set)

    def read(self, case: Case, features: list[str],
             is_held: bool) -> tuple[Images, Images] | None:
        """Input and reference; None if the input lacks features, or if one cannot be read, which a
        line says. is_held: train left that out as well, so that it does not count as unread."""
        files, opened = _files_of(features), {}
        try:
            if not holds(case.source, files, self.layers, opened):
                return None
            images = load(case.source, files, self.layers, opened)
            opened.clear()
            reference = load(case.target, ["hdr"], self.layers)
            check_beside(case.source, images, reference)
        except ToolError as e:
            if e.code != DATA:
                raise
            print(f"left out {case.name}: {e}")
            if not is_held:
                self.unread.add(case.name)
            return None
        return images, reference


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
    model = read_network(path)
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


def evaluate(case: Case, images: Images, reference: Images, path: Path,
             denoiser: Denoiser | Program, binary: Path | None, names: list[str],
             less_reference: bool = False) -> dict:
    """Scores of one case: by method and metric, and the agreement with OIDN running our weights.

    less_reference: PSNR as a reference without noise would give it."""
    main, *others = denoiser.features
    noisy, target = images["hdr"], reference["hdr"]
    exposure = color.autoexposure(target)
    if main == "ldr":
        noisy, target = (np.clip(image * exposure, 0, 1) for image in (noisy, target))
    images = {main: noisy, **{f: images[f] for f in others}}
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


def poor_gain(title: str, rows: list[dict], least: float | None) -> list[str]:
    """Says what the mean PSNR gains; what is to be said at the end if that is less than wanted."""
    if "psnr" not in rows[0]["lull"]:
        return []
    gain = float(np.mean([r["lull"]["psnr"] - r["noisy"]["psnr"] for r in rows]))
    print(f"{title}: {gain:+.2f} dB on average")
    return [] if least is None or gain >= least else [
        f"{title}: {gain:.2f} dB gained, {least:g} wanted"]


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
    add_layers(parser)
    parser.add_argument("--no_oidn", action="store_true", help="do not run the real OIDN")
    args = parser.parse_args(argv)
    if not args.images and not args.held_out:
        raise ToolError("nothing to measure: --images or --held_out is missing", USAGE)
    models = [parse_model(text) for text in args.weights]
    held_out = [parse_held_out(text) for text in args.held_out]
    if args.less_reference and "psnr" not in args.metric:
        raise ToolError("--less_reference: is about psnr, which --metric leaves out", USAGE)
    pictures = Pictures(parse_layers(args.layers))
    models = [(path, features, load_denoiser(path, features)) for path, features in models]
    torch.set_num_threads(1)
    binary = None if args.no_oidn else peer.find_binary()
    print(f"OIDN: {'oidnDenoise of pyoidn' if binary else 'not run'}")
    images = [(Path(d).name, find_cases(Path(d)), False) for d in args.images]
    lines, figures, failures = [], [], []
    for path, features, denoiser in models:
        if binary and not peer.takes(features):
            print(f"{path.stem}: OIDN takes normals beside an albedo only, and is left out")
        trained = trained_features(path, features) if held_out else features
        sets = images + [(f"held out of {folder.name}",
                          held_out_cases(folder, count, trained), True)
                         for folder, count in held_out]
        lines += [f"### {path.stem}", ""]
        before = len(figures)
        for title, cases, is_held in sets:
            rows = []
            for case in (c for c in cases if not args.spp or c.source.spp in args.spp):
                if (found := pictures.read(case, features, is_held)) is None:
                    continue
                rows.append(evaluate(case, *found, path, denoiser,
                                     binary if peer.takes(features) else None, list(args.metric),
                                     args.less_reference))
                r = rows[-1]
                print(f"{path.stem} {case.name}: " + ", ".join(
                    m + " " + "/".join(f"{v:.4g}" for v in r[m].values())
                    for m in ("noisy", "lull", "oidn") if m in r), flush=True)
            if not rows:
                continue
            print(verdict(rows))
            failures += poor_gain(title, rows, args.least_gain)
            lines += [f"**{title}** ({len(rows)} pictures)", "",
                      *table(by_spp(rows) if is_held else rows, rows), "", verdict(rows), ""]
            figures += [{"weights": path.name, "set": title, **r} for r in rows]
        if len(figures) == before and not pictures.unread:
            raise ToolError(f"{path}: no picture has {','.join(_files_of(features))}", DATA)
    try:
        if args.report:
            write_report(args.report, "\n".join(lines))
    finally:  # what was measured is kept where the report cannot be
        if args.json:
            with replacing(args.json) as tmp:
                tmp.write_text(json.dumps(figures, indent=1) + "\n")
    if pictures.unread:
        raise ToolError(f"pictures left out that cannot be read: {len(pictures.unread)}", DATA)
    if failures:
        raise ToolError("; ".join(failures), STATE)


if __name__ == "__main__":
    errors.run(main)
