"""Dead channels are named."""
from __future__ import annotations

import re

import pytest
import torch

from training import dead, nets, train
from training.result import Result



@pytest.mark.parametrize("model", ["w16", "k8"])
def test_dead_channels_are_warned_of(raw, work, capsys, monkeypatch, model):
    """Two channels of the first layer are killed, which was alive as a whole."""
    reader = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    monkeypatch.setattr(dead, "STEPS", 6)
    options = ["hdr", "alb", "nrm", "--raw", "-D", str(raw), "-t", "train", "-v", "valid", "-s",
               "3", "-m", model, "-l", "l1", "-b", "4", "--ts", "16", "-j", "0", "--threads", "1",
               "-d", "cpu", "--max_lr", "1e-4", "-e", "4", "--valid_epochs", "2"]
    train.main([*options, "-r", "a"])
    state = Result("results", "a").load()["model_state"]
    layer = next(k for k in state if k.endswith(".bias")).rpartition(".")[0]
    before = capsys.readouterr().err
    assert f" in {layer}" not in before
    state[f"{layer}.bias"][:2] = -1e3
    torch.save(state, "killed.pt")
    train.main([*options, "-r", "b", "--init", "killed.pt"])
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    for line in lines:
        assert re.match(r"Warning: \d+ of \d+ channels are dead, without a gradient in 6 steps: "
                        f"2 of {len(state[layer + '.bias'])} in {layer}[,;]", line)
        assert "--max_lr" in line
    log = reader.EventAccumulator("results/b/log")
    log.Reload()
    assert [(e.step, e.value) for e in log.Scalars(f"dead_channels/{layer}")] == [(2, 2), (4, 2)]
    total = [int(line.split()[1]) for line in lines]
    assert [e.value for e in log.Scalars("dead_channels")] == total


def test_a_few_steps_are_no_judgement():
    model = nets.build("k8", 0)
    channels = dead.Channels(model)
    model(torch.rand(1, 12, 16, 16)).sum().backward()
    for _ in range(dead.STEPS - 1):
        channels.watch()
    assert channels.dead() is None
    channels.watch()
    counts = channels.dead()
    assert list(counts) == [layer.name for layer in model.net.layers]
    assert channels.dead() is None  # it begins anew
