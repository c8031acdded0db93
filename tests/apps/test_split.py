"""oidnDenoise --split: the mean of a colour denoised as a whole and by its passes of light."""

from __future__ import annotations

import numpy as np
import pytest

from tests.apps import tools as t

OpenEXR = pytest.importorskip("OpenEXR", reason="optional: no Python package OpenEXR")
pytestmark = pytest.mark.usefixtures("exr")

H, W = 48, 64
LOBES = {"Diffuse": ("Diffuse Direct", "Diffuse Indirect", "Diffuse Color"),
         "Glossy": ("Glossy Direct", "Glossy Indirect", "Glossy Color"),
         "Transmission": ("Transmission Direct", "Transmission Indirect", "Transmission Color")}
OLDER = {name: name.replace("Diffuse", "Diff").replace("Glossy", "Gloss")
         .replace("Transmission", "Trans").replace(" Direct", "Dir").replace(" Indirect", "Ind")
         .replace(" Color", "Col") for names in LOBES.values() for name in names}
WHOLE = ("Combined", "Denoising Albedo", "Denoising Normal")


def images(seed: int = 1, emission: float = 0.5, glass: float = 0) -> dict[str, np.ndarray]:
    """What Cycles may write: light and colours of two lobes, of a third unless there is no glass,
    and a lamp in a corner that no pass of light has."""
    found = t.scene(H, W, seed)
    rng = np.random.default_rng(seed)
    layers = {}
    total = np.zeros((H, W, 3), np.float32)
    for lobe, (direct, indirect, color) in LOBES.items():
        size = {"Diffuse": 1, "Glossy": 0.3, "Transmission": glass}[lobe]
        layers[color] = (size * found["albedo"][:, :, ::-1]).astype(np.float32)
        for name in (direct, indirect):
            light = size * found["color"] * rng.gamma(2, 0.5, (H, W, 1))
            layers[name] = light.astype(np.float32)
            total = total + layers[name] * layers[color]
    total[:8, :8] += np.float32(emission) * (1 + found["color"][:8, :8])
    return {"Combined": total, "Denoising Albedo": found["albedo"],
            "Denoising Normal": found["normal"], **layers}


def channels(layers: dict[str, np.ndarray], view: str = "View.", dtype=np.float32) -> dict:
    found: dict[str, np.ndarray] = {}
    for name, image in layers.items():
        found |= t.planes(f"{view}{name}.", image, "XYZ" if "Normal" in name else "RGB", dtype)
    return found


def write_layers(path, layers: dict[str, np.ndarray]) -> None:
    t.write_exr(path, channels(layers))


def write_parts(path, layers: dict[str, np.ndarray]) -> None:
    """Each layer in a part of its own, as Blender 5 does, with channels of those names."""
    OpenEXR.File([OpenEXR.Part({"compression": OpenEXR.ZIP_COMPRESSION,
                                "type": OpenEXR.scanlineimage},
                               channels({name: image}), f"View.{name}")
                  for name, image in layers.items()]).write(str(path))


def colour(path, view: str = "View.") -> np.ndarray:
    found = t.read_parts(path)
    return np.stack([found[f"{view}Combined.{c}"] for c in "RGB"], -1)


class Calls:
    """What calls give that denoise one image each."""

    def __init__(self, denoise, work, *options):
        self.denoise, self.work, self.options = denoise, work, options

    def __call__(self, color, albedo, normal) -> np.ndarray:
        layers = {"Combined": color, "Denoising Albedo": albedo, "Denoising Normal": normal}
        write_layers(self.work / "share.exr", {k: v for k, v in layers.items() if v is not None})
        done = self.denoise("share.exr", "-o", "one.exr", "-q", "fast", *self.options)
        assert done.code == 0, done.err
        return colour(self.work / "one.exr")


def expected(one: Calls, layers: dict[str, np.ndarray], names=None) -> np.ndarray:
    """Of the layers; names: those of the passes, by Cycles' present ones."""
    names = names or {name: name for lobe in LOBES.values() for name in lobe}
    normal = layers.get("Denoising Normal")
    albedo = layers.get("Denoising Albedo")
    total = np.zeros((H, W, 3), np.float32)
    rest = layers["Combined"]
    size = np.abs(rest)
    for direct, indirect, color in LOBES.values():
        for name in (direct, indirect):
            if names[name] not in layers:
                continue
            share = layers[names[name]] * layers[names[color]]
            rest, size = rest - share, size + np.abs(share)
            if share.any():
                own = layers[names[color]]
                through = albedo if albedo is not None and "Trans" in name else own
                total = total + one(share, through, normal)
    rest = np.where(np.abs(rest) <= np.float32(0.002) * size, np.float32(0), rest)
    if rest.any():
        total = total + one(rest, albedo, normal)
    return np.float32(0.5) * (one(layers["Combined"], albedo, normal) + total)


@pytest.mark.parametrize("make", [write_layers, write_parts])
@pytest.mark.parametrize("options", [[], ["--inplace"], ["--inplace", "-n", "2"], ["-n", "2"],
                                     ["--threads", "1"], ["--buffer", "device"], ["--clean_aux"],
                                     ["--prefilter"], ["--ensemble", "2"]])
def test_it_is_the_mean_of_both_ways(denoise, work, make, options):
    layers = images()
    make(work / "in.exr", layers)
    done = denoise("in.exr", "--split", "-o", "out.exr", "-q", "fast", *options)
    assert done.code == 0, done.err
    kept = [x for x in options if x not in ("-n", "2")] if "-n" in options else options
    assert np.array_equal(colour("out.exr"), expected(Calls(denoise, work, *kept), layers))
    before, after = t.read_parts("in.exr"), t.read_parts("out.exr")
    assert all(np.array_equal(after[n], before[n]) for n in before if "Combined" not in n)


@pytest.mark.parametrize("left_out", [(), ("Denoising Albedo",)])
def test_glass_shows_the_albedo_of_what_is_behind(denoise, work, left_out):
    """Its own colour stands for it where the file has no albedo."""
    layers = {k: v for k, v in images(glass=0.5).items() if k not in left_out}
    write_layers(work / "in.exr", layers)
    options = ["--layer", "albedo=none"] if left_out else []
    done = denoise("in.exr", "--split", "-o", "out.exr", "-q", "fast", *options)
    assert done.code == 0, done.err
    assert np.array_equal(colour("out.exr"), expected(Calls(denoise, work), layers))


def test_strength_is_of_the_mean(denoise, work):
    layers = images()
    write_layers(work / "in.exr", layers)
    for strength, out in (("1", "whole.exr"), ("0.25", "out.exr")):
        assert denoise("in.exr", "--split", "-o", out, "-q", "fast", "--strength",
                       strength).code == 0
    noisy, whole = layers["Combined"], colour("whole.exr")
    assert np.allclose(colour("out.exr"), noisy + 0.25 * (whole - noisy), rtol=1e-5)


@pytest.mark.parametrize("left_out", [("Denoising Normal",), ("Denoising Albedo",),
                                      ("Denoising Normal", "Denoising Albedo")])
def test_without_albedo_or_normals(denoise, work, left_out):
    """Passes have albedos of their own; these are not to be taken for the file's."""
    layers = {k: v for k, v in images().items() if k not in left_out}
    write_layers(work / "in.exr", layers)
    options = ["--layer", "albedo=none"] if "Denoising Albedo" in left_out else []
    done = denoise("in.exr", "--split", "-o", "out.exr", "-q", "fast", *options)
    assert done.code == 0, done.err
    assert np.array_equal(colour("out.exr"), expected(Calls(denoise, work), layers))


def test_what_a_pass_of_light_needs(denoise, work):
    """Its color; without that it is of the rest, as is light of which there is no pass."""
    layers = {k: v for k, v in images().items() if k not in ("Glossy Color", "Diffuse Indirect")}
    write_layers(work / "in.exr", layers)
    done = denoise("in.exr", "--split", "-o", "out.exr", "-q", "fast", "--json")
    assert [p["layer"] for p in done.json["split"]] == ["Diffuse Direct", "the rest"]
    layers = {k: v for k, v in layers.items() if "Glossy" not in k}
    assert np.array_equal(colour("out.exr"), expected(Calls(denoise, work), layers))


@pytest.mark.parametrize("glass", [0, 1e-4])
def test_next_to_no_light_is_not_denoised(denoise, work, glass):
    """Light of so dark a glass, times its colour, is less than a hundred thousandth of all."""
    write_layers(work / "in.exr", images(emission=0, glass=glass))
    done = denoise("in.exr", "--split", "-o", "out.exr", "-q", "fast", "--json")
    split = done.json["split"]
    assert [p["layer"] for p in split] == ["Diffuse Direct", "Diffuse Indirect", "Glossy Direct",
                                           "Glossy Indirect"]
    assert all(p["msec"] > 0 for p in split)
    assert done.json["runs"][0]["msec"] > sum(p["msec"] for p in split)
    text = denoise("in.exr", "--split", "-q", "fast").out
    assert "\nDenoising\n  Diffuse Direct\n    msec=" in text and "rest" not in text


def test_older_names_and_halves(denoise, work):
    """Rounded to halves the passes do not quite add up; no rest is made of that."""
    layers = {OLDER.get(k, k): v for k, v in images(emission=0).items()}
    t.write_exr(work / "in.exr", channels(layers, dtype=np.float16))
    done = denoise("in.exr", "--split", "-o", "out.exr", "-q", "fast", "--json", "-t", "float")
    assert done.code == 0, done.err
    assert [p["layer"] for p in done.json["split"]] == [OLDER[n] for lobe in ("Diffuse", "Glossy")
                                                        for n in LOBES[lobe][:2]]
    rounded = {k: v.astype(np.float16).astype(np.float32) for k, v in layers.items()}
    result = expected(Calls(denoise, work), rounded, OLDER)
    assert np.array_equal(colour("out.exr"), result)


@pytest.mark.parametrize("names", [("directDiffuse", "indirectDiffuse"),
                                   ("diffuse_direct", "specular_indirect"),
                                   ("DIRECT_GLOSSY", "INDIRECT_DIFFUSE")])
def test_passes_that_are_shares_as_they_are(denoise, work, names):
    found = t.scene(H, W, 1)
    first = (0.25 * found["color"]).astype(np.float32)
    layers = {"Combined": found["color"], "Denoising Albedo": found["albedo"],
              "Denoising Normal": found["normal"], names[0]: first,
              names[1]: found["color"] - first}
    write_layers(work / "in.exr", layers)
    done = denoise("in.exr", "--split", "-o", "out.exr", "-q", "fast")
    assert done.code == 0, done.err
    one = Calls(denoise, work)
    whole, *shares = (one(layers[k], found["albedo"], found["normal"])
                      for k in ("Combined", *names))
    assert np.array_equal(colour("out.exr"), np.float32(0.5) * (whole + (shares[0] + shares[1])))


def test_passes_are_those_of_the_colour_s_view_layer(denoise, work):
    own, other = images(1), images(2)
    t.write_exr(work / "in.exr", channels(other, "A.") | channels(own, "View."))
    done = denoise("in.exr", "--split", "--layer", "color=View.Combined", "-o", "out.exr", "-q",
                   "fast")
    assert done.code == 0, done.err
    assert np.array_equal(colour("out.exr"), expected(Calls(denoise, work), own))


def test_a_sequence(denoise, work):
    for k in (1, 2):
        write_layers(work / f"in{k}.exr", images(k))
    done = denoise("in#.exr", "--frames", "1-2", "--split", "-o", "out#.exr", "-q", "fast")
    assert done.code == 0, done.err
    for k in (1, 2):
        assert denoise(f"in{k}.exr", "--split", "-o", "one.exr", "-q", "fast").code == 0
        assert np.array_equal(colour("one.exr"), colour(f"out{k}.exr"))


def test_infinite_light_hides_no_pass(denoise, work):
    layers = images()
    write_layers(work / "good.exr", layers)
    for name, value in (("Combined", np.inf), ("Diffuse Direct", np.nan)):
        layers[name][20, 20] = value
    write_layers(work / "in.exr", layers)
    good, done = (denoise(f"{name}.exr", "--split", "-o", f"{name}.out.exr", "-q", "fast", "--json")
                  for name in ("good", "in"))
    assert [p["layer"] for p in done.json["split"]] == [p["layer"] for p in good.json["split"]]
    assert np.isfinite(colour("in.out.exr")).all()


@pytest.mark.parametrize("options, code, text", [
    (["--split", "--part", "Combined"], 1, "--split is for"),
    (["--split", "-f", "RTLightmap"], 1, "the filter RT"),
    (["--split", "--frames", "1", "--temporal"], 1, "frames one by one"),
    (["--split", "--layer", "color=Diffuse Direct"], 2, "are no shares of the colour, but have"),
])
def test_errors_write_nothing(denoise, work, options, code, text):
    write_layers(work / "in.exr", images())
    done = denoise("in.exr", *options, "-o", "out.exr", "-q", "fast")
    assert done.code == code and text in done.error
    assert not (work / "out.exr").exists()


def test_it_wants_passes_of_light(denoise, work, frame):
    write_layers(work / "in.exr", {k: v for k, v in images().items() if k in WHOLE})
    done = denoise("in.exr", "--split", "-o", "out.exr")
    assert done.code == 2 and "such as 'Diffuse Direct' with 'Diffuse Color'" in done.error
    done = denoise("--hdr", "color.pfm", "--split", "-o", "out.exr")
    assert done.code == 2 and "'color.pfm' has no passes of light" in done.error
    write_layers(work / "in.exr", images())
    done = denoise("--ldr", "in.exr", "--split", "-o", "out.exr")
    assert done.code == 1 and "--split is for HDR colours" in done.error
