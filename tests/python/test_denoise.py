"""lull.denoise and lull.Denoiser: bytes, kinds of arrays, results in place, progress, errors."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.apps.tools import read_pfm, scene, write_pfm


@pytest.mark.parametrize("quality", ["high", "balanced", "fast"])
def test_bytes_are_those_of_the_program(lull, frame, quality, build, tmp_path):
    for name, image in frame.items():
        write_pfm(tmp_path / f"{name}.pfm", image)
    subprocess.run([build / "bin" / "oidnDenoise", "--hdr", "color.pfm", "--alb", "albedo.pfm",
                    "--nrm", "normal.pfm", "-q", quality, "-o", "out.pfm"], cwd=tmp_path,
                   check=True, capture_output=True)
    result = lull.denoise(**frame, hdr=True, quality=quality)
    assert result.dtype == np.float32
    assert np.array_equal(result, read_pfm(tmp_path / "out.pfm"))


def test_ensembles_are_means_of_orientations(lull, frame, clean):
    turned = {name: np.rot90(image).copy() for name, image in frame.items()}
    other = np.rot90(lull.denoise(**turned, hdr=True), -1)
    assert np.array_equal(lull.denoise(**frame, hdr=True, ensemble=2), clean / 2 + other / 2)


def test_panoramas_go_on_at_their_edges(lull, frame):
    border, (height, width) = 64, frame["color"].shape[:2]
    rows = np.arange(-border, height + border) % (2 * height)
    columns = np.arange(-border, width + border) % width
    over = rows >= height  # a pole, to the other side
    rows = np.where(over, 2 * height - 1 - rows, rows)
    shifted = (columns[None] + np.where(over, width // 2, 0)[:, None]) % width
    wider = {name: np.ascontiguousarray(image[rows[:, None], shifted])
             for name, image in frame.items()}
    expected = lull.denoise(**wider, hdr=True)[border:-border, border:-border]
    assert np.array_equal(lull.denoise(**frame, hdr=True, panorama=True), expected)


def test_settings_reach_the_library(lull, frame, clean):
    ldr = {**frame, "color": frame["color"].clip(0, 1)}
    charts = frame["normal"].copy()
    charts[:, ::16] = 0
    results = [clean, lull.denoise(**ldr), lull.denoise(**ldr, srgb=True),
               lull.denoise(**frame, hdr=True, quality="fast"),
               lull.denoise(frame["color"], hdr=True),
               lull.denoise(frame["color"], frame["albedo"], hdr=True),
               lull.denoise(frame["color"] * 2 - 1, filter_type="RTLightmap", directional=True),
               lull.denoise(frame["color"], filter_type="RTLightmap"),
               lull.denoise(frame["color"], normal=charts, filter_type="RTLightmap"),
               lull.denoise(frame["color"], hdr=True, input_scale=9.0),
               lull.denoise(**frame, hdr=True, ensemble=2),
               lull.denoise(**frame, hdr=True, ensemble=4),
               lull.denoise(**frame, hdr=True, panorama=True)]
    hashes = [r.tobytes() for r in results]
    same = hashes.pop(7)
    assert same == hashes[4]  # a light map is denoised as colour alone
    assert len(set(hashes)) == len(hashes)
    assert np.array_equal(lull.denoise(**frame, hdr=True, threads=1, max_memory_mb=8), clean)
    fast = lull.denoise(**frame, hdr=True, quality=4)  # OIDN_QUALITY_FAST, as pyoidn takes it
    assert fast.tobytes() == hashes[3]


def test_auxiliary_images_alone(lull, frame):
    albedo = lull.denoise(albedo=frame["albedo"])
    normal = lull.denoise(normal=frame["normal"])
    assert np.abs(albedo - frame["albedo"]).mean() < 0.05
    assert np.abs(normal - frame["normal"]).mean() < 0.2
    assert np.array_equal(lull.denoise(None, frame["albedo"]), albedo)


def test_layers_of_one_array_are_used_where_they_lie(lull, frame, clean, monkeypatch):
    layers = np.zeros((90, 128, 12), np.float32)
    parts = [layers[:, 4:124, k:k + 3] for k in (0, 3, 6)]
    for part, image in zip(parts, frame.values()):
        part[...] = image
    monkeypatch.setattr(np, "ascontiguousarray", lambda a: pytest.fail("it was copied"))
    assert np.array_equal(lull.denoise(*parts, hdr=True), clean)
    before = layers.copy()
    target = layers[:, 4:124, 9:12]
    assert lull.denoise(*parts, hdr=True, out=target) is target
    before[:, 4:124, 9:12] = clean
    assert np.array_equal(layers, before)


@pytest.mark.parametrize("change", [
    lambda a: np.ascontiguousarray(a[::-1])[::-1], lambda a: np.asfortranarray(a),
    lambda a: np.ascontiguousarray(a.transpose(2, 0, 1)).transpose(1, 2, 0),
    lambda a: np.ascontiguousarray(a[..., ::-1])[..., ::-1], lambda a: a.astype(">f4"),
    lambda a: a.astype(np.float64), lambda a: torch.from_numpy(a),
    lambda a: torch.from_numpy(a).permute(2, 0, 1).contiguous().permute(1, 2, 0),
    lambda a: torch.from_numpy(a).requires_grad_(),
    lambda a: np.frombuffer(b"\0" + a.tobytes(), np.uint8)[1:].view("f4").reshape(a.shape),
], ids=["upside down", "columns first", "planes", "bgr", "big endian", "double", "tensor",
        "tensor of planes", "with gradients", "unaligned"])
def test_any_layout_gives_the_same(lull, frame, clean, change):
    result = lull.denoise(*map(change, frame.values()), hdr=True)
    assert type(result) is type(change(frame["color"]))
    assert result.dtype == change(frame["color"]).dtype
    assert np.array_equal(np.asarray(result), clean)


def test_halves(lull, frame, clean):
    result = lull.denoise(*(a.astype(np.float16) for a in frame.values()), hdr=True)
    assert result.dtype == np.float16
    assert np.abs(result - clean).mean() < 0.01
    tensor = lull.denoise(*(torch.from_numpy(a).half() for a in frame.values()), hdr=True)
    assert tensor.dtype == torch.float16 and np.array_equal(tensor.numpy(), result)


def test_channels(lull, frame):
    grey = frame["color"][..., 1]
    one = lull.denoise(grey, hdr=True)
    assert one.shape == grey.shape
    assert np.array_equal(lull.denoise(grey[..., None], hdr=True), one[..., None])
    two = lull.denoise(frame["color"][..., :2], hdr=True)
    assert two.shape == (90, 120, 2)
    alpha = np.linspace(0, 1, 90 * 120, dtype=np.float32).reshape(90, 120, 1)
    four = lull.denoise(np.concatenate([frame["color"], alpha], -1), hdr=True)
    assert np.array_equal(four[..., 3:], alpha)
    assert np.array_equal(four[..., :3], lull.denoise(frame["color"], hdr=True))


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (17, 3)])
def test_odd_sizes(lull, shape):
    image = np.full((*shape, 3), 0.25, np.float32)
    assert np.allclose(lull.denoise(image, hdr=True), image, rtol=1e-3)
    wide = np.zeros((2 * shape[0], 2 * shape[1], 5), np.float32)
    wide[::2, ::2, 1:4] = image
    narrow = wide[:, :-1].copy()  # its rows are shorter than the pixels of every second column
    for view in (wide[::2, ::2, 1:4], narrow[::2, ::2, 1:4], narrow[:shape[0], ::2, 1:4]):
        assert np.array_equal(lull.denoise(view, hdr=True), lull.denoise(view.copy(), hdr=True))


@pytest.mark.parametrize("make", [
    np.copy, lambda a: a.astype(np.float64), lambda a: a[::-1].copy()[::-1],
    lambda a: torch.from_numpy(a.copy()), lambda a: torch.from_numpy(a.astype(np.float64)),
    lambda a: a.astype(np.float16)])
def test_results_in_place(lull, frame, clean, make):
    image = make(frame["color"])
    expected = lull.denoise(image, frame["albedo"], frame["normal"], hdr=True)
    assert lull.denoise(image, frame["albedo"], frame["normal"], hdr=True, out=image) is image
    assert np.array_equal(np.asarray(image), np.asarray(expected))


def test_inputs_stay_and_results_are_new(lull, frame, clean):
    copies = {k: v.copy() for k, v in frame.items()}
    with lull.Denoiser(hdr=True) as denoiser:
        first = denoiser(**frame)
        second = denoiser(**{k: v[::-1] for k, v in frame.items()})
        assert not np.shares_memory(first, second)
        assert np.array_equal(first, clean) and not np.array_equal(second, first)
        assert np.array_equal(denoiser(frame["color"][:40, :50]),
                              lull.denoise(frame["color"][:40, :50], hdr=True))
        assert np.array_equal(denoiser(**frame), clean)
    assert all(np.array_equal(copies[k], v) for k, v in frame.items())


def test_arrays_need_not_outlive_the_call(lull, frame, clean):
    with lull.Denoiser(hdr=True) as denoiser:
        for _ in range(5):
            assert np.array_equal(denoiser(*(a.copy() for a in frame.values())), clean)
            gc.collect()
            np.full((1000, 1000), np.nan)
        with pytest.raises(ValueError):
            denoiser(frame["color"], frame["albedo"][:5])
        assert np.array_equal(denoiser(**frame), clean)


def test_progress(lull, frame, clean):
    seen: list[float] = []
    assert np.array_equal(lull.denoise(**frame, hdr=True, progress=seen.append), clean)
    assert seen[0] == 0 and seen[-1] == 1 and seen == sorted(seen)
    with lull.Denoiser(hdr=True) as denoiser:
        with pytest.raises(lull.Cancelled):
            denoiser(**frame, progress=lambda part: part < 0.3)
        with pytest.raises(ZeroDivisionError):
            denoiser(**frame, progress=lambda part: 1 / 0)
        assert np.array_equal(denoiser(**frame), clean)


def test_weights(lull, frame, root: Path, tmp_path):
    file = root / "weights" / "kernel5_8.tza"
    fast = lull.denoise(**frame, hdr=True, quality="fast")
    assert np.array_equal(lull.denoise(**frame, hdr=True, weights=file), fast)
    assert np.array_equal(lull.denoise(**frame, hdr=True, weights=file.read_bytes()), fast)
    copy = tmp_path / "w.tza"
    copy.write_bytes(file.read_bytes())
    assert np.array_equal(lull.denoise(**frame, hdr=True, weights=str(copy)), fast)
    copy.write_bytes((root / "weights" / "kernel5_12.tza").read_bytes())
    assert np.array_equal(lull.denoise(**frame, hdr=True, weights=str(copy)),
                          lull.denoise(**frame, hdr=True, quality="balanced"))
    with pytest.raises(FileNotFoundError):
        lull.denoise(**frame, weights=tmp_path / "none.tza")
    with pytest.raises(RuntimeError):
        lull.denoise(**frame, weights=b"no weights")


def test_auto_says_what_it_took(lull):
    big = {k: v for k, v in scene(400, 400).items() if k != "clean"}
    with lull.Denoiser(quality="auto", hdr=True) as denoiser:
        result = denoiser(**big)
        used = denoiser.used_quality
    assert used in ("high", "balanced", "fast")
    assert np.array_equal(result, lull.denoise(**big, hdr=True, quality=used))


IMAGE = np.zeros((8, 8, 3), np.float32)


@pytest.mark.parametrize("kind, says, arguments", [
    (ValueError, "color, albedo or normal", {}),
    (TypeError, "color: uint8", {"color": IMAGE.astype(np.uint8)}),
    (TypeError, "color: complex64", {"color": IMAGE.astype(np.complex64)}),
    (TypeError, "color: a numpy array", {"color": IMAGE.tolist()}),
    (ValueError, "color: shape", {"color": IMAGE[0, 0]}),
    (ValueError, "color: shape", {"color": np.zeros((8, 8, 5), np.float32)}),
    (ValueError, "color: shape", {"color": IMAGE[:0]}),
    (ValueError, "albedo: 8x7 pixels", {"color": IMAGE, "albedo": IMAGE[:7]}),
    (ValueError, "out: shape", {"color": IMAGE, "out": IMAGE[:7].copy()}),
    (TypeError, "out: int32", {"color": IMAGE, "out": IMAGE.astype(np.int32)}),
    (ValueError, "quality: 'best'", {"color": IMAGE, "quality": "best"}),
    (ValueError, "filter_type: 'SVGF'", {"color": IMAGE, "filter_type": "SVGF"}),
    (ValueError, "linear", {"color": IMAGE, "hdr": True, "srgb": True}),
    (ValueError, "'RT'", {"color": IMAGE, "filter_type": "RTLightmap", "srgb": True}),
    (ValueError, "'RTLightmap'", {"color": IMAGE, "directional": True}),
    (ValueError, "a color", {"color": IMAGE, "albedo": IMAGE, "filter_type": "RTLightmap"}),
    (ValueError, "a color", {"normal": IMAGE, "filter_type": "RTLightmap"}),
    (ValueError, "quality: 7", {"color": IMAGE, "quality": 7}),
    (ValueError, "threads", {"color": IMAGE, "threads": -1}),
    (ValueError, "ensemble: 3", {"color": IMAGE, "ensemble": 3}),
    (TypeError, "threads: '2'", {"color": IMAGE, "threads": "2"}),
    (TypeError, "max_memory_mb: 100.5", {"color": IMAGE, "max_memory_mb": 100.5}),
    (ValueError, "max_memory_mb: 4294967296", {"color": IMAGE, "max_memory_mb": 2**32}),
    (TypeError, "input_scale: 'auto'", {"color": IMAGE, "input_scale": "auto"}),
    (TypeError, "sharpen", {"color": IMAGE, "sharpen": 1}),
    (MemoryError, "MB|bytes", {"color": np.zeros((2000, 3000, 3), np.float32),
                               "weights": Path("rt_hdr_w16.tza"), "hdr": True,
                               "max_memory_mb": 1}),
])
def test_errors(lull, root, kind, says, arguments):
    if isinstance(arguments.get("weights"), Path):
        arguments = {**arguments, "weights": root / "weights" / arguments["weights"]}
    with pytest.raises(kind, match=says):
        lull.denoise(**arguments)


def test_results_cannot_be_read_only(lull, frame):
    image = frame["color"].copy()
    image.flags.writeable = False
    lull.denoise(image, hdr=True)
    with pytest.raises(ValueError, match="out: it cannot be written"):
        lull.denoise(image, hdr=True, out=image)


def test_what_a_progress_function_raises_when_all_is_done_is_raised(lull, frame):
    with pytest.raises(ZeroDivisionError):
        lull.denoise(**frame, hdr=True, progress=lambda part: 1 / (1 - part))


def test_a_missing_library_is_named(root, tmp_path):
    for path, text in ((tmp_path / "none.so", "no library"), (Path(__file__), "test_denoise.py")):
        done = subprocess.run([sys.executable, "-c", "import lull; lull.load_library()"],
                              capture_output=True, text=True,
                              env={**os.environ, "PYTHONPATH": str(root / "python"),
                                   "LULL_LIBRARY": str(path)})
        assert done.returncode == 1 and text in done.stderr and str(path) in done.stderr
