"""export.temper: wider kernels, confidence and blending of a K model's finest level."""
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from export import kernel, pixels, temper
from export.tza import Reader

GOLDEN = Path(__file__).resolve().parent.parent / "golden" / "kernel"
COLOR = np.fromfile(GOLDEN / "color.f32", "<f4").reshape(37, 45, 3)


def result(path: Path) -> np.ndarray:
    """Clipped, so that its values are of one size."""
    return kernel.run_frame(kernel.load(path), pixels.Frame({"color": COLOR}, "ldr"))


def roughness(image: np.ndarray) -> float:
    return float(np.abs(np.diff(image, axis=1)).mean())


def made(work: Path, *options: str) -> Path:
    temper.main([str(GOLDEN / "weights.tza"), str(work / "out.tza"), *options])
    return work / "out.tza"


def test_nothing_asked_nothing_changed(work):
    tensors, same = Reader(made(work)), Reader(GOLDEN / "weights.tza")
    assert set(tensors) == set(same)
    assert all(np.array_equal(tensors[k], same[k]) for k in same)


def test_wider_kernels_and_more_of_the_coarser_level_are_smoother(work):
    before = roughness(result(GOLDEN / "weights.tza"))
    for option, value in (("--radiance", "0.3"), ("--blend", "4")):
        assert roughness(result(made(work, option, value))) < before, option
    assert roughness(result(made(work, "--blend", "-4"))) > before


def test_only_the_finest_head_changes(work):
    tensors = Reader(made(work, "--radiance", "0.9", "--confidence", "0.5", "--blend", "-1"))
    before = Reader(GOLDEN / "weights.tza")
    changed = {k for k in before if not np.array_equal(tensors[k], before[k])}
    assert changed == {"head0.scale", "head0.bias"}
    ratio = tensors["head0.scale"] / before["head0.scale"]
    np.testing.assert_allclose(ratio[:25], 0.9, rtol=1e-6)
    np.testing.assert_allclose(ratio[25:], [0.5] + [1.0] * 26, rtol=1e-6)
    unit = float(before["head0.scale"][26]) / 16
    lower = (before["head0.bias"][26] - tensors["head0.bias"][26]) * unit
    assert lower == pytest.approx(1.0, abs=unit)


@pytest.mark.parametrize("option, text", [
    (("--radiance", "0"), "--radiance must be above 0"), (("--blend", "nan"), "--blend must be"),
    (("--confidence", "5"), "at most 4")])
def test_numbers_that_make_no_sense_are_refused(option, text, work, fails):
    code, message = fails(temper.main, [str(GOLDEN / "weights.tza"), "out.tza", *option])
    assert code == 2 and text in message


def test_files_that_are_none_are_named(work, fails):
    Path("broken.tza").write_bytes(b"no")
    code, message = fails(temper.main, ["broken.tza", "out.tza"])
    assert code == 4 and "broken.tza" in message and not Path("out.tza").exists()
