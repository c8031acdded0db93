"""export.dequantize: float weights of integer models, to train on from."""
from pathlib import Path

import numpy as np
import pytest

from export import kernel
from export.dequantize import float_tensors, whole_kernels
from export.fold import phase_kernels
from export.graph import ModelError
from export.pixels import Frame
from export.quantize_kernel import calibration_input
from export.reference import float_model, load_model
from export.synthetic import noisy
from export.tza import Reader

ROOT = Path(__file__).resolve().parent.parent.parent


def test_phases_become_the_kernel_that_they_were_folded_from():
    weight = np.random.default_rng(1).normal(0, 1, (3, 5, 3, 3))
    assert abs(whole_kernels(phase_kernels(weight)) - weight).max() < 1e-12


@pytest.mark.parametrize("name", ("kernel5_8", "kernel5_12", "kernel5_32"))
def test_built_in_models(name):
    """The logits differ by what codes between layers and phases rounded apart cost."""
    tensors = Reader(ROOT / "weights" / f"{name}.tza")
    whole = kernel.int_trunk(tensors, name)
    again = kernel.FloatTrunk(whole.net, float_tensors(tensors, name))
    x = calibration_input(noisy(96, 3, 4))
    wanted, got = whole.maps(whole.codes(x)), again.maps(x)
    for head in whole.net.heads:
        error = abs(np.clip(got[head] / kernel.HEAD_STEP, 0, 255) - wanted[head])
        spread = wanted[head].std()  # in codes; sharper heads round more
        assert error.mean() < 0.25 + 0.017 * spread and spread > 5


@pytest.mark.parametrize("name", ("rt_hdr_w16", "rt_hdr_alb_nrm_w16"))
def test_a_unet_comes_back(name, int8_of):
    exact = load_model(ROOT / "weights" / f"{name}.tza")
    again = float_model(float_tensors(Reader(int8_of(name)), name), name)
    images = noisy(96, 777, 4)
    features = ("color", "albedo", "normal")[:exact.inputs // 3]
    x = Frame({f: images[f] for f in features}).network_input()
    wanted, got = exact.run(x), again.run(x)
    assert abs(got - wanted).mean() < 0.02 * wanted.std()


def test_what_is_no_integer_model_is_refused():
    with pytest.raises(ModelError, match="rt_hdr_w16.tza: tensor 'enc_conv0.weight'"):
        float_tensors(Reader(ROOT / "weights" / "rt_hdr_w16.tza"), "rt_hdr_w16.tza")
