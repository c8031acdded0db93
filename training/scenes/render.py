"""Render procedural scenes to train on: python -m training.scenes.render OUT --seeds 0:500

OUT/sNNNNN/ holds sNNNNN_SSSSspp.{hdr,alb,nrm}.exr for every sample count (the highest is the
target) and manifest.json. Finished scenes are skipped, so a stopped run continues where it was.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path

import numpy as np

from training import errors
from training.errors import DATA, OUTPUT, USAGE, ToolError
from training.imageio import replacing

from . import backend, options
from .files import tonemap
from .options import bit_pair, count_list, size_pair

ATTEMPTS = 8
PILOT = 4          # samples of each of two pilot renders
CLEAN = 0.035      # noise that a target may have before it gets more samples
HOPELESS = 0.40    # noise of a pilot render beyond which another scene is made of the seed


def parser() -> argparse.ArgumentParser:
    p = options.parser("training.scenes.render", __doc__, 256, "1,2,4,8,16,32", 0)
    p.add_argument("--ref", default="1024", help="samples of the target; of several counts "
                   "(128,512) each scene gets the least that leaves little noise")
    p.add_argument("--variant", default="llvm_ad_rgb", choices=backend.VARIANTS)
    p.add_argument("--threads", type=int, default=0, help="CPU threads, 0 = all cores")
    p.add_argument("--assets", metavar="DIR", help="own meshes, pictures and environments to use")
    p.add_argument("--plain", action="store_true",
                   help="box filter, independent sampler and no fog everywhere")
    p.add_argument("--windows", type=float, default=0.0, metavar="P",
                   help="share of pictures that are a part of a frame 1.5 to 5 times as large")
    p.add_argument("--unaimed", type=float, default=0.0, metavar="P",
                   help="share of scenes whose noisy versions meet lights by chance (where no fog, "
                   "point or spot light forbids it); targets sample lights as ever")
    p.add_argument("--no_light", action="store_true", help="albedo and normals alone, as models "
                   "that denoise these are trained with: only the paths to them are traced")
    return p


def draw_counts(rng: np.random.Generator, counts: list[int], pick: int, target: int) -> list[int]:
    """All counts below the target, or pick of them, likelier the fewer samples they have."""
    counts = [c for c in counts if c < target]
    if not pick or pick >= len(counts):
        return counts
    p = 1.0 / (1.0 + np.log2(np.array(counts, float)))
    return sorted(int(c) for c in rng.choice(counts, pick, replace=False, p=p / p.sum()))


def judge(image: np.ndarray, lit: bool = True) -> str:
    """Why a pilot picture (h, w, 9) is not worth rendering, or ""; lit: radiance counts."""
    shapes = image[..., 3:].reshape(-1, 6).std(0).sum()
    if not lit:
        return "flat" if shapes < 0.1 else ""
    light = np.nan_to_num(image[..., :3].mean(-1), posinf=0.0).clip(0)
    white = np.percentile(light, 95)
    if not white > 0:
        return "black"
    if (light > 0.01 * white).mean() < 0.4:
        return "mostly black"
    spread = np.std(np.log(light + 0.02 * white))
    return "flat" if spread < 0.1 or shapes < 0.1 else ""


def pilot_noise(a: np.ndarray, b: np.ndarray) -> float:
    """Standard deviation of the noise of tone-mapped radiance, from two renders (h, w, 9)."""
    white = max(float(np.percentile((a + b)[..., :3].max(-1) / 2, 95)), 1e-9)
    d = tonemap(a[..., :3], white) - tonemap(b[..., :3], white)
    return float(np.sqrt(np.mean(d * d) / 2))


def noise_at(pilot: float, spp: int) -> float:
    """Noise to expect at a count; tone mapping and fireflies make it fall slower than 1/sqrt."""
    return pilot * (PILOT / spp) ** 0.4


def judge_pair(one: np.ndarray, two: np.ndarray, lit: bool = True) -> tuple[str, float]:
    """Of two renders of a pilot (h, w, 9): why it is not worth rendering, or "", and the standard
    deviation of its noise."""
    noise = pilot_noise(one, two)
    return judge((one + two) / 2, lit) or ("too noisy" if noise > HOPELESS else ""), noise


def target_of(noise: float, targets: list[int]) -> int:
    """The least of the counts that leaves a target clean, by the noise of the pilot."""
    return next((n for n in targets if noise_at(noise, n) < CLEAN), targets[-1])


def render_seed(mi, seed: int, args: argparse.Namespace, assets) -> dict:
    """Renders one scene into OUT; returns its manifest. Raises ToolError when nothing usable."""
    from . import features, picture, scene
    counts = count_list(args.spp, "--spp")
    targets = count_list(args.ref, "--ref", 2)
    width, height = size_pair(args.size)
    name, start, why = f"s{seed:05d}", time.process_time(), []
    for attempt in range(ATTEMPTS):
        try:
            built = scene.build(mi, seed, attempt, assets, args.plain, max(width, height) > 160,
                                args.windows, args.unaimed)
        except ValueError as err:
            why.append(str(err))
            continue
        st = built.settings
        if args.no_light:
            integrator = by_chance = features.FeatureVolume(None, st.features)
        else:
            integrator = features.make(st.features, st.max_depth, st.fog > 0)
            by_chance = features.make(st.features, st.max_depth, st.fog > 0, st.aimed)
        shot = picture.shot(mi, built.camera, width, height, st.rfilter, st.sampler)
        one, two = (picture.clean(picture.render(mi, built.scene, integrator, shot, PILOT,
                                                 seed * 1000 + k))[0] for k in (998, 999))
        fault, noise = judge_pair(one, two, not args.no_light)
        if fault:
            why.append(fault)
            continue
        light = ((one + two) / 2)[..., :3].mean(-1)
        gain = 1.0 if args.no_light else float(
            np.exp(st.log_exposure) / light.clip(0, np.percentile(light, 97)).mean())
        rng = np.random.default_rng([seed, 99])
        target = target_of(noise, targets)
        noisy = draw_counts(rng, counts, args.pick, target)
        figures = picture.write_group(mi, args.out, name, built.scene, (by_chance, integrator),
                                      shot, noisy, target, seed, gain, bit_pair(args.bits),
                                      picture.AUX if args.no_light else picture.KINDS)
        manifest = {**st.manifest(), "size": [width, height], "noisy": noisy, "target": target,
                    "gain": gain, "noise": round(noise_at(noise, target), 4), "rejected": why,
                    "variant": args.variant, "mitsuba": mi.__version__, **figures,
                    "cpu_seconds": round(time.process_time() - start, 2)}
        picture.publish(args.out, name, manifest)
        return manifest
    raise ToolError(f"no usable view in {ATTEMPTS} attempts ({', '.join(why)})", DATA)


def _same_options(out: str, args: argparse.Namespace) -> None:
    """Keeps a data set from being mixed out of different options."""
    keep = {k: getattr(args, k) for k in ("size", "spp", "pick", "ref", "plain", "bits",
                                         "windows", "unaimed", "no_light")}
    keep["assets"] = bool(args.assets)
    path = os.path.join(out, "render.json")
    if os.path.exists(path):
        with open(path) as f:
            before = {"windows": 0.0, "unaimed": 0.0, "no_light": False}  # folders from before them
            had = before | json.load(f)
        options.check_same(path, "folder was rendered", had, keep)
        return
    with replacing(Path(path)) as tmp:
        tmp.write_text(json.dumps(keep, indent=1))


def run(args: argparse.Namespace) -> None:
    """Renders the seeds of this shard."""
    seeds = options.check(args)
    if count_list(args.spp, "--spp")[0] >= count_list(args.ref, "--ref", 2)[0]:
        raise ToolError("--ref: the target needs more samples than the least of --spp", USAGE)
    if args.threads < 0:
        raise ToolError("--threads must be at least 0", USAGE)
    if not (0 <= args.windows <= 1 and 0 <= args.unaimed <= 1):
        raise ToolError("--windows and --unaimed are shares: 0 to 1", USAGE)
    if args.no_light and args.unaimed:
        raise ToolError("--unaimed: of --no_light scenes no path looks for a light", USAGE)
    options.make_folder(args.out)
    try:
        _same_options(args.out, args)
    except OSError as err:
        raise ToolError(f"{args.out}: {err.strerror}", OUTPUT) from None
    todo = options.unfinished(args.out, seeds, "s", "scenes to render")
    if not todo:
        return
    mi = backend.load(args.variant, args.threads)
    import drjit as dr
    from . import assets
    stock = assets.load(mi, args.assets)
    failed = 0
    for k, seed in enumerate(todo):
        try:
            m = render_seed(mi, seed, args, stock)
        except (ToolError, RuntimeError) as err:  # RuntimeError: Mitsuba or Dr.Jit
            if getattr(err, "code", DATA) == OUTPUT:
                raise
            failed += 1
            print(f"warning: seed {seed}: {str(err).splitlines()[0]}", file=sys.stderr, flush=True)
            continue
        print(f"{k + 1}/{len(todo)} s{seed:05d} {m['layout']} {m['noisy']} + {m['target']} spp, "
              f"{m['cpu_seconds']} s", flush=True)
        dr.flush_malloc_cache()
        dr.flush_kernel_cache()
    if failed == len(todo):
        raise ToolError(f"{args.out}: none of {failed} scenes could be rendered", DATA)


def main(argv: list[str] | None = None) -> None:
    run(parser().parse_args(argv))


if __name__ == "__main__":
    errors.run(main)
