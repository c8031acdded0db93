#!/usr/bin/env python3
"""Denoise a raw data set with a result, and measure it where there are references.

    python -m training.infer -r my_result -D data -i test -F exr png -M psnr ssim flip

Output: <output_dir>/<data set>/<input name>.<suffix>[_<epoch>].<feature>.<format>; the suffix is
the result's name, of a name with folders (proj/mine) the last part, unless told. exr, pfm, phm
and hdr hold linear values, png tone-mapped sRGB. A file <group>.json (or the group's name cut at an
underscore) may give {"exposure": x} for tone mapping; it is copied beside the output. EXR files lie
in the frame where their inputs do.
"""
from __future__ import annotations

if __name__ == "__main__" and not __package__:  # run as a file: go on as a module
    import runpy
    import sys
    sys.path[0] = __file__.rpartition("training")[0] or ".."
    sys.exit(runpy.run_module("training.infer", run_name="__main__", alter_sys=True))

import json
import shutil
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from export.albedo import ALBEDO_MOST
from training import color, errors, kernel_model, metrics, parallel
from training.auxiliary import load_prefilters, run_network
from training.errors import DATA, ToolError
from training.features import Images, check_beside, encode, load
from training.imageio import LINEAR_FORMATS, WRITERS, read_display, replacing, write_image
from training.result import Result, load_model
from training.scan import CHANNELS, Group, Version, scan
from training.settings import Settings, parse


@dataclass
class Denoiser:
    """A network and how its features are coded; `run` denoises one picture."""

    model: torch.nn.Module
    features: list[str]
    main: str
    transfer: str
    prefilters: list

    def run(self, images: dict[str, np.ndarray]) -> np.ndarray:
        """Cleaned features by name (features.load) -> main feature, in its own range, [H,W,C]."""
        noisy = images[self.main]
        exposure = color.autoexposure(noisy) if self.main == "hdr" else 1.0
        is_kernel = self.model.net.family == "K"
        codes = encode({f: images[f] for f in self.features}, self.main, self.transfer, exposure,
                       ALBEDO_MOST if is_kernel else 1.0)
        for p in self.prefilters:
            codes = p.apply(codes, self.features)
        if is_kernel:
            codes = kernel_model.planes(codes, self.features)
        m = CHANNELS[self.main]
        out = np.concatenate([run_network(self.model, np.concatenate(
            [codes[..., k:min(k + 3, m)], codes[..., m:]], -1)) for k in range(0, m, 3)], -1)
        out = color.TRANSFERS[self.transfer].inverse(np.maximum(np.nan_to_num(out), 0.0))
        if self.main in ("nrm", "sh1"):
            return np.clip(out * 2.0 - 1.0, -1.0, 1.0).astype(np.float32)
        return (out / exposure if self.main in ("hdr", "z") else np.minimum(out, 1.0)).astype(
            np.float32)


def main(argv: list[str]) -> None:
    settings = parse("infer", argv, __doc__)
    for kind in settings.format:
        if kind.lower() not in WRITERS:
            raise ToolError(f"unknown format '{kind}' (known: {' '.join(WRITERS)})", errors.USAGE)
    parallel.configure(settings)
    device = parallel.open_device(settings)
    print(f"PyTorch: {torch.__version__}\nDevice: {device}")
    result = Result(settings.results_dir, settings.result)
    model, trained, epoch = load_model(result, settings.num_epochs, settings.best, settings.weights)
    aux = settings.aux_results or trained.get("aux_results") or []
    work = settings.replace(aux_results=aux, aux_features=trained.aux_features)
    denoiser = Denoiser(model.to(device), trained.features, trained.main_feature, trained.transfer,
                        load_prefilters(work))
    suffix = settings.output_suffix or result.folder.name
    if settings.num_epochs and settings.num_epochs > 0:
        suffix += f"_{epoch}"
    root = Path(settings.data_dir) / settings.input_data
    found = scan(root, trained.features, [trained.main_feature], need_target=False)
    print("\n".join(found.summary()))
    if not found.groups:
        raise ToolError(f"{root}: nothing to denoise for {' '.join(trained.features)}", DATA)
    sums: dict[str, list[float]] = defaultdict(list)
    done = 0
    for group in found.groups:
        for name, values in infer_group(group, denoiser, settings, root, suffix):
            done += 1
            text = ", ".join(f"{k}={v:.4f}" for k, v in values.items())
            print(f"{name} ... {text}" if text else name, flush=True)
            for k, v in metrics.limited(values).items():
                sums[k].append(v)
    if not done:
        raise ToolError(f"{root}: no picture can be read", DATA)
    if sums:
        count = len(next(iter(sums.values())))
        text = ", ".join(f"{k}_avg={np.mean(v):.4f}" for k, v in sums.items())
        print(f"{settings.result}: {text} ({count} images)")


def read(version: Version, features: list[str], settings: Settings) -> Images | None:
    """Features of a picture; None, with a line that says why, if it cannot be read."""
    try:
        return load(version, features, settings.layers)
    except ToolError as e:
        if e.code != DATA:
            raise
        print(f"left out {version.name}: {e}")
        return None


def infer_group(group: Group, denoiser: Denoiser, settings: Settings, root: Path, suffix: str):
    """Denoise and save the inputs of a group; yields (name, metrics) of each that can be read."""
    folder = Path(settings.output_dir) / settings.input_data
    main_feature = denoiser.main
    exposure, metadata = read_metadata(root, group.name)
    if metadata:
        copy = folder / metadata.relative_to(root)
        if not (copy.exists() and copy.samefile(metadata)):
            with replacing(copy) as tmp:
                shutil.copyfile(metadata, tmp)
    target = read(group.target, [main_feature], settings) if group.target else None
    if target and settings.save_all:
        save(folder / group.target.name, target[main_feature], main_feature, settings.format,
             exposure, place_of(group.target, target))
    for version in group.inputs:
        images = read(version, denoiser.features, settings)
        if images is None:
            continue
        output = denoiser.run(images)
        place = place_of(version, images)
        save(folder / f"{version.name}.{suffix}", output, main_feature, settings.format, exposure,
             place)
        if settings.save_all:
            save(folder / version.name, images[main_feature], main_feature, settings.format,
                 exposure, place)
        yield version.name, score(version, images, output, target, settings.metric, exposure)


def score(version: Version, images: Images, output: np.ndarray, target: Images | None,
          names: list[str], exposure: float) -> dict[str, float]:
    """Metrics of a result beside its reference; none, with a line that says why, where that does
    not fit."""
    if target is None:
        return {}
    try:
        check_beside(version, images, target)
    except ToolError as e:
        print(f"not measured: {e}")
        return {}
    (main, reference), = target.items()
    shown = [metrics.to_display(i, main, exposure) for i in (output, reference)]
    return metrics.measure(*shown, names, version.name)


def place_of(version: Version, images: Images) -> dict[str, Any]:
    """Where the picture lies in its frame, for write_image, as the EXR of its main feature says."""
    path = version.files.get(next(iter(images)), version.files.get("*"))
    if images.origin is None or path is None or path.suffix.lower() != ".exr":
        return {}
    return {"origin": images.origin, "display": read_display(path)}


def save(stem: Path, image: np.ndarray, feature: str, formats: list[str], exposure: float,
         place: dict[str, Any]) -> None:
    """Write a feature in every format; sh1 as three pictures."""
    if feature == "sh1":
        for i, axis in enumerate("xyz"):
            for kind in formats:
                _save(Path(f"{stem}.sh1{axis}.{kind}"), image[..., 3 * i:3 * i + 3], feature, 1.0,
                      place)
        return
    for kind in formats:
        _save(Path(f"{stem}.{feature}.{kind}"), image, feature, exposure, place)


def _save(path: Path, image: np.ndarray, feature: str, exposure: float,
          place: dict[str, Any]) -> None:
    linear = path.suffix[1:].lower() in LINEAR_FORMATS
    write_image(path, image if linear else metrics.to_codes(image, feature, exposure),
                **place)


def read_metadata(root: Path, group: str) -> tuple[float, Path | None]:
    """(tone mapping exposure, its file): <group>.json, or the name cut at its last underscores."""
    name = group
    while True:
        path = root / f"{name}.json"
        if path.is_file():
            try:
                return float(json.loads(path.read_text()).get("exposure", 1.0)), path
            except (ValueError, TypeError, AttributeError) as e:
                raise ToolError(f"{path}: not a JSON object with a number 'exposure'", DATA) from e
        folder, _, last = name.rpartition("/")
        if "_" not in last:
            return 1.0, None
        name = (folder + "/" if folder else "") + last.rpartition("_")[0]


if __name__ == "__main__":
    errors.run(main)
