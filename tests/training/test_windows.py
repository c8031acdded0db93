"""Data windows of EXR files, as crops have them: pictures that lie elsewhere are not mixed."""

import numpy as np
import OpenEXR
import pytest

from export.calibrate import Kind, read_picture
from tests.training.tools import QUICK, make_raw, noisy, picture
from training import convert_image, doctor, evaluate, imageio, infer, split_exr, train
from training.errors import ToolError
from training.features import load
from training.scan import scan

F = ["hdr", "alb", "nrm"]
NAMES = {"hdr": "RGB", "alb": "RGB", "nrm": "XYZ"}


def part_at(feature, image, left, top, title):
    """A part whose data window begins at a pixel of the frame."""
    height, width = image.shape[:2]
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage,
              "name": title, "dataWindow": (np.array([left, top], np.int32), np.array(
                  [left + width - 1, top + height - 1], np.int32)),
              "displayWindow": (np.zeros(2, np.int32), np.array([199, 99], np.int32))}
    return OpenEXR.Part(header, {c: np.ascontiguousarray(image[..., i], np.float32)
                                 for i, c in enumerate(NAMES[feature])}, title)


def write_group(root, name, places):
    """Renders of a picture with the features at (left, top), by version."""
    for version, place in places.items():
        images = picture(1) if version == "ref" else noisy(picture(1), 4, int(version[0]))
        root.mkdir(parents=True, exist_ok=True)
        for f, image in images.items():
            part = part_at(f, image, *place.get(f, place["hdr"]), f)
            OpenEXR.File([part]).write(str(root / f"{name}_{version}.{f}.exr"))


HERE, THERE = (7, -3), (8, -3)


def test_crops_of_one_place_are_read(tmp_path, capsys):
    write_group(tmp_path / "d", "a", {v: {"hdr": HERE} for v in ("4", "ref")})
    version = scan(tmp_path / "d", F).groups[0].inputs[0]
    images = load(version, F)
    assert images.origin == HERE
    assert np.array_equal(images["hdr"], noisy(picture(1), 4, 4)["hdr"].astype(np.float32))
    doctor.main([*F, "-D", str(tmp_path), "-i", "d"])
    assert read_picture(tmp_path / "d" / "a_4.hdr.exr", Kind.of(9, "hdr", "color"))


def test_features_of_different_places_are_refused(tmp_path, capsys, fails):
    write_group(tmp_path / "d", "a", {"4": {"hdr": HERE, "alb": THERE}, "ref": {"hdr": HERE}})
    version = scan(tmp_path / "d", F).groups[0].inputs[0]
    with pytest.raises(ToolError, match=r"a_4: data windows begin .* \(hdr at 7,-3, alb at 8,-3"):
        load(version, F)
    assert load(version, ["hdr", "nrm"]).origin == HERE
    fails(doctor.main, [*F, "-D", str(tmp_path), "-i", "d"])
    text = "a_4: data windows begin at different pixels (hdr at 7,-3, alb at 8,-3"
    assert text in capsys.readouterr().out
    with pytest.raises(ToolError, match="begin at different pixels"):
        read_picture(tmp_path / "d" / "a_4.hdr.exr", Kind.of(9, "hdr", "color"))
    parts = [part_at("hdr", picture(1)["hdr"], *HERE, "beauty"),
             part_at("alb", picture(1)["alb"], *THERE, "albedo")]
    OpenEXR.File(parts).write(str(tmp_path / "d" / "b_4.exr"))
    version = scan(tmp_path / "d", ["hdr"], need_target=False).groups[1].inputs[0]
    with pytest.raises(ToolError, match="b_4: data windows begin at different pixels"):
        load(version, ["hdr", "alb"])


def test_references_of_another_place_are_no_references(work, root, capsys, fails):
    """Training and evaluate leave such inputs out by name, infer does not measure them."""
    make_raw(work / "data" / "train", 2)
    places = {"4": {"hdr": HERE}, "8": {"hdr": THERE}, "ref": {"hdr": HERE}}
    write_group(work / "data" / "train", "a", places)
    text = "a_8: the data window begins at 8,-3, that of its reference at 7,-3"
    train.main([*F, "--raw", "-r", "r", "-t", "train", "-e", "1", *QUICK])
    assert f"left out a_8: {text}" in capsys.readouterr().out
    write_group(work / "data" / "test", "a", places)
    infer.main(["-r", "r", "-M", "psnr"])
    out = capsys.readouterr().out
    assert f"not measured: {text}" in out and "(1 images)" in out
    assert len([*(work / "infer").rglob("*.exr")]) == 2
    code, message = fails(evaluate.main, [f"{root}/weights/rt_hdr_w16.tza=hdr", "--no_oidn",
                                          "--images", "data/test"])
    assert code == 3 and f"left out a_8: {text}" in capsys.readouterr().out


def windows(path):
    """The data window and the display window, left, top, right, bottom."""
    with OpenEXR.File(str(path), header_only=True) as f:
        return [imageio.window_of(f.parts[0].header, f"{name}Window")
                for name in ("data", "display")]


def test_results_and_split_layers_lie_where_their_inputs_do(work):
    """They began at 0,0, with a frame of their own size, so that no compositor, and no reference of
    the same crop, could take them."""
    make_raw(work / "data" / "train", 2)
    train.main(["hdr", "--raw", "-r", "r", "-t", "train", "-e", "1", *QUICK])
    write_group(work / "data" / "test", "a", {v: {"hdr": HERE} for v in ("4", "ref")})
    infer.main(["-r", "r", "-F", "exr", "png", "pfm", "--save_all"])
    want = windows("data/test/a_4.hdr.exr")
    assert want == [(7, -3, 70, 44), (0, 0, 199, 99)]
    for name in "a_4.r.hdr.exr", "a_4.hdr.exr", "a_ref.hdr.exr":
        assert windows(f"infer/test/{name}") == want, name
    convert_image.main(["data/test/a_4.hdr.exr", "c.ldr.exr"])
    assert windows("c.ldr.exr") == want
    parts = [part_at("hdr", picture(1)["hdr"], *HERE, "beauty"),
             part_at("alb", picture(1)["alb"], *THERE, "albedo")]
    OpenEXR.File(parts).write("b_4.exr")
    split_exr.main(["b_4.exr"])
    assert windows("b_4.hdr.exr") == want
    assert windows("b_4.alb.exr") == [(8, -3, 71, 44), want[1]]
    split_exr.main(["b_4.exr", "--layer", "albedo"])
    assert windows("b_4.hdr.exr") == [(8, -3, 71, 44), want[1]]
