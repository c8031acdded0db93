"""Multilayer EXR files: which layers are taken, and what is kept in the output."""

from __future__ import annotations

import numpy as np
import OpenEXR
import pytest

from tests.apps import tools as t
from tests.apps.conftest import runner

H, W = 40, 56
pytestmark = pytest.mark.usefixtures("exr")


def layers(
    color: str = "", albedo: str | None = None, normal: str | None = None, xyz: str = "XYZ"
) -> dict:
    """Channels of a frame under the given prefixes."""
    images = t.scene(H, W)
    channels = t.planes(color, images["color"])
    if albedo is not None:
        channels |= t.planes(albedo, images["albedo"])
    if normal is not None:
        channels |= t.planes(normal, images["normal"], xyz)
    return channels


NAMES = [  # colour, albedo, normal; components of the normal
    ("", "albedo.", "normal.", "XYZ"),
    ("", "albedo.", "normal.", "RGB"),
    ("Noisy Image.", "Denoising Albedo.", "Denoising Normal.", "XYZ"),
    ("ViewLayer.Combined.", "ViewLayer.Denoising Albedo.", "ViewLayer.Denoising Normal.", "XYZ"),
    ("ViewLayer.Noisy Image.", "ViewLayer.DiffCol.", "ViewLayer.Normal.", "XYZ"),
    ("Beauty.", "VisibleDiffuse.", "VisibleNormals.", "XYZ"),
    ("Composite.Combined.", "diffuse.", "Normals.", "XYZ"),
    ("", "diffuse_albedo.", "N.", "XYZ"),
    ("", "Albedo.", "Ns.", "XYZ"),
    ("", "OptixAlbedo.", "OptixNormals.", "XYZ"),
    ("rgba.", "albedo.", "sh_normal.", "XYZ"),
]


@pytest.mark.parametrize("color, albedo, normal, xyz", NAMES)
def test_usual_names(denoise, identity, work, color, albedo, normal, xyz):
    t.write_exr(work / "in.exr", layers(color, albedo, normal, xyz))
    done = denoise("--hdr", "in.exr", "-w", identity[9])
    assert done.code == 0, done.err
    for role, prefix, names in (
        ("color", color, "RGB"),
        ("albedo", albedo, "RGB"),
        ("normal", normal, xyz),
    ):
        channels = " ".join(prefix + n for n in names)
        assert f"  {role}=in.exr ({channels})\n" in done.out


def test_long_component_names(denoise, identity, work):
    images = t.scene(H, W)
    channels = t.planes("", images["color"])
    for layer in ("albedo", "normal"):
        for i, name in enumerate(("red", "green", "blue")):
            channels[f"{layer}.{name}"] = np.ascontiguousarray(images[layer][..., i])
    t.write_exr(work / "in.exr", channels)
    done = denoise("in.exr", "-w", identity[9], "--json")
    assert done.code == 0, done.err
    assert done.json["normal"]["layer"] == ["normal.red", "normal.green", "normal.blue"]


@pytest.mark.parametrize("present, inputs", [((), 3), (("albedo.",), 6)])
def test_missing_layers_are_left_out(denoise, identity, work, present, inputs):
    t.write_exr(work / "in.exr", layers("", *present))
    done = denoise("in.exr", "-w", identity[inputs], "--json")
    assert done.code == 0, done.err
    assert ("albedo" in done.json) == (inputs == 6) and "normal" not in done.json


def test_normals_without_albedo_are_left_out(denoise, identity, work):
    t.write_exr(work / "in.exr", layers("", None, "N."))
    done = denoise("in.exr", "-w", identity[3])
    assert done.code == 0, done.err
    assert "normals are left out" in done.out


def test_layer_option(denoise, identity, work):
    channels = layers("", "albedo.", "normal.")
    other = t.scene(H, W, seed=9)
    channels |= t.planes("texture.", other["albedo"]) | t.planes("bump.", other["normal"], "XYZ")
    channels |= {"a": channels["R"], "b": channels["G"], "c": channels["B"]}
    t.write_exr(work / "in.exr", channels)
    done = denoise(
        "in.exr",
        "-w",
        identity[9],
        "--json",
        "--layer",
        "albedo=texture",
        "--layer",
        "normal=bump.X,bump.Y,bump.Z",
        "--layer",
        "color=a,b,c",
    )
    assert done.code == 0, done.err
    assert done.json["albedo"]["layer"] == ["texture.R", "texture.G", "texture.B"]
    assert done.json["normal"]["layer"] == ["bump.X", "bump.Y", "bump.Z"]
    assert done.json["color"]["layer"] == ["a", "b", "c"]
    done = denoise("in.exr", "-w", identity[6], "--layer", "normal=none", "--json")
    assert done.code == 0 and "normal" not in done.json
    done = denoise("in.exr", "-w", identity[3], "--no_aux", "--json")
    assert done.code == 0 and "albedo" not in done.json
    done = denoise("in.exr", "--layer", "albedo=nothing")
    assert done.code == 2 and "in.exr" in done.error and "nothing" in done.error


PICTURES = {  # of files with two pictures: prefix of each, name of the colour
    "view layers": ("BG.", "Char.", "Combined."),
    "stereo": ("", "right.", ""),
}


@pytest.mark.parametrize("kind", PICTURES)
@pytest.mark.parametrize("which", [0, 1])
def test_albedo_and_normals_of_the_same_picture(denoise, info, identity, work, kind, which):
    *prefixes, name = PICTURES[kind]
    channels = {}
    for prefix in prefixes:
        normal = "Denoising Normal." if prefix == "Char." else "Normal."  # the other's better name
        channels |= layers(prefix + name, prefix + "DiffCol.", prefix + normal)
    t.write_exr(work / "in.exr", channels)
    told = info("in.exr", "--json").json["files"][0]
    assert all(told["normal"]["layer"][i] == f"{prefixes[0]}Normal.{'XYZ'[i]}" for i in range(3))
    mine = prefixes[which]
    color = (mine + name).rstrip(".")
    chosen = color if color else "R,G,B"
    done = denoise("in.exr", "--layer", f"color={chosen}", "-w", identity[9], "--json")
    assert done.code == 0, done.err
    for role in ("color", "albedo", "normal"):
        assert all(c.startswith(mine) for c in done.json[role]["layer"]), done.json[role]
        assert mine or not any(c.startswith("right.") for c in done.json[role]["layer"])


def test_albedo_of_the_same_part(denoise, work):
    """Parts may have channels of the same names."""
    kind = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    parts = [OpenEXR.Part(dict(kind), layers("", "albedo."), name) for name in ("left", "right")]
    parts[0].channels["albedo.R"].pixels[:] = 7
    OpenEXR.File(parts).write(str(work / "in.exr"))
    for name, exceeds in (("left", True), ("right", False)):
        done = denoise("in.exr", "--layer", f"color={name}", "--check")
        assert done.code == 0, done.err
        assert ("albedo exceeds 1" in done.out) == exceeds, done.out


def test_given_files_come_first(denoise, identity, work):
    t.write_exr(work / "in.exr", layers("", "albedo.", "normal."))
    t.write_pfm(work / "albedo.pfm", t.noise(H, W))
    done = denoise("in.exr", "--alb", "albedo.pfm", "-w", identity[9], "--json")
    assert done.json["albedo"]["file"] == "albedo.pfm" and done.json["normal"]["file"] == "in.exr"
    done = denoise(
        "--hdr", "in.exr", "--alb", "in.exr", "--nrm", "in.exr", "-w", identity[9], "--json"
    )
    assert done.json["albedo"]["layer"] == ["albedo.R", "albedo.G", "albedo.B"]
    assert done.json["normal"]["layer"] == ["normal.X", "normal.Y", "normal.Z"]


def test_albedo_in_a_file_of_its_own(denoise, identity, work):
    images = t.scene(H, W)
    t.write_exr(work / "in.exr", t.planes("", images["color"]))
    t.write_exr(work / "alb.exr", t.planes("", images["albedo"]))
    t.write_exr(work / "nrm.exr", t.planes("", images["normal"], "XYZ"))
    done = denoise("in.exr", "--alb", "alb.exr", "--nrm", "nrm.exr", "-w", identity[9], "--json")
    assert done.code == 0, done.err
    assert done.json["albedo"]["layer"] == ["R", "G", "B"]
    assert done.json["normal"]["layer"] == ["X", "Y", "Z"]


def test_grey_and_unknown_colour(denoise, identity, work):
    grey = t.noise(H, W, 1)
    t.write_exr(work / "y.exr", t.planes("", grey, "Y"))
    assert denoise("y.exr", "-w", identity[3], "--json").json["color"]["layer"] == ["Y"]
    image = t.noise(H, W)
    channels = t.planes("View.CryptoObject00.", image) | t.planes("albedo.", image)
    for other, name in (("x", "pass"), ("AO", "Image")):  # the latter is Blender's compositor's
        channels |= t.planes(f"{name}.", image) | t.planes(f"{other}.", image)
        t.write_exr(work / "z.exr", channels)
        report = denoise("z.exr", "-w", identity[6], "--json").json
        assert report["color"]["layer"] == [f"{name}.{c}" for c in "RGB"]


# ---- What is kept --------------------------------------------------------------------------------


def header_of(path, part: int = 0) -> dict:
    return {k: repr(v) for k, v in OpenEXR.File(str(path)).parts[part].header.items()}


EXTRA = {
    "comments": "hello",
    "owner": "somebody",
    "capDate": "2020:01:02 03:04:05",
    "framesPerSecond": 24.0,
    "renderer": "test 1.0",
    "samples": 4,
}


@pytest.mark.parametrize("compression", "NO RLE ZIPS ZIP PIZ PXR24 B44 B44A".split())
@pytest.mark.parametrize("tiled", [False, True])
def test_other_layers_and_metadata_are_kept(denoise, identity, work, compression, tiled):
    channels = layers("", "albedo.", "N.")
    rng = np.random.default_rng(5)
    channels |= {
        "A": rng.random((H, W)).astype(np.float16),
        "Z": rng.random((H, W)).astype(np.float32),
        "id": rng.integers(0, 2**32, (H, W), dtype=np.uint32),
        "a.layer.with.a.name.longer.than.31.letters.R": rng.random((H, W)).astype(np.float16),
    }
    header = {**EXTRA, "compression": getattr(OpenEXR, f"{compression}_COMPRESSION")}
    if tiled:
        header |= {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
        header["tiles"].xSize, header["tiles"].ySize = 16, 32
    t.write_exr(work / "in.exr", channels, **header)
    before = t.read_exr(work / "in.exr")  # what a lossy compression left
    done = denoise("in.exr", "-w", identity[9], "-o", "out.exr", "-o", "out.pfm")
    assert done.code == 0, done.err
    after = t.read_exr(work / "out.exr")
    assert list(after) == list(before)
    for name in before:
        assert after[name].dtype == before[name].dtype
        if name not in ("R", "G", "B"):
            assert np.array_equal(after[name], before[name]), name
    assert (t.stack(after, "R", "G", "B") == t.read_pfm(work / "out.pfm")).all()
    lossy = compression in ("PXR24", "B44", "B44A")
    expected, found = header_of(work / "in.exr"), header_of(work / "out.exr")
    assert found.pop("compression") == (
        repr(OpenEXR.ZIP_COMPRESSION) if lossy else expected["compression"]
    )
    expected.pop("compression")
    assert found == expected


def test_window_and_line_order(denoise, identity, work):
    box = ((-3, 7), (-3 + W - 1, 7 + H - 1))
    t.write_exr(
        work / "in.exr",
        layers("", "albedo."),
        dataWindow=box,
        displayWindow=((0, 0), (99, 99)),
        lineOrder=OpenEXR.DECREASING_Y,
    )
    assert denoise("in.exr", "-w", identity[6], "-o", "out.exr").code == 0
    expected, found = header_of(work / "in.exr"), header_of(work / "out.exr")
    for name in ("dataWindow", "displayWindow"):
        assert found[name] == expected[name]
    albedo = "albedo.R", "albedo.G", "albedo.B"
    assert (
        t.stack(t.read_exr(work / "out.exr"), *albedo)
        == t.stack(t.read_exr(work / "in.exr"), *albedo)
    ).all()


def test_parts_are_kept(denoise, identity, work):
    images = t.scene(H, W)
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 16
    parts = [
        OpenEXR.Part(
            {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **EXTRA},
            t.planes("", images["color"]),
            "beauty",
        ),
        OpenEXR.Part(
            {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage},
            t.planes("", images["albedo"]),
            "albedo",
        ),
        OpenEXR.Part(
            {"compression": OpenEXR.B44_COMPRESSION, "type": OpenEXR.tiledimage, "tiles": tiles},
            t.planes("", images["normal"], "XYZ"),
            "N",
        ),
        OpenEXR.Part(
            {
                "compression": OpenEXR.RLE_COMPRESSION,
                "type": OpenEXR.scanlineimage,
                "displayWindow": ((0, 0), (W - 1, H - 1)),
            },
            {"Z": t.noise(7, 9, 1)[..., 0]},
            "small depth",
        ),
    ]
    OpenEXR.File(parts).write(str(work / "in.exr"))
    done = denoise("in.exr", "-w", identity[9], "-o", "out.exr", "--json")
    assert done.code == 0, done.err
    assert done.json["albedo"]["layer"] == ["R", "G", "B"]
    assert done.json["normal"]["layer"] == ["X", "Y", "Z"]
    for part in range(4):
        expected, found = header_of(work / "in.exr", part), header_of(work / "out.exr", part)
        assert found == expected
        before, after = t.read_exr(work / "in.exr", part), t.read_exr(work / "out.exr", part)
        assert list(before) == list(after)
        if part:
            assert all(np.array_equal(before[n], after[n]) for n in before)


def test_output_may_replace_the_input(denoise, identity, work):
    t.write_exr(work / "in.exr", layers("", "albedo.", "N."), comments="kept")
    before = t.read_exr(work / "in.exr")
    assert denoise("in.exr", "-w", identity[9], "-o", "in.exr").code == 0
    after = t.read_exr(work / "in.exr")
    assert np.array_equal(after["albedo.R"], before["albedo.R"])
    assert header_of(work / "in.exr")["comments"] == "'kept'"
    assert [p.name for p in work.iterdir()] == ["in.exr"]


def test_type_option_changes_only_the_colour(denoise, identity, work):
    t.write_exr(work / "in.exr", layers("", "albedo.", "N."))
    assert denoise("in.exr", "-w", identity[9], "-t", "float", "-o", "out.exr").code == 0
    after = t.read_exr(work / "out.exr")
    assert {n: after[n].dtype for n in ("R", "albedo.R", "N.X")} == {
        "R": np.float32,
        "albedo.R": np.float16,
        "N.X": np.float16,
    }


@pytest.mark.parametrize("program", ["oidnDenoise", "ynlmdenoise"])
def test_data_windows_that_differ(build, identity, work, program):
    """Pictures that do not lie upon each other are refused, even where their sizes are the same."""
    corners = {"color": (0, 0), "albedo": (3, 2), "same": (0, 0)}
    for name, (x, y) in corners.items():
        window = (np.array((x, y), np.int32), np.array((x + W - 1, y + H - 1), np.int32))
        whole = (np.array((0, 0), np.int32), np.array((99, 99), np.int32))
        t.write_exr(work / f"{name}.exr", t.planes("", t.noise(H, W)), dataWindow=window,
                    displayWindow=whole)
    for albedo, code in (("albedo.exr", 2), ("same.exr", 0)):
        arguments = {"oidnDenoise": ("--hdr", "color.exr", "--alb", albedo, "-w", identity[6]),
                     "ynlmdenoise": ("-i", "color.exr", "-a", albedo)}[program]
        done = runner(build / "bin" / program)(*arguments, "-o", "out.exr")
        assert done.code == code, done.err
        if code:
            assert "the albedo of 'albedo.exr'" in done.error
            assert "3,2" in done.error and "0,0" in done.error
            assert not (work / "out.exr").exists()
