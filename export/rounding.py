"""Rounding of weights to integers so that the layer's output changes least, not the weights.

For one output channel with wished weights w, integers q and inputs x (a random vector over pixels)
the error is E[((q - w) . x)^2] = (q - w)' H (q - w), H = E[x x']. Two starts are refined by single
steps of +-1 as long as one helps: rounding to nearest, and rounding one weight after the other with
its error passed on to those that follow (Frantar et al., "GPTQ", 2022).
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from export.bounds import Bound

STEPS_PER_WEIGHT = 3  # bound on refinement steps
DAMPING = 0.01        # share of the mean of the diagonal of H added to it: pixels are few


@dataclass(frozen=True)
class Problem:
    """Rounding problem of a layer: all its K weights per output channel in one row."""

    hessian: np.ndarray  # [K,K]
    bound: Bound

    def damped(self) -> np.ndarray:
        mean = max(float(np.trace(self.hessian)) / len(self.hessian), 1e-12)
        return self.hessian + np.eye(len(self.hessian)) * (DAMPING * mean)


def passed_on(wish: np.ndarray, problem: Problem) -> np.ndarray:
    """[O,K] integers within the bound, rounded column after column, heaviest inputs first."""
    hessian = problem.damped()
    order = np.argsort(-np.diag(hessian), kind="stable")
    inverse = np.linalg.inv(hessian[np.ix_(order, order)])
    factor = np.linalg.cholesky((inverse + inverse.T) / 2).T  # upper: inverse = factor' factor
    q = wish.copy()
    for i, k in enumerate(order):
        low, high = problem.bound.limits_of(k, q)
        wanted, q[:, k] = q[:, k].copy(), np.clip(np.rint(q[:, k]), low, high)
        error = (wanted - q[:, k]) / factor[i, i]
        q[:, order[i + 1:]] -= error[:, None] * factor[i, i + 1:]
    return q


def refined(q: np.ndarray, wish: np.ndarray, problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """q after the best single steps of +-1, and its errors [O]."""
    hessian, q = problem.damped(), q.copy()
    diagonal, rows = np.diag(hessian), np.arange(len(q))
    gradient = (q - wish) @ hessian
    for _ in range(STEPS_PER_WEIGHT * len(hessian)):
        low, high = problem.bound.limits(q)
        gain = 2 * np.abs(gradient) - diagonal  # of the step against the gradient
        step = -np.sign(gradient)
        allowed = (q + step >= low) & (q + step <= high)
        gain = np.where(allowed, gain, -1.0)
        k = gain.argmax(1)
        moves = gain[rows, k] > 1e-9 * diagonal[k]
        if not moves.any():
            break
        o, k = rows[moves], k[moves]
        change = step[o, k]
        q[o, k] += change
        gradient[o] += change[:, None] * hessian[k]
    return q, ((q - wish) * gradient).sum(1)


def rounded(wish: np.ndarray, problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Integers [O,K] near `wish` (float64 [O,K]) within the bound, and errors [O]."""
    best, error = refined(problem.bound.nearest(wish), wish, problem)
    other, other_error = refined(passed_on(wish, problem), wish, problem)
    take = other_error < error
    return np.where(take[:, None], other, best), np.where(take, other_error, error)
