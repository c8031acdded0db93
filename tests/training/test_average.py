"""Means of the weights of several trainings."""

import sys

import numpy as np
import pytest
import torch

from export import export, kernel, quantize_kernel
from export.tza import Reader
from tests.training.test_kernel_train import RAW
from tests.training.test_train import state
from training import average, train


@pytest.fixture
def two(tmp_path):
    """Two state dicts and their files."""
    generator = torch.Generator().manual_seed(1)
    states = [{"a.weight": torch.randn(4, 3, 3, 3, generator=generator),
               "a.bias": torch.randn(4, generator=generator)} for _ in range(2)]
    paths = [tmp_path / "one.pt", tmp_path / "two.pt"]
    for tensors, path in zip(states, paths):
        torch.save(tensors, path)
    return states, [str(p) for p in paths]


@pytest.mark.parametrize("shares,want", [(("", ""), (0.5, 0.5)), ((":3", ""), (0.75, 0.25)),
                                         ((":.2", ":1.8"), (0.1, 0.9))])
def test_is_the_weighted_mean(two, tmp_path, shares, want):
    states, paths = two
    average.main([str(tmp_path / "mean.pt"), *(p + s for p, s in zip(paths, shares))])
    mean = torch.load(tmp_path / "mean.pt", weights_only=True)
    assert mean.keys() == states[0].keys()
    for name, tensor in mean.items():
        assert tensor.dtype == torch.float32
        assert torch.allclose(tensor, want[0] * states[0][name] + want[1] * states[1][name])


def test_of_a_result_the_averaged_weights_count(raw, work):
    train.main([*RAW, "-D", str(raw), "-e", "2", "-r", "k", "--max_lr", "1e-2"])
    ema = state("k")["ema_state"]
    assert any((ema[k] - v).any() for k, v in state("k")["model_state"].items())
    torch.save({k: v + 4 for k, v in ema.items()}, "more.pt")
    average.main(["mean.pt", "k:3", "more.pt"])
    for name, tensor in torch.load("mean.pt", weights_only=True).items():
        assert torch.allclose(tensor, ema[name] + 1, atol=1e-5)


def test_last_steps_are_those_of_the_first(root, tmp_path, capsys, monkeypatch):
    """Of integer files, too, and files made of the mean have them: `high` lost .4 dB else."""
    mean, back = str(tmp_path / "mean.pt"), tmp_path / "back.tza"
    high = str(root / "weights" / "kernel5_32.tza")
    average.main([mean, f"{high}:3", high])
    assert "Last steps" not in capsys.readouterr().out
    state = torch.load(mean, weights_only=True)
    assert state[kernel.BILATERAL].tolist() == [kernel.ALL_STEPS]
    average.main([mean, mean, high])
    codes = np.random.default_rng(1).random((64, 64, 12)).astype(np.float32)
    monkeypatch.setattr(quantize_kernel, "calibration_set", lambda *settings: [codes])
    half = str(tmp_path / "half.tza")
    export.main(["-r", mean, "-o", half])
    for source in (mean, half):
        quantize_kernel.main([source, str(back), "--data", "-"])
        assert kernel.bilateral_of(Reader(back), "") == kernel.ALL_STEPS
    torch.save({k: v for k, v in state.items() if k != kernel.BILATERAL}, tmp_path / "plain.pt")
    average.main([mean, str(tmp_path / "plain.pt"), high])
    assert f"plain.pt 0, {high} 3; the mean has 0" in capsys.readouterr().out
    assert kernel.BILATERAL not in torch.load(mean, weights_only=True)


def test_bad_input(two, tmp_path, fails):
    states, paths = two
    out = str(tmp_path / "mean.pt")
    assert fails(average.main, [str(tmp_path / "mean.tza"), *paths])[0] == 2
    for share in ("0", "-1", "nan", "inf"):
        code, text = fails(average.main, [out, f"{paths[0]}:{share}", paths[1]])
        assert code == 2 and "above 0" in text
    torch.save({"a.weight": states[0]["a.weight"]}, tmp_path / "other.pt")
    code, text = fails(average.main, [out, *paths, str(tmp_path / "other.pt")])
    assert code == 4 and "other.pt" in text and "another model" in text
    code, text = fails(average.main, [out, paths[0], str(tmp_path / "none.pt")])
    assert code and "none.pt" in text
    assert not (tmp_path / "mean.pt").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="optional: needs a folder nobody writes to")
def test_output_that_cannot_be_written(two, fails):
    code, text = fails(average.main, ["/proc/mean.pt", *two[1]])
    assert code == 5 and text.startswith("/proc/mean.pt: cannot write")
