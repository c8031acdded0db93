"""export.quantize_kernel: what rounding gives models of family K."""
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from export import golden_kernel, kernel, quantize_kernel
from export.bounds import Bound, word_groups
from export.dequantize import float_tensors
from export.quantize_kernel import (
    OPTIONS,
    KernelQuantizer,
    calibration_input,
    tensors_of,
    varied,
)
from export.reference import IntLayer, unsafe_pairs
from export.synthetic import noisy
from export.tza import Reader
from training.kernel_integer import IntegerKernel

ROOT = Path(__file__).resolve().parent.parent.parent
MODEL = ROOT / "weights" / "kernel5_8.tza"
INPUTS = [calibration_input(noisy(64, seed, spp)) for seed, spp in ((3, 1), (4, 4), (5, 32))]


def quantised(words: float) -> kernel.IntTrunk:
    tensors = float_tensors(Reader(MODEL), "kernel5_8")
    model = kernel.FloatTrunk(kernel.find_trunk(tensors, "kernel5_8"), tensors)
    return KernelQuantizer(model, INPUTS, replace(OPTIONS, words=words, samples=4000)).run()


@pytest.fixture(scope="module")
def by_words():
    return {words: quantised(words) for words in (0.0, OPTIONS.words)}


def fits_words(x: IntLayer) -> bool:
    """Every run by hand: elements 0 and 1 of 4, then 2 and 3."""
    for w in (x.weight, x.skip):
        if w is None:
            continue
        runs = w.astype(int).transpose(0, 2, 3, 1).reshape(len(w), w.shape[2], -1)
        for word in (0, 1):
            part = runs[..., np.arange(runs.shape[-1]) // 2 % 2 == word]
            if np.maximum(part, 0).sum(-1).max() > 128 or np.minimum(part, 0).sum(-1).min() < -128:
                return False
    return True


def test_heads_keep_their_one_tap(by_words):
    """Errors are not passed on to taps around it, which no file holds."""
    for model in by_words.values():
        for x in model.layers:
            if x.layer.name in model.net.heads:
                around = x.weight.copy()
                around[:, :, 1, 1] = 0
                assert not around.any() and x.weight.any()


def test_most_layers_fit_words_and_outputs_hardly_change(by_words):
    pairs, words = by_words[0.0], by_words[OPTIONS.words]
    fit = [x.layer.name for x in words.layers if fits_words(x)]
    assert {"enc0a", "enc0b", "enc1a", "enc1b", "dec1", "dec0", "head0", "head1"} <= set(fit)
    assert sum(map(fits_words, pairs.layers)) < len(fit) // 2
    x = calibration_input(noisy(64, 9, 4))
    for head in words.net.heads[:2]:
        wanted, got = (m.maps(m.codes(x))[head].astype(float) for m in (pairs, words))
        assert abs(got - wanted).mean() < 0.05 * wanted.std()


def test_shipped_models_fit_words_where_most_work_is():
    for name in ("kernel5_8", "kernel5_12"):
        model = kernel.int_trunk(Reader(ROOT / "weights" / f"{name}.tza"), name)
        fit = {x.layer.name for x in model.layers if fits_words(x)}
        assert {"enc0a", "enc0b", "enc1a", "enc1b", "dec1", "dec0", "head0", "head1"} <= fit


def test_training_as_integers_keeps_what_fits_words(by_words):
    net = IntegerKernel(by_words[OPTIONS.words], "pu")
    fit = [x for x in net.layers if fits_words(x.source)]
    assert len(fit) > 10
    rng = np.random.default_rng(1)
    for layer in net.layers:
        for p in (layer.weight, layer.skip):
            if p is not None:
                p.data += p.data.new_tensor(rng.normal(0, 2, p.shape))
    changed = 0
    for layer in fit:
        made = layer.rounded()
        assert fits_words(made)
        changed += int((made.weight != layer.source.weight).sum())
    assert changed > 1000


def test_an_integer_model_is_rounded_anew(tmp_path, monkeypatch):
    monkeypatch.setattr(quantize_kernel, "calibration_set", lambda *settings: INPUTS)
    out = tmp_path / "again.tza"
    quantize_kernel.main([str(MODEL), str(out), "--data", "-", "--words", "0"])
    tensors = dict(Reader(out))
    made, source = kernel.int_trunk(tensors, "again"), kernel.int_trunk(Reader(MODEL), "kernel5_8")
    assert made.bilateral == source.bilateral == kernel.SMOOTH
    assert not all(map(fits_words, made.layers[:5]))
    assert {k: v.shape for k, v in tensors_of(source).items()} == \
        {k: v.shape for k, v in tensors.items()}
    x = calibration_input(noisy(64, 9, 4))
    for head in made.net.heads[:2]:
        wanted, got = (m.maps(m.codes(x))[head].astype(float) for m in (source, made))
        assert abs(got - wanted).mean() < 0.05 * wanted.std()


def test_words_by_hand_are_those_of_the_bound(by_words):
    for x in by_words[OPTIONS.words].layers:
        rows = [(w, Bound(word_groups(w.shape[1:]))) for w in (x.weight, x.skip) if w is not None]
        assert fits_words(x) == all(b.holds(w.reshape(len(w), -1).astype(int)) for w, b in rows)


@pytest.mark.parametrize("words", (0.0, 1e9))
def test_pairs_of_a_head_with_odd_inputs(words, monkeypatch):
    """Its run begins with channel 0, not after those of a column to the left."""
    monkeypatch.setattr(golden_kernel, "WIDTHS", (5, 4, 6, 4, 8, 7, 8, 8, 9, 8, 8, 6, 7, 5))
    tensors = float_tensors(tensors_of(golden_kernel.random_model(3)), "odd")
    model = kernel.FloatTrunk(kernel.find_trunk(tensors, "odd"), tensors)
    made = KernelQuantizer(model, INPUTS[:1], replace(OPTIONS, words=words, samples=400)).run()
    tight = 0
    for net in (made, IntegerKernel(made, "pu").integer_model()):
        for x in net.layers:
            if x.layer.name in ("head0", "head1"):
                one = x.weight[:, :, 1:2, 1:2]
                assert one.shape[1] % 2 == 1 and unsafe_pairs(one) == 0
                tight += unsafe_pairs(np.roll(one, 1, 1))
        again = kernel.int_trunk(tensors_of(net), "odd")  # as a loader reads it
        assert len(again.layers) == len(net.layers)
    assert tight, "the weights are too small to tell"


def test_models_of_all_features_are_calibrated_with_all():
    images = dict(zip(("color", "albedo", "normal"), np.ones((3, 4, 4, 3), np.float32)))
    kept = {len(varied(images, i)[0]) for i in range(12)}
    assert kept == {1, 2, 3} and {len(varied(images, i, True)[0]) for i in range(12)} == {3}
    assert [varied(images, i, True)[1] for i in (4, 5)] == ["hdr", "ldr"]
