"""Every format read and written. With weights that change nothing, and --srgb, which keeps values
as they are, the result of a picture in [0, 1] is that picture, but for rounding."""

from __future__ import annotations
import os


import numpy as np
import OpenEXR
import pytest

from tests.apps import tools as t

H, W = 21, 35
COMPRESSIONS = "NO RLE ZIPS ZIP PIZ PXR24".split()


@pytest.fixture
def copy(denoise, identity, work):
    """Denoises a file into another with weights that change nothing."""

    def run(source, target, *more):
        done = denoise(
            "--ldr", source, "--srgb", "--no_aux", "-w", identity[3], "-o", target, *more
        )
        assert done.code == 0, done.err
        return done

    return run


@pytest.mark.parametrize("channels", [1, 2, 3])
@pytest.mark.parametrize("half", [False, True])
def test_pfm_and_phm(copy, work, channels, half):
    image = t.noise(H, W, channels)
    source = t.write_pfm(work / "in.pfm", image, half)
    expected = image.astype(np.float16) if half else image
    copy(source, work / "out.pfm")
    copy(source, work / "out.phm")
    assert t.equal(t.read_pfm(work / "out.pfm"), expected.astype(np.float32))
    assert t.equal(t.read_pfm(work / "out.phm"), expected.astype(np.float16))


@pytest.mark.parametrize("scale", [1.0, -2.0, 0.5])
def test_pfm_scale_and_byte_order(copy, work, scale):
    image = np.round(t.noise(H, W) * 256) / 256
    copy(t.write_pfm(work / "in.pfm", image, scale=scale), work / "out.pfm")
    assert t.equal(t.read_pfm(work / "out.pfm"), image)


@pytest.mark.parametrize(
    "end, after", [(b"\n", b""), (b"\n", b"\n"), (b"\r", b""), (b"\r\n", b""), (b" \n", b"")]
)
def test_pfm_line_ends(copy, work, end, after):
    """No byte of the pixels is taken for the end of the header, nor the other way round."""
    image = t.noise(H, W)
    image[-1, 0, 0] = np.frombuffer(b"\n\n\n?", "<f4")[0]  # the first pixel of the file
    head = end.join([b"PF", b"%d %d" % (W, H), b"-1.0", b""])
    (work / "in.pfm").write_bytes(head + image[::-1].astype("<f4").tobytes() + after)
    copy(work / "in.pfm", work / "out.pfm")
    assert t.equal(t.read_pfm(work / "out.pfm"), image)


def test_half_rounds_to_even_and_overflows_to_infinity(denoise, identity, work):
    values = np.array(
        [1 + 2**-11, 1 + 3 * 2**-11, 65519, 65520, 1e30, 2**-25, 3 * 2**-25, 2**-24], np.float32
    )
    image = np.repeat(values.reshape(1, -1, 1), 3, 2)
    t.write_pfm(work / "in.pfm", image)
    assert denoise("--ldr", "in.pfm", "-w", identity[3], "-t", "half", "--json").code == 0
    # The file is converted when it is read: --check tells what was read, denoising would clamp.
    report = denoise("--ldr", "in.pfm", "--check", "-t", "half", "--json").json
    assert report["color"]["type"] == "half"
    text = {c["kind"]: c["text"] for c in report["check"]}["non-finite"]
    assert text.startswith("6 values"), text  # 65520 and 1e30, three channels each


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("tiled", [False, True])
def test_exr_read(copy, work, exr, dtype, compression, tiled):
    image = t.noise(67, 70)
    if dtype == np.float32:
        image = image.astype(np.float16).astype(np.float32)  # PXR24 keeps 24 bits
    header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION")}
    if tiled:
        header |= {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
        header["tiles"].xSize, header["tiles"].ySize = 32, 16
    source = t.write_exr(work / "in.exr", t.planes("", image, dtype=dtype), **header)
    copy(source, work / "out.pfm")
    assert t.equal(t.read_pfm(work / "out.pfm"), image.astype(dtype).astype(np.float32))


@pytest.mark.parametrize("channels, names", [(1, "Y"), (2, "RG"), (3, "RGB")])
@pytest.mark.parametrize("half", [False, True])
def test_exr_written_alone(copy, work, exr, channels, names, half):
    image = t.noise(37, W, channels)
    copy(t.write_pfm(work / "in.pfm", image, half), work / "out.exr")
    result = t.read_exr(work / "out.exr")
    dtype = np.float16 if half else np.float32
    assert sorted(result) == sorted(names)
    assert all(v.dtype == dtype for v in result.values())
    assert t.equal(t.stack(result, *names), image.astype(dtype))


def test_two_channels_are_read_back(copy, work, exr):
    image = t.noise(H, W, 2)
    copy(t.write_pfm(work / "in.pfm", image), work / "two.exr")
    copy(work / "two.exr", work / "out.pfm")
    assert t.equal(t.read_pfm(work / "out.pfm"), image)


@pytest.mark.parametrize("name", ["a" * 251 + ".pfm", "\u96ea" * 80 + ".pfm"])
def test_names_as_long_as_names_can_be(copy, work, name):
    copy(t.write_pfm(work / "in.pfm", t.noise(H, W)), work / name)
    assert sorted(p.name for p in work.iterdir()) == sorted(["in.pfm", name])


def test_links_are_followed(copy, work):
    """To files that are to be made, too."""
    t.write_pfm(work / "in.pfm", t.noise(H, W))
    (work / "folder").mkdir()
    (work / "link.pfm").symlink_to("folder/next.pfm")
    (work / "folder" / "next.pfm").symlink_to("real.pfm")
    for _ in range(2):
        copy(work / "in.pfm", work / "link.pfm")
        assert (work / "link.pfm").is_symlink() and (work / "folder" / "next.pfm").is_symlink()
        assert not (work / "folder" / "real.pfm").is_symlink()
        assert t.equal(t.read_pfm(work / "folder" / "real.pfm"), t.noise(H, W))


@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0,
                    reason="optional: only root may give files away")
def test_files_stay_their_owners(copy, work):
    """And their modes, where another user's file is replaced."""
    t.write_pfm(work / "in.pfm", t.noise(H, W))
    (work / "out.pfm").write_text("old")
    os.chown(work / "out.pfm", 65534, 65533)
    (work / "out.pfm").chmod(0o640)
    copy(work / "in.pfm", work / "out.pfm")
    info = (work / "out.pfm").stat()
    assert (info.st_uid, info.st_gid, info.st_mode & 0o7777) == (65534, 65533, 0o640)


def test_exr_of_uint_channels(copy, work, exr):
    codes = np.random.default_rng(1).integers(0, 2, (H, W, 3)).astype(np.uint32)
    copy(t.write_exr(work / "in.exr", t.planes("", codes, dtype=np.uint32)), work / "out.pfm")
    assert t.equal(t.read_pfm(work / "out.pfm"), codes)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("interlaced", [False, True])
def test_png(copy, work, png, bits, channels, interlaced):
    codes = np.random.default_rng(1).integers(0, 1 << bits, (H, W, channels))
    copy(t.write_png(work / "in.png", codes, bits, interlaced), work / "out.png")
    result, result_bits = t.read_png(work / "out.png")
    assert result_bits == bits and (result == codes).all()  # alpha included
    copy(work / "in.png", work / "out.pfm")
    color = codes[..., : 1 if channels < 3 else 3] / ((1 << bits) - 1)
    assert np.abs(t.read_pfm(work / "out.pfm") - color).max() < 1e-6


def test_alpha_of_exr_and_png(copy, denoise, identity, work, exr, png):
    """EXR files hold colours multiplied by the alpha, PNG files as they are."""
    alpha = np.random.default_rng(2).integers(1, 5, (H, W)).astype(np.float32) / 4
    alpha[0] = 0
    straight = t.noise(H, W).clip(0, 1)
    channels = t.planes("", straight * alpha[..., None], dtype=np.float32)
    channels |= {"A": alpha, "Z": alpha + 7}
    copy(t.write_exr(work / "in.exr", channels), work / "out.png")
    codes, _ = t.read_png(work / "out.png")
    assert codes.shape == (H, W, 4)
    assert np.abs(codes[..., 3] / 255 - alpha).max() < 0.003
    assert np.abs(codes[1:, :, :3] / 255 - straight[1:]).max() < 0.003
    copy(work / "out.png", work / "back.exr")
    back = t.read_exr(work / "back.exr")
    assert np.abs(back["A"] - alpha).max() < 0.003
    assert np.abs(t.stack(back, *"RGB") - (codes[..., :3] * codes[..., 3:]) / 255**2).max() < 1e-3
    copy(work / "in.exr", work / "out.exr")
    kept = t.read_exr(work / "out.exr")
    assert t.equal(kept["A"], alpha) and t.equal(kept["Z"], alpha + 7)
    copy(work / "in.exr", work / "out.pfm")
    assert np.abs(t.read_pfm(work / "out.pfm") - straight * alpha[..., None]).max() < 1e-6


def test_alpha_with_a_long_name(copy, work, exr, png):
    channels = {f"beauty.{c}": np.full((H, W), 0.25, np.float32) for c in ("red", "green", "blue")}
    t.write_exr(work / "in.exr", channels | {"beauty.alpha": np.full((H, W), 0.5, np.float32)})
    copy(work / "in.exr", work / "out.png")
    codes, _ = t.read_png(work / "out.png")
    assert codes.shape == (H, W, 4) and (codes == 128).all()


def test_png_palette(copy, work, png):
    rng = np.random.default_rng(1)
    palette, index = rng.integers(0, 256, (16, 3)), rng.integers(0, 16, (H, W, 1))
    copy(t.write_png(work / "in.png", index, palette=palette), work / "out.png")
    assert (t.read_png(work / "out.png")[0] == palette[index[..., 0]]).all()


@pytest.mark.parametrize(
    "coding, width, up",
    [
        ("flat", 5, False),
        ("flat", 40, False),
        ("runs", 40, False),
        ("runs", 300, True),
        ("repeats", 40, False),
        ("repeats", 300, False),
    ],
)
def test_radiance(copy, work, coding, width, up):
    rgbe = t.to_rgbe(t.noise(H, width) * 0.9)
    rgbe[:, width // 3 : width // 2] = rgbe[0, 0]  # something to repeat
    copy(t.write_hdr(work / "in.hdr", rgbe, coding, up), work / "out.pfm")
    assert t.equal(t.read_pfm(work / "out.pfm"), t.from_rgbe(rgbe))
    copy(work / "in.hdr", work / "out.hdr")
    assert (t.from_rgbe(t.read_hdr(work / "out.hdr")) == t.from_rgbe(rgbe)).all()


def test_radiance_header_lines_have_any_length(copy, work):
    codes = t.to_rgbe(t.noise(4, 9))
    data = t.write_hdr(work / "in.hdr", codes).read_bytes()
    (work / "in.hdr").write_bytes(data.replace(b"# made", b"oconv" + b" a.rad" * 700 + b"\n# made"))
    copy(work / "in.hdr", work / "out.pfm")
    assert t.equal(t.read_pfm(work / "out.pfm"), t.from_rgbe(codes))


@pytest.mark.parametrize("lines, factor", [
    (b"EXPOSURE=4", (4, 4, 4)),
    (b"EXPOSURE= 2.0\t\nEXPOSURE=0.5\nEXPOSURE=8", (8, 8, 8)),
    (b"COLORCORR= 1 2 4\nEXPOSURE=2", (2, 4, 8)),
    (b"EXPOSURE=0\nEXPOSURE=-1\nEXPOSURE=nan\nEXPOSURE=\nCOLORCORR=2 2\nEXPOSURES=2", (1, 1, 1)),
    (b"FORMAT= 32-bit_rle_rgbe \t", (1, 1, 1)),
])
def test_radiance_factors(copy, work, lines, factor):
    """Pixels were multiplied by what such lines say."""
    codes = t.to_rgbe(t.noise(H, 16))
    data = t.write_hdr(work / "in.hdr", codes).read_bytes()
    (work / "in.hdr").write_bytes(data.replace(b"# made", lines + b"\n# made", 1))
    copy(work / "in.hdr", work / "out.pfm")
    assert t.equal(t.read_pfm(work / "out.pfm"), t.from_rgbe(codes) / np.float32(factor))


def test_radiance_rounds_to_nearest(denoise, identity, work):
    image = t.noise(H, 64) * 50
    t.write_pfm(work / "in.pfm", image)
    assert denoise("--hdr", "in.pfm", "-w", identity[3], "-o", "out.hdr").code == 0
    error = np.abs(t.from_rgbe(t.read_hdr(work / "out.hdr")) - image)
    assert (error <= image.max(-1, keepdims=True) / 255).all()


@pytest.mark.parametrize("maximum", [255, 100, 65535])
@pytest.mark.parametrize("channels", [1, 3])
def test_ppm_and_pgm(copy, work, maximum, channels):
    codes = np.random.default_rng(1).integers(0, maximum + 1, (H, W, channels))
    name = "in.ppm" if channels == 3 else "in.pgm"
    copy(t.write_ppm(work / name, codes, maximum, comment=True), work / "out.pfm")
    assert np.abs(t.read_pfm(work / "out.pfm") - codes / maximum).max() < 1e-6


def test_ppm_truncates_and_clamps(denoise, identity, work):
    expected = np.random.default_rng(1).integers(0, 256, (H, W, 3))
    image = (expected + np.random.default_rng(2).uniform(0.01, 0.99, expected.shape)) / 255
    image[0], expected[0], image[1], expected[1] = 1.7, 255, -0.3, 0
    t.write_pfm(work / "in.pfm", image)
    done = denoise("--ldr", "in.pfm", "--srgb", "-w", identity[3], "-o", "out.ppm")
    assert done.code == 0, done.err
    assert (t.read_ppm(work / "out.ppm") == expected).all()


def test_pgm_takes_grey_only(denoise, identity, work):
    t.write_pfm(work / "in.pfm", t.noise(H, W))
    done = denoise("--ldr", "in.pfm", "-w", identity[3], "-o", "out.pgm")
    assert done.code == 4 and "PGM" in done.error and not (work / "out.pgm").exists()


def test_formats_are_told_by_content(copy, work, exr):
    image = t.noise(H, W)
    t.write_exr(work / "in.exr", t.planes("", image, dtype=np.float32))
    (work / "in.exr").rename(work / "in.pfm")
    copy(work / "in.pfm", work / "out.pfm")
    assert t.equal(t.read_pfm(work / "out.pfm"), image)


# ---- sRGB ----------------------------------------------------------------------------------------


def test_colour_of_integer_files_is_linearised(denoise, identity, work, png):
    codes = np.random.default_rng(1).integers(0, 256, (H, W, 3))
    t.write_png(work / "in.png", codes)
    assert denoise("--ldr", "in.png", "-w", identity[3], "-o", "out.pfm", "-o", "out.png").code == 0
    assert np.abs(t.read_pfm(work / "out.pfm") - t.srgb_decode(codes / 255)).max() < 1e-5
    assert (t.read_png(work / "out.png")[0] == codes).all()


def test_albedo_is_linearised_even_with_srgb(denoise, identity, work, png):
    codes = np.random.default_rng(1).integers(0, 256, (H, W, 3))
    t.write_png(work / "in.png", codes)
    for more in [], ["--srgb"]:
        done = denoise("--alb", "in.png", *more, "-w", identity[3], "-o", "out.pfm")
        assert done.code == 0, done.err
        assert np.abs(t.read_pfm(work / "out.pfm") - t.srgb_decode(codes / 255)).max() < 1e-4


def test_hdr_to_integer_files_is_clipped_and_encoded(denoise, identity, work, png):
    image = t.noise(H, W) * 3
    t.write_pfm(work / "in.pfm", image)
    done = denoise("--hdr", "in.pfm", "-w", identity[3], "-o", "out.png", "-o", "out.ppm")
    assert done.code == 0, done.err
    expected = t.srgb_encode(np.clip(image, 0, 1)) * 255
    assert np.abs(t.read_png(work / "out.png")[0] - expected).max() < 0.51
    assert np.abs(t.read_ppm(work / "out.ppm") + 0.5 - expected).max() < 0.51


def test_normals_of_integer_files_are_decoded(denoise, identity, work, png):
    codes = np.random.default_rng(1).integers(0, 256, (H, W, 3))
    t.write_png(work / "in.png", codes)
    done = denoise("--nrm", "in.png", "-w", identity[3], "-o", "out.pfm", "-o", "out.png")
    assert done.code == 0, done.err
    assert np.abs(t.read_pfm(work / "out.pfm") - (codes / 255 * 2 - 1)).max() < 1e-5
    assert (t.read_png(work / "out.png")[0] == codes).all()
