"""Training data rendered by Blender's Cycles: from .blend files, or the procedural scenes.

  python -m training.scenes.cycles DATA/own --blend shot.blend --frames 1,40,80 --spp 1,4,16
  python -m training.scenes.cycles DATA/train --seeds 0:500 --assets FURNITURE
  python -m training.scenes.cycles DATA/objects --seeds 0:500 --still_lifes

Wants Blender as a Python module, for the Python version that it was made for, and OpenEXR's (pip
install bpy OpenEXR numpy).
"""

from __future__ import annotations

import argparse
import itertools
import os
import sys
import tempfile
import time
from pathlib import Path
from types import ModuleType

import numpy as np

from training import errors
from training.errors import DATA, DEPENDENCY, OUTPUT, USAGE, ToolError
from training.features import load
from training.scan import Version

from . import options, picture
from .render import ATTEMPTS, PILOT, draw_counts, judge_pair, noise_at, target_of

FEATURES = ["hdr", "alb", "nrm"]
LOBES, LIGHTS = ("diffuse", "glossy", "transmission"), ("direct", "indirect", "color")


def parser() -> argparse.ArgumentParser:
    p = errors.Parser(prog="training.scenes.cycles", description=__doc__)
    p.add_argument("out", metavar="OUT", help="folder of the data set; made if missing")
    p.add_argument("--blend", metavar="FILE", help="a scene of your own, as it is but for size, "
                   "samples, and what else would come after rendering")
    p.add_argument("--frames", metavar="N,N", help="with --blend: these frames (default: the "
                   "current one)")
    p.add_argument("--cameras", metavar="A,B", help="with --blend: these cameras, or all (default: "
                   "the active one)")
    p.add_argument("--seeds", help="procedural scenes: 0:500 (end excluded), 7, or 3,7,20:40")
    p.add_argument("--assets", metavar="DIR", help="with --seeds: furniture libraries (.sh3f)")
    p.add_argument("--still_lifes", action="store_true", help="with --seeds: objects in the place "
                   "of rooms, with fog, hair, glass, mirrors, motion and what else rooms lack")
    p.add_argument("--panorama", action="store_true", help="with --seeds, of rooms: all around "
                   "the camera, equirectangular; a size twice as wide as high shows it undistorted")
    p.add_argument("--light_passes", action="store_true", help="direct and indirect light of "
                   "diffuse, glossy and transmission, and their colours, as further layers")
    p.add_argument("--size", help="pixels: 256 or 320x208 (width x height; default: the size of "
                   "FILE, or 256)")
    p.add_argument("--spp", default="1,4,16", help="sample counts of the noisy images")
    p.add_argument("--pick", type=int, default=0, metavar="N",
                   help="how many of the counts a picture gets, drawn per seed (0 = all)")
    p.add_argument("--ref", default="1024", help="samples of the target; with --seeds a list gives "
                   "each scene the least that leaves it clean")
    p.add_argument("--noise_threshold", type=float, metavar="T", help="adaptive sampling of "
                   "the noisy images: where the noise is below this (Blender's default is 0.01) "
                   "they get no more samples, elsewhere --spp (default: --spp everywhere)")
    p.add_argument("--shard", default="0/1", metavar="i/n",
                   help="the i-th of n shares of the pictures, i from 0")
    p.add_argument("--threads", type=int, default=0, help="CPU threads, 0 = all cores")
    return p


def start() -> ModuleType:
    try:
        import bpy
    except ImportError as err:
        raise ToolError(f"Blender's Python module is missing (pip install bpy): {err}",
                        DEPENDENCY) from None
    return bpy


def set_up(scene, size: tuple[int, int] | None, threads: int, light_passes: bool = False) -> None:
    """Cycles, features beside the radiance, and nothing that would change either afterwards. size:
    or None for the scene's own."""
    scene.render.engine = "CYCLES"
    cycles, render = scene.cycles, scene.render
    cycles.device, cycles.use_denoising = "CPU", False
    cycles.time_limit = 0
    kept = next((x for x in scene.view_layers if x.use), scene.view_layers[0])
    for layer in scene.view_layers:
        layer.use = layer == kept
    kept.cycles.denoising_store_passes = True
    for lobe, kind in itertools.product(LOBES, LIGHTS):
        if light_passes:
            setattr(kept, f"use_pass_{lobe}_{kind}", True)
    render.use_compositing = render.use_sequencer = render.use_border = False
    if size:
        render.resolution_x, render.resolution_y = size
        render.resolution_percentage = 100
    render.use_persistent_data = True  # from one sample count to the next
    render.threads_mode = "FIXED" if threads else "AUTO"
    render.threads = threads or render.threads
    settings = render.image_settings
    if hasattr(settings, "media_type"):  # since Blender 5
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format, settings.color_depth = "OPEN_EXR_MULTILAYER", "16"
    settings.exr_codec = "ZIP"
    render.use_file_extension = False


def shoot(bpy, path: str, samples: int, seed: int, threshold: float | None = None) -> None:
    """Renders the current scene into a file; seed: any number from 0; threshold: of the noise below
    which a pixel gets no more samples."""
    scene = bpy.context.scene
    cycles = scene.cycles
    cycles.samples, cycles.seed = samples, seed & 0x7FFFFFFF
    cycles.use_adaptive_sampling = threshold is not None
    if threshold is not None:
        cycles.adaptive_threshold = threshold
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
    if not os.path.exists(path):
        raise ToolError(f"{path}: Blender wrote nothing", OUTPUT)


def pilot(bpy, seed: int) -> np.ndarray:
    """Radiance, albedo and normals (h, w, 9) of a few samples."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "pilot.exr")
        shoot(bpy, path, PILOT, seed)
        images = load(Version("pilot", PILOT, None, files={"*": Path(path)}), FEATURES)
    return np.concatenate([images[f] for f in FEATURES], -1)


def levels(bpy, out: str, name: str, counts: list[int], seed: int, manifest: dict,
           threshold: float | None) -> float:
    """Renders the current scene at these counts into out/name, which appears when all are done;
    the seconds that it took. threshold: of all but the last, the target (shoot)."""
    begin = time.time()
    with picture.folder(out, name) as temporary:
        for spp in reversed(counts):  # an unfinished group has its target at least
            shoot(bpy, os.path.join(temporary, f"{name}_{spp:04d}spp.exr"), spp,
                  seed * 1000 + spp, threshold if spp < counts[-1] else None)
        seconds = round(time.time() - begin, 2)
        picture.publish(out, name, {**manifest, "blender": bpy.app.version_string,
                                    "samples": counts, "seconds": seconds})
    return seconds


def build(bpy, seed: int, attempt: int, stock, size: tuple[int, int],
          args: argparse.Namespace) -> str:
    """The procedural scene of a seed as the current one; its layout. ValueError without a view."""
    from . import blender, layouts, still_lifes, views
    streams = [np.random.default_rng([seed, attempt, 100 + k]) for k in range(3)]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    set_up(bpy.context.scene, size, args.threads, args.light_passes)
    if args.still_lifes:
        return still_lifes.arrange(bpy, streams[0], stock.pictures)
    name, stage = stock.home(streams[0]) or layouts.make(streams[0])
    blender.furnish(bpy, streams[1], stage, stock.pictures, 512 if max(size) > 160 else 256)
    view = views.choose(streams[2], stage, name,
                        lambda eye, dirs: blender.probe(bpy, eye, dirs))
    blender.place_camera(bpy, view, args.panorama)
    bpy.context.scene.cycles.max_bounces = int(streams[2].integers(4, 12))
    return name


def library(bpy, folder: str | None):
    """Assets of the furniture libraries in a folder."""
    from . import assets, blender
    stock = assets.Assets(picture=lambda path: blender.picture(bpy, path))
    if folder:
        stock.read(folder, readers={})
    return stock


def worth_rendering(bpy, seed: int, stock, size: tuple[int, int], args: argparse.Namespace
                    ) -> tuple[dict, float]:
    """Builds the scene of a seed; what its manifest says and the noise of a pilot. Raises
    ValueError if none of its attempts is of use."""
    why = []
    for attempt in range(ATTEMPTS):
        try:
            layout = build(bpy, seed, attempt, stock, size, args)
        except ValueError as err:
            why.append(str(err))
            continue
        fault, noise = judge_pair(*(pilot(bpy, seed * 1000 + k) for k in (998, 999)))
        if not fault:
            return {"seed": seed, "layout": layout, "rejected": why}, noise
        why.append(fault)
    raise ValueError(f"no usable view in {ATTEMPTS} attempts ({', '.join(why)})")


def procedural(bpy, args: argparse.Namespace, counts: list[int], targets: list[int],
               size: tuple[int, int]) -> None:
    """Scenes of seeds. The noise and the choice of counts are those of render."""
    seeds = options.shard(options.seed_list(args.seeds), args.shard)
    kept = {k: getattr(args, k) for k in ("size", "spp", "pick", "ref", "noise_threshold")}
    kept["assets"] = bool(args.assets)
    for name in ("panorama", "light_passes"):
        kept[name] = getattr(args, name) or None  # as where it was no option yet
    letter = "o" if args.still_lifes else "c"
    todo = options.unfinished(args.out, seeds, letter, "scenes to render", kept)
    stock = library(bpy, args.assets)
    for k, seed in enumerate(todo):
        try:
            manifest, noise = worth_rendering(bpy, seed, stock, size, args)
        except ValueError as err:
            print(f"warning: seed {seed}: {err}", file=sys.stderr)
            continue
        target = target_of(noise, targets)
        noisy = draw_counts(np.random.default_rng([seed, 99]), counts, args.pick, target)
        manifest |= {"noise": round(noise_at(noise, target), 4), "options": kept}
        name = f"{letter}{seed:05d}"
        seconds = levels(bpy, args.out, name, [*noisy, target], seed, manifest,
                         args.noise_threshold)
        print(f"{k + 1}/{len(todo)} {name} {manifest['layout']} {noisy} + {target} spp, "
              f"noise {manifest['noise']}, {seconds} s", flush=True)


def own(bpy, args: argparse.Namespace, counts: list[int], size: tuple[int, int] | None) -> None:
    """Frames and cameras of a .blend file; counts: the target is the last."""
    try:
        bpy.ops.wm.open_mainfile(filepath=os.path.abspath(args.blend), load_ui=False)
    except RuntimeError as err:
        raise ToolError(f"{args.blend}: {str(err).strip().splitlines()[-1]}", DATA) from None
    scene = bpy.context.scene
    cameras = {x.name: x for x in scene.objects if x.type == "CAMERA"}
    names = list(cameras) if args.cameras == "all" else (
        args.cameras.split(",") if args.cameras else [scene.camera.name] if scene.camera else [])
    for name in names:
        if name not in cameras:
            raise ToolError(f"--cameras: {args.blend} has no camera {name!r} (but "
                            f"{', '.join(cameras) or 'none'})", USAGE)
    if not names:
        raise ToolError(f"{args.blend}: no camera", DATA)
    frames = (options.count_list(args.frames, "--frames", 0) if args.frames
              else [scene.frame_current])
    set_up(scene, size, args.threads, args.light_passes)
    base = options.plain(os.path.splitext(os.path.basename(args.blend))[0])
    plain = {name: options.plain(name) for name in names}
    if len(set(plain.values())) < len(names):
        raise ToolError(f"{args.blend}: cameras of one name but for marks ({', '.join(names)}), "
                        "which are not told apart in names of files", DATA)
    kept = {k: getattr(args, k) for k in ("size", "spp", "ref", "noise_threshold")}
    kept["light_passes"] = args.light_passes or None
    jobs = options.shard([(f, c) for f in frames for c in names], args.shard)
    for k, (frame, camera) in enumerate(jobs):
        name = f"{base}-f{frame:04d}" + (f"-{plain[camera]}" if len(names) > 1 else "")
        if options.is_finished(args.out, name, kept):
            continue
        scene.frame_set(frame)
        scene.camera = cameras[camera]
        seconds = levels(bpy, args.out, name, counts, frame,
                         {"blend": os.path.basename(args.blend), "frame": frame,
                          "camera": camera, "options": kept}, args.noise_threshold)
        print(f"{k + 1}/{len(jobs)} {name} {counts} spp, {seconds} s", flush=True)


def run(args: argparse.Namespace) -> None:
    counts = options.count_list(args.spp, "--spp")
    targets = options.count_list(args.ref, "--ref", 2)
    size = options.size_pair(args.size) if args.size else None
    if bool(args.blend) == bool(args.seeds):
        raise ToolError("either --blend or --seeds is wanted", USAGE)
    if args.panorama and (args.blend or args.still_lifes):
        raise ToolError("--panorama: with --seeds and rooms only", USAGE)
    if args.still_lifes and args.blend:
        raise ToolError("--still_lifes: with --seeds only", USAGE)
    if counts[-1] >= targets[0]:
        raise ToolError("--ref: targets need more samples than any of --spp", USAGE)
    if args.blend and len(targets) > 1:
        raise ToolError("--ref: one count with --blend", USAGE)
    if args.blend and not os.path.isfile(args.blend):
        raise ToolError(f"--blend: {args.blend} is not a file", DATA)
    if args.noise_threshold is not None and not 0 < args.noise_threshold <= 1:
        raise ToolError("--noise_threshold must be above 0, 1 at most", USAGE)
    if args.threads < 0:
        raise ToolError("--threads must be at least 0", USAGE)
    options.make_folder(args.out)
    bpy = start()
    if args.blend:
        own(bpy, args, [*counts, *targets], size)
    else:
        procedural(bpy, args, counts, targets, size or (256, 256))


def main(argv: list[str] | None = None) -> None:
    run(parser().parse_args(argv))


if __name__ == "__main__":
    errors.run(main)
