"""The input doctor: oidnDenoise --check and --repair."""

from __future__ import annotations

import numpy as np
import pytest

from tests.apps import tools as t

H, W = 96, 128


@pytest.fixture
def check(denoise, work):
    """Writes images and returns {(role, kind): text} of the findings."""

    def run(options: dict[str, np.ndarray], *more: str) -> dict[tuple[str, str], str]:
        arguments = []
        for option, image in options.items():
            path = t.write_pfm(work / f"{option}.pfm", image)
            arguments += [f"--{option}", path]
        done = denoise(*arguments, "--check", "--json", *more)
        assert done.code == 0, done.err
        return {(c["image"], c["kind"]): c["text"] for c in done.json["check"]}

    return run


@pytest.fixture(scope="module")
def images() -> dict[str, np.ndarray]:
    return t.scene(H, W, seed=3)


def frame(images: dict[str, np.ndarray], **changes: np.ndarray) -> dict[str, np.ndarray]:
    return {"hdr": images["color"], "alb": images["albedo"], "nrm": images["normal"], **changes}


def tent(image: np.ndarray) -> np.ndarray:
    """Splats each pixel over its neighbours."""
    for axis in (0, 1):
        image = 0.5 * image + 0.25 * (np.roll(image, 1, axis) + np.roll(image, -1, axis))
    return image.astype(np.float32)


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_good_input(check, denoise, work, seed):
    assert check(frame(t.scene(H, W, seed))) == {}
    text = denoise("--hdr", "hdr.pfm", "--check").out
    assert text.endswith("Checking input\n  nothing found\n") and "Denoising" not in text


@pytest.mark.parametrize("name", ["house_0004spp.exr"])
def test_good_render(denoise, root, exr, name):
    done = denoise(root / "demo" / name, "--check", "--json")
    assert done.code == 0 and done.json["check"] == [] and "normal" in done.json


def test_encoded_normals(check, denoise, identity, work, images):
    encoded = images["normal"] * 0.5 + 0.5
    found = check(frame(images, nrm=encoded))
    assert list(found) == [("normal", "normals-encoded")]
    assert "[-1, 1]" in found["normal", "normals-encoded"]
    encoded[:20] = 0.5  # background
    assert ("normal", "normals-encoded") in check(frame(images, nrm=encoded))
    done = denoise("--nrm", "nrm.pfm", "--repair", "-w", identity[3], "-o", "out.pfm")
    assert done.code == 0 and "repaired" in done.out
    assert np.abs(t.read_pfm(work / "out.pfm") - (encoded * 2 - 1)).max() < 1e-5


def test_normals_that_are_too_long(check, images):
    assert ("normal", "normals-length") in check(frame(images, nrm=images["normal"] * 2))


def test_albedo_above_one(check, images):
    found = check(frame(images, alb=images["albedo"] * 3))
    assert list(found) == [("albedo", "albedo-above-one")]
    assert "exceeds 1" in found["albedo", "albedo-above-one"]


def test_black_albedo(check, images):
    assert ("albedo", "albedo-black") in check(frame(images, alb=images["albedo"] * 0))


def test_non_finite_and_negative_values(check, images):
    color = images["color"].copy()
    color[4, 5] = np.nan
    color[6, 7, 0] = -1
    found = check(frame(images, hdr=color))
    assert found["color", "non-finite"].startswith("3 values")
    assert found["color", "negative"].startswith("1 values")


def test_infinities_leave_an_exposure(denoise, work, images):
    """Many in a place leave none to measure, and the frame is lost, unless they are mended."""
    def psnr(image):
        return -10 * np.log10(((image.clip(0, 4) - images["clean"].clip(0, 4)) ** 2).mean())

    color = images["color"].copy()
    color[3:9, 3:9] = np.inf
    t.write_pfm(work / "hdr.pfm", color)
    done = denoise("--hdr", "hdr.pfm", "--check", "-o", "lost.pfm")
    assert done.code == 0 and "repaired" not in done.out
    done = denoise("--hdr", "hdr.pfm", "--repair", "-o", "mended.pfm")
    assert done.code == 0 and "repaired: infinities count as 0" in done.out
    color[3:9, 3:9] = np.nan
    t.write_pfm(work / "nan.pfm", color)
    assert denoise("--hdr", "nan.pfm", "-o", "nan_out.pfm").code == 0
    mended = t.read_pfm(work / "mended.pfm")
    assert np.array_equal(mended, t.read_pfm(work / "nan_out.pfm"))
    assert psnr(mended) > psnr(t.read_pfm(work / "lost.pfm")) + 5


def test_srgb_marked_hdr(check, denoise, identity, work, images):
    codes = np.round(t.srgb_encode(np.clip(images["color"], 0, 1)) * 255)
    shown = (codes / 255).astype(np.float32)
    found = check({"hdr": shown})
    assert list(found) == [("color", "ldr-as-hdr")] and "sRGB" in found["color", "ldr-as-hdr"]
    linear = t.srgb_decode(shown).astype(np.float32)
    assert list(check({"hdr": linear})) == [("color", "ldr-as-hdr")]
    assert check({"ldr": linear}) == {} and check({"ldr": shown}, "--srgb") == {}
    t.write_pfm(work / "hdr.pfm", shown)
    done = denoise("--hdr", "hdr.pfm", "--repair", "-w", identity[3], "-o", "out.pfm")
    assert done.code == 0 and "repaired" in done.out
    assert t.equal(t.read_pfm(work / "out.pfm"), shown)  # denoised as sRGB, not as radiance


def test_srgb_png_marked_hdr(denoise, work, images, png):
    codes = np.round(t.srgb_encode(np.clip(images["color"], 0, 1)) * 255).astype(int)
    t.write_png(work / "in.png", codes)
    kinds = [c["kind"] for c in denoise("--hdr", "in.png", "--check", "--json").json["check"]]
    assert kinds == ["ldr-as-hdr"]


def test_clipped_colour_marked_hdr(check, images):
    clipped = np.minimum(images["color"] * 1.7, 1)
    assert list(check({"hdr": clipped})) == [("color", "ldr-as-hdr")]
    assert check({"hdr": images["color"] * 0.3}) == {}  # a dark picture is not clipped


def test_hdr_marked_ldr(check, images):
    found = check({"ldr": images["color"] * 2})
    assert list(found) == [("color", "hdr-as-ldr")] and "--hdr" in found["color", "hdr-as-ldr"]


def test_correlated_pixels(check, images):
    found = check(frame(images, hdr=tent(images["color"])))
    assert list(found) == [("color", "correlated")]
    assert check(frame(images, hdr=images["clean"])) == {}  # structure is not correlated noise


@pytest.mark.parametrize("dx, dy", [(2, 0), (0, -3), (3, 2), (-1, -2)])
@pytest.mark.parametrize("role", ["alb", "nrm"])
def test_shifted_auxiliary_image(check, images, role, dx, dy):
    name = "albedo" if role == "alb" else "normal"
    moved = np.roll(images[name], (dy, dx), (0, 1))
    found = check(frame(images, **{role: moved}))
    assert list(found) == [(name, "shifted")]
    assert f"by {dx} pixels to the right and {dy} down" in found[name, "shifted"]


@pytest.mark.parametrize("axis, words", [(0, "top to bottom"), (1, "left to right")])
def test_mirrored_auxiliary_image(check, images, axis, words):
    found = check(frame(images, alb=np.flip(images["albedo"], axis)))
    assert words in found["albedo", "shifted"]


def test_check_and_denoise(denoise, identity, work, images):
    t.write_pfm(work / "in.pfm", images["color"])
    done = denoise("--hdr", "in.pfm", "--check", "-w", identity[3], "-o", "out.pfm")
    assert done.code == 0 and "nothing found" in done.out and (work / "out.pfm").exists()


def test_tiny_images(check):
    for size in (1, 2, 31, 33):
        image = t.noise(size, size)
        assert ("color", "shifted") not in check({"hdr": image, "alb": image, "nrm": image})


def test_panorama(check, work):
    """What goes around, and is seen so; not what is cut elsewhere, nor one that is known."""
    across, down = np.meshgrid(np.arange(256) * np.pi / 128, np.arange(128) / 128)
    light = 1.2 + np.sin(across + 1) * np.cos(2 * across) + down
    color = (light[..., None] * (0.5 + t.noise(128, 256))).astype(np.float32)
    found = check({"hdr": color})
    assert list(found) == [("color", "panorama")] and "--panorama" in found["color", "panorama"]
    assert check({"hdr": color}, "--panorama") == {}
    assert check({"hdr": color, "alb": np.full_like(color, 0.5)}) == {}  # tells nothing
    wide = np.repeat(color, 2, 1)[:, :256]
    assert check({"hdr": wide}) == check({"hdr": color[:, :-2]}) == {}
