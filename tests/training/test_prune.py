"""export.prune on integer models: bytes that nothing depends on."""
from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from export import kernel, prune
from export.quantize_kernel import calibration_input
from export.reference import unsafe_pairs
from export.synthetic import noisy

ROOT = Path(__file__).resolve().parent.parent.parent
MODEL = ROOT / "weights" / "kernel5_8.tza"
SILENT = {"enc0b": [1], "enc2a": range(3, 21), "enc4b": [0, 5, 6, 7, 8, 9, 10, 11, 12, 30],
          "dec2": range(8), "dec1": [15]}


@pytest.fixture(scope="module")
def inputs() -> list[np.ndarray]:
    return [calibration_input(noisy(48, seed, spp)) for seed, spp in ((3, 1), (4, 16))]


@pytest.fixture(scope="module")
def model() -> kernel.IntTrunk:
    """kernel5_8 with silent channels."""
    whole = kernel.load(MODEL)
    layers = []
    for x in whole.layers:
        bias = x.bias.copy()
        bias[list(SILENT.get(x.layer.name, []))] = -10**6
        layers.append(replace(x, bias=bias))
    return kernel.IntTrunk(whole.net, layers, whole.bilateral)


@pytest.fixture(scope="module")
def less(model, inputs) -> kernel.IntTrunk:
    return prune.without_silent_codes(
        model, prune.active_channels(model, map(model.codes, inputs)))


def test_results_stay_to_the_bit(model, less, inputs):
    """And whole vectors of silent channels are gone, from the layers that read them, too."""
    kernel.check_trunk(less, "less")
    outputs = {x.layer.name: x.outputs for x in less.layers}
    assert outputs["enc2a"] == 8 and outputs["dec2"] == 16 and outputs["enc4b"] <= 24
    assert outputs["enc0b"] == 8 and outputs["dec1"] == 16  # one would not do
    for x in inputs:
        a, b = (m.maps(m.codes(x)) for m in (model, less))
        for head in model.net.heads:
            assert np.array_equal(a[head], b[head])
    assert less.bilateral == model.bilateral


def test_channels_find_partners_that_are_safe():
    """Two of one sign and more than 64 each are no pair; those left over get their own back."""
    weight = np.zeros((1, 8, 3, 3), np.int8)
    weight[:, [0, 2], 0, 0] = 100
    weight[:, [4, 6], 0, 0] = -100
    order = prune.paired(np.array([0, 2, 4, 6]), 8, [weight])
    assert sorted(order) == [0, 2, 4, 6] and not unsafe_pairs(weight[:, order])
    order = prune.paired(np.array([0, 2, 5]), 8, [weight])
    assert sorted(order) == [0, 2, 3, 5] and not unsafe_pairs(weight[:, order])
    assert list(prune.paired(np.array([2]), 3, [weight[:, :3]])) == [2]


def test_pairs_of_odd_widths_reach_across_columns():
    """What cannot be left out safely stays."""
    small = kernel.load(ROOT / "tests" / "golden" / "kernel" / "weights.tza")
    for k in range(3):
        active = {x.layer.name: np.arange(x.outputs) % 3 != k for x in small.layers}
        kernel.check_trunk(prune.without_silent_codes(small, active), "pruned")


def test_command(raw, work, fails, capsys):
    """With a share, channels go that are rarely above 0."""
    for share in ("0", "0.2"):
        prune.main([str(MODEL), f"{share}.tza", "--data", str(raw / "train"), "--count", "2",
                    "--share", share])
    sizes = [Path(f"{share}.tza").stat().st_size for share in ("0", "0.2")]
    assert sizes[1] < sizes[0] <= MODEL.stat().st_size
    assert "channels" in capsys.readouterr().out
    data = ["--data", str(raw / "train")]
    assert fails(prune.main, [str(MODEL), "x.tza", *data, "--share", "1"])[0] == 2
    assert fails(prune.main, [str(MODEL), "x.tza", *data, "--count", "0"])[0] == 2
    code, message = fails(prune.main, [str(ROOT / "weights" / "rt_hdr_w16.tza"), "x.tza", *data])
    assert code and "rt_hdr_w16" in message and not Path("x.tza").exists()
    code, message = fails(prune.main, [str(ROOT / "weights" / "kernel5_alb.tza"), "x.tza", *data])
    assert code == 4 and "kernel5_alb" in message and "alone" in message
