"""Dead channels are named."""
from __future__ import annotations

import re

import pytest
import torch

from training import dead, nets, train
from training.loss import loss_of_settings
from training.result import Result


@pytest.mark.parametrize("model", ["w16", "k8"])
def test_dead_channels_are_warned_of_and_revived(raw, work, capsys, monkeypatch, model):
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
    width = len(state[layer + ".bias"])
    assert re.match(r"Warning: \d+ of \d+ channels are dead, without a gradient since the last "
                    f"look: 2 of {width} in {layer}[,;]", lines[0])
    assert "--max_lr" in lines[0] and not any(f" in {layer}" in line for line in lines[1:])
    log = reader.EventAccumulator("results/b/log")
    log.Reload()
    assert [(e.step, e.value) for e in log.Scalars(f"dead_channels/{layer}")] == [(2, 2)]
    assert [e.step for e in log.Scalars("dead_channels")] == [2, 4]
    assert log.Scalars("dead_channels")[0].value == int(lines[0].split()[1])
    assert (Result("results", "b").load()["model_state"][f"{layer}.bias"] > -1).all()


def test_numbers_too_small_to_be_normal_are_zero(raw, work, monkeypatch):
    """While there is training: the momenta of dead channels end among them, and each epoch took
    longer than the one before."""
    def is_flushed():
        return float(torch.tensor(1e-38) * 0.01) == 0
    seen = []
    monkeypatch.setattr(train, "loss_of_settings", lambda settings: seen.append(is_flushed()) or
                        loss_of_settings(settings))
    train.main(["hdr", "--raw", "-D", str(raw), "-t", "train", "-v", "valid", "-s", "3", "-m",
                "k8", "-b", "4", "--ts", "16", "-j", "0", "-d", "cpu", "-e", "1", "-r", "a"])
    assert seen == [True] and not is_flushed()


@pytest.mark.parametrize("model", ["unet:" + ",".join(["8"] * 15), "k8"])
def test_a_layer_that_is_dead_as_a_whole_comes_back(model):
    """And every layer that reads it is told, but hardly changes what it gives."""
    torch.manual_seed(2)
    net = nets.build(model, 9)
    inner = getattr(net, "trunk", net)
    x = torch.rand(1, 12 if net.net.family == "K" else 9, 32, 32)
    name = net.net.layers[2].name
    getattr(net, name).bias.data.fill_(-1e3)
    before = [y.detach().clone() for y in inner(x)]
    gone = {name: torch.ones(len(getattr(net, name).bias), dtype=torch.bool)}
    dead.revive(net, gone, 5)
    after = inner(x)
    assert all((a - b).abs().max() < 0.5 for a, b in zip(after, before))
    sum(y.square().sum() for y in after).backward()
    alive = getattr(net, name).bias.grad != 0
    assert alive.float().mean() > 0.5
    copy = nets.build(model, 9)
    copy.load_state_dict(net.state_dict())
    dead.revive(net, gone, 6), dead.revive(copy, gone, 6)
    assert all(torch.equal(a, b) for a, b in zip(net.parameters(), copy.parameters()))


def test_a_few_steps_are_no_judgement():
    model = nets.build("k8", 0)
    channels = dead.Channels(model)
    model(torch.rand(1, 12, 16, 16)).sum().backward()
    for _ in range(dead.STEPS - 1):
        channels.watch()
    assert channels.dead() is None
    other = dead.Channels(model)
    other.load(channels.state())
    channels.watch(), other.watch()
    found = channels.dead()
    assert list(found) == [layer.name for layer in model.net.layers]
    assert all(torch.equal(found[k], v) for k, v in other.dead().items())
    assert channels.dead() is None  # it begins anew
