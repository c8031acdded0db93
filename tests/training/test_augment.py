"""Collages and textures: what they add to tiles, and what they must leave as it was."""

import numpy as np
import pytest

from training import augment, color
from training.augment import DARKEST, DEFOCUS, ZOOMS, Augment, between, blurred, defocused, \
    enlarge, figure, hits_by_chance, minified, texture, waves, zoomed
from training.data import Batches, Picture

F = ["hdr", "alb", "nrm"]
MANY = 1e6  # samples per pixel: no noise of its own


def pictures(spp: float, count: int = 4) -> list[Picture]:
    """Each of one radiance code and albedo, input equal to target."""
    out = []
    for g in range(count):
        y = np.full((48, 48, 9), 0.3 + 0.1 * g, np.float16)
        out.append(Picture(f"g{g}", [y], [spp], y))
    return out


def light(spp: float, augment: Augment, seed: int):
    p = pictures(spp)
    x, y, _ = Batches(p, F, "hdr", "pu", 1, 48, 1, augment).light(
        p[0], 0, np.s_[:48, :48], np.random.default_rng(seed))
    return x, y


def test_waves_have_the_slope_they_say():
    for seed in range(10):
        f, slope = waves(64, 64, np.random.default_rng(seed))
        gy, gx = np.gradient(f)
        inner = np.s_[1:-1, 1:-1]
        assert np.abs(np.hypot(gy, gx)[inner] - slope[inner]).max() < 0.7 * slope.max()
        assert abs(np.hypot(gy, gx)[inner].mean() / slope[inner].mean() - 1) < 0.35


def test_figures_have_edges_of_a_pixel():
    insides, widths = [], []
    for seed in range(60):
        c = figure(64, 64, np.random.default_rng(seed))
        assert c.shape == (64, 64) and c.min() >= 0 and c.max() <= 1
        insides.append(c.mean())
        edge = (c > 0) & (c < 1)
        flips = (np.diff(c > 0.5, axis=1).sum() + np.diff(c > 0.5, axis=0).sum())
        if flips > 40:
            widths.append(edge.sum() / flips)
    assert 0.15 < np.mean(insides) < 0.75 and len(widths) > 30
    assert 0.3 < np.median(widths) < 1.5


def test_aliased_figures_are_of_many_samples():
    """At few, single samples on an antialiased edge look like an aliased one."""
    few, many = (np.mean([not ((c > 0) & (c < 1)).any() for c in (
        figure(64, 64, np.random.default_rng(seed), spp) for seed in range(200))])
        for spp in (1.0, 64.0))
    assert few < 0.25 and 0.4 < many < 0.7


@pytest.mark.parametrize("height", [1, 2, 5])
def test_tiles_of_a_few_rows_can_be_zoomed(height):
    x = np.ones((height, 16, 3), np.float32)
    for seed in range(20):
        a, b, c = zoomed(x, x, x, np.random.default_rng(seed))
        assert a.shape == b.shape == c.shape == x.shape and np.allclose(c, 1)


def test_textures_are_factors():
    fine = 0
    for seed in range(60):
        seen, true = texture(32, 40, 1.0, np.random.default_rng(seed))
        for t in (seen, true):
            assert t.shape == (32, 40, 3) and DARKEST <= t.min() + 1e-6 and t.max() <= 1.0 + 1e-6
        if not np.array_equal(seen, true):
            fine += 1
            assert len(np.unique(seen[..., 0])) == 2  # one sample sees one of two colours
            assert np.abs(seen.mean((0, 1)) - true.mean((0, 1))).max() < 0.06
    assert 10 < fine < 35


@pytest.mark.parametrize("spp", [MANY, 1.0])
def test_collage_is_one_picture_or_the_other(spp):
    """Away from the edges; on them the samples fall to either side, with the right mean."""
    mixed, bias = 0, []
    for seed in range(60):
        x, y = light(spp, Augment(collage=1.0), seed)
        ends, counts = np.unique(y[..., 0], return_counts=True)
        if len(ends) < 3 or min(counts[0], counts[-1]) < 20:  # a thin figure, or none
            continue
        mixed += 1
        low, high = (color.pu_inverse(np.float64(v)) for v in (ends[0], ends[-1]))
        share = (color.pu_inverse(y[..., 0].astype(np.float64)) - low) / (high - low)
        drawn = (color.pu_inverse(x[..., 0].astype(np.float64)) - low) / (high - low)
        inside = (share < 1e-3) | (share > 1 - 1e-3)
        assert (np.abs(x[..., :3] - y[..., :3])[inside] > 2e-3).mean() < 0.02
        if spp == MANY:
            assert np.abs(x[..., :3] - y[..., :3]).max() < 0.03
        else:
            assert np.all(np.minimum(abs(drawn), abs(drawn - 1)) < 0.02)  # one sample: all or none
            bias.append((drawn - share)[~inside].mean())
    assert mixed > 25
    assert spp == MANY or abs(np.mean(bias)) < 0.02


def test_features_follow_the_collage():
    """The albedo of a pixel belongs to the same picture as its radiance."""
    for seed in range(20):
        x, y = light(1.0, Augment(collage=1.0), seed)
        for value in np.unique(x[..., 0]):
            assert np.ptp(x[..., 3][x[..., 0] == value]) < 2e-3


def test_textures_multiply_radiance_and_albedo_alike():
    alike = shadows = 0
    for seed in range(60):
        x, y = light(MANY, Augment(texture=1.0), seed)
        assert np.abs(x[..., :3] - y).max() < 2e-3
        plain, _ = light(MANY, Augment(), seed)
        factor = color.pu_inverse(x[..., :3]) / color.pu_inverse(plain[..., :3])
        albedo = x[..., 3:6] / plain[..., 3:6]
        assert np.array_equal(x[..., 6:], plain[..., 6:])
        if np.abs(albedo - 1).max() < 1e-3 and np.abs(factor - 1).max() > 0.05:
            shadows += 1
        else:
            assert np.abs(factor / albedo - 1).max() < 0.03
            alike += 1
    assert alike > 30 and shadows > 4


def test_hits_keep_the_mean_and_are_rare():
    """The mean over many tiles is the target; single tiles may be mostly dark."""
    target = np.full((64, 64, 3), (0.2, 0.4, 0.8), np.float32)
    tiles = [hits_by_chance(target, np.random.default_rng(seed)) for seed in range(200)]
    mean = np.mean(tiles, (0, 1, 2))
    assert np.abs(mean / target[0, 0] - 1).max() < 0.05
    assert sum((t == 0).mean() > 0.8 for t in tiles) > 20
    assert all(np.isfinite(t).all() and t.min() >= 0 for t in tiles)
    grey = sum(np.allclose(t[..., 0] * 2, t[..., 1], rtol=1e-4) for t in tiles)
    assert 60 < grey < 140  # the others have hits of many colours


def test_hits_replace_the_noise_of_the_input():
    x, y = light(MANY, Augment(hits=1.0), 3)
    plain, target = light(MANY, Augment(), 3)
    assert np.abs(y - target).max() < 1e-3 and np.array_equal(x[..., 3:], plain[..., 3:])
    assert np.std(x[..., :3]) > 0.01 > np.std(plain[..., 0])


def test_enlarged_pictures_lie_where_they_should():
    """A ramp stays a ramp, `zoom` times as flat; at full sharpness pixels become squares."""
    zoom, n = 4.0, 32
    at, make = between(n, zoom, 0.5, 1.0)
    ramp = np.arange(make.shape[1], dtype=np.float32)
    assert np.allclose((make @ ramp)[2:-6], at[2:-6], atol=1e-5)
    _, make = between(n, zoom, 0.5, 1e6)
    assert set(np.unique(make)) == {0.0, 1.0} and np.allclose(make.sum(1), 1)
    image = np.random.default_rng(1).random((make.shape[1], make.shape[1], 3), np.float32)
    big = enlarge((make, make), image)
    assert big.shape == (n, n, 3)
    assert np.allclose(big, np.einsum("yi,xj,ijc->yxc", make, make, image), atol=1e-6)


def test_zoomed_tiles_have_the_noise_of_the_original(monkeypatch):
    """Mean and spread per pixel stay; neighbours are as independent as they were."""
    monkeypatch.setattr(augment, "FADED_P", 0.0)
    rng = np.random.default_rng(5)
    means, spreads, neighbours = [], [], []
    for seed in range(40):
        y = np.full((64, 64, 3), 0.5, np.float32)
        x = y * rng.gamma(0.5, 2.0, (64, 64, 1)).astype(np.float32)
        aux = np.full((64, 64, 6), 0.25, np.float32)
        a, b, c = zoomed(x, aux, y, np.random.default_rng(seed))
        assert a.shape == x.shape and b.shape == aux.shape and c.shape == y.shape
        assert np.allclose(b, 0.25) and np.allclose(c, 0.5, atol=1e-5)
        e = a[..., 0] / 0.5 - 1
        means.append(e.mean())
        spreads.append(e.std())
        neighbours.append((e[:, 1:] * e[:, :-1]).mean() / e.var())
    assert abs(np.mean(means)) < 0.03
    assert abs(np.mean(spreads) / 2**0.5 - 1) < 0.12
    assert abs(np.mean(neighbours)) < 0.05


def test_zoomed_tiles_can_be_nearly_clean(monkeypatch):
    monkeypatch.setattr(augment, "FADED_P", 1.0)
    y = np.full((64, 64, 3), 0.5, np.float32)
    x = y * np.random.default_rng(5).gamma(4, 0.25, (64, 64, 1)).astype(np.float32)
    left = []
    for seed in range(40):
        a, _, b = zoomed(x, np.zeros((64, 64, 6), np.float32), y, np.random.default_rng(seed))
        left.append((a - b).std() / (x - y).std())
    assert min(left) < 0.04 and max(left) > 0.5


@pytest.mark.parametrize("spp, is_zoomed", [(4.0, False), (1.0, True)])
def test_only_clean_targets_are_enlarged(spp, is_zoomed):
    """Noise of a target that is enlarged would be taught as a pattern of the surface."""
    y = np.zeros((48, 48, 9), np.float16)
    y[::2] = 0.5  # stripes
    p = [Picture("p", [y], [spp], y, target_spp=32.0)]
    batches = Batches(p, F, "hdr", "pu", 1, 48, 1, Augment(zoom=1.0))
    _, out, _ = batches.light(p[0], 0, np.s_[:48, :48], np.random.default_rng(1))
    stripes = np.array_equal(out, y[..., :3].astype(np.float32))
    assert stripes != is_zoomed and ZOOMS[0] > 1


def test_wide_filters_make_neighbours_alike():
    """Means stay, noise becomes less and is shared by neighbours, along rows and columns alike; all
    images are seen through one filter, which is symmetric."""
    rng = np.random.default_rng(6)
    point = np.zeros((9, 9, 1), np.float32)
    point[4, 4] = 1.0
    shares = []
    for seed in range(40):
        x = rng.gamma(0.5, 2.0, (64, 64, 3)).astype(np.float32)
        a, spread = blurred([x, point], np.random.default_rng(seed))
        assert a.dtype == np.float32 and a.shape == x.shape
        assert abs(a.mean() / x.mean() - 1) < 0.01 and a.std() < 0.95 * x.std()
        assert np.isclose(spread.sum(), 1.0, atol=1e-6) and spread.max() == spread[4, 4]
        assert (spread == spread[::-1]).all() and np.allclose(spread, spread.transpose(1, 0, 2))
        e = a - a.mean()
        shares.append([(e[:, 1:] * e[:, :-1]).mean() / e.var(),
                       (e[1:] * e[:-1]).mean() / e.var()])
    assert 0.01 < np.min(shares) and 0.4 < np.max(shares) < 0.8
    assert np.allclose(*np.mean(shares, 0), atol=0.03)


def test_wide_filters_are_seen_by_input_target_and_features():
    rng = np.random.default_rng(7)
    y = rng.uniform(0.1, 0.6, (48, 48, 9)).astype(np.float16)
    p = Picture("g", [y], [1.0], y)
    plain, seen = (Batches([p], F, "hdr", "pu", 1, 48, 1, a).light(
        p, 0, np.s_[:48, :48], np.random.default_rng(3)) for a in (Augment(), Augment(blur=1.0)))
    assert np.array_equal(seen[0][..., :3], seen[1])
    for c in range(9):
        assert seen[0][..., c].std() < 0.9 * plain[0][..., c].std()


def test_out_of_focus_each_sample_sees_one_place():
    """Radiance and features of a sample come from the same place near the pixel; the target is what
    samples see in the mean, and so are clean features."""
    n = 64
    code = np.arange(n * n, dtype=np.float32).reshape(n, n, 1)
    y, x = np.mgrid[:n, :n].astype(np.float32)
    smooth = 2 + np.sin(x / 3)[..., None] * np.cos(y / 5)[..., None]
    reaches, changes = [], []
    for seed in range(30):
        light, aux, target = defocused(code, np.stack([y, x], -1), smooth, 1.0, False,
                                       np.random.default_rng(seed))
        assert np.array_equal(light[..., 0], aux[..., 0] * n + aux[..., 1])
        reaches.append(np.hypot(aux[..., 0] - y, aux[..., 1] - x).max())
        seen, clean, again = defocused(smooth, smooth, smooth, 16.0, True,
                                       np.random.default_rng(seed))
        assert np.array_equal(target, again) and np.array_equal(clean, target)
        error = seen - target
        assert abs(error.mean()) < 0.003 and error.std() < 0.3 * smooth.std()
        changes.append(np.abs(target - smooth).max())
    assert max(reaches) <= DEFOCUS[1] + 1 and max(reaches) > 0.7 * DEFOCUS[1]
    assert min(reaches) < 3 and max(changes) > 0.5


def test_only_pictures_of_few_samples_get_out_of_focus():
    rng = np.random.default_rng(8)
    y = rng.uniform(0.1, 0.6, (48, 48, 9)).astype(np.float16)
    for spp in (1.0, 16.0, 17.0):
        p = Picture("g", [y], [spp], y)
        plain, seen = (Batches([p], F, "hdr", "pu", 1, 48, 1, a).light(
            p, 0, np.s_[:48, :48], np.random.default_rng(3))
            for a in (Augment(), Augment(defocus=1.0)))
        assert np.array_equal(plain[0], seen[0]) == np.array_equal(plain[1], seen[1]) == (spp > 16)


def test_minified_pixels_are_what_a_renderer_makes_at_that_size():
    """A pixel of the target is the mean of a cell; one of the input is the mean of `count` of the
    cell's pixels, each as often as the others, with the features of the same ones."""
    n, factor = 48, 3
    y, x = np.mgrid[:n, :n]
    code = (y * n + x).astype(np.float32)[..., None]
    place = np.stack([y, x], -1).astype(np.float32)
    cells = code.reshape(n // factor, factor, n // factor, factor).mean((1, 3))
    light, aux, target = minified(code, place, code, factor, 1, False, np.random.default_rng(1))
    assert np.array_equal(light[..., 0], aux[..., 0] * n + aux[..., 1])
    assert np.array_equal(target[..., 0], cells)
    at = (aux % factor @ np.float32([factor, 1])).astype(int)
    assert np.array_equal(aux // factor, place[:n // factor, :n // factor])
    counts = np.bincount(at.ravel(), minlength=factor * factor)
    assert counts.min() > 0.5 * counts.mean() and len(counts) == factor * factor
    noise = np.random.default_rng(2).random((384, 384, 1), np.float32)
    still = np.zeros_like(noise)
    for count in (1, 2, 5, 9):
        light, _, _ = minified(noise, still, still, factor, count, False, np.random.default_rng(3))
        assert abs(light.var() * count * 12 - 1) < 0.05
    light, aux, target = minified(noise, noise, noise, factor, 2, True, np.random.default_rng(4))
    assert np.array_equal(aux, target) and not np.array_equal(light, target)


def test_large_pictures_are_minified():
    """All of a picture twice and three times as wide as the tile; samples count for more."""
    rng = np.random.default_rng(9)
    y = rng.uniform(0.1, 0.6, (56, 60, 9)).astype(np.float16)
    p = Picture("g", [y], [1.0], y, target_spp=32.0)

    def tiles(tile: int, share: float = 1.0):
        batches = Batches([p], F, "hdr", "pu", 1, tile, 1, Augment(minify=share))
        return batches, [batches[k] for k in range(30)]

    for tile, factors in ((16, {2, 3}), (28, {2}), (32, {1})):
        batches, made = tiles(tile)
        assert {batches.factor(p, rng) for _ in range(50)} == factors
        assert all(x.shape == (1, 9, tile, tile) and t.shape == (1, 3, tile, tile) for x, t in made)
        spread = np.median([float(t.std()) for _, t in made])
        assert (spread < 0.11) == (tile < 32)
    assert tiles(16, 0.0)[0].factor(p, rng) == 1
    mean = y[:56, :56, 3:].astype(np.float32).reshape(28, 2, 28, 2, 6).mean((1, 3))
    away = []
    for seed in range(100):  # counts of 1 to 4, most of them 1
        out, target, _ = Batches([p], F, "hdr", "pu", 1, 28, 1, Augment(minify=1.0)).light(
            p, 0, np.s_[:56, :56], np.random.default_rng(seed), 2)
        assert out.shape == (28, 28, 9) and target.shape == (28, 28, 3)
        away.append(np.abs(out[..., 3:] - mean).mean())
    assert min(away) < 1e-6 and max(away) > 0.05
