"""oidnDenoise --pass and --part: further layers of the colour's file in one call."""

from __future__ import annotations

import numpy as np
import pytest

from tests.apps import tools as t

OpenEXR = pytest.importorskip("OpenEXR", reason="optional: no Python package OpenEXR")
pytestmark = pytest.mark.usefixtures("exr")

H, W = 48, 64
LIGHT = ("Combined_key", "Combined_sky")
OTHER = ("DiffDir", "spec")


def images(seed: int = 1) -> dict[str, np.ndarray]:
    """What a renderer may write: two lamps' light, whose sum is the colour, and other passes."""
    found = t.scene(H, W, seed)
    rng = np.random.default_rng(seed)
    share = rng.uniform(0, 1, (H, W, 1)).astype(np.float32)
    key = found["color"] * share
    light = dict(zip(LIGHT, (key, found["color"] - key)))
    bare = found["color"] / found["albedo"]
    alpha = np.clip(rng.normal(0.8, 0.3, (H, W, 1)), 0, 1).astype(np.float32)
    return {"Combined": light[LIGHT[0]] + light[LIGHT[1]], "Denoising Albedo": found["albedo"],
            "Denoising Normal": found["normal"], **light, "DiffDir": bare, "A": alpha,
            "spec": t.noise(H, W, 3, seed), "Depth": t.noise(H, W, 1, seed)}


def channels(name: str, image: np.ndarray, dtype=np.float32) -> dict[str, np.ndarray]:
    if name == "A":
        return {"View.Combined.A": np.ascontiguousarray(image[..., 0].astype(dtype))}
    names = {"Denoising Normal": "XYZ", "Depth": "Z"}.get(name, "RGB")
    return t.planes(f"View.{name}.", image, names, dtype)


def write(path, seed: int = 1, dtype=np.float32) -> dict[str, np.ndarray]:
    """One part with all; returns its channels."""
    found: dict[str, np.ndarray] = {}
    for name, image in images(seed).items():
        found |= channels(name, image, dtype)
    t.write_exr(path, found)
    return found


def write_parts(path) -> None:
    """Each layer in a part of its own, but for the alpha, which is in that of the colour; halves
    but for `spec`."""
    all_images = images()
    parts = []
    for name, image in all_images.items():
        if name == "A":
            continue
        dtype = np.float32 if name == "spec" else np.float16
        inside = channels(name, image, dtype)
        if name == "Combined":
            inside |= channels("A", all_images["A"], dtype)
        parts.append(OpenEXR.Part({"compression": OpenEXR.ZIP_COMPRESSION,
                                   "type": OpenEXR.scanlineimage}, inside, f"View.{name}"))
    OpenEXR.File(parts).write(str(path))


def of(found: dict, name: str) -> np.ndarray:
    return np.stack([found[c] for c in channels(name, np.zeros((1, 1, 3)))], -1)


def alone(denoise, name: str, *options) -> np.ndarray:
    """What a call on one layer makes of it."""
    layer = "View.Combined.A" if name == "A" else name
    bare = ["--layer", "albedo=none"] if name in ("A", "DiffDir") else []
    done = denoise("in.exr", "--layer", f"color={layer}", *bare, "-o", "alone.exr", "-q", "fast",
                   *options)
    assert done.code == 0, done.err
    return of(t.read_parts("alone.exr"), name)


@pytest.mark.parametrize("make", [write, write_parts])
@pytest.mark.parametrize("options", [[], ["--inplace"], ["--strength", "0.5"], ["--threads", "1"],
                                     ["--buffer", "device", "-n", "2"], ["--no_aux"]])
def test_passes_are_what_calls_on_them_give(denoise, work, make, options):
    make(work / "in.exr")
    asked = [x for name in (*OTHER, "A") for x in ("--pass", name)]
    done = denoise("in.exr", *asked, "-o", "out.exr", "-q", "fast", *options)
    assert done.code == 0, done.err
    before, after = t.read_parts("in.exr"), t.read_parts("out.exr")
    assert list(after) == list(before)
    assert {n: c.dtype for n, c in after.items()} == {n: c.dtype for n, c in before.items()}
    options = [] if "-n" in options else options
    for name in ("Combined", *OTHER):
        assert np.array_equal(of(after, name), alone(denoise, name, *options)), name
        assert not np.array_equal(of(after, name), of(before, name)), name
    expected = alone(denoise, "A", *options)
    assert np.array_equal(of(after, "A"), np.minimum(expected, 1))
    for name in (*LIGHT, "Denoising Albedo", "Denoising Normal", "Depth"):
        for c in channels(name, np.zeros((1, 1, 3))):
            assert np.array_equal(after[c], before[c])


@pytest.mark.parametrize("options", [[], ["--inplace"], ["--strength", "0.5"]])
def test_parts_add_up_to_the_colour(denoise, work, options):
    """They are denoised as passes are, and the result is the sum of theirs."""
    write(work / "in.exr")
    asked = [x for name in LIGHT for x in ("--part", name)]
    done = denoise("in.exr", *asked, "--pass", "spec", "-o", "out.exr", "-q", "fast", *options)
    assert done.code == 0, done.err
    after = t.read_parts("out.exr")
    for name in (*LIGHT, "spec"):
        assert np.array_equal(of(after, name), alone(denoise, name, *options)), name
    assert np.array_equal(of(after, "Combined"), of(after, LIGHT[0]) + of(after, LIGHT[1]))
    assert not np.array_equal(of(after, "Combined"), alone(denoise, "Combined", *options))
    assert np.array_equal(after["View.Combined.A"], t.read_parts("in.exr")["View.Combined.A"])


def test_a_sequence_with_passes(denoise, work):
    for k in (1, 2):
        write(work / f"in{k}.exr", k)
    asked = ["--part", LIGHT[0], "--part", LIGHT[1], "--pass", "DiffDir", "-q", "fast"]
    done = denoise("in#.exr", "--frames", "1-2", *asked, "-o", "out#.exr")
    assert done.code == 0, done.err
    for k in (1, 2):
        assert denoise(f"in{k}.exr", *asked, "-o", "one.exr").code == 0
        one, both = t.read_parts("one.exr"), t.read_parts(f"out{k}.exr")
        assert all(np.array_equal(one[name], both[name]) for name in one)


def test_what_it_says(denoise, work):
    write(work / "in.exr")
    asked = ["in.exr", "--part", LIGHT[0], "--part", LIGHT[1], "--pass", "DiffDir", "-q", "fast"]
    text = denoise(*asked).out
    assert "\nDenoising Combined_key\n" in text
    assert "\nDenoising DiffDir, without the albedo\n" in text
    passes = denoise(*asked, "-o", "out.exr", "-o", "out.pfm", "--json").json["passes"]
    assert [(p["layer"], p["part"], p["albedo"]) for p in passes] == [
        ("Combined_key", True, True), ("Combined_sky", True, True), ("DiffDir", False, False)]
    assert all(p["msec"] > 0 for p in passes)
    colour = t.read_pfm(work / "out.pfm")
    assert np.array_equal(colour, of(t.read_parts("out.exr"), "Combined"))


@pytest.mark.parametrize("options, code, text", [
    (["--pass", "nothing"], 2, "no layer 'nothing'"),
    (["--pass", "Combined"], 1, "Combined has the same channels as the colour"),
    (["--pass", "spec", "--pass", "View.spec"], 1, "View.spec has the same channels as spec"),
    (["--part", LIGHT[0]], 2, "do not add up to the colour, but differ from it by "),
    (["--part", LIGHT[0], "--part", "Depth.Z"], 2, "Depth.Z"),
    (["--part", LIGHT[0], "--part", LIGHT[1], "-n", "2"], 1, "--part does not go with -n"),
    (["--pass", "spec", "-f", "RTLightmap"], 1, "the filter RT"),
    (["--pass", "spec", "--frames", "1", "--temporal"], 1, "frames one by one"),
    (["--pass", ""], 1, "--pass"),
    (["--pass", "spec"] * 65, 1, "given 65 times; at most 64"),
])
def test_errors_write_nothing(denoise, work, options, code, text):
    write(work / "in.exr")
    done = denoise("in.exr", *options, "-o", "out.exr", "-q", "fast")
    assert done.code == code and text in done.error
    assert not (work / "out.exr").exists()


def test_passes_want_layers(denoise, work, frame):
    write(work / "in.exr")
    done = denoise("in.exr", "--pass", "spec", "-o", "out.pfm")
    assert done.code == 1 and "'out.pfm' holds no layers" in done.error
    done = denoise("--hdr", "color.pfm", "--pass", "spec", "-o", "out.exr")
    assert done.code == 2 and "spec: 'color.pfm' has no layers" in done.error


def test_pass_that_is_no_number(denoise, work):
    found = write(work / "in.exr")
    found |= channels("spec", np.full((H, W, 3), np.nan))
    t.write_exr(work / "in.exr", found)
    done = denoise("in.exr", "--pass", "spec", "-o", "out.exr")
    assert done.code == 2 and "'in.exr': spec has no finite value" in done.error
