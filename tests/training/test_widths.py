"""Networks begun with the weights of wider and narrower ones."""
from __future__ import annotations

import pytest
import torch

from training import nets, train
from training.nets import convolutions
from training.widths import fitted

K_WIDTHS = [4, 6, 5, 4, 7, 8, 8, 6, 8, 9, 8, 7, 6, 4]
U_WIDTHS = [5, 4, 6, 5, 7, 6, 8, 7, 6, 8, 7, 6, 5, 4, 6]


def wider(model: torch.nn.Module, more: dict[str, int]) -> dict[str, torch.Tensor]:
    """The model's tensors and among their channels so many more by layer, hardly used.

    more: no layer whose channels another of them uses."""
    state = {k: v.clone() for k, v in model.state_dict().items()}
    convs = convolutions(model)
    for layer, count in more.items():
        at = torch.arange(count) * 2  # their places
        old = torch.tensor([i for i in range(len(state[f"{layer}.bias"]) + count) if i not in at])
        for part in ("weight", "bias"):
            value = state[f"{layer}.{part}"]
            grown = value.new_full((len(value) + count, *value.shape[1:]), 0.3)
            grown[old] = value
            state[f"{layer}.{part}"] = grown
        for conv in convs:
            for source, first in ((conv.source, 0), (getattr(conv, "skip", None), None)):
                if source != layer:
                    continue
                first = len(state[f"{conv.source}.bias"]) if first is None else first
                value = state[f"{conv.name}.weight"]
                part = value[:, first:first + len(old)]
                grown = part.new_full((len(part), len(old) + count, *part.shape[2:]), 1e-6)
                grown[:, old] = part
                state[f"{conv.name}.weight"] = torch.cat(
                    (value[:, :first], grown, value[:, first + len(old):]), 1)
    return state


@pytest.mark.parametrize("name, widths, inputs, more", [
    ("kernel5", K_WIDTHS, 0, {"enc0a": 3, "enc3a": 2, "enc4b": 4, "dec1": 1}),
    ("unet", U_WIDTHS, 9, {"enc_conv0": 2, "enc_conv2": 3, "dec_conv3b": 2})])
def test_channels_that_weigh_least_are_cut(name, widths, inputs, more):
    torch.manual_seed(5)
    model = nets.build(f"{name}:" + ",".join(map(str, widths)), inputs)
    wide = wider(model, more)
    got, cut, added = fitted(model, wide)
    assert not added and len(cut) == len(more)
    assert all(any(c.startswith(f"{k} ") for c in cut) for k in more)
    wanted = model.state_dict()
    assert got.keys() == wanted.keys()
    for key, value in wanted.items():
        assert torch.equal(got[key], value), key


def test_weights_of_the_same_widths_stay():
    model = nets.build("kernel5:" + ",".join(map(str, K_WIDTHS)), 0)
    got, cut, added = fitted(model, model.state_dict())
    assert not cut and not added
    assert all(torch.equal(got[k], v) for k, v in model.state_dict().items())


@pytest.mark.parametrize("name, widths, inputs, more", [
    ("kernel5", K_WIDTHS, 0, {0: 3, 5: 2, 9: 4, 13: 1}),
    ("unet", U_WIDTHS, 9, {0: 2, 2: 3, 13: 2})])
def test_channels_that_are_missing_change_nothing_at_first(name, widths, inputs, more):
    torch.manual_seed(6)
    have = nets.build(f"{name}:" + ",".join(map(str, widths)), inputs)
    wide = [w + more.get(i, 0) for i, w in enumerate(widths)]
    model = nets.build(f"{name}:" + ",".join(map(str, wide)), inputs)
    got, cut, added = fitted(model, have.state_dict())
    assert not cut and len(added) == len(more)
    model.load_state_dict(got)
    x = torch.rand(1, 12 if inputs == 0 else inputs, 32, 32)
    run = (lambda m: m.trunk(x)) if inputs == 0 else (lambda m: [m(x)])
    with torch.no_grad():
        for a, b in zip(run(have), run(model)):
            assert torch.allclose(a, b, atol=1e-5) and a.std() > 0
    for conv in convolutions(model):  # what is new can learn
        assert getattr(model, conv.name).weight.flatten(1).norm(dim=1).min() > 0
    assert "enc0a 4 to 7" in added or "enc_conv0 5 to 7" in added


def test_outputs_are_not_fitted():
    have, model = (nets.build("unet:" + ",".join(map(str, U_WIDTHS)), 9, n) for n in (3, 1))
    got, cut, added = fitted(model, have.state_dict())
    assert not cut and not added
    assert all(torch.equal(got[k], v) for k, v in have.state_dict().items())


def test_a_training_says_what_it_cuts(raw, work, fails, capsys):
    rest = "," + ",".join(["6"] * 13)
    torch.save(nets.build(f"kernel5:6{rest}", 0).state_dict(), "wide.pt")
    options = ["hdr", "alb", "nrm", "--raw", "-D", str(raw), "-t", "train", "-v", "valid", "-s",
               "3", "-e", "1", "-j", "0", "--ts", "32", "-b", "4", "--init", "wide.pt"]
    train.main([*options, "-r", "n", "-m", f"kernel5:4{rest}"])
    assert "wide.pt that weigh most: enc0a 6 to 4\n" in capsys.readouterr().out
    train.main([*options, "-r", "w", "-m", f"kernel5:8{rest}"])
    assert "Channels that wide.pt lacks: enc0a 6 to 8\n" in capsys.readouterr().out
    code, message = fails(train.main, [*options, "-r", "m", "-m", "w8", "--net", "unet"])
    assert code == 4 and "wide.pt" in message and "another model" in message
