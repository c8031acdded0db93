"""Features, batches and augmentation."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.training.tools import make_raw, noisy, picture, write_features
from training import color
from training.data import (Alternating, Augment, Batches, Picture, from_raw, load_group,
                           shuffle)
from training.errors import ToolError
from training.features import encode, load
from training.imageio import write_exr, write_image
from training.parallel import Team
from training.scan import CHANNELS, scan
from training.settings import parse
from training.pictures import make_batches

F = ["hdr", "alb", "nrm"]


def test_features_are_cleaned_and_encoded(tmp_path):
    hdr = np.array([[[np.nan, -1, np.inf], [0.5, 1, 2]]], np.float32)
    alb = np.array([[[2, -1, 0.5], [np.inf, 99, np.nan]]], np.float32)
    nrm = np.array([[[-1, 0, 3]] * 2], np.float32)
    write_features(tmp_path, "a_4", {"hdr": hdr, "alb": alb, "nrm": nrm})
    write_features(tmp_path, "a_ref", {"hdr": hdr})
    images = load(scan(tmp_path, F, ["hdr"]).groups[0].inputs[0], F)
    assert images["hdr"][0, 0, :2].tolist() == [0, 0] and np.isfinite(images["hdr"]).all()
    assert images["alb"][0].tolist() == [[2, 0, 0.5], [64, 64, 0]]  # lamps: their light
    codes = encode(images, "hdr", "pu", 2.0)
    assert codes.shape == (1, 2, 9)
    assert codes[0, 1, 1] == pytest.approx(float(color.pu_forward(np.array(2.0))), rel=1e-5)
    assert codes[0, :, 3:6].tolist() == [[1, 0, 0.5], [1, 1, 0]]
    assert codes[0, 0, 6:].tolist() == [0, 0.5, 1]


def test_multichannel_file_is_the_same_as_split_files(tmp_path):
    clean = picture(0)
    write_features(tmp_path / "split", "a_4", clean)
    write_features(tmp_path / "split", "a_ref", clean)
    names = ("R", "G", "B", "Denoising Albedo.R", "Denoising Albedo.G", "Denoising Albedo.B",
             "mine.X", "mine.Y", "mine.Z")
    (tmp_path / "multi").mkdir()
    for stem in ("a_4", "a_ref"):
        write_exr(tmp_path / "multi" / f"{stem}.exr", np.concatenate(list(clean.values()), -1),
                  names)
    one, two = (scan(tmp_path / d, F).groups[0] for d in ("split", "multi"))
    a = load_group(one, F, "hdr", "pu")
    b = load_group(two, F, "hdr", "pu", layers={"nrm": "mine"})
    assert np.array_equal(a.inputs[0], b.inputs[0]) and np.array_equal(a.target, b.target)
    with pytest.raises(ToolError, match="no channels for 'nrm'.*--layers"):
        load_group(two, F, "hdr", "pu")


def test_png_inputs_for_ldr(tmp_path):
    ldr = np.clip(picture(1)["alb"], 0, 1)
    for stem in ("a_4", "a_ref"):
        write_image(tmp_path / f"{stem}.ldr.png", color.srgb_forward(ldr))
    group = scan(tmp_path, ["ldr"]).groups[0]
    codes = load_group(group, ["ldr"], "ldr", "srgb").target
    assert np.abs(codes - color.srgb_forward(ldr)).max() < 5e-3


def test_sizes_must_agree(tmp_path):
    """What has another size is left out and named; a group is not, while it has others."""
    make_raw(tmp_path, 1, spp=(4,))
    write_features(tmp_path / "scene0", "view0_8", picture(0, 32, 64))
    group, said = scan(tmp_path, ["hdr"]).groups[0], []
    assert len(load_group(group, ["hdr"], "hdr", "pu", log=said.append).inputs) == 1
    assert len(said) == 1 and "64x32 pixels, its reference has 64x48" in said[0]
    group.inputs = [v for v in group.inputs if v.spp == 8]
    with pytest.raises(ToolError, match="64x32 pixels, its reference has 64x48"):
        load_group(group, ["hdr"], "hdr", "pu")


def test_references_of_layers_need_no_features(tmp_path):
    """As those of single files: only the inputs have to have albedo and normals."""
    images = picture(0, 32, 48)
    for name, kept in ("v_4", ("hdr", "alb", "nrm")), ("v_ref", ("hdr",)):
        channels = {f"{prefix}{c}": images[f][..., i] for f, prefix in
                    (("hdr", ""), ("alb", "albedo."), ("nrm", "normal.")) if f in kept
                    for i, c in enumerate("RGB")}
        write_exr(tmp_path / f"{name}.exr", np.stack(list(channels.values()), -1), tuple(channels))
    group = scan(tmp_path, F).groups[0]
    loaded = load_group(group, F, "hdr", "pu")
    assert loaded.inputs[0].shape[-1] == 9 and loaded.target.shape[-1] == 3


def small_pictures(seed: int = 0, groups: int = 3) -> list[Picture]:
    """Pictures whose values can be recognised: aux channels carry their own number."""
    rng = np.random.default_rng(seed)
    pictures = []
    for g in range(groups):
        y = rng.uniform(0.1, 0.9, (40, 40, 9)).astype(np.float16)
        inputs = [np.clip(y + rng.normal(0, 0.05, y.shape), 0, 1).astype(np.float16)
                  for _ in range(2)]
        pictures.append(Picture(f"g{g}", inputs, [1.0, 4.0], y))
    return pictures


AUGMENT = Augment(2.0, 0.3, 0.3, 0.3, 0.5)


def test_batches_depend_on_seed_and_step_only():
    pictures = small_pictures()
    one = Batches(pictures, F, "hdr", "pu", 4, 32, 7, AUGMENT)
    two = Batches(pictures, F, "hdr", "pu", 4, 32, 7, AUGMENT)
    two[5], two[0]
    for step in (0, 3, 8):
        assert all(torch.equal(a, b) for a, b in zip(one[step], two[step]))
    assert not torch.equal(one[0][0], one[1][0])
    assert not torch.equal(one[0][0], Batches(pictures, F, "hdr", "pu", 4, 32, 8, AUGMENT)[0][0])


def test_ranks_share_a_batch():
    whole = Batches(small_pictures(), F, "hdr", "pu", 4, 32, 7, AUGMENT)
    parts = [Batches(small_pictures(), F, "hdr", "pu", 4, 32, 7, AUGMENT, rank=r, world=2)
             for r in range(2)]
    for step in (0, 1, 5):
        both = torch.cat([p[step][0] for p in parts])
        assert torch.equal(whole[step][0], both)


def test_an_epoch_visits_every_pair():
    batches = Batches(small_pictures(), F, "hdr", "pu", 4, 32, 7)
    seen = []
    batches.sample = lambda pair, rng: (seen.append(pair), (np.zeros(1), np.zeros(1)))[1]
    assert batches.steps_per_epoch == 2  # 6 pairs in batches of 4: the second is filled up
    for step in range(2):
        batches[step]
    assert len(seen) == 8 and set(seen[:6]) == set(batches.pairs)


def test_small_data_fills_a_batch():
    batches = Batches(small_pictures(groups=1), F, "hdr", "pu", 16, 32, 7)
    assert batches.steps_per_epoch == 1 and batches[0][0].shape == (16, 9, 32, 32)


def test_tiles_larger_than_a_picture_are_refused():
    with pytest.raises(ToolError, match="choose --tile_size 32 or less") as caught:
        Batches(small_pictures(), F, "hdr", "pu", 4, 64, 7)
    assert caught.value.code == 2
    with pytest.raises(ToolError, match="no training images"):
        Batches([], F, "hdr", "pu", 4, 64, 7)


@settings(max_examples=40)
@given(st.integers(0, 10**6))
def test_augmentation_moves_input_and_target_alike(seed):
    """With an input equal to its target they stay equal whatever happens to them."""
    y = small_pictures(seed)[0].target
    clean = [Picture("g", [y, y], [1.0, 4.0], y)]
    batches = Batches(clean, F, "hdr", "pu", 1, 32, seed, AUGMENT)
    x, t = batches.sample((0, 0), np.random.default_rng(seed))
    assert x.shape == (9, 32, 32) and np.array_equal(x[:3], t)
    assert 0 <= x.min() and x.max() <= 1


@pytest.mark.parametrize("main", ["hdr", "nrm", "sh1", "z", "alb"])
def test_shuffle_permutes_within_features(main):
    features = [main] if main != "hdr" else F
    n = sum(CHANNELS[f] for f in features)
    x = np.broadcast_to(np.arange(n, dtype=np.float32), (8, 8, n)).copy()
    for seed in range(20):
        a, b = shuffle(x, x[..., :CHANNELS[main]].copy(), features, main,
                       np.random.default_rng(seed))
        got = [sorted(a[0, 0, k:k + 3].tolist()) for k in range(0, a.shape[-1], 3)]
        if main == "sh1":
            assert len(set(a[0, 0].tolist())) == 3 and a.shape[-1] == 3
        elif main == "hdr":
            assert got == [[0, 1, 2], [3, 4, 5], [6, 7, 8]]
            assert (a[0, 0, 3:6] - 3).tolist() == a[0, 0, :3].tolist()  # albedo as colour
        assert np.array_equal(a[..., :b.shape[-1]], b)


def test_black_tiles_and_exposure_jitter():
    """Black-outs hit colour and target only; jitter changes the light and not the aux."""
    batches = Batches(small_pictures(), F, "hdr", "pu", 1, 32, 1, Augment(exposure=2.0))
    black, means = 0, []
    for seed in range(600):
        x, y = batches.sample((0, 0), np.random.default_rng(seed))
        if not y.any():
            black += 1
            assert not x[:3].any() and x[3:].any()
        else:
            means.append(y.mean())
    assert 1 <= black <= 20
    assert np.std(means) > 0.05  # without jitter all tiles have about the same mean


def test_fireflies():
    """Few pixels of some inputs shine, nothing else of the tile differs, the target not at all."""
    p, cut, found = small_pictures()[0], np.s_[:64, :64], 0
    for seed in range(60):
        tiles = [Batches([p], F, "hdr", "pu", 1, 32, 1, Augment(fireflies=share)).light(
            p, 0, cut, np.random.default_rng(seed)) for share in (0.0, 0.5)]
        (x, y, _), (fx, fy, _) = tiles
        assert np.array_equal(x[..., 3:], fx[..., 3:]) and np.abs(y - fy).max() < 1e-3
        more = np.abs(fx[..., :3] - x[..., :3]).max(-1) > 2e-3
        found += bool(more.any())
        assert more.mean() < 0.02
        if more.any():
            light, dark = (color.pu_inverse(a[..., :3][more]) for a in (fx, x))
            assert (light.max(-1) > dark.max(-1)).all() and light.max() <= color.HDR_MAX * 1.01
    assert 12 <= found <= 45  # of 30 tiles; some get no pixel


def test_average_input_is_the_weighted_mean():
    p = small_pictures()[0]
    batches = Batches([p], F, "hdr", "linear", 1, 32, 1, Augment(average=1.0))
    x, _, _ = batches.light(p, 0, np.s_[:32, :32], np.random.default_rng(0))
    a, b = (i[:32, :32].astype(np.float32) for i in p.inputs)
    assert np.abs(x - (a + 4 * b) / 5).max() < 2e-3


def test_inputs_move_towards_cleaner_targets_only():
    """At 4 samples per pixel a target of 63 would teach to keep noise; one of 64 will do."""
    p = small_pictures()[0]
    batches = Batches([p], F, "hdr", "linear", 1, 32, 1, Augment(blend=1.0))
    for spp, moves in ((63.0, False), (64.0, True), (math.inf, True)):
        p.target_spp = spp
        noisy_input = p.inputs[1][:32, :32, :3].astype(np.float32)
        nearer = 0
        for seed in range(20):
            x, y, _ = batches.light(p, 1, np.s_[:32, :32], np.random.default_rng(seed))
            nearer += np.abs(x[..., :3] - y).mean() < 0.95 * np.abs(noisy_input - y).mean()
        assert nearer >= 15 if moves else nearer == 0


def test_inputs_come_close_to_clean_targets():
    """Of targets that show noise of their own a fifth of the input's stays, of clean ones less."""
    p = small_pictures()[0]
    batches = Batches([p], F, "hdr", "linear", 1, 32, 1, Augment(blend=1.0))
    noise = np.abs(p.inputs[1][:32, :32, :3].astype(np.float32) - p.target[:32, :32, :3]).mean()
    for spp, least in ((64.0, 0.2), (1024.0, 0.03)):
        p.target_spp = spp
        left = []
        for seed in range(60):
            x, y, _ = batches.light(p, 1, np.s_[:32, :32], np.random.default_rng(seed))
            left.append(np.abs(x[..., :3] - y).mean() / noise)
        assert min(left) == pytest.approx(least, abs=0.5 * least + 0.02) and max(left) > 0.7


def test_noise_of_the_synthetic_data_falls_with_spp():
    clean = picture(0)
    errors = [np.abs(noisy(clean, n, 0)["hdr"] - clean["hdr"]).mean() for n in (1, 4, 16, 64)]
    assert errors == sorted(errors, reverse=True)


def test_every_nth_batch_is_of_large_tiles(tmp_path):
    """The others are what they would be without them; large ones come from large images alone."""
    make_raw(tmp_path, 3, spp=(4,))
    small = [load_group(g, F, "hdr", "pu") for g in scan(tmp_path, F).groups]
    large = Picture("large", [np.full((80, 72, 9), 0.25, np.float16)], [4.0],
                    np.full((80, 72, 9), 0.5, np.float16))
    s = parse("train", [*F, "-b", "8", "--ts", "32", "-s", "5", "--large_tiles", "3"])
    team = Team(0, 1, torch.device("cpu"))
    mixed, plain = (make_batches([*small, large], o, team) for o in (s, s.replace(large_tiles=0)))
    assert isinstance(mixed, Alternating) and mixed.steps_per_epoch == plain.steps_per_epoch
    for step in range(7):
        x, y = mixed[step]
        if step % 3 < 2:
            assert all(torch.equal(a, b) for a, b in zip((x, y), plain[step]))
        else:
            assert x.shape == (2, 9, 64, 64) and set(np.unique(x)) <= {0.0, 0.25}
    assert torch.equal(mixed[5][0], mixed[5][0])
    with pytest.raises(ToolError, match="no image is larger than 63x63"):
        make_batches(small, s, team)
    with pytest.raises(ToolError, match="a quarter of --batch_size 6 does not divide"):
        parse("train", [*F, "-b", "6", "--large_tiles", "3"])


def test_black_pixels_stay_black_whatever_their_sign(tmp_path):
    """Where radiance is decoded to be augmented; in a render they may be negative zeros."""
    image = picture(0)["hdr"]
    for name, black in (("plus", 0.0), ("minus", -0.0)):
        image[10:30, 10:30] = black
        for spp in (1, 64):
            write_features(tmp_path / name, f"p_{spp}", {"hdr": image})
    tiles = []
    for name in ("plus", "minus"):
        pictures = from_raw(scan(tmp_path / name, ["hdr"]), ["hdr"], "hdr", "pu")
        batches = Batches(pictures, ["hdr"], "hdr", "pu", 4, 32, 1, Augment(exposure=2.0))
        tiles.append(batches[0])
    for plus, minus in zip(*tiles, strict=True):
        assert torch.equal(plus, minus) and plus.max() < 0.6
