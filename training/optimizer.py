"""Optimisers: Adam as in Open Image Denoise's toolkit, or Muon, which needs far fewer steps.

Muon (K. Jordan et al., "Muon: An optimizer for hidden layers in neural networks", 2024) replaces
the momentum of a matrix by the nearest matrix with orthogonal rows. Here the matrices are the
kernels of convolutions, [outputs, inputs * kernel height * kernel width]; biases, 1x1 heads and
layers of few outputs stay with Adam. Its steps are scaled to the size of Adam's (J. Liu et al.,
"Muon is scalable for LLM training", 2025), so that one learning rate serves both.
"""
from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

KINDS = ["adam", "muon"]
MOMENTUM = 0.95
DECAY = 0.1  # of Muon's matrices in a step, times the rate: steps of one length add up
STEPS, QUINTIC = 5, (3.4445, -4.7750, 2.0315)  # of Newton and Schulz's iteration, Jordan's factors
LEAST_OUTPUTS = 8  # of a layer whose kernels are a matrix worth the name


def adam(params: Iterable[Tensor], rate: float) -> torch.optim.Adam:
    """Adam, a step of it in one pass where there is such a thing."""
    params = list(params)
    return torch.optim.Adam(params, rate, fused=params[0].device.type in ("cpu", "cuda"))


def is_matrix(param: Tensor) -> bool:
    return param.ndim == 4 and param.shape[2] > 1 and param.shape[0] >= LEAST_OUTPUTS


def as_matrix(kernels: Tensor, like: Tensor) -> Tensor:
    """[O,I,h,w] as a matrix, its memory shared, in the order in which `like` lies in memory."""
    kernels = kernels.detach()
    return (kernels if like.is_contiguous() else kernels.permute(0, 2, 3, 1)).flatten(1)


def orthogonal(m: Tensor) -> Tensor:
    """A matrix with the singular vectors of m [r,c] and singular values from 0.7 to 1.2 (less for
    those that were almost 0).

    x -> a x + b (x x^T) x + c (x x^T)^2 x, five times; but x is only multiplied at the end: what
    comes before happens among the r x r (or c x c) products of its rows. In fp32, where PyTorch's
    own Muon takes bfloat16: several processes see the same numbers as one does.
    """
    x = m if m.shape[0] <= m.shape[1] else m.T
    x = x / x.norm().clamp(min=1e-7)
    gram = x @ x.T
    eye = torch.eye(len(gram), dtype=x.dtype, device=x.device)
    a, b, c = QUINTIC
    total = eye
    for _ in range(STEPS):
        factor = a * eye + b * gram + c * (gram @ gram)
        total = factor @ total
        gram = factor @ gram @ factor
    x = total @ x
    return x if m.shape[0] <= m.shape[1] else x.T


class Muon(torch.optim.Optimizer):
    """Nesterov's momentum of matrices, made orthogonal. On CUDA its steps may be a graph: they are
    some thirty small kernels for each matrix, which take longer to launch than to run."""

    def __init__(self, matrices: Iterable[Tensor], rate: float, as_graph: bool = False):
        super().__init__(matrices, {"lr": rate})
        self.as_graph, self.recorded = as_graph, None

    @torch.no_grad()
    def step(self) -> None:
        group, = self.param_groups
        matrices = [p for p in group["params"] if p.grad is not None]
        for p in matrices:
            if not self.state[p]:
                self.state[p]["momentum"] = torch.zeros_like(p)
        momenta = [self.state[p]["momentum"] for p in matrices]
        grads = [p.grad for p in matrices]
        if self.as_graph and len(matrices) == len(group["params"]):
            self.recorded = self.recorded or Recorded(matrices, momenta)
            self.recorded(grads, group["lr"])
        else:
            take_step(matrices, grads, momenta, group["lr"])

    def load_state_dict(self, state: dict) -> None:
        super().load_state_dict(state)
        self.recorded = None  # it knows the momenta of before


def take_step(matrices: list[Tensor], grads: list[Tensor], momenta: list[Tensor],
              rate: float | Tensor) -> None:
    """Muon's step, in place."""
    keep = 1 - DECAY * rate
    for p, grad, momentum in zip(matrices, grads, momenta):
        momentum.lerp_(grad, 1 - MOMENTUM)
        move = orthogonal(grad.lerp(momentum, MOMENTUM))
        p.mul_(keep).sub_(move.mul_(0.2 * max(p.shape) ** 0.5 * rate))


class Recorded:
    """take_step of some matrices as a CUDA graph."""

    def __init__(self, matrices: list[Tensor], momenta: list[Tensor]):
        self.grads = [torch.zeros_like(p) for p in matrices]
        self.rate = torch.zeros((), device=matrices[0].device)
        stream = torch.cuda.Stream()
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):  # once without effect: libraries set themselves up
            copies = [[v.clone() for v in values] for values in (matrices, momenta)]
            take_step(copies[0], self.grads, copies[1], self.rate)
        torch.cuda.current_stream().wait_stream(stream)
        self.graph = torch.cuda.CUDAGraph()
        # Loaders pin memory meanwhile, in another thread.
        with torch.cuda.graph(self.graph, stream=stream, capture_error_mode="thread_local"):
            take_step(matrices, self.grads, momenta, self.rate)

    def __call__(self, grads: list[Tensor], rate: float) -> None:
        torch._foreach_copy_(self.grads, grads)
        self.rate.fill_(rate)
        self.graph.replay()


class Optimizer:
    """One or two optimisers that take their steps together.

    as_graph: Muon's is a CUDA graph, for parameters that are there."""

    def __init__(self, params: Iterable[Tensor], rate: float, kind: str = "adam",
                 as_graph: bool = False):
        self.params = list(params)
        self.kernels = [p for p in self.params if kind == "muon" and is_matrix(p)]
        chosen = {id(p) for p in self.kernels}
        self.matrices = [as_matrix(p, p) for p in self.kernels]
        self.parts = [adam([p for p in self.params if id(p) not in chosen], rate)]
        if self.matrices:
            self.parts.append(Muon(self.matrices, rate, as_graph))

    def schedule(self, rate: float, beta1: float | None = None) -> None:
        """Learning rate and Adam's momentum of the steps to come."""
        for part in self.parts:
            for group in part.param_groups:
                group["lr"] = rate
                if beta1 is not None and "betas" in group:
                    group["betas"] = beta1, group["betas"][1]

    def zero_grad(self) -> None:
        for p in self.params:
            p.grad = None

    def take_gradients(self) -> None:
        """To be called between the gradients and `step`, or what looks at `parts`."""
        for p, m in zip(self.kernels, self.matrices):
            m.grad = None if p.grad is None else as_matrix(p.grad, p)

    def step(self) -> None:
        self.take_gradients()
        for part in self.parts:
            part.step()

    def state_dict(self) -> dict:
        first, *more = (part.state_dict() for part in self.parts)
        return {**first, "more": more} if more else first

    def load_state_dict(self, state: dict) -> None:
        for part, s in zip(self.parts, [state, *state.get("more", [])]):
            part.load_state_dict({"state": s["state"], "param_groups": s["param_groups"]})
