"""Files of several pictures: layers of one go together, and its reference."""

from __future__ import annotations

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
