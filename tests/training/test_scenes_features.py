"""Albedo and normal of the scene renderer against scenes with known answers, and its radiance
against Mitsuba's path tracer. Skipped where Mitsuba is missing."""

from __future__ import annotations

import numpy as np
import pytest

from training.errors import ToolError
from training.scenes import backend

pytest.importorskip("mitsuba", reason="optional: the package mitsuba is not installed")

FLOOR, SIDE, BACK = (0.3, 0.6, 0.2), (0.7, 0.2, 0.1), (0.1, 0.3, 0.8)
TINT = (0.9, 0.7, 0.5)


@pytest.fixture(scope="module")
def mi():
    """Mitsuba with LLVM, else its scalar variant."""
    try:
        return backend.load("llvm_ad_rgb", 2)
    except ToolError:
        return backend.load("scalar_rgb")


def rgb(values) -> dict:
    return {"type": "rgb", "value": list(values)}


def wall(mi, transform, colour, **extra) -> dict:
    bsdf = {"type": "twosided", "b": {"type": "diffuse", "reflectance": rgb(colour)}}
    return {"type": "rectangle", "to_world": transform, "bsdf": bsdf, **extra}


def camera(mi, size: int = 8) -> dict:
    """Parallel rays along -z through x, y in -1..1."""
    t = mi.ScalarTransform4f
    return {"type": "orthographic", "near_clip": 0.01, "far_clip": 100.0,
            "to_world": t().look_at(origin=[0, 0, 5], target=[0, 0, 0], up=[0, 1, 0])}


def mirror_scene(mi) -> dict:
    """A tinted mirror at 45 degrees shows a wall at x = 8 (normal -x); nothing else is seen."""
    t = mi.ScalarTransform4f
    return {
        "type": "scene", "light": {"type": "constant", "radiance": rgb((0.5, 0.5, 0.5))},
        "mirror": {"type": "rectangle", "to_world": t().rotate([0, 1, 0], 45).scale(4),
                   "bsdf": {"type": "conductor", "material": "none",
                            "specular_reflectance": rgb(TINT)}},
        "side": wall(mi, t().translate([8, 0, 0]).rotate([0, 1, 0], -90).scale(20), SIDE)}


def glass_scene(mi) -> dict:
    """A slab of glass in front of a wall; what the slab reflects is a wall behind the camera."""
    t = mi.ScalarTransform4f
    return {
        "type": "scene", "light": {"type": "constant", "radiance": rgb((0.5, 0.5, 0.5))},
        "slab": {"type": "cube", "to_world": t().scale([4, 4, 0.2]),
                 "bsdf": {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}},
        "floor": wall(mi, t().translate([0, 0, -3]).scale(20), FLOOR),
        "back": wall(mi, t().translate([0, 0, 9]).rotate([1, 0, 0], 180).scale(20), BACK)}


def picture(mi, scene: dict, settings: dict, spp: int, volume: bool = False, cam=None, size=8):
    """Mean radiance, albedo and normal over the picture, (9,)."""
    from training.scenes import features
    from training.scenes import picture as pic
    shot = pic.shot(mi, cam or camera(mi), size, size, {"type": "box"}, "independent")
    integrator = features.make(features.FeatureSettings(**settings), 6, volume)
    return pic.render(mi, mi.load_dict(scene), integrator, shot, spp, 1)


def both(**more):
    """The same answer is due from the path tracer's own paths and from the separate walk."""
    return pytest.mark.parametrize("volume", [False, True], ids=["path", "walk"])


@both()
def test_mirror_first_non_delta_hit(mi, volume):
    image = picture(mi, mirror_scene(mi), {"follow": "delta"}, 2, volume)
    assert image[..., 3:6] == pytest.approx(np.broadcast_to(np.multiply(TINT, SIDE), (8, 8, 3)),
                                            abs=1e-5)
    assert image[..., 6:9] == pytest.approx(np.broadcast_to([-1.0, 0, 0], (8, 8, 3)), abs=1e-5)


@both()
def test_mirror_first_hit(mi, volume):
    image = picture(mi, mirror_scene(mi), {"follow": "first"}, 2, volume)
    s = np.sqrt(0.5)
    assert image[..., 3:6] == pytest.approx(np.broadcast_to(TINT, (8, 8, 3)), abs=1e-5)
    assert image[..., 6:9] == pytest.approx(np.broadcast_to([s, 0, s], (8, 8, 3)), abs=1e-5)


def test_first_hit_equals_mitsubas_aov(mi):
    plain = mi.load_dict({"type": "aov", "aovs": "n:sh_normal"})
    scene = mi.load_dict(mirror_scene(mi) | {"ball": {
        "type": "sphere", "center": [0.3, 0.2, 2], "radius": 0.5,
        "bsdf": {"type": "dielectric"}}})
    from training.scenes import features
    from training.scenes import picture as pic
    shot = pic.shot(mi, camera(mi), 16, 16, {"type": "box"}, "independent")
    theirs = np.array(mi.render(scene, sensor=shot.sensor(1), integrator=plain, spp=1, seed=64))
    first = features.make(features.FeatureSettings(follow="first"), 6)
    ours = pic.render(mi, scene, first, shot, 1, 1)
    close = np.abs(ours[..., 6:9] - theirs[..., -3:]).max(-1) < 1e-4
    assert close.mean() > (0.99 if "llvm" in mi.variant() else 0.7)
    delta = features.make(features.FeatureSettings(follow="delta"), 6)
    assert np.abs(pic.render(mi, scene, delta, shot, 1, 1)[..., 6:9]
                  - theirs[..., -3:]).max() > 0.5, "the two kinds of features differ here"


@both()
def test_glass_mixes_what_it_shows(mi, volume):
    spp = 512 if "llvm" in mi.variant() else 64
    image = picture(mi, glass_scene(mi), {"follow": "delta"}, spp, volume).mean((0, 1))
    r = 0.04                         # Fresnel at normal incidence, index 1.5
    t = (1 - r) / (1 + r)            # of a slab, with all bounces inside
    expected = t * np.array(FLOOR) + (1 - t) * np.array(BACK)
    error = 4 * 0.3 / np.sqrt(spp * 64)
    assert image[3:6] == pytest.approx(expected, abs=error)
    assert image[6:8] == pytest.approx(0, abs=1e-5)
    assert image[8] == pytest.approx(t - (1 - t), abs=2 * error)


@both()
def test_glass_first_hit(mi, volume):
    image = picture(mi, glass_scene(mi), {"follow": "first"}, 2, volume)
    assert image[..., 6:9] == pytest.approx(np.broadcast_to([0, 0, 1.0], (8, 8, 3)), abs=1e-5)
    assert image[..., 3:6] == pytest.approx(1, abs=1e-5), "the weight of a sample of clear glass"


def test_glass_colour_is_radiance_without_light_loss(mi):
    """Under constant light of 0.5 everything diffuse and clear: albedo explains radiance."""
    scene = glass_scene(mi)
    del scene["back"]
    image = picture(mi, scene, {"follow": "delta", "miss": "env"}, 64).mean((0, 1))
    assert image[:3] == pytest.approx(image[3:6] * 0.5, rel=0.15)


def test_cutout_passes_masks_not_mirrors(mi):
    t = mi.ScalarTransform4f
    scene = mirror_scene(mi)
    scene["card"] = {"type": "rectangle", "to_world": t().translate([0, 0, 4]).scale(4),
                     "bsdf": {"type": "mask", "opacity": 0.25,
                              "b": {"type": "diffuse", "reflectance": rgb(FLOOR)}}}
    spp = 512 if "llvm" in mi.variant() else 64
    image = picture(mi, scene, {"follow": "cutout"}, spp).mean((0, 1))
    expected = 0.25 * np.array(FLOOR) + 0.75 * np.array(TINT)
    assert image[3:6] == pytest.approx(expected, abs=4 * 0.5 / np.sqrt(spp * 64))
    image = picture(mi, scene, {"follow": "first"}, 16)
    assert image[..., 6:9] == pytest.approx(np.broadcast_to([0, 0, 1.0], (8, 8, 3)), abs=1e-5)


@pytest.mark.parametrize("emitter, expected", [
    ("one", (1, 1, 1)), ("colour", (1, 0.25, 0.5)), ("surface", SIDE)])
def test_emitters(mi, emitter, expected):
    scene = mirror_scene(mi)
    scene["side"]["emitter"] = {"type": "area", "radiance": rgb((4, 0.25, 0.5))}
    scene["side"]["bsdf"] = {"type": "diffuse", "reflectance": rgb(SIDE)}
    image = picture(mi, scene, {"follow": "delta", "emitter": emitter}, 2)
    assert image[..., 3:6] == pytest.approx(
        np.broadcast_to(np.multiply(TINT, expected), (8, 8, 3)), abs=1e-5)


@pytest.mark.parametrize("miss, expected", [("zero", 0.0), ("one", 1.0), ("env", 0.5)])
def test_misses(mi, miss, expected):
    scene = mirror_scene(mi)
    del scene["side"]
    image = picture(mi, scene, {"follow": "delta", "miss": miss}, 2)
    assert image[..., 3:6] == pytest.approx(
        np.broadcast_to(np.multiply(TINT, expected), (8, 8, 3)), abs=1e-5)
    assert image[..., 6:9] == pytest.approx(0)


def test_faceforward_turns_normals(mi):
    t = mi.ScalarTransform4f
    scene = {"type": "scene", "light": {"type": "constant"},
             "away": wall(mi, t().rotate([1, 0, 0], 180).scale(9), FLOOR)}
    for turn, z in ((False, -1.0), (True, 1.0)):
        image = picture(mi, scene, {"faceforward": turn}, 1)
        assert image[..., 8] == pytest.approx(z, abs=1e-5)


@pytest.mark.parametrize("volume, weight", [("ignore", 0.0), ("scatter", 1 - np.exp(-1.5))])
def test_media(mi, volume, weight):
    """Three metres of fog with extinction 0.5 and albedo 0.9 before a wall."""
    t = mi.ScalarTransform4f
    fog = {"type": "homogeneous", "sigma_t": 0.5, "albedo": rgb((0.9, 0.9, 0.9))}
    scene = {"type": "scene", "light": {"type": "constant"},
             "wall": wall(mi, t().translate([0, 0, -4]).scale(20), FLOOR),
             "fog": {"type": "cube", "to_world": t().scale([9, 9, 1.5]), "interior": fog,
                     "bsdf": {"type": "null"}}}
    spp = 256 if "llvm" in mi.variant() else 48
    for follow in ("delta", "first"):
        image = picture(mi, scene, {"volume": volume, "follow": follow}, spp, True).mean((0, 1))
        error = 4 * 0.5 / np.sqrt(spp * 64) if weight else 1e-4
        assert image[3:6] == pytest.approx((1 - weight) * np.array(FLOOR) + weight * 0.9, abs=error)
        assert image[8] == pytest.approx(1 - weight, abs=error)


def test_radiance_equals_mitsubas_path_tracer(mi):
    box = mi.cornell_box()
    box["ball"] = {"type": "sphere", "center": [0.3, -0.2, 0.3], "radius": 0.3,
                   "bsdf": {"type": "dielectric"}}
    sensor = box.pop("sensor")
    cam = {k: sensor[k] for k in ("type", "fov", "to_world", "near_clip", "far_clip")
           if k in sensor}
    from training.scenes import features
    from training.scenes import picture as pic
    scene = mi.load_dict(box)
    spp = 64 if "llvm" in mi.variant() else 16
    shot = pic.shot(mi, cam, 12, 12, {"type": "box"}, "independent")
    ours = pic.render(mi, scene, features.make(features.FeatureSettings(), 6), shot, spp, 1)
    path = mi.load_dict({"type": "path", "max_depth": 6, "rr_depth": 4})
    theirs = np.array(mi.render(scene, sensor=shot.sensor(spp), integrator=path, spp=spp, seed=64))
    if "llvm" in mi.variant():  # the same random numbers in the same order
        assert ours[..., :3] == pytest.approx(theirs[..., :3], abs=1e-3, rel=1e-3)
    assert ours[..., :3].mean() == pytest.approx(theirs[..., :3].mean(), rel=0.15)


@pytest.mark.parametrize("aimed", [0, 1])
def test_lights_met_by_chance_give_the_same_light_and_more_noise(mi, aimed):
    box = mi.cornell_box()
    sensor = box.pop("sensor")
    cam = {k: sensor[k] for k in ("type", "fov", "to_world", "near_clip", "far_clip")
           if k in sensor}
    from training.scenes import features
    from training.scenes import picture as pic
    scene = mi.load_dict(box)
    shot = pic.shot(mi, cam, 12, 12, {"type": "box"}, "independent")
    spp = 4096 if "llvm" in mi.variant() else 64
    one, two = (pic.render(mi, scene, features.make(features.FeatureSettings(), 6, aimed=n), shot,
                           spp, 1) for n in (None, aimed))
    assert two[..., :3].mean() == pytest.approx(one[..., :3].mean(), rel=1.6 / spp ** 0.5)
    assert one[..., 3:] == pytest.approx(two[..., 3:], abs=1 / spp ** 0.5)
    one, two = (np.std([pic.render(mi, scene, features.make(
        features.FeatureSettings(), 6, aimed=n), shot, 4, k)[..., :3] for k in range(8)], 0).mean()
        for n in (None, aimed))
    assert two > 1.3 * one


def test_unknown_variant():
    with pytest.raises(ToolError, match="--variant") as e:
        backend.load("nonsense")
    assert e.value.code == 2
