"""Training data by Blender's Cycles: what a run refuses, and, with bpy, what it renders."""
from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from training import errors
from training.features import load
from training.scan import scan
from training.scenes import cycles, views

needs_bpy = pytest.mark.skipif(
    importlib.util.find_spec("bpy") is None,
    reason="optional: bpy (Blender as a Python module) is not installed")
FEATURES = ["hdr", "alb", "nrm"]
SMALL = ["--size", "48x32", "--spp", "1,8", "--ref", "64", "--threads", "2"]

OWN = """
import sys
import bpy
bpy.ops.wm.read_factory_settings(use_empty=False)  # a cube, a lamp and a camera
bpy.ops.mesh.primitive_plane_add(size=40, location=(0, 0, -1))
first = bpy.context.scene.camera
second = bpy.data.objects.new("Top/view", first.data)
second.location = (0, 0, 9)
bpy.context.collection.objects.link(second)
cube = bpy.data.objects["Cube"]
for frame, x in ((1, 0.0), (5, 2.0)):
    cube.location[0] = x
    cube.keyframe_insert("location", frame=frame)
bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = 64, 48
bpy.context.scene.render.resolution_percentage = 50
bpy.context.scene.view_layers[0].use = False
bpy.context.scene.view_layers.new("second")
bpy.context.scene.cycles.time_limit = 0.001
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
"""

# A strip of squares, some twice, and triangles without an area, on which Blender's normals crash.
DEGENERATE = """
import numpy as np
import bpy
from training.scenes import blender
from training.scenes.mesh import Mesh
bpy.ops.wm.read_factory_settings(use_empty=True)
n = 4000
v = np.stack([np.repeat(np.arange(n), 2), np.tile([0, 1], n), np.zeros(2 * n)], 1).astype(float)
k = np.arange(0, 2 * n - 2, 2)[:, None]
good = np.concatenate([k + [0, 2, 1], k + [1, 2, 3]])
f = np.concatenate([good, good[:500, [0, 1, 1]], good[:500], good[:9, [0, 0, 0]]])
up = np.tile([0.0, 0, 1], (2 * n, 1))
made = blender._object(bpy, "strip", Mesh(v, f, up, v[:, :2], None))
assert len(made.data.polygons) == len(good), len(made.data.polygons)
assert len(made.data.uv_layers["uv"].data) == 3 * len(good)
"""


def start(*args: object, program: tuple[str, ...] = ("-m", "training.scenes.cycles")
          ) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, *program, *map(str, args)], capture_output=True,
                          text=True, timeout=300)


def group_of(root: Path, name: str):
    return next(g for g in scan(root, FEATURES).groups if g.name.endswith(name))


@pytest.mark.parametrize("options, code, message", [
    ([], 2, "either --blend or --seeds"),
    (["--seeds", "1", "--blend", "a.blend"], 2, "either --blend or --seeds"),
    (["--blend", "a.blend", "--still_lifes"], 2, "--still_lifes: with --seeds"),
    (["--blend", "a.blend", "--panorama"], 2, "--panorama: with --seeds"),
    (["--seeds", "1", "--still_lifes", "--panorama"], 2, "--panorama: with --seeds and rooms"),
    (["--seeds", "1", "--spp", "4,16", "--ref", "16"], 2, "--ref: targets need more samples"),
    (["--blend", "a.blend", "--ref", "64,256"], 2, "--ref: one count"),
    (["--seeds", "1", "--threads", "-1"], 2, "--threads"),
    (["--seeds", "1", "--size", "0x4"], 2, "--size"),
    (["--seeds", "1", "--noise_threshold", "0"], 2, "--noise_threshold must be above 0"),
    (["--blend", "nowhere.blend"], 3, "nowhere.blend is not a file"),
])
def test_what_cannot_be_is_refused(tmp_path, options, code, message):
    with pytest.raises(errors.ToolError, match=message) as e:
        cycles.main([str(tmp_path / "out"), *options])
    assert e.value.code == code and not (tmp_path / "out").exists()


def test_without_blender_it_says_what_is_missing(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "bpy", None)
    with pytest.raises(errors.ToolError, match="pip install bpy") as e:
        cycles.main([str(tmp_path), "--seeds", "1"])
    assert e.value.code == 6


def test_views_are_scored_by_depth():
    flat, near = np.full((32, 32), 3.0), np.full((32, 32), 0.1)
    steps = np.where(np.arange(32) % 8 < 4, 2.0, 4.0) * np.ones((32, 1))
    ids = np.zeros((32, 32), int)
    assert views.score(flat, ids, 0.35) == pytest.approx(0, abs=1e-9)
    assert views.score(steps, ids, 0.35) > 0.1
    assert views.score(near, ids, 0.35) == views.score(np.full((32, 32), np.inf), ids, 0.35) == -1


def test_rays_go_through_the_pixels_of_a_view():
    dirs = views.rays(np.zeros(3), np.array([0, 5.0, 0]), 90, 2).reshape(2, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(dirs, axis=-1), 1)
    np.testing.assert_allclose(dirs[..., 0] / dirs[..., 1], [[-0.5, 0.5]] * 2)
    np.testing.assert_allclose(dirs[..., 2] / dirs[..., 1], [[0.5] * 2, [-0.5] * 2])


@needs_bpy
def test_meshes_with_triangles_without_an_area():
    done = start(program=("-c", DEGENERATE))
    assert done.returncode == 0, done.stderr


@needs_bpy
def test_procedural_scenes(tmp_path):
    options = SMALL
    done = start(tmp_path, "--seeds", "9,9000014", *options)
    assert done.returncode == 0, done.stderr
    for name in ("c00009", "c9000014"):
        group = group_of(tmp_path, name)
        images = [load(v, FEATURES) for v in [*group.inputs, group.target]]
        noisy, less, target = images
        assert [v.spp for v in group.inputs] == [1, 8] and target["hdr"].shape == (32, 48, 3)
        light = [np.log1p(np.maximum(x["hdr"], 0)) for x in images]
        assert np.square(light[0] - light[2]).mean() > np.square(light[1] - light[2]).mean() > 0
        assert 0.05 < np.minimum(target["alb"], 1).mean() < 0.95  # lamps have more
        assert np.linalg.norm(target["nrm"], axis=-1).max() == pytest.approx(1, abs=0.02)
        kept = json.loads((tmp_path / name / "manifest.json").read_text())
        assert kept["samples"] == [1, 8, 64] and kept["seed"] == int(name[1:])
    again = start(tmp_path, "--seeds", "9,9000014", *options)
    assert again.returncode == 0 and "0 scenes to render, 2 finished before" in again.stdout
    other = start(tmp_path, "--seeds", "9", *options, "--ref", "128")
    assert other.returncode == 4 and "ref = 64, not 128" in other.stderr


EACH = """
import sys
import bpy
import numpy as np
from training.scenes import cycles, still_lifes
pictures = [np.full((8, 8, 3), 0.5), np.full((8, 8, 3), 0.1)]
seen = {}
for extra in (None, *still_lifes.EXTRAS):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    cycles.set_up(bpy.context.scene, (48, 32), 2)
    still_lifes.EXTRAS = (extra,) * 2 if extra else (lambda t: None,) * 2
    still_lifes.arrange(bpy, np.random.default_rng(3), pictures)
    seen[extra] = cycles.pilot(bpy, 5)
    assert np.isfinite(seen[extra]).all() and seen[extra][..., :3].max() > 0, extra
    assert extra is None or np.abs(seen[extra] - seen[None]).mean() > 1e-4, extra
assert len(seen) == 14
"""


@needs_bpy
def test_every_extra_of_a_still_life_can_be_seen():
    done = start(program=("-c", EACH))
    assert done.returncode == 0, done.stderr


@needs_bpy
def test_still_lifes(tmp_path):
    options = ["--still_lifes", *SMALL]
    twice = [tmp_path / k for k in ("a", "b")]
    for out in twice:
        done = start(out, "--seeds", "7,8", *options)
        assert done.returncode == 0, done.stderr
    for name in ("o00007", "o00008"):
        first, again = ([load(v, FEATURES) for v in (*group_of(out, name).inputs,
                                                     group_of(out, name).target)]
                        for out in twice)
        for x, y in zip(first, again, strict=True):  # a seed is a picture, but for rounding
            assert all(np.abs(x[f] - y[f]).mean() < 1e-4 for f in FEATURES)
        kept = json.loads((twice[0] / name / "manifest.json").read_text())
        layout, *extras = kept["layout"].split("-")
        assert layout == "objects" and 1 <= len(extras) <= 2
    assert np.abs(load(group_of(twice[0], "o00007").target, FEATURES)["hdr"]
                  - first[-1]["hdr"]).mean() > 0.01


@needs_bpy
def test_adaptive_sampling_is_of_the_noisy_images_alone(tmp_path):
    common = ["--still_lifes", "--seeds", "7", *SMALL[:2], "--spp", "256", "--ref", "320",
              "--threads", "2"]
    seen = []
    for threshold in ("0.9", "0.01"):
        done = start(tmp_path / threshold, *common, "--noise_threshold", threshold)
        assert done.returncode == 0, done.stderr
        group = group_of(tmp_path / threshold, "o00007")
        seen.append([np.log1p(np.maximum(load(v, FEATURES)["hdr"], 0))
                     for v in (*group.inputs, group.target)])
    (few, target), (many, same) = seen
    assert np.abs(target - same).mean() < 1e-4
    typical = [np.median(np.abs(x - target) / (target + 1e-3)) for x in (few, many)]
    assert typical[0] > 1.5 * typical[1] > 0  # the mean is of single bright pixels
    again = start(tmp_path / "0.9", *common)
    assert again.returncode == 4 and "noise_threshold = 0.9, not None" in again.stderr


@needs_bpy
def test_light_passes_add_up_to_the_colour(tmp_path):
    """Products of light and colour, but for lamps, the sky and fog; to the last bits of halves."""
    import OpenEXR
    done = start(tmp_path, "--seeds", "9", *SMALL, "--light_passes")
    assert done.returncode == 0, done.stderr
    version = group_of(tmp_path, "c00009").inputs[0]
    layers = {}
    for part in OpenEXR.File(str(version.files["*"])).parts:
        layers |= {name.removeprefix("ViewLayer."): c.pixels for name, c in part.channels.items()}
    layers = {name: pixels.astype(np.float32) for name, pixels in layers.items()}
    light = sum((layers[f"{lobe} Direct"] + layers[f"{lobe} Indirect"]) * layers[f"{lobe} Color"]
                for lobe in ("Diffuse", "Glossy", "Transmission"))
    colour = layers["Combined"][..., :3]
    apart = np.abs(light - colour) > 0.01 * (colour + 1e-3)
    assert light.any() and (light <= 1.01 * colour + 1e-3).all() and apart.mean() < 0.5
    again = start(tmp_path, "--seeds", "9", *SMALL)
    assert again.returncode == 4 and "light_passes = True, not None" in again.stderr


@needs_bpy
def test_panoramas_meet_at_their_edges(tmp_path):
    done = start(tmp_path, "--seeds", "9", "--panorama", "--size", "64x32", "--spp", "1", "--ref",
                 "64", "--threads", "2")
    assert done.returncode == 0, done.stderr
    image = load(group_of(tmp_path, "c00009").target, FEATURES)
    a = np.concatenate([np.log1p(np.maximum(image["hdr"], 0)), image["alb"]], -1)
    apart = [np.abs(a[:, 0] - a[:, k]).mean() for k in (-1, 16, 32, 48)]
    assert apart[0] < 0.5 * min(apart[1:])
    poles = [np.abs(np.diff(image["nrm"][y], axis=0)).mean() for y in (0, 31, 16)]
    assert max(poles[:2]) < poles[2]  # a point each
    again = start(tmp_path, "--seeds", "9", "--size", "64x32", "--spp", "1", "--ref", "64")
    assert again.returncode == 4 and "panorama = True, not None" in again.stderr


@needs_bpy
def test_scenes_of_ones_own(tmp_path):
    blend = tmp_path / "my_shot.blend"
    assert start(blend, program=("-c", OWN)).returncode == 0
    out = tmp_path / "data"
    done = start(out, "--blend", blend, "--frames", "1,5", "--cameras", "all", "--spp", "1,4",
                 "--ref", "16", "--threads", "2")
    assert done.returncode == 0, done.stderr
    names = {f"my-shot-f000{f}-{c}" for f in (1, 5) for c in ("Camera", "Top-view")}
    found = scan(out, FEATURES)
    assert {g.name.split("/")[-1] for g in found.groups} == names and not found.left_out
    targets = {n: load(group_of(out, n).target, FEATURES) for n in names}
    assert {x["hdr"].shape for x in targets.values()} == {(24, 32, 3)}, "half of the file's"
    for camera in ("Camera", "Top-view"):
        a, b = (np.log1p(targets[f"my-shot-f000{f}-{camera}"]["hdr"]) for f in (1, 5))
        assert np.abs(a - b).mean() > 0.05, "the cube has moved"


@needs_bpy
@pytest.mark.parametrize("options, code, message", [
    (["--cameras", "Nobody"], 2, "has no camera 'Nobody' (but Camera, Top/view)"),
    ([], 3, "broken.blend: ")])
def test_scenes_of_ones_own_that_cannot_be(tmp_path, options, code, message):
    blend = tmp_path / ("shot.blend" if options else "broken.blend")
    if options:
        assert start(blend, program=("-c", OWN)).returncode == 0
    else:
        blend.write_bytes(b"BLENDER, or not")
    done = start(tmp_path / "data", "--blend", blend, *options)
    assert done.returncode == code and message in done.stderr, done.stderr
