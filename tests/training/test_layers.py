"""Layers of multichannel EXR files: the names of renderers, parts, and what doctor says of both."""

import re

import numpy as np
import OpenEXR
import pytest

from tests.training.tools import noisy, picture, write_features
from export import calibrate
from training import doctor, split_exr
from training.errors import ToolError
from training.features import holds, load
from training.imageio import read_exr_channels, read_image, write_exr
from training.layers import COMPONENTS, LAYERS, find_channels
from training.scan import scan

F = ["hdr", "alb", "nrm"]


def test_names_are_those_of_the_programs(root):
    """One table in C, one in Python: the same names in the same order."""
    text = (root / "apps" / "layers.c").read_text()
    rows = re.findall(r'\{IMAGE_(\w+), "([^"]*)"\}', text)
    roles = {"COLOR": "hdr", "ALBEDO": "alb", "NORMAL": "nrm", "MOTION": "motion"}
    for role, feature in roles.items():
        assert LAYERS[feature] == tuple(name for r, name in rows if r == role)
    assert len(rows) == sum(len(LAYERS[f]) for f in roles.values())
    body = re.search(r"components\[\]\[3\] = \{(.*?)\};", text, re.DOTALL)[1]
    assert COMPONENTS == tuple(tuple(re.findall(r'"(\w+)"', row))
                               for row in re.findall(r"\{.*?\}", body))


def rgb(*layers):
    return [f"{layer}.{c}" if layer else c for layer in layers for c in "BGR"]


def layer_of(name, components="RGB"):
    return tuple(f"{name}.{c}" for c in components)


@pytest.mark.parametrize("feature, names, layer, want", [
    ("hdr", rgb("Beauty", ""), None, ("R", "G", "B")),
    ("hdr", rgb("a.beauty", "Combined"), None, layer_of("a.beauty")),
    ("alb", rgb("x.DiffCol", "DiffCol"), None, layer_of("DiffCol")),
    ("alb", rgb("diffuse", "VIEW.ALBEDO"), None, layer_of("VIEW.ALBEDO")),
    ("alb", rgb("myalbedo"), None, None),
    ("nrm", ["N.Z", "N.Y", "N.X", "sh.N.red"], None, layer_of("N", "XYZ")),
    ("nrm", ["N.X", "N.Y", *rgb("v.N")], None, layer_of("v.N")),
    ("z", ["ViewLayer.Depth.Z", "depth.V"], None, ("depth.V",)),
    ("z", ["ViewLayer.Depth.Z"], None, ("ViewLayer.Depth.Z",)),
    ("z", ["Z", "v.Denoising Depth.Z"], None, ("v.Denoising Depth.Z",)),
    ("a", ["A", "R"], None, ("A",)),
    ("alb", rgb("v.mine", "albedo"), "mine", layer_of("v.mine")),
    ("alb", rgb("albedo"), "mine", None),
    ("z", ["far", "Z"], "far", ("far",))])
def test_layers_are_found(feature, names, layer, want):
    assert find_channels(feature, names, layer) == want


def write_layers(path, images, layers):
    """Features as layers of one part: (layer, feature, components)."""
    names = [f"{layer}.{c}" if layer else c for layer, _, cs in layers for c in cs]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_exr(path, np.concatenate([images[f] for _, f, _ in layers], -1), tuple(names))


def write_parts(path, images, layers):
    """Features as parts of a file: (part, feature, components)."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    parts = [OpenEXR.Part(header | {"name": part}, {
        c: np.ascontiguousarray(images[f][..., i], np.float32) for i, c in enumerate(cs)}, part)
        for part, f, cs in layers]
    path.parent.mkdir(parents=True, exist_ok=True)
    OpenEXR.File(parts).write(str(path))


BLENDER = (("ViewLayer.Combined", "hdr", "RGB"), ("ViewLayer.DiffCol", "alb", "RGB"),
           ("ViewLayer.Normal", "nrm", "XYZ"))
VRAY = ("", "hdr", "RGB"), ("VRayDiffuseFilter", "alb", "RGB"), ("VRayNormals", "nrm", "XYZ")
PARTS = ("albedo", "alb", "RGB"), ("beauty", "hdr", "RGB"), ("normal", "nrm", "XYZ")


@pytest.mark.parametrize("write, layers", [
    (write_layers, BLENDER), (write_layers, VRAY), (write_parts, PARTS)])
def test_renders_of_renderers_are_read(tmp_path, capsys, write, layers):
    """Each feature is what it is, wherever it stands in the file."""
    clean = picture(1)
    for spp in (4, 16, 512):
        write(tmp_path / "d" / f"a_{spp}spp.exr", noisy(clean, spp, 1), layers)
    group = scan(tmp_path / "d", F).groups[0]
    for version in group.inputs:
        want = noisy(clean, version.spp, 1)
        for feature, image in load(version, F).items():
            assert np.abs(image - want[feature]).max() < 1e-6
    doctor.main([*F, "-D", str(tmp_path), "-i", "d"])
    assert "nothing found" in capsys.readouterr().out


def test_pictures_and_splits_of_multipart_files(tmp_path):
    """Without a role the colour is the picture, not what comes first."""
    images = picture(1)
    write_parts(tmp_path / "a_4.exr", images, PARTS)
    assert list(read_exr_channels(tmp_path / "a_4.exr"))[:3] == rgb("albedo")
    assert np.array_equal(read_image(tmp_path / "a_4.exr"), images["hdr"])
    split_exr.main([str(tmp_path / "a_4.exr")])
    for feature, image in images.items():
        assert np.array_equal(read_image(tmp_path / f"a_4.{feature}.exr"), image)


def test_split_files_are_no_findings(tmp_path, capsys):
    """The alpha that split_exr writes was one, "name is not <picture>_<version>"."""
    for spp, images in ("4", noisy(picture(1), 4, 1)), ("ref", picture(1)):
        path = tmp_path / "d" / f"a_{spp}.exr"
        path.parent.mkdir(exist_ok=True)
        write_exr(path, np.concatenate([images["hdr"], np.ones_like(images["hdr"][..., :1])], -1),
                  (*"RGBA",))
        split_exr.main([str(path)])
    assert (tmp_path / "d" / "a_4.a.exr").exists()
    doctor.main(["hdr", "-D", str(tmp_path), "-i", "d"])
    assert "left out" not in capsys.readouterr().out


def test_inputs_without_features_are_findings(tmp_path, capsys, fails):
    """Each by itself; of references the light is enough."""
    clean = picture(3)
    for spp in (4, 16):
        write_layers(tmp_path / "d" / f"a_{spp}.exr", noisy(clean, spp, 1),
                     [("", "hdr", "RGB"), ("mine", "alb", "RGB")])
    write_features(tmp_path / "d", "a_ref", {"hdr": clean["hdr"]})
    args = ["-D", str(tmp_path), "-i", "d"]
    assert fails(doctor.main, ["hdr", "alb", *args])[1] == "2 findings in 1 groups"
    assert "a_16.exr: no channels for 'alb'" in capsys.readouterr().out
    doctor.main(["hdr", "alb", *args, "--layers", "alb=mine"])


@pytest.mark.parametrize("write", [write_layers, write_parts])
@pytest.mark.parametrize("exposure", [0.1, 1, 1000])
@pytest.mark.parametrize("is_light", [False, True])
def test_diffuse_light_is_no_albedo(tmp_path, write, exposure, is_light):
    """To Arnold, RenderMan and others it is the light of diffuse surfaces; as for oidnDenoise."""
    layers = (("beauty" if write is write_parts else "", "hdr", "RGB"),
              ("diffuse", "diffuse", "RGB"), ("N", "nrm", "XYZ"))
    for spp in (4, 512):
        images = noisy(picture(4), spp, 1)
        images["hdr"] = images["hdr"] * exposure
        images["diffuse"] = 0.9 * images["hdr"] if is_light else images["alb"]
        write(tmp_path / "d" / f"a_{spp}spp.exr", images, layers)
    version = scan(tmp_path / "d", F).groups[0].inputs[0]
    named = load(version, F, {"alb": "diffuse"})
    if is_light:
        with pytest.raises(ToolError, match="diffuse.R, diffuse.G, diffuse.B is light"):
            load(version, F)
        assert not holds(version, F) and holds(version, F, {"alb": "diffuse"})
    else:
        assert np.array_equal(load(version, F)["alb"], named["alb"]) and holds(version, F)
    split_exr.main([str(tmp_path / "d" / "a_4spp.exr")])
    assert (tmp_path / "d" / "a_4spp.alb.exr").exists() != is_light
    kind = calibrate.Kind(("color", "normal"), "hdr")
    optional = calibrate.read_picture(tmp_path / "d" / "a_4spp.exr", kind, ["albedo"])
    assert ("albedo" in optional) != is_light


def test_features_are_those_of_the_colours_view_layer(tmp_path):
    """What has the prefix of the colour that was taken comes before all others, as for
    oidnDenoise."""
    back, char = picture(5), picture(6)
    back = {f: 0.5 * i for f, i in back.items()}
    images = {f"b{f}": i for f, i in back.items()} | char
    write_layers(tmp_path / "d" / "a_4.exr", images, [
        ("Back.Combined", "bhdr", "RGB"), ("Back.Denoising Albedo", "balb", "RGB"),
        ("Back.Denoising Normal", "bnrm", "XYZ"), ("char.DiffCol", "alb", "RGB"),
        ("Char.Combined", "hdr", "RGB"), ("char.Normal", "nrm", "XYZ")])
    version = scan(tmp_path / "d", F, need_target=False).groups[0].inputs[0]
    for chosen, want in ({}, back), ({"hdr": "Char.Combined"}, char):
        for feature, image in load(version, F, chosen).items():
            assert np.array_equal(image, want[feature].astype(np.float32)), (chosen, feature)
    named = load(version, F, {"hdr": "Char.Combined", "alb": "Back.Denoising Albedo"})
    assert np.array_equal(named["alb"], back["alb"])
