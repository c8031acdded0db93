"""oidnDenoise --temporal: less flicker, and nothing of other things than those that are seen."""

from __future__ import annotations

import numpy as np
import pytest

from tests.apps import tools as t

WIDTH, HEIGHT, FRAMES = 128, 96, 6
NAMES = ("--hdr", "c#.pfm", "--alb", "a#.pfm", "--nrm", "n#.pfm", "-q", "fast")
STILL = ("--layer", "motion=none")


def texture(seed: int, height: int = HEIGHT, width: int = 2 * WIDTH) -> dict[str, np.ndarray]:
    """A wide picture without noise, to pan over: light that is smooth, and its features."""
    s = t.scene(height, width, seed)
    return {"clean": s["clean"], "albedo": s["albedo"], "normal": s["normal"]}


def write_frames(work, pans: list[float], light=None, sign=(1, -1)) -> list[np.ndarray]:
    """Frames of a picture seen from `pans` pixels to the right on; returns them without noise."""
    s, clean = texture(5), []
    rng = np.random.default_rng(7)
    for k, pan in enumerate(pans):
        left = int(pan)
        part = {n: v[:, left:left + WIDTH] for n, v in s.items()}
        bright = light[k] if light else 1.0
        clean.append(part["clean"] * np.float32(bright))
        noise = rng.gamma(1.0, 1.0, (HEIGHT, WIDTH, 1)).astype(np.float32)
        t.write_pfm(work / f"c{k}.pfm", clean[-1] * noise)
        t.write_pfm(work / f"a{k}.pfm", part["albedo"])
        t.write_pfm(work / f"n{k}.pfm", part["normal"])
        moved = np.zeros((HEIGHT, WIDTH, 3), np.float32)
        moved[..., 0] = (pan - pans[max(k - 1, 0)]) * sign[0]
        t.write_pfm(work / f"m{k}.pfm", moved)
    return clean


def results(work, denoise, *options: str, frames: str = f"0-{FRAMES - 1}") -> list[np.ndarray]:
    done = denoise(*NAMES, "--frames", frames, "-o", "o#.pfm", *options)
    assert done.code == 0, done.err
    found = sorted(work.glob("o*.pfm"), key=lambda path: int(path.stem[1:]))
    images = [t.read_pfm(p) for p in found]
    for path in found:
        path.unlink()
    return images


def error(images, clean) -> float:
    return float(np.mean([((a - b) ** 2).mean() for a, b in zip(images[2:], clean[2:])]))


def flicker(images, clean, pans) -> float:
    """Mean square of how errors change from frame to frame, at the same places of the picture."""
    errors = [a - b for a, b in zip(images, clean)]
    sums = []
    for k in range(2, len(errors)):
        d = int(pans[k]) - int(pans[k - 1])
        here, before = errors[k][:, :WIDTH - d], errors[k - 1][:, d:]
        sums.append(((here - before) ** 2).mean())
    return float(np.mean(sums))


@pytest.mark.parametrize("pans, options", [
    ([0.0] * FRAMES, STILL), ([0.0] * FRAMES, ("--motion", "m#.pfm")),
    ([3.0 * k for k in range(FRAMES)], ("--motion", "m#.pfm"))])
def test_flicker_and_error_are_less(denoise, work, pans, options):
    clean = write_frames(work, pans)
    alone = results(work, denoise)
    steady = results(work, denoise, "--temporal", *options)
    assert np.array_equal(steady[0], alone[0])
    assert flicker(steady, clean, pans) < 0.5 * flicker(alone, clean, pans)
    assert error(steady, clean) < 0.6 * error(alone, clean)


@pytest.mark.parametrize("sign", [(1, -1), (1, 1), (-1, 1), (-1, -1)])
def test_signs_of_vectors_are_found(denoise, work, sign):
    pans = [4.0 * k for k in range(FRAMES)]
    write_frames(work, pans, sign=sign)
    options = ("--temporal", "--motion", "m#.pfm")
    given = results(work, denoise, *options, "--motion_scale", f"{sign[0]},{sign[1]}")
    found = results(work, denoise, *options)
    wrong = results(work, denoise, *options, "--motion_scale", f"{-sign[0]},1")
    assert all(np.array_equal(a, b) for a, b in zip(given, found))
    assert not np.array_equal(given[-1], wrong[-1])


def test_light_that_changes_is_followed(denoise, work):
    light = [1, 1, 1, 4, 4, 4]
    clean = write_frames(work, [0.0] * FRAMES, light=light)
    alone = results(work, denoise)
    steady = results(work, denoise, "--temporal", *STILL)
    for k in (3, 4):
        assert abs(steady[k].mean() / clean[k].mean() - 1) < 0.05
        assert ((steady[k] - clean[k]) ** 2).mean() < 1.3 * ((alone[k] - clean[k]) ** 2).mean()


def test_light_that_fades_is_followed(denoise, work):
    """Each frame by less than chance shows, in many frames by much."""
    light = [0.9 ** k for k in range(12)]
    clean = write_frames(work, [0.0] * 12, light=light)
    steady = results(work, denoise, "--temporal", *STILL, frames="0-11")
    for k in range(6, 12):
        assert abs(steady[k].mean() / clean[k].mean() - 1) < 0.15


def test_means_of_many_frames(denoise, work):
    """Where nothing moves, nine frames are as one of nine times the samples."""
    clean = write_frames(work, [0.0] * 10)
    samples = [t.read_pfm(work / f"c{k}.pfm") for k in range(10)]
    steady = results(work, denoise, "--temporal", *STILL, frames="0-9")
    t.write_pfm(work / "c0.pfm", np.mean(samples[1:], 0, dtype=np.float32))
    many = results(work, denoise, frames="0-0")
    assert ((steady[9] - clean[9]) ** 2).mean() < 1.6 * ((many[0] - clean[9]) ** 2).mean()


def test_lamps_do_not_hide_what_changes(denoise, work):
    """Few pixels that are as bright as lamps are."""
    light = [1, 1, 1, 4, 4, 4]
    write_frames(work, [0.0] * FRAMES, light=light)
    for k in range(FRAMES):
        noisy = t.read_pfm(work / f"c{k}.pfm").copy()
        noisy[:3, :40] = 1e7
        t.write_pfm(work / f"c{k}.pfm", noisy)
    alone = results(work, denoise)
    steady = results(work, denoise, "--temporal", *STILL)
    part = np.s_[20:]
    assert abs(steady[3][part].mean() / alone[3][part].mean() - 1) < 0.05


def test_a_cut_takes_nothing_over(denoise, work):
    """But what has like features and like light by chance."""
    pans = [0.0, 0.0, float(WIDTH)]  # another place altogether
    clean = write_frames(work, pans)
    alone = results(work, denoise, frames="0-2")
    steady = results(work, denoise, "--temporal", *STILL, frames="0-2")
    assert not np.array_equal(steady[1], alone[1])
    assert ((steady[2] - clean[2]) ** 2).mean() < 1.1 * ((alone[2] - clean[2]) ** 2).mean()


def test_what_was_outside_stays_as_it_is(denoise, work):
    """But for what denoising takes from the pixels around, and from the mean of the frame."""
    pans = [0.0, 20.0]
    write_frames(work, pans)
    alone = results(work, denoise, frames="0-1")
    steady = results(work, denoise, "--temporal", "--motion", "m#.pfm", frames="0-1")
    change = np.abs(steady[1] / alone[1] - 1)
    assert np.median(change[:, WIDTH - 12:]) < 0.2 * np.median(change[:, :WIDTH - 20])


def test_frames_that_do_not_follow_are_not_mixed(denoise, work):
    write_frames(work, [0.0] * FRAMES)
    alone = results(work, denoise, frames="0-4x2")
    steady = results(work, denoise, "--temporal", *STILL, frames="0-4x2")
    assert all(np.array_equal(a, b) for a, b in zip(alone, steady))


def test_bytes_do_not_depend_on_how_it_is_run(denoise, work):
    write_frames(work, [2.0 * k for k in range(FRAMES)])
    options = ("--temporal", "--motion", "m#.pfm")
    steady = results(work, denoise, *options)
    for more in (("--inplace",), ("--threads", "1"), ("--buffer", "device")):
        again = results(work, denoise, *options, *more)
        assert all(np.array_equal(a, b) for a, b in zip(steady, again)), more


def test_strength_is_of_the_steady_result(denoise, work):
    write_frames(work, [0.0] * 3)
    options = ("--temporal", *STILL)
    whole = results(work, denoise, *options, frames="0-2")
    half = results(work, denoise, *options, "--strength", "0.5", frames="0-2")
    noisy = t.read_pfm(work / "c2.pfm")
    assert np.allclose(half[2], noisy + 0.5 * (whole[2] - noisy), rtol=1e-5, atol=1e-6)


def test_vectors_that_are_no_numbers(denoise, work):
    write_frames(work, [0.0] * 2)
    vectors = t.read_pfm(work / "m1.pfm").copy()
    vectors[:10] = np.nan
    vectors[10:20] = np.inf
    vectors[20:30] = 1e30
    t.write_pfm(work / "m1.pfm", vectors)
    alone = results(work, denoise, frames="0-1")
    steady = results(work, denoise, "--temporal", "--motion", "m#.pfm", frames="0-1")
    change = np.abs(steady[1] / alone[1] - 1)
    assert np.median(change[:20]) < 0.2 * np.median(change[40:])


def test_values_that_are_no_numbers_are_those_of_before(denoise, work):
    clean = write_frames(work, [0.0] * 3)
    for k, bad in ((1, np.nan), (2, np.inf)):
        noisy = t.read_pfm(work / f"c{k}.pfm").copy()
        noisy[40:44, 40:44] = bad
        t.write_pfm(work / f"c{k}.pfm", noisy)
    steady = results(work, denoise, "--temporal", *STILL, frames="0-2")
    for image, truth in zip(steady, clean):
        assert np.isfinite(image).all()
        assert np.abs(image / truth - 1)[36:48, 36:48].max() < 0.5


def test_results_that_are_infinite(denoise, work):
    """Halves end at 65504: what is brighter is infinite, and stays alone."""
    write_frames(work, [0.0] * 3)
    for k in range(3):
        noisy = t.read_pfm(work / f"c{k}.pfm").copy()
        noisy[40:60, 40:60] = 1e6
        t.write_pfm(work / f"c{k}.pfm", noisy)
    options = ("-t", "half", "--is", "0.1")
    alone = results(work, denoise, *options, frames="0-2")
    steady = results(work, denoise, *options, "--temporal", *STILL, frames="0-2")
    assert any(np.isinf(image).any() for image in alone)
    for a, s in zip(alone, steady):
        assert np.array_equal(np.isinf(a), np.isinf(s)) and not np.isnan(s).any()


@pytest.mark.parametrize("options", [(), ("--inplace",)])
def test_data_windows_that_move(denoise, work, exr, options):
    """A crop that wanders over a picture that stands still: what was seen before has not moved."""
    pans = [3.0 * k for k in range(FRAMES)]
    write_frames(work, pans)
    steady = results(work, denoise, "--temporal", "--motion", "m#.pfm")
    for k in range(FRAMES):
        planes = {}
        for name, file, letters in (("", "c", "RGB"), ("albedo.", "a", "RGB"),
                                    ("normal.", "n", "XYZ")):
            planes |= t.planes(name, t.read_pfm(work / f"{file}{k}.pfm"), letters, np.float32)
        corner = np.array([int(pans[k]) - 5, 7], np.int32)
        header = {"dataWindow": (corner, corner + np.array([WIDTH - 1, HEIGHT - 1], np.int32))}
        t.write_exr(work / f"e{k}.exr", planes, **header)
    done = denoise("e#.exr", "-q", "fast", "--temporal", *STILL, "--frames", f"0-{FRAMES - 1}",
                   "-o", "o#.pfm", *options)
    assert done.code == 0, done.err
    wandering = [t.read_pfm(work / f"o{k}.pfm") for k in range(FRAMES)]
    assert np.array_equal(wandering[0], steady[0])
    clean = [texture(5)["clean"][:, int(p):int(p) + WIDTH] for p in pans]
    assert error(wandering, clean) <= error(steady, clean)


@pytest.mark.parametrize("layer", ["Vector", "ViewLayer.Vector", "motionvector", "velocity"])
@pytest.mark.parametrize("components", ["XYZ", "XY", "RG"])
def test_layers_of_motion(denoise, work, exr, layer, components):
    pans = [2.0 * k for k in range(3)]
    write_frames(work, pans)
    steady = results(work, denoise, "--temporal", "--motion", "m#.pfm", frames="0-2")
    for k in range(3):
        planes = {}
        for name, file, letters in (("", "c", "RGB"), ("albedo.", "a", "RGB"),
                                    ("normal.", "n", "XYZ"), (layer + ".", "m", components)):
            image = t.read_pfm(work / f"{file}{k}.pfm")[..., :len(letters)]
            planes |= t.planes(name, image, letters, np.float32)
        t.write_exr(work / f"e{k}.exr", planes)
    done = denoise("e#.exr", "-q", "fast", "--temporal", "--frames", "0-2", "-o", "o#.pfm")
    assert done.code == 0, done.err
    assert f"motion=e1.exr ({layer}.{components[0]}" in done.out
    assert all(np.array_equal(a, t.read_pfm(work / f"o{k}.pfm")) for k, a in enumerate(steady))


@pytest.mark.parametrize("code, says, options", [
    (1, "--frames", ("--temporal", *STILL)),
    (1, "--temporal only", ("--frames", "0-1", "--motion", "m#.pfm")),
    (1, "--temporal only", ("--frames", "0-1", *STILL)),
    (1, "one run", ("--frames", "0-1", "--temporal", *STILL, "-n", "2")),
    (1, "RT", ("--frames", "0-1", "--temporal", *STILL, "-f", "RTLightmap")),
    (1, "X,Y", ("--frames", "0-1", "--temporal", *STILL, "--motion_scale", "1")),
    (2, "no motion vectors", ("--frames", "0-1", "--temporal")),
    (2, "none#.pfm".replace("#", "0"), ("--frames", "0-1", "--temporal", "--motion", "none#.pfm")),
    (2, "two channels", ("--frames", "0-1", "--temporal", "--motion", "grey.pfm")),
    (2, "has 8x8 pixels", ("--frames", "0-1", "--temporal", "--motion", "small.pfm")),
    (2, "integers", ("--frames", "0-1", "--temporal", "--motion", "codes.ppm")),
])
def test_errors(denoise, work, code, says, options):
    write_frames(work, [0.0] * 2)
    t.write_pfm(work / "grey.pfm", np.zeros((HEIGHT, WIDTH, 1), np.float32))
    t.write_pfm(work / "small.pfm", np.zeros((8, 8, 3), np.float32))
    t.write_ppm(work / "codes.ppm", np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    done = denoise("--hdr", "c#.pfm", "-q", "fast", "-o", "o#.pfm", *options)
    assert done.code == code and says in done.error
    assert not list(work.glob("o*.pfm"))
