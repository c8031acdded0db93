"""A layer called diffuse: the albedo to some renderers, light to Arnold, RenderMan and others."""

from __future__ import annotations

import numpy as np
import OpenEXR
import pytest

from tests.apps import tools as t
from tests.apps.conftest import runner

pytestmark = pytest.mark.usefixtures("exr")
KIND = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}


def write(path, is_light: bool, exposure: float, is_multipart: bool) -> None:
    images = t.scene(40, 56)
    color = images["color"] * exposure
    diffuse = 0.9 * color if is_light else images["albedo"]
    if is_multipart:
        main = t.planes("", color, dtype=np.float32)
        parts = {"rgba": main, "diffuse": t.planes("", diffuse)}
        files = [OpenEXR.Part(dict(KIND), c, name) for name, c in parts.items()]
        OpenEXR.File(files).write(str(path))
    else:
        channels = t.planes("", color, dtype=np.float32) | t.planes("diffuse.", diffuse)
        t.write_exr(path, channels | t.planes("specular.", color - diffuse))


@pytest.mark.parametrize("is_multipart", [False, True])
@pytest.mark.parametrize("exposure", [0.1, 1, 1000])
@pytest.mark.parametrize("is_light", [False, True])
def test_diffuse_light_is_no_albedo(denoise, info, build, work, is_light, exposure, is_multipart):
    write(work / "in.exr", is_light, exposure, is_multipart)
    done = denoise("in.exr", "--json")
    assert done.code == 0, done.err
    assert ("albedo" in done.json) == (not is_light)
    assert ("diffuse_left_out" in done.json) == is_light
    without, named = (denoise("in.exr", "--layer", f"albedo={layer}", "--json")
                      for layer in ("none", "diffuse"))
    same = without if is_light else named
    assert done.json["runs"][0]["hash"] == same.json["runs"][0]["hash"]
    assert named.code == 0 and "albedo" in named.json
    assert ("albedo" in info("in.exr", "--json").json["files"][0]) == (not is_light)
    classical = runner(build / "bin" / "ynlmdenoise")("-i", "in.exr", "-o", "out.pfm")
    assert classical.code == 0 and ("albedo=" in classical.out) == (not is_light)


def test_diffuse_light_that_is_given(denoise, build, work):
    write(work / "in.exr", True, 1, False)
    assert "albedo" in denoise("in.exr", "--alb", "in.exr", "--json").json
    classical = runner(build / "bin" / "ynlmdenoise")
    assert "albedo=" in classical("-i", "in.exr", "-a", "in.exr", "-o", "out.pfm").out


def test_diffuse_light_is_told(denoise, work):
    write(work / "in.exr", True, 1, False)
    assert "  diffuse is left out: it is light, not albedo\n" in denoise("in.exr").out
