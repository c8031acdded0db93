"""Trainings that begin with other weights, and layers that keep them."""

import pytest
import torch

from tests.training.tools import QUICK
from training import train
from training.result import Result

RAW = ["hdr", "alb", "nrm", "--raw", "-t", "train", "-s", "3", *QUICK]


def state(result: str) -> dict:
    return Result("results", result).load()


def test_warm_start(raw, work, fails):
    from export import export
    train.main([*RAW, "-D", str(raw), "-r", "a", "-e", "8"])
    export.main(["-r", "a"])
    first = {}
    for name, init in (("cold", []), ("result", ["--init", "a"]),
                       ("tza", ["--init", "results/a/a.tza"])):
        train.main([*RAW, "-D", str(raw), "-r", name, "-e", "1", "--max_lr", "1e-6", *init])
        first[name] = state(name)["model_state"]["dec_conv0.bias"]
    a = state("a")["ema_state"]["dec_conv0.bias"]
    assert torch.allclose(first["result"], a, atol=1e-4)
    assert torch.allclose(first["tza"], a, atol=2e-3)
    assert not torch.allclose(first["cold"], a, atol=1e-3)
    code, _ = fails(train.main, [*RAW, "-D", str(raw), "-r", "x", "--init", "nothing"])
    assert code == 4


@pytest.mark.parametrize("optimizer", ["adam", "muon"])
def test_frozen_layers_stay(raw, work, fails, optimizer):
    """To the last bit, in averaged weights, too, while the rest moves as it would."""
    options = [*RAW, "-D", str(raw), "--optimizer", optimizer, "-m", "w16"]
    train.main([*options, "-r", "a", "-e", "1"])
    before, frozen = state("a")["ema_state"], ["enc_conv2", "dec_conv1b"]

    def moved(result: str, kind: str) -> set[str]:
        return {k for k, t in state(result)[kind].items() if not torch.equal(t, before[k])}

    train.main([*options, "-r", "free", "-e", "3", "--init", "a"])
    train.main([*options, "-r", "b", "-e", "3", "--init", "a", "--freeze", *frozen])
    for kind in ("model_state", "ema_state"):
        names = {f"{layer}.{part}" for layer in frozen for part in ("weight", "bias")}
        assert names < moved("free", kind)
        assert moved("b", kind) == moved("free", kind) - names
    code, message = fails(train.main, [*options, "-r", "c", "--freeze", "enc_conv2"])
    assert code == 2 and "--freeze enc_conv2: without --init" in message
    code, message = fails(train.main, [*options, "-r", "c", "--init", "a", "--freeze", "enc9"])
    assert code == 2 and "--freeze enc9: no layer of the model (enc_conv0, " in message
    layers = {name.partition(".")[0] for name in before}
    code, message = fails(train.main, [*options, "-r", "c", "--init", "a", "--freeze", *layers])
    assert code == 2 and "nothing is left to train" in message
