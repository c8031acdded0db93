"""Renders one loaded scene from one camera at several sample counts into a folder of EXRs."""

from __future__ import annotations

import contextlib
import glob
import json
import os
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from training.errors import OUTPUT, ToolError

from .files import write_exr

KINDS = ("hdr", "alb", "nrm")
AUX = KINDS[1:]
PASS_SAMPLES = 1 << 22   # camera samples in flight at once: bounds memory (about 1 GB)


@dataclass(frozen=True)
class Shot:
    """Size in pixels, and a function that gives the sensor for so many samples per pixel."""

    width: int
    height: int
    sensor: Callable[[int], object]


def shot(mi, camera: dict, width: int, height: int, rfilter: dict, sampler: str) -> Shot:
    """A Shot of a camera dictionary without film and sampler."""
    film = {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgb",
            "component_format": "float32", "rfilter": rfilter}

    def sensor(spp: int, kind: str = sampler):
        made = mi.load_dict({**camera, "film": film,
                             "sampler": {"type": kind, "sample_count": spp}})
        if made.sampler().sample_count() != spp:  # some samplers round the count up
            return sensor(spp, "independent")
        return made

    return Shot(width, height, sensor)


def render(mi, scene, integrator, shot: Shot, spp: int, seed: int) -> np.ndarray:
    """(height, width, 9) float32: radiance, albedo, normal. Deterministic in seed.

    Large counts are split into passes of equal size with their own seeds.
    """
    passes = 1
    while shot.width * shot.height * spp > PASS_SAMPLES * passes and spp % (passes * 2) == 0:
        passes *= 2
    sensor = shot.sensor(spp // passes)
    total = np.zeros((shot.height, shot.width, 9), np.float64)
    for k in range(passes):
        image = np.array(mi.render(scene, sensor=sensor, integrator=integrator, spp=spp // passes,
                                   seed=(seed * 64 + k) & 0x7FFFFFFF))
        colour = image[..., : 3 if image.shape[-1] > 8 else 1]  # a film of one channel
        total += np.concatenate([np.broadcast_to(colour, total.shape[:2] + (3,)),
                                 image[..., -6:]], -1)
    return (total / passes).astype(np.float32)


def clean(image: np.ndarray) -> tuple[np.ndarray, int]:
    """Replaces non-finite values by 0; returns the image and how many pixels were bad."""
    bad = ~np.isfinite(image).all(-1)
    return np.where(bad[..., None], 0.0, image), int(bad.sum())


def write_level(folder: str, name: str, spp: int, image: np.ndarray, bits: int,
                kinds: tuple[str, ...] = KINDS) -> None:
    """name_SSSSspp.{hdr,alb,nrm}.exr, those of `kinds`"""
    for kind in kinds:
        k = KINDS.index(kind)
        part = image[..., 3 * k: 3 * k + 3]
        if kind == "hdr":
            part = np.maximum(part, 0.0)
        elif kind == "alb":
            part = np.clip(part, 0.0, 1.0)
        write_exr(os.path.join(folder, f"{name}_{spp:04d}spp.{kind}.exr"), part, bits)


@contextlib.contextmanager
def folder(out: str, name: str):
    """A folder in out to fill, which `publish` gives its name; nothing is left of it after an
    error."""
    temporary = os.path.join(out, f".{name}.tmp{os.getpid()}")
    for old in glob.glob(os.path.join(glob.escape(out), f".{name}.tmp*")):  # of a killed run
        shutil.rmtree(old)
    try:
        os.makedirs(temporary)
        yield temporary
    except BaseException as err:
        shutil.rmtree(temporary, ignore_errors=True)
        if isinstance(err, OSError):
            raise ToolError(f"{temporary}: {err.strerror}", OUTPUT) from None
        raise


def write_group(mi, out: str, name: str, scene, integrators, shot: Shot, noisy: list[int],
                target: int, seed: int, gain: float = 1.0, bits: tuple[int, int] = (10, 10),
                kinds: tuple[str, ...] = KINDS) -> dict:
    """Renders all levels into out/name, which appears only when complete; returns figures.

    integrators: of the noisy versions and of the target; noisy, target: samples per pixel; gain
    multiplies the radiance; bits: mantissa of the noisy files and of the target; kinds: of KINDS,
    those to write.
    """
    figures: dict = {"seconds": {}, "non_finite": 0}
    with folder(out, name) as temporary:
        for spp in [target, *noisy]:  # an unfinished group has its target at least
            start = time.process_time()
            image, bad = clean(render(mi, scene, integrators[spp == target], shot, spp,
                                      seed * 1000 + spp))
            image[..., :3] *= gain
            write_level(temporary, name, spp, image, bits[spp == target], kinds)
            figures["seconds"][f"{spp:04d}"] = round(time.process_time() - start, 2)
            figures["non_finite"] += bad
    return figures


def publish(out: str, name: str, manifest: dict) -> None:
    """Adds manifest.json to the finished folder and gives it its name."""
    folder = os.path.join(out, f".{name}.tmp{os.getpid()}")
    try:
        with open(os.path.join(folder, "manifest.json"), "w") as f:
            json.dump(manifest, f, indent=1)
        os.rename(folder, os.path.join(out, name))
    except OSError as err:
        shutil.rmtree(folder, ignore_errors=True)
        raise ToolError(f"{os.path.join(out, name)}: {err.strerror}", OUTPUT) from None
