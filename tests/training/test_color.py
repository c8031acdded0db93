"""Transfer functions, auto-exposure, tone mapping."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from training import color


@pytest.mark.parametrize("y,code", [(0.01, 0.0711), (0.18, 0.2152), (1, 0.3189), (10, 0.4601),
                                    (1000, 0.7430), (65504, 1.0)])
def test_pu_known_values(y, code):
    assert color.pu_forward(np.array([y]))[0] == pytest.approx(code, abs=1e-4)


@pytest.mark.parametrize("name", list(color.TRANSFERS))
def test_round_trip(name):
    t = color.TRANSFERS[name]
    y = np.concatenate([[0.0], np.logspace(-6, 0 if name == "srgb" else 4, 200)])
    assert t.inverse(t.forward(y)) == pytest.approx(y, rel=1e-5, abs=1e-9)
    ty = torch.from_numpy(y)
    assert torch.allclose(t.forward(ty), torch.from_numpy(np.asarray(t.forward(y))))


@pytest.mark.parametrize("name", ["pu", "log", "srgb", "linear"])
def test_half_tables_agree(name):
    table, t = color.HalfTable(name), color.TRANSFERS[name]
    code = np.linspace(0, 1, 500).astype(np.float16)
    assert table.decode(code) == pytest.approx(t.inverse(code.astype(np.float64)), rel=1e-5)
    y = np.linspace(0, 1, 500).astype(np.float32)
    want = np.clip(t.forward(y.astype(np.float16).astype(np.float64)), 0, 1)
    assert table.encode(y) == pytest.approx(want, abs=1e-6)


@pytest.mark.parametrize("name", ["pu", "log", "srgb", "linear"])
def test_negative_zeros_are_black(name):
    """Renders have some; their bits are those of the largest half floats and more."""
    table, black = color.HalfTable(name), np.array([-0.0], np.float16)
    assert table.decode(black) == table.encode(black.astype(np.float32)) == 0


def slow_autoexposure(image):
    """As the definition reads: bin by bin."""
    h, w = image.shape[:2]
    nh, nw = -(-h // 16), -(-w // 16)
    logs = []
    for i in range(nh):
        for j in range(nw):
            part = image[i * h // nh:(i + 1) * h // nh, j * w // nw:(j + 1) * w // nw]
            mean = (part.astype(np.float64) @ np.array(color.LUMINANCE)).mean()
            if mean > 1e-8:
                logs.append(np.log2(mean))
    return 0.18 / 2 ** np.mean(logs) if logs else 1.0


@given(st.integers(1, 50), st.integers(1, 50), st.integers(0, 1000))
def test_autoexposure_is_its_definition(height, width, seed):
    rng = np.random.default_rng(seed)
    image = (rng.gamma(0.3, 1, (height, width, 3)) * (rng.random((height, width, 1)) > 0.3)
             ).astype(np.float32)
    assert color.autoexposure(image) == pytest.approx(slow_autoexposure(image), rel=1e-5)


def test_autoexposure_of_nothing_and_of_nan():
    assert color.autoexposure(np.zeros((8, 8, 3))) == 1.0
    assert color.autoexposure(np.zeros((0, 0, 3))) == 1.0
    image = np.full((16, 16, 3), 0.5, np.float32)
    image[0, 0] = np.nan
    assert color.autoexposure(image) == pytest.approx(0.18 / 0.5 * 256 / 255, rel=1e-5)


def test_tonemap_keeps_middle_grey_and_saturates():
    assert color.tonemap(np.array([0.18]))[0] == pytest.approx(0.18, abs=2e-3)
    assert color.tonemap(np.array([6.38, 1e6])) == pytest.approx([1, 1], abs=1e-3)
    assert color.display(np.zeros((1, 1, 3)))[0, 0, 0] == pytest.approx(0, abs=1e-6)
