"""Muon for kernels, Adam for the rest, in either layout of memory."""

import copy
from types import SimpleNamespace

import pytest
import torch

from training import nets, parallel
from training.optimizer import DECAY, MOMENTUM, Muon, Optimizer, Recorded, is_matrix, orthogonal, \
    take_step


def steps(model, kind: str, count: int = 3, rate: float = 1e-2):
    optimizer = Optimizer(model.parameters(), rate, kind)
    torch.manual_seed(3)
    x = torch.rand(2, 9, 16, 16)
    for _ in range(count):
        optimizer.zero_grad()
        (model(x) ** 2).mean().backward()
        optimizer.step()
    return optimizer


@pytest.fixture
def model():
    torch.manual_seed(1)
    return nets.build("unet:" + ",".join(["8"] * 15), 9)


def test_muon_takes_kernels_of_layers_with_enough_outputs(model):
    optimizer = Optimizer(model.parameters(), 1e-2, "muon")
    assert len(optimizer.parts) == 2
    assert len(optimizer.kernels) == sum(is_matrix(p) for p in model.parameters()) == 15
    count = sum(p.numel() for part in optimizer.parts for g in part.param_groups
                for p in g["params"])
    assert count == sum(p.numel() for p in model.parameters())
    assert len(Optimizer(model.parameters(), 1e-2).parts) == 1


def test_adam_is_pytorchs(model):
    other = copy.deepcopy(model)
    steps(model, "adam")
    optimizer = torch.optim.Adam(other.parameters(), 1e-2)
    torch.manual_seed(3)
    x = torch.rand(2, 9, 16, 16)
    for _ in range(3):
        optimizer.zero_grad()
        (other(x) ** 2).mean().backward()
        optimizer.step()
    for a, b in zip(model.parameters(), other.parameters()):
        torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("outputs", [8, 96])  # fewer and more rows than columns
def test_muon_moves_along_orthogonal_rows(outputs):
    """One step moves a kernel by 0.2 sqrt(longer side) * rate * something nearly orthogonal."""
    torch.manual_seed(2)
    conv = torch.nn.Conv2d(9, outputs, 3)
    before = conv.weight.detach().clone()
    steps(conv, "muon", 1)
    move = (conv.weight.detach() - before).flatten(1) / (0.2 * max(81, outputs) ** 0.5 * 1e-2)
    lengths = torch.linalg.svdvals(move)
    assert lengths.max() < 1.4 and lengths.median() > 0.5


@pytest.mark.parametrize("shape", [(16, 108), (96, 27), (8, 9)])
def test_muon_is_pytorchs(shape):
    """Which takes bfloat16 for the iteration."""
    torch.manual_seed(4)
    mine, theirs = (torch.zeros(shape, requires_grad=True) for _ in range(2))
    a = Muon([mine], 1e-2)
    b = torch.optim.Muon([theirs], 1e-2, weight_decay=DECAY, adjust_lr_fn="match_rms_adamw")
    for _ in range(4):
        mine.grad = torch.randn(shape)
        theirs.grad = mine.grad.clone()
        a.step(), b.step()
    error = (mine - theirs).norm() / theirs.norm()
    assert error < 0.02


def test_orthogonal_keeps_singular_vectors():
    torch.manual_seed(5)
    u, _ = torch.linalg.qr(torch.randn(12, 12))
    v, _ = torch.linalg.qr(torch.randn(40, 12))
    for lengths in (torch.linspace(1, 2, 12), torch.logspace(-2, 0, 12)):
        inner = u.T @ orthogonal(u @ torch.diag(lengths) @ v.T) @ v
        assert (inner - torch.diag(inner.diagonal())).abs().max() < 1e-4
        assert 0.6 < inner.diagonal().min() and inner.diagonal().max() < 1.3


def test_muon_does_not_mind_the_layout_of_memory(model):
    other = copy.deepcopy(model).to(memory_format=torch.channels_last)
    steps(model, "muon"), steps(other, "muon")
    for a, b in zip(model.parameters(), other.parameters()):
        torch.testing.assert_close(a, b, rtol=0, atol=1e-5)


def test_clipped_gradients_are_what_steps_take(model):
    """Also where the gradient lies in memory unlike its kernels."""
    model.to(memory_format=torch.channels_last)
    optimizer = Optimizer(model.parameters(), 1e-2, "muon")
    for p in optimizer.params:
        p.grad = torch.ones(p.shape)
    assert optimizer.kernels and not any(
        p.grad.is_contiguous(memory_format=torch.channels_last) for p in optimizer.kernels)
    settings = SimpleNamespace(precision="fp32")
    team = SimpleNamespace(device=torch.device("cpu"))
    parallel.Mixed(settings, team).step(optimizer, clip=1e-3)
    lengths = [s["momentum"].norm() ** 2 for s in optimizer.parts[1].state.values()]
    assert 0 < sum(lengths) ** 0.5 <= (1 - MOMENTUM) * 1.01e-3


def test_state_comes_back(model):
    optimizer = steps(model, "muon")
    state = copy.deepcopy(optimizer.state_dict())
    fresh = Optimizer(model.parameters(), 1e-2, "muon")
    fresh.load_state_dict(state)
    for a, b in zip(optimizer.parts, fresh.parts):
        old, new = a.state_dict()["state"], b.state_dict()["state"]
        assert old.keys() == new.keys() and old
        for k in old:
            for name, value in old[k].items():
                assert torch.equal(torch.as_tensor(value), torch.as_tensor(new[k][name]))
    optimizer.schedule(5e-3, 0.9)
    assert {g["lr"] for part in optimizer.parts for g in part.param_groups} == {5e-3}
    assert optimizer.parts[0].param_groups[0]["betas"][0] == 0.9


def muons_tensors(device: str):
    torch.manual_seed(4)
    shapes = ((8, 18), (16, 9))
    return tuple([torch.randn(*shape).to(device) for shape in shapes] for _ in range(3))


def test_muons_rate_may_be_a_tensor():
    """As in a CUDA graph, whose numbers stay as they were recorded."""
    with_number, with_tensor = muons_tensors("cpu"), muons_tensors("cpu")
    for rate in (0.01, 0.002):
        take_step(*with_number, rate)
        take_step(*with_tensor, torch.tensor(rate))
    for a, b in zip(sum(with_number, []), sum(with_tensor, [])):
        assert torch.allclose(a, b, rtol=1e-6, atol=1e-8)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="optional: no CUDA device")
def test_muons_graph_takes_the_same_steps():
    matrices, grads, momenta = muons_tensors("cuda")
    expected = [[v.clone() for v in values] for values in (matrices, grads, momenta)]
    recorded = Recorded(matrices, momenta)
    for rate in (0.01, 0.002, 0.005):
        recorded(grads, rate)
        take_step(*expected, rate)
        for a, b in zip(matrices + momenta, expected[0] + expected[2]):
            assert torch.allclose(a, b, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("mode, device, expected", [
    (None, "cuda", True), ("graphs", "cuda", True), ("disable", "cuda", False),
    ("default", "cuda", False), (None, "cpu", False), ("graphs", "cpu", False)])
def test_graphs_only_where_they_are_asked_for(mode, device, expected):
    """--compile disable does without Muon's, too."""
    team = SimpleNamespace(device=torch.device(device))
    assert parallel.uses_graphs({"compile": mode}, team) == expected
