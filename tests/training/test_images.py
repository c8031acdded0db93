"""Image files: reading, writing, and what goes wrong."""

import struct
from pathlib import Path

import numpy as np
import pytest

from tests.training.tools import picture, write_features
from training import convert_image, preprocess, split_exr
from training.errors import ToolError
from training.imageio import read_image, write_image


@pytest.mark.parametrize("ext,tolerance", [("exr", 0), ("pfm", 0), ("phm", 1e-3), ("hdr", 1e-2),
                                           ("png", 2e-3)])
@pytest.mark.parametrize("channels", [1, 3])
def test_image_round_trip(tmp_path, ext, tolerance, channels):
    image = np.random.default_rng(0).random((11, 17, channels)).astype(np.float32)
    write_image(tmp_path / f"x.{ext}", image)
    again = read_image(tmp_path / f"x.{ext}")[..., :channels]
    assert again.shape == image.shape and np.abs(again - image).max() <= tolerance
    assert [p.name for p in tmp_path.iterdir()] == [f"x.{ext}"]  # no temporary file stays


def test_flat_hdr_whose_first_pixel_is_blue(tmp_path):
    """Red and green of 2 are the mark of run lengths only before a blue that is below 128."""
    image = np.full((4, 9, 3), 0.5, np.float32)
    image[0, 0] = 2 / 256, 2 / 256, 0.75
    write_image(tmp_path / "x.hdr", image)
    assert np.array_equal(read_image(tmp_path / "x.hdr"), image)


def test_normals_named_xyz(tmp_path):
    """Y of X,Y,Z is no luminance: three channels, as R,G,B would be."""
    import OpenEXR
    normal = np.random.default_rng(0).random((5, 7, 3)).astype(np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    planes = {n: np.ascontiguousarray(normal[..., i]) for i, n in enumerate("XYZ")}
    OpenEXR.File(header, planes).write(str(tmp_path / "n.exr"))
    assert np.array_equal(read_image(tmp_path / "n.exr"), normal)


def test_png_filters_and_depths(tmp_path):
    """Every scan line filter, 16 bit, palette: built by hand."""
    import struct
    import zlib
    rng = np.random.default_rng(1)
    image = rng.integers(0, 256, (5, 4, 3), np.uint8)
    flat = image.reshape(5, 12).astype(int)
    rows = b""
    for y in range(5):
        up = flat[y - 1] if y else np.zeros(12, int)
        left = np.concatenate([np.zeros(3, int), flat[y][:-3]])
        corner = np.concatenate([np.zeros(3, int), up[:-3]])
        p = left + up - corner
        pa, pb, pc = abs(p - left), abs(p - up), abs(p - corner)
        paeth = np.where((pa <= pb) & (pa <= pc), left, np.where(pb <= pc, up, corner))
        guess = [np.zeros(12, int), left, up, (left + up) // 2, paeth][y]
        rows += bytes([y]) + ((flat[y] - guess) % 256).astype(np.uint8).tobytes()

    def png(depth, kind, data, extra=b""):
        def chunk(name, body):
            return struct.pack(">I", len(body)) + name + body + b"\0\0\0\0"
        head = struct.pack(">IIBBBBB", 4, 5, depth, kind, 0, 0, 0)
        return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + extra
                + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b""))

    (tmp_path / "a.png").write_bytes(png(8, 2, rows))
    assert np.array_equal(read_image(tmp_path / "a.png"), image.astype(np.float32) / 255)
    wide = rng.integers(0, 65536, (5, 4, 1)).astype(">u2")
    data = b"".join(b"\0" + row.tobytes() for row in wide)
    (tmp_path / "b.png").write_bytes(png(16, 0, data))
    assert np.array_equal(read_image(tmp_path / "b.png"), wide.astype(np.float32) / 65535)


@pytest.mark.parametrize("name,data", [
    ("a.exr", b"no exr"), ("b.exr", b""), ("c.pfm", b"PF\n4 4\n-1.0\n123"),
    ("d.pfm", b"XX\n1 1\n1"),
    ("e.hdr", b"#?RADIANCE\n\n-Y 2 +X 9\n\2\2\0\11\x85"), ("f.png", b"\x89PNG\r\n\x1a\n\0\0"),
    ("g.png", b"GIF"), ("h.xyz", b""), ("missing.exr", None)])
def test_broken_images_are_one_line(tmp_path, name, data):
    if data is not None:
        (tmp_path / name).write_bytes(data)
    with pytest.raises(ToolError) as caught:
        read_image(tmp_path / name)
    assert name in str(caught.value) and "\n" not in str(caught.value) and caught.value.code == 3


def test_truncated_exr(tmp_path):
    write_image(tmp_path / "a.exr", np.random.default_rng(0).random((40, 40, 3)))
    whole = (tmp_path / "a.exr").read_bytes()
    (tmp_path / "a.exr").write_bytes(whole[:len(whole) // 2])
    with pytest.raises(ToolError, match="cannot read"):
        read_image(tmp_path / "a.exr")


def test_unwritable_output(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(ToolError) as caught:
        write_image(tmp_path / "file" / "x.exr", np.zeros((2, 2, 3)))
    assert caught.value.code == 5


def exr_of_samples(width: int, height: int, channels: dict[str, int]) -> bytes:
    """An uncompressed EXR of floats: by channel, of how many columns and rows it has one sample."""
    def attribute(name: str, kind: str, value: bytes) -> bytes:
        return f"{name}\0{kind}\0".encode() + struct.pack("<I", len(value)) + value

    names = sorted(channels)
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    head = struct.pack("<2I", 20000630, 2) + attribute("channels", "chlist", b"".join(
        n.encode() + b"\0" + struct.pack("<4I", 2, 0, channels[n], channels[n]) for n in names)
        + b"\0") + attribute("compression", "compression", b"\0") + attribute(
        "lineOrder", "lineOrder", b"\0") + b"".join(
        attribute(n, "box2i", window) for n in ("dataWindow", "displayWindow")) + b"".join(
        attribute(n, "float", struct.pack("<f", 1)) for n in (
            "pixelAspectRatio", "screenWindowWidth")) + attribute(
        "screenWindowCenter", "v2f", bytes(8)) + b"\0"
    offsets, body = [], b""
    for y in range(height):
        line = b"".join(bytes(4 * (width // channels[n])) for n in names if y % channels[n] == 0)
        offsets.append(len(head) + 8 * height + len(body))
        body += struct.pack("<2i", y, len(line)) + line
    return head + struct.pack(f"<{height}Q", *offsets) + body


@pytest.mark.parametrize("channels", [{"R": 1, "G": 1, "B": 2}, {"Y": 1, "RY": 2, "BY": 2}])
def test_subsampled_channels_are_refused(work, fails, capsys, channels):
    """With their name, whatever they are read for; grey is not all of a picture with chroma."""
    for version in ("1", "ref"):
        write_features(Path("data/train"), f"b_{version}", {"hdr": picture(0)["hdr"]})
        for name in (f"a_{version}.hdr.exr", f"c_{version}.exr"):
            Path("data/train", name).write_bytes(exr_of_samples(16, 16, channels))
    for main, args in ((convert_image.main, ["data/train/a_1.hdr.exr", "a.png"]),
                       (split_exr.main, ["data/train/c_1.exr"])):
        code, message = fails(main, args)
        assert code == 3 and message == f"{args[0]}: subsampled channels are not supported"
    preprocess.main(["hdr", "-t", "train"])
    out = capsys.readouterr().out
    assert out.count("subsampled channels are not supported") == 2 and ": 1 pairs" in out
