"""Pictures drawn without a renderer: what the noisy versions and the target promise."""
from __future__ import annotations

import json

import numpy as np
import pytest

from training.errors import ToolError
from training.imageio import read_image
from training.scenes import leaves

SMALL = ["--size", "32x24", "--spp", "1,2", "--pick", "0"]


def draw(out, *more):
    leaves.main([str(out), *SMALL, *more])


@pytest.mark.parametrize("seed, style", [*((s, "any") for s in range(6)),
                                         (6, "sparks"), (7, "soft"), (2, "rooms"),
                                         (3, "rooms")])
def test_target_is_the_mean_of_the_samples(seed, style):
    """Of all nine channels, by blocks of 4x4 pixels, within what is left of the noise."""
    stage = leaves.Stage(32, 32, np.random.default_rng([seed, 7]), leaves.STYLES[style])
    rng = np.random.default_rng(seed)

    def blocks(x):
        return x.reshape(8, 4, 8, 4, 9).mean((1, 3))

    n = 600
    samples = np.stack([blocks(stage.sample(rng)) for _ in range(n)])
    wanted = blocks(stage.target)
    left = samples.std(0) / np.sqrt(n)
    off = np.abs(samples.mean(0) - wanted)
    assert (off <= 6 * left + 0.01 * np.abs(wanted) + 1e-5).mean() > 0.99
    assert abs((samples.mean(0) - wanted).mean()) <= 0.02 * np.abs(wanted).mean()


def test_pictures_differ_and_repeat(tmp_path, capsys):
    draw(tmp_path / "a", "--seeds", "0:3")
    draw(tmp_path / "b", "--seeds", "2")
    files = sorted(p.name for p in (tmp_path / "a" / "l00002").iterdir())
    kinds = [f"l00002_{n}spp.{k}.exr" for n in ("0001", "0002", "4096")
             for k in ("alb", "hdr", "nrm")]
    assert files == sorted([*kinds, "manifest.json"])
    for name in files:
        a, b = ((tmp_path / side / "l00002" / name).read_bytes() for side in "ab")
        assert name == "manifest.json" or a == b
    image = read_image(tmp_path / "a" / "l00002" / "l00002_4096spp.hdr.exr")
    other = read_image(tmp_path / "a" / "l00001" / "l00001_4096spp.hdr.exr")
    assert image.shape == other.shape == (24, 32, 3) and not np.allclose(image, other, rtol=0.1)
    noisy = read_image(tmp_path / "a" / "l00002" / "l00002_0001spp.hdr.exr")
    assert np.isfinite(noisy).all() and (noisy >= 0).all() and not np.array_equal(noisy, image)
    manifest = json.loads((tmp_path / "a" / "l00002" / "manifest.json").read_text())
    assert manifest["size"] == [32, 24] and manifest["noisy"] == [1, 2]
    capsys.readouterr()
    draw(tmp_path / "a", "--seeds", "0:3")
    assert capsys.readouterr().out == "0 pictures to draw, 3 finished before\n"


def test_lamps_are_bright_and_black_to_the_albedo(tmp_path):
    def black_and_bright(*more):
        draw(tmp_path / f"a{len(more)}", "--seeds", "0:6", *more)
        found = 0
        for folder in (tmp_path / f"a{len(more)}").iterdir():
            light, albedo = (read_image(folder / f"{folder.name}_4096spp.{kind}.exr")
                             for kind in ("hdr", "alb"))
            found += ((albedo.max(-1) < 1e-3) & (light.max(-1) > 4 * np.median(light))).sum()
        return found
    assert black_and_bright("--style", "lamps") > 20 + black_and_bright()


def test_sparks_carry_much_of_the_light(tmp_path):
    """One pixel in 30 at one sample each: the share of all the light."""
    def share(*more):
        draw(tmp_path / f"a{len(more)}", "--seeds", "0:10", *more)
        found = []
        for folder in (tmp_path / f"a{len(more)}").iterdir():
            light = np.sort(read_image(folder / f"{folder.name}_0001spp.hdr.exr").mean(-1), None)
            found.append(light[-light.size // 30:].sum() / light.sum())
        return np.median(found)
    assert share("--style", "sparks") > share() + 0.15


def test_soft_light_is_even():
    """Light that falls onto the points changes little from one to the next."""
    def steps(style):
        found = []
        for seed in range(20):
            stage = leaves.Stage(32, 32, np.random.default_rng([seed, 7]), leaves.STYLES[style])
            points = stage.values.reshape(stage.h, stage.w, -1)
            light = points[..., 15:18] + sum(points[..., k:k + 3] * points[..., k + 3:k + 4]
                                             for k in range(19, points.shape[-1], 4))
            level = np.log(light.mean(-1) + 1e-4)
            found.append(np.quantile(np.abs(np.diff(level, axis=1)), 0.9))
        return np.median(found)
    assert steps("soft") < 0.6 * steps("any")


@pytest.mark.parametrize("more, what", [(["--size", "8"], "--size"), (["--spp", "x"], "--spp"),
                                        (["--bits", "1,1"], "--bits"),
                                        (["--pick", "-1"], "--pick")])
def test_bad_options_are_named(tmp_path, more, what):
    with pytest.raises(ToolError, match=what):
        draw(tmp_path / "a", *more)
    assert not (tmp_path / "a").exists()


def test_seeds_that_are_finished_with_other_options(tmp_path, fails):
    """They are refused; others may have options of their own."""
    draw(tmp_path, "--seeds", "0:2", "--style", "soft")
    draw(tmp_path, "--seeds", "0:3", "--style", "soft")
    draw(tmp_path, "--seeds", "3:4", "--style", "lamps")
    args = [str(tmp_path), "--seeds", "0:4", "--size", "32"]
    code, message = fails(leaves.main, [*args, "--style", "lamps"])
    assert code == 4 and "l00000/manifest.json: this group was made with" in message
    (tmp_path / "l00000" / "manifest.json").write_text("[]")
    assert fails(leaves.main, args)[0] == 3
