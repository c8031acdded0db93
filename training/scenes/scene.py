"""From a seed to a loaded Mitsuba scene, its camera and the settings of its render."""

from __future__ import annotations

import os
import tempfile
from dataclasses import asdict, dataclass, field

import numpy as np

from . import layouts
from . import materials
from . import textures as tx
from .assets import Assets
from .features import FeatureSettings
from .mesh import scale, translate, write_ply
from .stage import Stage
from .views import choose

FILTERS = (({"type": "box"}, 0.72), ({"type": "tent"}, 0.08),
           ({"type": "gaussian", "stddev": 0.5}, 0.1),
           ({"type": "gaussian", "stddev": 0.7}, 0.03),
           ({"type": "mitchell"}, 0.03), ({"type": "catmullrom"}, 0.01),
           ({"type": "lanczos"}, 0.01), ({"type": "gaussian", "stddev": 0.9}, 0.02))
WINDOWS = (1.5, 5.0)  # how many times larger the frame is of which a picture is a part


@dataclass(frozen=True)
class Settings:
    """What differs from seed to seed besides the scene itself. Written to the manifest."""

    seed: int
    attempt: int
    layout: str
    features: FeatureSettings
    max_depth: int
    rfilter: dict
    sampler: str
    aperture: float          # lens radius, 0 = pinhole
    fog: float               # extinction per unit length, 0 = none
    log_exposure: float      # natural logarithm of the mean of the picture
    window: float = 1.0      # the picture is 1/window of a frame as wide and as high
    aimed: int | None = None # vertices at which the noisy versions sample lights, None = all
    lights: list[str] = field(default_factory=list)

    def manifest(self) -> dict:
        return asdict(self)


@dataclass
class Built:
    settings: Settings
    scene: object            # mi.Scene
    camera: dict             # sensor dictionary without film and sampler


def _choice(rng: np.random.Generator, table):
    p = np.array([x[1] for x in table])
    return table[rng.choice(len(table), p=p / p.sum())][0]


def _rgb(values) -> dict:
    return {"type": "rgb", "value": [float(x) for x in values]}


def _warm(rng: np.random.Generator) -> np.ndarray:
    """Colour of a lamp: white, warm, cold or saturated; largest component 1."""
    c = np.array([[1, 1, 1], [1, 0.8, 0.55], [0.7, 0.85, 1], rng.random(3) + 0.05])[
        rng.choice(4, p=[0.3, 0.4, 0.15, 0.15])]
    return c / c.max()


def _emitters(mi, rng, stage: Stage, assets: Assets) -> tuple[dict, list[str]]:
    """Emitter dictionaries without mesh lights, and words for the manifest."""
    out, words = {}, []
    for k, lamp in enumerate(stage.lamps):
        value = _warm(rng) * float(lamp["power"])
        words.append(lamp["type"])
        if lamp["type"] == "point":
            out[f"lamp{k}"] = {"type": "point", "intensity": _rgb(value),
                               "position": [float(x) for x in lamp["from"]]}
        else:
            look = mi.ScalarTransform4f().look_at(
                origin=[float(x) for x in lamp["from"]],
                target=[float(x) for x in lamp["to"]], up=[0.02, 1, 0.01])
            out[f"lamp{k}"] = {"type": "spot", "intensity": _rgb(value * 3), "to_world": look,
                               "cutoff_angle": float(lamp["angle"]),
                               "beam_width": float(lamp["angle"] * rng.uniform(0.5, 0.95))}
    meshes = any(slot in ("light", "panel") for slot, _ in stage.parts)
    if rng.random() < stage.sky or not (out or meshes):
        to = (mi.ScalarTransform4f().rotate([0, 0, 1], float(rng.uniform(0, 360)))
              .rotate([1, 0, 0], 90))
        pick = rng.random()
        if assets.skies and pick < 0.5:
            image = assets.skies[rng.integers(len(assets.skies))]
        elif pick < 0.92:
            image = tx.sky(rng, 512)
        else:
            image = np.ones((2, 4, 3), np.float32) * _warm(rng)
        strength = float(np.exp(rng.uniform(-1.5, 1.5)))
        out["sky"] = {"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(image)),
                      "scale": strength, "to_world": to}
        words.append("sky")
    return out, words


def _shapes(mi, rng, stage: Stage, assets: Assets, folder: str, fine: bool
            ) -> tuple[dict, list[str]]:
    """One PLY per material slot, as Mitsuba shapes; also the BSDFs and words for mesh lights."""
    meshes = stage.by_slot()
    for slot, mesh in meshes.items():
        if mesh.c is None:
            meshes[slot] = mesh.coloured((0.5, 0.5, 0.5))
    texels = np.full((1, 1, 3), 0.5, np.float32)
    if "gloss" in meshes:
        meshes["gloss"], texels = materials.colours_to_texels(meshes["gloss"])
    bsdfs = materials.palette(mi, rng, meshes, assets.pictures, texels, fine,
                              stage.prints.bitmap if "print" in meshes else None)
    out, words = {}, []
    for slot, mesh in meshes.items():
        path = os.path.join(folder, f"{slot}.ply")
        write_ply(path, mesh)
        shape = {"type": "ply", "filename": path}
        if slot in ("light", "panel"):
            power = np.exp(rng.uniform(np.log(2), np.log(30)))
            if slot == "panel":
                power *= 2
            radiance = _warm(rng) * power / (np.pi * max(mesh.area(), 1e-5)) * 2
            shape["bsdf"] = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
            shape["emitter"] = {"type": "area", "radiance": _rgb(radiance)}
            words.append(slot)
        else:
            out[f"bsdf_{slot}"] = bsdfs[slot]
            shape["bsdf"] = {"type": "ref", "id": f"bsdf_{slot}"}
        out[f"shape_{slot}"] = shape
    return out, words


def _fog(mi, rng, stage: Stage, density: float):
    """A block of homogeneous medium filling the stage's extent: (shapes, medium, lo, hi)."""
    lo, hi = (np.asarray(x, float) for x in stage.extent)
    m = translate(*((lo + hi) / 2)) @ scale(*((hi - lo) / 2 * 0.998))
    albedo = np.clip(rng.uniform(0.6, 0.99) * _warm(rng) ** 0.3, 0, 0.99)
    phase = ({"type": "isotropic"} if rng.random() < 0.5
             else {"type": "hg", "g": float(rng.uniform(-0.2, 0.8))})
    medium = mi.load_dict({"type": "homogeneous", "sigma_t": density, "albedo": _rgb(albedo),
                           "phase": phase})
    block = {"type": "cube", "to_world": mi.ScalarTransform4f(m), "interior": medium,
             "bsdf": {"type": "null"}}
    return {"fog": block}, medium, lo, hi


def probe(mi, scene, eye: np.ndarray, dirs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (n; inf = miss) and ids of what is seen from eye along unit vectors (n, 3)."""
    if "scalar" in mi.variant():
        dist, ids = [], []
        for v in dirs:
            p = scene.ray_intersect_preliminary(
                mi.Ray3f([float(a) for a in eye], [float(a) for a in v]), False)
            dist.append(p.t if p.is_valid() else np.inf)
            ids.append(p.prim_index)
        return np.array(dist, float), np.array(ids)
    ray = mi.Ray3f(mi.Point3f([float(a) for a in eye]),
                   mi.Vector3f(*(mi.Float(dirs[:, k].astype(np.float32)) for k in range(3))))
    p = scene.ray_intersect_preliminary(ray, False)
    dist = np.where(np.array(p.is_valid()), np.array(p.t), np.inf)
    return dist, np.array(p.prim_index)


def _camera(mi, rng, scene, stage: Stage, name: str) -> tuple[dict, float]:
    """Best of some random views, as a sensor dictionary, and its lens radius."""
    view = choose(rng, stage, name, lambda eye, dirs: probe(mi, scene, eye, dirs))
    aim = mi.ScalarTransform4f().look_at(origin=[float(x) for x in view.eye],
                                         target=[float(x) for x in view.target],
                                         up=[view.roll, 0.0, 1.0])
    cam = {"type": "perspective", "fov": view.fov, "fov_axis": "smaller", "to_world": aim,
           "near_clip": 0.01, "far_clip": 1000.0}
    if view.aperture:
        cam |= {"type": "thinlens", "aperture_radius": view.aperture,
                "focus_distance": view.focus}
    return cam, view.aperture


def _window(mi, rng: np.random.Generator, camera: dict) -> tuple[dict, float]:
    """The camera of a part of the frame, and how many times smaller the part is: large pictures
    show surfaces as broad and edges as far apart."""
    part = float(np.exp(rng.uniform(*np.log(WINDOWS))))
    half = np.tan(np.radians(camera["fov"]) / 2)
    x, y = rng.uniform(-1, 1, 2) * half * (1 - 1 / part)
    turn = (mi.ScalarTransform4f().rotate([0, 1, 0], float(np.degrees(np.arctan(x))))
            .rotate([1, 0, 0], float(np.degrees(np.arctan(y)))))
    return camera | {"fov": float(2 * np.degrees(np.arctan(half / part))),
                     "to_world": camera["to_world"] @ turn}, part


def build(mi, seed: int, attempt: int, assets: Assets, plain: bool = False,
          fine: bool = True, windows: float = 0.0, unaimed: float = 0.0) -> Built:
    """Scene of a seed; raises ValueError when this attempt has no usable view.

    plain: box filter, independent sampler, no fog (for comparisons). fine: large bitmaps,
    for pictures of more than about 160 pixels. windows: share of views that are a part of a larger
    frame. unaimed: share of scenes, of those it can be done in, whose noisy versions meet lights
    by chance, all of them or all but those of the first surface.
    """
    streams = [np.random.default_rng([seed, attempt, k]) for k in range(5)]
    name, stage = assets.home(streams[0]) or layouts.make(streams[0])
    assets.furnish(streams[4], stage)
    with tempfile.TemporaryDirectory(prefix="lull-scene-") as folder:
        shapes, words = _shapes(mi, streams[1], stage, assets, folder, fine)
        emitters, more = _emitters(mi, streams[2], stage, assets)
        base = {"type": "scene", **shapes, **emitters}
        rng = streams[3]
        scene = mi.load_dict(base)
        cam, radius = _camera(mi, rng, scene, stage, name)
        fog = 0.0
        if rng.random() < 0.1 and not plain:
            lo, hi = (np.asarray(x, float) for x in stage.extent)
            fog = float(rng.uniform(0.1, 1.2) / np.linalg.norm(hi - lo) * 2)
            block, medium, lo, hi = _fog(mi, rng, stage, fog)
            scene = mi.load_dict(base | block)
            eye = np.array(cam["to_world"].matrix, float).reshape(4, 4)[:3, 3]
            if (eye > lo).all() and (eye < hi).all():
                cam["medium"] = medium
    part, aimed = 1.0, None
    extra = np.random.default_rng([seed, attempt, 5])
    if extra.random() < windows:
        cam, part = _window(mi, extra, cam)
    if extra.random() < unaimed and fog == 0.0 and not {"point", "spot"} & set(more):
        aimed = int(extra.integers(2))
    feats = FeatureSettings(
        follow=str(rng.choice(["first", "cutout", "delta"], p=[0.08, 0.32, 0.6])),
        emitter=str(rng.choice(["one", "colour", "surface"], p=[0.5, 0.3, 0.2])),
        miss=str(rng.choice(["zero", "one", "env"], p=[0.45, 0.25, 0.3])),
        faceforward=bool(rng.random() < 0.5),
        volume=str(rng.choice(["ignore", "scatter"])))
    st = Settings(
        seed=seed, attempt=attempt, layout=name, features=feats,
        max_depth=int(rng.integers(4, 10)),
        rfilter={"type": "box"} if plain else dict(_choice(rng, FILTERS)),
        sampler="independent" if plain else str(rng.choice(
            ["independent", "multijitter", "ldsampler"], p=[0.76, 0.14, 0.1])),
        aperture=radius, fog=fog, log_exposure=float(rng.normal(-1.2, 1.2)), window=part,
        aimed=aimed,
        lights=words + more)
    return Built(st, scene, cam)
