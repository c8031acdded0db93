"""Files of several pictures: layers of one go together, and its reference."""

from __future__ import annotations

import numpy as np
import OpenEXR
import pytest

from tests.apps import tools as t
from tests.apps.test_layers import layers

pytestmark = pytest.mark.usefixtures("exr")
BLENDER = ("ViewLayer.Combined", "ViewLayer.Denoising Albedo", "ViewLayer.Denoising Normal")
PLAIN = ("", "albedo", "N")


def write_stereo(path, names: tuple[str, str, str], views: list[str]) -> None:
    """Layers NAME.VIEW; of a layer without a name, the default view has none either."""
    channels = t.planes("AO." if names[0] else "Spec.", t.noise(40, 56))
    for view in views:
        plain = "" if view == views[0] else f"{view}."
        prefixes = [f"{name}.{view}." if name else plain for name in names]
        channels |= layers(*prefixes) | t.planes(f"{names[0] or 'x'}.AO.{view}.", t.noise(40, 56))
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header | {"multiView": views}, channels).write(str(path))


@pytest.mark.parametrize("names", [BLENDER, PLAIN], ids=["blender", "plain"])
@pytest.mark.parametrize("views", [["left", "right"], ["right", "left"]])
@pytest.mark.parametrize("is_second", [False, True])
def test_layers_of_one_view_go_together(denoise, identity, work, names, views, is_second):
    write_stereo(work / "in.exr", names, views)
    view = views[is_second]
    color = ".".join(filter(None, (names[0], view)))
    chosen = ("--layer", f"color={color}") if is_second else ()
    done = denoise("in.exr", *chosen, "-w", identity[9], "-o", "out.exr", "--json")
    assert done.code == 0, done.err
    layer = {role: done.json[role]["layer"][0] for role in ("color", "albedo", "normal")}
    assert layer["albedo"] == f"{names[1]}.{view}.R"
    assert layer["normal"] == f"{names[2]}.{view}.X"
    if names[0] or is_second:
        assert layer["color"] == f"{color}.R"
    else:
        assert layer["color"] == "R"
    assert list(t.read_exr(work / "out.exr")) == list(t.read_exr(work / "in.exr"))


PARTS = {  # name of a part, of its channels, and how to ask for the colour of the second view
    "blender": ("{layer}-{view}", "{layer}.", "ViewLayer.Combined.{view}"),
    "nuke": ("{layer}_{view}", "{layer}.", "ViewLayer.Combined.{view}"),
    "plain": ("{layer}.{view}", "", "ViewLayer.Combined.{view}"),
}


@pytest.mark.parametrize("kind", PARTS)
@pytest.mark.parametrize("views", [["left", "right"], ["right", "left"]])
@pytest.mark.parametrize("is_second", [False, True])
@pytest.mark.parametrize("is_albedo_first", [False, True])
def test_views_in_parts(denoise, work, kind, views, is_second, is_albedo_first):
    """Albedo and normals of the view that is denoised: those of the other one are no numbers."""
    part, prefix, color = PARTS[kind]
    images = t.scene(40, 56)
    parts, kept = [], []
    for name, role in zip(BLENDER, ("color", "albedo", "normal"), strict=True):
        for view in views:
            is_mine = view == views[is_second]
            image = images[role] if is_mine else np.full_like(images[role], np.nan)
            channels = t.planes(prefix.format(layer=name), image, "XYZ" if "Nor" in name else "RGB")
            header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
            title = part.format(layer=name, view=view)
            parts.append(OpenEXR.Part(header | {"view": view}, channels, title))
            kept.append(role != "color" or not is_mine)
    order = sorted(range(6), key=lambda i: i // 2 != 1) if is_albedo_first else range(6)
    OpenEXR.File([parts[i] for i in order]).write(str(work / "in.exr"))
    for name, image in images.items():
        t.write_pfm(work / f"{name}.pfm", image.astype(np.float16).astype(np.float32))
    chosen = ("--layer", "color=" + color.format(view=views[1])) if is_second else ()
    done = denoise("in.exr", *chosen, "-t", "float", "-o", "out.exr", "--json")
    assert done.code == 0, done.err
    expected = denoise("--hdr", "color.pfm", "--alb", "albedo.pfm", "--nrm", "normal.pfm", "--json")
    assert done.json["runs"][0]["hash"] == expected.json["runs"][0]["hash"]
    for place, i in enumerate(order):
        before, after = (t.read_exr(work / file, place) for file in ("in.exr", "out.exr"))
        same = all(np.array_equal(before[c], after[c], equal_nan=True) for c in before)
        assert same == kept[i]


@pytest.mark.parametrize("reference", ["out.exr", "plain.exr"])
def test_reference_of_the_layer_that_was_named(denoise, identity, work, reference):
    char = t.noise(40, 56, seed=3)
    channels = layers("BG.Combined.") | t.planes("Char.Combined.", char)
    t.write_exr(work / "in.exr", channels)
    t.write_exr(work / "plain.exr", t.planes("", char))
    named = ("in.exr", "--layer", "color=Char.Combined", "-w", identity[3])
    assert denoise(*named, "-o", "out.exr").code == 0
    done = denoise(*named, "--ref", reference, "--json")
    assert done.code == 0, done.err
    assert done.json["reference"]["errors"] == 0


def test_reference_of_another_crop(denoise, identity, work):
    """Pixels of equal crops at different places are not compared; of the same place they are."""
    for name, x in (("in", 8), ("ref", 12)):
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage,
                  "dataWindow": (np.array([x, 0], "i4"), np.array([x + 55, 39], "i4")),
                  "displayWindow": (np.zeros(2, "i4"), np.array([99, 99], "i4"))}
        OpenEXR.File(header, t.planes("", np.ones((40, 56, 3)))).write(str(work / f"{name}.exr"))
    done = denoise("--hdr", "in.exr", "--ref", "ref.exr", "-w", identity[3], "-o", "out.pfm")
    assert done.code == 2 and not (work / "out.pfm").exists()
    assert all(word in done.error for word in ("ref.exr", "12,0", "in.exr", "8,0")), done.error
    assert denoise("--hdr", "in.exr", "--ref", "in.exr", "-w", identity[3]).code == 0
