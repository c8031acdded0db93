"""Render your own Mitsuba scene to train on: python -m training.scenes.render_scene SCENE.xml OUT

OUT/NAME/ holds NAME_SSSSspp.{hdr,alb,nrm}.exr for every sample count (the highest is the target)
and manifest.json. The radiance comes from the scene's own integrator; albedo and normal from the
same camera rays. Finished views are skipped.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import time
from dataclasses import asdict

import numpy as np

from training import errors
from training.errors import DATA, USAGE, ToolError

from . import backend
from .options import bit_pair, count_list, is_finished, make_folder, plain, shard, size_pair


def parser() -> argparse.ArgumentParser:
    p = errors.Parser(prog="training.scenes.render_scene", description=__doc__)
    p.add_argument("scene", metavar="SCENE", help="Mitsuba 3 scene file (.xml)")
    p.add_argument("out", metavar="OUT", help="folder of the data set; made if missing")
    p.add_argument("--name", help="name of the groups (default: the scene's file name)")
    p.add_argument("--spp", default="1,2,4,8,16,32", help="sample counts of the noisy images")
    p.add_argument("--ref", type=int, default=1024, help="samples of the target")
    p.add_argument("--size", help="pixels: 256 or 640x480 (default: the scene's film)")
    p.add_argument("--sensors", default="all", help="which of the scene's cameras: all, or 0,2")
    p.add_argument("--views", type=int, default=1,
                   help="views per camera; those after the first are moved at random")
    p.add_argument("--move", type=float, default=0.2,
                   help="how far further views move, relative to the distance of what is seen")
    p.add_argument("--seed", type=int, default=0, help="of views and noise")
    p.add_argument("-D", dest="define", action="append", default=[], metavar="KEY=VALUE",
                   help="value of a $KEY in the scene file")
    p.add_argument("--depth", type=int, default=0,
                   help="use a path tracer of this depth instead of the scene's integrator")
    p.add_argument("--follow", default="delta", choices=("first", "cutout", "delta"),
                   help="features of the first hit, behind cut-outs, or behind mirrors and glass")
    p.add_argument("--emitter", default="one", choices=("one", "colour", "surface"),
                   help="albedo of emitters")
    p.add_argument("--miss", default="zero", choices=("zero", "one", "env"),
                   help="albedo where nothing is hit")
    p.add_argument("--faceforward", action="store_true", help="turn normals towards the camera")
    p.add_argument("--volume", default="ignore", choices=("ignore", "scatter"),
                   help="features of a medium that scatters before the surface")
    p.add_argument("--shard", default="0/1", metavar="i/n",
                   help="the i-th of n shares of the views, i from 0")
    p.add_argument("--variant", default="llvm_ad_rgb", choices=backend.VARIANTS)
    p.add_argument("--threads", type=int, default=0, help="CPU threads, 0 = all cores")
    p.add_argument("--bits", default="10,10", metavar="N,T",
                   help="mantissa bits kept in noisy files and targets")
    return p


def _load(mi, args: argparse.Namespace):
    keys = {}
    for text in args.define:
        key, eq, value = text.partition("=")
        if not eq or not key:
            raise ToolError(f"-D: cannot read {text!r} (wanted: KEY=VALUE)", USAGE)
        keys[key] = value
    try:
        with backend.reading():
            scene = mi.load_file(args.scene, **keys)
    except Exception as err:
        text = " ".join(str(err).split())
        raise ToolError(f"{args.scene}: {text[:300]}", DATA) from None
    if not isinstance(scene, mi.Scene) or not scene.sensors():
        raise ToolError(f"{args.scene}: holds no scene with a sensor", DATA)
    return scene


def _kept(args: argparse.Namespace) -> dict:
    """What decides the pictures of a view: the scene file, by a digest, and options."""
    with open(args.scene, "rb") as f:
        scene = hashlib.sha256(f.read()).hexdigest()[:16]
    return {"scene": scene, **{k: getattr(args, k) for k in (
        "define", "spp", "ref", "size", "move", "seed", "depth", "follow", "emitter", "miss",
        "faceforward", "volume", "bits")}}


def _which(args: argparse.Namespace, count: int) -> list[int]:
    if args.sensors == "all":
        return list(range(count))
    chosen = count_list(args.sensors, "--sensors", 0)
    if chosen[-1] >= count:
        raise ToolError(f"--sensors: the scene has {count} (numbered from 0)", USAGE)
    return chosen


def _moved(mi, scene, matrix: np.ndarray, rng: np.random.Generator, amount: float) -> np.ndarray:
    """Camera matrix (4,4) at a random place near, looking at the same point."""
    eye, ahead = matrix[:3, 3], matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    hit = scene.ray_intersect(mi.Ray3f([float(x) for x in eye], [float(x) for x in ahead]))
    t = float(np.array(hit.t).reshape(-1)[0])
    if not np.isfinite(t):
        box = scene.bbox()
        t = float(np.linalg.norm(np.array(box.max).ravel() - np.array(box.min).ravel())) / 2
    target = eye + ahead * t
    eye = eye + rng.normal(size=3) * amount * t * 0.5
    d = target - eye + rng.normal(size=3) * amount * t * 0.15
    look = mi.ScalarTransform4f().look_at(origin=[float(x) for x in eye],
                                          target=[float(x) for x in eye + d],
                                          up=[float(x) for x in matrix[:3, 1]])
    return np.array(look.matrix, float).reshape(4, 4)


def _integrator(mi, scene, args: argparse.Namespace):
    from . import features
    s = features.FeatureSettings(args.follow, args.emitter, args.miss, args.faceforward,
                                 args.volume)
    if args.depth:
        return features.FeaturePath(None, s, args.depth), s
    inner = scene.integrator()
    if inner is None or not isinstance(inner, mi.SamplingIntegrator) or inner.aov_names():
        raise ToolError(f"{args.scene}: its integrator gives no radiance along rays "
                         "(path and volpath do); use --depth", USAGE)
    return features.FeatureVolume(inner, s), s


def _view(mi, scene, number: int, view: int, args: argparse.Namespace):
    """Shot of one camera from one view, and the camera's matrix."""
    from . import picture
    sensor = scene.sensors()[number]
    params = mi.traverse(sensor)
    if args.size:
        params["film.size"] = list(size_pair(args.size))
    if view:
        rng = np.random.default_rng([args.seed, number, view])
        key = "to_world"
        matrix = np.array(params[key].matrix, float).reshape(-1)[:16].reshape(4, 4)
        matrix = _moved(mi, scene, matrix, rng, args.move)
        params[key] = mi.Transform4f(mi.ScalarTransform4f(matrix))
    params.update()
    w, h = (int(x) for x in np.array(sensor.film().crop_size()).ravel())
    return picture.Shot(w, h, lambda spp: sensor)


def run(args: argparse.Namespace) -> None:
    """Renders the views of this shard."""
    counts = count_list(args.spp, "--spp")
    if args.ref <= counts[0]:
        raise ToolError("--ref: the target needs more samples than the least of --spp", USAGE)
    if args.views < 1 or args.threads < 0 or args.depth < 0 or args.seed < 0 or args.move < 0:
        raise ToolError("--views must be >= 1; --threads, --depth, --seed and --move >= 0", USAGE)
    bits = bit_pair(args.bits)
    if args.size:
        size_pair(args.size)
    if not os.path.isfile(args.scene):
        raise ToolError(f"{args.scene}: no such file", DATA)
    name = args.name or plain(os.path.splitext(os.path.basename(args.scene))[0])
    make_folder(args.out)
    mi = backend.load(args.variant, args.threads)
    from . import picture
    scene = _load(mi, args)
    integrator, settings = _integrator(mi, scene, args)
    jobs = [(n, v) for n in _which(args, len(scene.sensors())) for v in range(args.views)]
    wanted = _kept(args)
    groups = {job: f"{name}-c{job[0]}v{job[1]}" if len(jobs) > 1 else name
              for job in shard(jobs, args.shard)}
    finished = {g for g in groups.values() if is_finished(args.out, g, wanted)}
    for (number, view), group in groups.items():
        if group in finished:
            print(f"{group}: finished before", flush=True)
            continue
        start = time.process_time()
        scene = _load(mi, args) if view else scene  # each view starts from the scene's own camera
        shot = _view(mi, scene, number, view, args)
        figures = picture.write_group(mi, args.out, group, scene, (integrator,) * 2, shot,
                                      [c for c in counts if c < args.ref], args.ref,
                                      args.seed * 977 + number * 31 + view, 1.0, bits)
        manifest = {"scene": os.path.basename(args.scene), "sensor": number, "view": view,
                    "size": [shot.width, shot.height], "features": asdict(settings),
                    "target": args.ref, "variant": args.variant, "mitsuba": mi.__version__,
                    "options": wanted, **figures,
                    "cpu_seconds": round(time.process_time() - start, 2)}
        picture.publish(args.out, group, manifest)
        print(f"{group}: {shot.width}x{shot.height}, {manifest['cpu_seconds']} s", flush=True)


def main(argv: list[str] | None = None) -> None:
    run(parser().parse_args(argv))


if __name__ == "__main__":
    errors.run(main)
