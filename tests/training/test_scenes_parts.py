"""Parts of the scene renderer that need no renderer: meshes, textures, layouts, files, options."""

from __future__ import annotations

import numpy as np
import pytest

from training.errors import ToolError
from training.imageio import read_image
from training.scenes import (files, furniture, layouts, mesh, options, plants, render, shapes,
                             sheet, textures)

SLOTS = {"floor", "wall", "paint", "gloss", "atlas", "metal", "glass", "leaf", "mask", "special",
         "light", "panel"}

SOLIDS = {
    "box": (lambda r: shapes.box(1, 2, 3), 6.0),
    "bevel_box": (lambda r: shapes.bevel_box(1, 1, 1, 0.1), 0.95),
    "sphere": (lambda r: shapes.sphere(0.5, 64), np.pi / 6),
    "cylinder": (lambda r: shapes.cylinder(0.5, 2.0, 96), np.pi / 2),
    "torus": (lambda r: shapes.torus(0.38, 0.12), 2 * np.pi ** 2 * 0.38 * 0.12 ** 2),
    "knot": (lambda r: shapes.knot(), None),
    "displaced": (lambda r: shapes.displaced(r), None),
    "superquadric": (lambda r: shapes.superquadric(r), None),
    "gear": (lambda r: shapes.gear(11), None),
    "twisted_prism": (lambda r: shapes.twisted_prism(r), None),
}


def volume(m: mesh.Mesh) -> float:
    """Signed volume of a closed mesh; positive when its triangles face outwards."""
    a, b, c = (m.v[m.f[:, k]] for k in range(3))
    return float((np.cross(a, b) * c).sum() / 6)


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_face_outwards(name):
    make, expected = SOLIDS[name]
    m = make(np.random.default_rng(3))
    v = volume(m)
    assert v > 0
    if expected:
        assert v == pytest.approx(expected, rel=0.06)
    t = m.v[m.f]
    face = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    agree = (face[:, None] * m.n[m.f]).sum(-1) >= -1e-9
    assert agree.mean() > 0.97, "vertex normals on the side that the triangles face"
    assert m.v[:, 2].min() == pytest.approx(0, abs=5e-3)


def test_vessels_are_closed_walls():
    rng = np.random.default_rng(0)
    for _ in range(12):
        _, m = furniture.vessel(rng)[0]
        assert 0 < volume(m) < 1.0
        assert np.isfinite(m.v).all()


def test_mirrored_transform_keeps_orientation():
    m = shapes.box().moved(mesh.scale(-1, 1, 1))
    assert volume(m) == pytest.approx(1.0)


def test_closed_tube_joins():
    t = np.linspace(0, 2 * np.pi, 60)
    m = shapes.tube(np.stack([np.cos(t), np.sin(t), 0.3 * np.sin(2 * t)], 1), 0.1, 8, closed=True)
    rings = m.v.reshape(60, 9, 3)
    assert np.abs(rings[0] - rings[-1]).max() < 0.03


@pytest.mark.parametrize("seed", range(12))
def test_layouts_are_sound(seed):
    name, stage = layouts.make(np.random.default_rng(seed))
    assert name in {n for n, _, _ in layouts.LAYOUTS} and stage.eyes
    for slot, m in stage.parts:
        assert str(slot) in SLOTS
        assert np.isfinite(m.v).all() and np.isfinite(m.n).all() and np.isfinite(m.uv).all()
        assert m.f.min() >= 0 and m.f.max() < len(m.v) == len(m.n) == len(m.uv)
        assert np.linalg.norm(m.n, axis=1) == pytest.approx(1, abs=1e-3)
    assert sum(len(m.f) for _, m in stage.parts) < 3_000_000


def test_layouts_repeat():
    a = layouts.make(np.random.default_rng(5))[1]
    b = layouts.make(np.random.default_rng(5))[1]
    assert len(a.parts) == len(b.parts)
    assert all(s == t and np.array_equal(m.v, n.v) for (s, m), (t, n) in zip(a.parts, b.parts))


def test_every_layout_occurs():
    p = np.array([p for _, _, p in layouts.LAYOUTS])
    assert p.sum() == pytest.approx(1) and (p > 0.05).all()


def test_thin_things_are_thin():
    rng = np.random.default_rng(1)
    m = plants.lattice(rng, 10, 10, 0.01)
    assert len(m.f) == 20 * 12
    _, m = plants.hair_patch(rng)[0]
    t = m.v[m.f]
    area = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1) / 2
    assert area.max() < 0.005


def test_patterns_are_textures():
    rng = np.random.default_rng(2)
    for kind in textures.PATTERNS:
        a = np.asarray(kind(rng, 64), float)
        assert a.shape == (64, 64) and a.min() >= -1e-6 and a.max() <= 1 + 1e-6, kind.__name__
        assert a.std() > 0.01, kind.__name__
    pic = textures.picture(rng, 64, furniture.colour)
    assert pic.shape == (64, 64, 3) and 0 <= pic.min() and pic.max() <= 1


def test_noise_is_tileable():
    a = textures.noise(np.random.default_rng(0), 256, 4)
    inside = np.abs(np.diff(a, axis=1)).max()
    assert np.abs(a[:, 0] - a[:, -1]).max() <= inside * 1.01


def test_normal_map_of_flat_is_up():
    n = textures.normal_map(np.zeros((8, 8), np.float32), 1.0)
    assert n == pytest.approx(np.broadcast_to([0.5, 0.5, 1.0], n.shape))


def test_sky_has_finite_positive_radiance():
    for seed in range(12):
        sky = textures.sky(np.random.default_rng(seed), 128)
        assert sky.shape == (64, 128, 3) and np.isfinite(sky).all() and sky.min() >= 0
        assert sky.max() > 0


def test_ply_header(tmp_path):
    path = tmp_path / "a.ply"
    mesh.write_ply(str(path), shapes.box().coloured((0.1, 0.2, 0.3)))
    data = path.read_bytes()
    head, _, body = data.partition(b"end_header\n")
    assert b"element vertex 24" in head and b"element face 12" in head
    assert len(body) == 24 * 11 * 4 + 12 * 13


def test_round_mantissa_keeps_bits_and_is_nearest():
    x = np.linspace(-70000, 70000, 9999).astype(np.float32)
    for bits in (4, 6, 8, 10):
        h = files.round_mantissa(x, bits)
        assert np.isfinite(h).all()
        assert not (h.view(np.uint16) & ((1 << (10 - bits)) - 1))[np.abs(h) < 60000].any()
        inside = np.abs(x) < 60000
        big = inside & (np.abs(x) > 1e-3)
        assert (np.abs(h[big] / x[big] - 1) <= 2.0 ** -(bits + 1) + 2.0 ** -11).all()


def test_exr_round_trip(tmp_path):
    a = np.random.default_rng(0).random((5, 7, 3)).astype(np.float16).astype(np.float32)
    files.write_exr(tmp_path / "a.exr", a)
    assert np.array_equal(read_image(tmp_path / "a.exr"), a)
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]


def test_exr_to_unwritable_place(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ToolError) as e:
        files.write_exr(tmp_path / "file" / "a.exr", np.zeros((2, 2, 3), np.float32))
    assert e.value.code == 5


@pytest.mark.parametrize("text, expected", [
    ("7", [7]), ("0:3", [0, 1, 2]), ("5,1,3:5", [1, 3, 4, 5])])
def test_seed_list(text, expected):
    assert options.seed_list(text) == expected


@pytest.mark.parametrize("parse, text, word", [
    (options.seed_list, "a", "--seeds"), (options.seed_list, "4:4", "--seeds"),
    (options.seed_list, "-3", "--seeds"), (options.bit_pair, "6", "--bits"),
    (options.bit_pair, "1,8", "--bits"), (options.size_pair, "0", "--size"),
    (options.size_pair, "12x", "--size"), (options.size_pair, "64x4", "--size"),
    (lambda t: options.count_list(t, "--spp"), "1,x", "--spp"),
    (lambda t: options.count_list(t, "--spp"), "0,4", "--spp"),
    (lambda t: options.shard([], t), "2/2", "--shard"),
    (lambda t: options.shard([], t), "1", "--shard")])
def test_bad_options_are_named(parse, text, word):
    with pytest.raises(ToolError, match=word) as e:
        parse(text)
    assert e.value.code == 2 and "\n" not in str(e.value)


def test_shards_partition():
    parts = [options.shard(list(range(11)), f"{i}/3") for i in range(3)]
    assert sorted(sum(parts, [])) == list(range(11)) and all(parts)


def test_counts_are_drawn_below_the_target():
    rng = np.random.default_rng(0)
    drawn = [render.draw_counts(rng, [1, 4, 16, 64, 256], 2, 128) for _ in range(200)]
    assert all(len(d) == 2 and d == sorted(set(d)) and max(d) <= 64 for d in drawn)
    count = np.bincount(sum(drawn, []))
    assert count[1] > count[64] > 0
    assert render.draw_counts(rng, [1, 4, 256], 0, 128) == [1, 4]


def test_judge_names_degenerate_pictures():
    rng = np.random.default_rng(0)
    good = rng.random((16, 16, 9)).astype(np.float32)
    assert render.judge(good) == ""
    assert render.judge(good * 0) == "black"
    assert render.judge(good * 0, lit=False) == "flat"
    unlit = np.concatenate([good[..., :3] * 0, good[..., 3:]], -1)
    assert render.judge(unlit) == "black" and render.judge(unlit, lit=False) == ""
    dark = good.copy()
    dark[:12, :, :3] = 0
    assert render.judge(dark) == "mostly black"
    flat = good.copy()
    flat[..., :3] = 0.4
    assert render.judge(flat) == "flat"
    nothing = good.copy()
    nothing[..., 3:] = 0.5
    assert render.judge(nothing) == "flat"


def test_sheet_shows_each_scene(tmp_path):
    for name, value in (("a", 0.2), ("b", 0.7)):
        (tmp_path / name).mkdir()
        for spp in (2, 16):
            for kind in ("hdr", "alb", "nrm"):
                files.write_exr(tmp_path / name / f"{name}_{spp:04d}spp.{kind}.exr",
                                np.full((8, 8, 3), value if kind == "alb" else 0.0, np.float32))
    sheet.main([str(tmp_path), str(tmp_path / "s.png"), "--size", "8", "--columns", "1"])
    png = read_image(tmp_path / "s.png")
    assert png.shape == (16, 32, 3)
    assert png[3, 20, 0] < png[11, 20, 0], "albedo of b is lighter"
    assert png[3, 28] == pytest.approx(0.5, abs=0.01), "normal 0 is grey"


def test_sheet_of_nothing(tmp_path):
    with pytest.raises(ToolError, match="no scene") as e:
        sheet.main([str(tmp_path), str(tmp_path / "s.png")])
    assert e.value.code == 3 and not (tmp_path / "s.png").exists()
