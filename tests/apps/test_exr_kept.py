"""What OpenEXR itself does not know, or reads wrongly, and the output keeps."""

from __future__ import annotations

import numpy as np
import OpenEXR
import pytest

from tests.apps import tools as t
from tests.apps.test_layers import EXTRA, header_of, layers

pytestmark = pytest.mark.usefixtures("exr")


@pytest.mark.parametrize("parts", [1, 2])
def test_attributes_of_unknown_types_are_kept(denoise, identity, work, parts):
    kind = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **EXTRA}
    names = ("beauty", "spare")[:parts]
    files = [OpenEXR.Part(dict(kind), layers(), name) for name in names]
    OpenEXR.File(files).write(str(work / "in.exr"))
    known, mine = b"renderer\0string\0\x08\0\0\0test 1.0", b"renderer\0strinx\0\x08\0\0\0test 1.0"
    data = (work / "in.exr").read_bytes()
    assert data.count(known) == parts
    (work / "in.exr").write_bytes(data.replace(known, mine))
    done = denoise("in.exr", "-w", identity[3], "-o", "out.exr")
    assert done.code == 0, done.err
    assert (work / "out.exr").read_bytes().count(mine) == parts
    assert header_of(work / "out.exr")["owner"] == "'somebody'"
    assert list(t.read_exr(work / "out.exr")) == list(t.read_exr(work / "in.exr"))


def test_alpha_and_passes_by_further_calls(denoise, work):
    """As docs/apps.md has it: each call denoises one layer and keeps the others."""
    s = t.scene(64, 80)
    light = s["color"] / (s["albedo"] + 0.02)
    alpha = s["color"][..., :1].clip(0, 1)
    channels = {**t.planes("", s["color"]), "A": alpha[..., 0].astype("f2"),
                **t.planes("albedo.", s["albedo"]), **t.planes("normal.", s["normal"], "XYZ"),
                **t.planes("View.GlossDir.", light)}
    t.write_exr(work / "in.exr", channels)
    calls = (("in.exr", "R"), ("out.exr", "A", "--layer", "color=A"),
             ("out.exr", "View.GlossDir.R", "--layer", "color=View.GlossDir", "--layer",
              "albedo=none"))
    before = t.read_exr(work / "in.exr")
    for source, changed, *layer in calls:
        done = denoise(source, *layer, "-o", "out.exr")
        assert done.code == 0, done.err
        after = t.read_exr(work / "out.exr")
        same = {name for name, values in after.items() if (values == before[name]).all()}
        assert set(after) == set(channels)
        assert set(after) - same == ({changed[:-1] + c for c in "RGB"} if changed != "A" else {"A"})
        if "albedo=none" in layer:
            assert "albedo=" not in done.out.replace("albedo=none", "")
        before = after


def test_alpha_is_not_divided_by_itself(denoise, identity, work, png):
    """Denoised for a PNG file it came out white."""
    alpha = t.noise(20, 30, 1)[..., 0]
    t.write_exr(work / "in.exr", t.planes("", t.noise(20, 30)) | {"A": alpha})
    done = denoise("in.exr", "--layer", "color=A", "--no_aux", "-w", identity[3], "-o", "out.png")
    codes, _ = t.read_png(work / "out.png")
    assert done.code == 0 and codes.shape == (20, 30, 1)
    assert np.abs(codes[..., 0] / 255 - t.srgb_encode(alpha)).max() < 0.003


@pytest.mark.parametrize("compression", ["B44", "B44A"])
@pytest.mark.parametrize("dtype", [np.float32, np.float16])
@pytest.mark.parametrize("width, height, tile", [(32, 33, 0), (2, 33, 0), (33, 32, 16)])
def test_chunks_that_compression_does_not_shrink(
    denoise, identity, work, compression, dtype, width, height, tile
):
    """They are stored as they are, as are all of float channels."""
    rng = np.random.default_rng(8)
    channels = {c: (rng.random((height, width)) + 0.5).astype(dtype) for c in "RGBA"}
    header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION")}
    if tile:
        header |= {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
        header["tiles"].xSize = header["tiles"].ySize = tile
    t.write_exr(work / "in.exr", channels, **header)
    before = t.read_exr(work / "in.exr")
    done = denoise("in.exr", "-w", identity[3], "--strength", 0, "-o", "out.exr", "-o", "out.pfm")
    assert done.code == 0, done.err
    assert np.array_equal(t.read_pfm(work / "out.pfm"), t.stack(before, "R", "G", "B"))
    assert np.array_equal(t.read_exr(work / "out.exr")["A"], before["A"])


def test_chunks_that_are_as_long_as_their_pixels(denoise, identity, work):
    """Of 400 lines of a gradient, each compressed by itself, half are."""
    gradient = np.add.outer(np.arange(400), np.arange(4)) / 50
    image = np.stack([0 * gradient, gradient, gradient], axis=-1)
    t.write_exr(work / "in.exr", t.planes("", image), compression=OpenEXR.ZIPS_COMPRESSION)
    assert denoise("in.exr", "-w", identity[3], "--strength", 0, "-o", "out.exr").code == 0
    before, after = (t.read_exr(work / name) for name in ("in.exr", "out.exr"))
    assert all(np.array_equal(before[c], after[c]) for c in "RGB")
