"""Bounds on integer weights under which x86's byte instructions are exact (docs/arithmetic.md).

Weights of equal sign of a group sum to at most 128. Groups are pairs, two weights that meet
neighbours along a run (columns outer, channels inner; what lies under one kernel row), or words:
every second pair of a run.
"""
from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

SUM_MAX = 128
WEIGHT_MAX = 127


def _runs(shape: tuple[int, ...]) -> np.ndarray:
    """[C*kh*kw, 2]: the kernel row of each of a kernel's weights, and its place in the run."""
    c, kh, kw = shape
    row, place = np.arange(kh)[:, None], np.arange(kw) * c
    place = np.arange(c)[:, None, None] + place
    return np.stack(np.broadcast_arrays(row, place), -1).reshape(-1, 2)


def pair_groups(shape: tuple[int, ...]) -> np.ndarray:
    """int [C*kh*kw]: the pair of each weight of a kernel [C,kh,kw]."""
    row, place = _runs(shape).T
    return row * ((shape[0] * shape[2] + 1) // 2) + place // 2


def word_groups(shape: tuple[int, ...]) -> np.ndarray:
    """int [C*kh*kw]: what meets the low words of a run's dwords, and what the high ones."""
    row, place = _runs(shape).T
    return row * 2 + place // 2 % 2


def own_groups(shape: tuple[int, ...]) -> np.ndarray:
    """int [C*kh*kw]: each weight alone, as those on wide inputs."""
    return np.arange(int(np.prod(shape)))


@dataclass(frozen=True)
class Bound:
    """What weights [O,K] must keep, a row per output; `group` [K] numbers each weight's group."""

    group: np.ndarray

    def of(self, columns: np.ndarray) -> Bound:
        """The bound of these columns, the others being 0."""
        return Bound(self.group[columns])

    @cached_property
    def _sorted(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Columns by group, where each of the G groups that occur begins, and which is whose."""
        _, starts, index = np.unique(np.sort(self.group), return_index=True, return_inverse=True)
        order = np.argsort(self.group, kind="stable")
        own = np.empty_like(order)
        own[order] = index
        return order, starts, own

    def _sums(self, q: np.ndarray) -> np.ndarray:
        """[O,G] of the positive weights."""
        order, starts, _ = self._sorted
        return np.add.reduceat(np.maximum(q, 0)[:, order], starts, 1)

    def norm(self, rows: np.ndarray) -> np.ndarray:
        """[O]: the least factor t >= 0 for which rows / t keep the bound before rounding."""
        return np.max([np.abs(rows).max(1, initial=0) / WEIGHT_MAX]
                      + [self._sums(v).max(1, initial=0) / SUM_MAX for v in (rows, -rows)], 0)

    def holds(self, q: np.ndarray) -> bool:
        return bool((self.norm(q) <= 1).all())

    def _most(self, q: np.ndarray) -> np.ndarray:
        room = (SUM_MAX - self._sums(q))[:, self._sorted[2]]
        return np.clip(room + np.maximum(q, 0), 0, WEIGHT_MAX)

    def limits(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest value [O,K] each weight may take, given the others of its row."""
        return -self._most(-q), self._most(q)

    def limits_of(self, k: int, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same [O], in integers, of column k, while columns are rounded in turn: those that
        are still to come count as they are wished, so that none takes their room."""
        group = self.group == self.group[k]
        def most(v: np.ndarray) -> np.ndarray:
            others = np.maximum(v[:, group], 0).sum(1) - np.maximum(v[:, k], 0)
            return np.clip(np.floor(SUM_MAX - others + 1e-9), 0, WEIGHT_MAX)
        return -most(-q), most(q)

    def nearest(self, wish: np.ndarray) -> np.ndarray:
        """[O,K] integers near `wish`: the nearest, then single steps towards 0 where a group's sum
        is too large, each of its weight that lies furthest beyond its wish."""
        q, rows = np.clip(np.rint(wish), -WEIGHT_MAX, WEIGHT_MAX), np.arange(len(wish))
        for sign in (1, -1):
            v = sign * q
            while True:
                excess = self._sums(v) > SUM_MAX
                if not excess.any():
                    break
                above = np.where((v > 0) & excess[:, self._sorted[2]], v - sign * wish, -np.inf)
                last = above.shape[1] - 1 - above[:, ::-1].argmax(1)  # of equal ones
                v[rows, last] -= excess.any(1)
            q = sign * v
        return q

    def kernels(self, wish: np.ndarray) -> np.ndarray:
        """The same of kernels [N,C,kh,kw], a row each, as int8."""
        return self.nearest(wish.reshape(len(wish), -1)).reshape(wish.shape).astype(np.int8)
