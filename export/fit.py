"""Rounding problems of layers: which inputs each weight meets, and weights as one row per output.

A row holds the source's weights ([C,3,3] flattened; for an upsampled source the four phases [C,2,2]
one after the other), then the skip's. Inputs are codes; those of wide tensors count 2^-shift.
"""
from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from export.bounds import Bound, own_groups, pair_groups, word_groups
from export.fold import phase_kernels
from export.graph import Layer
from export.reference import NARROW_MAX, WIDE_MAX, kinds

GOLDEN = 0.6180339887498949


@dataclass(frozen=True)
class Block:
    """Weights [O*phases,C,k,k] on one input tensor, in units of value per code of that input."""

    weight: np.ndarray
    wide: bool
    one_tap: bool = False  # only the tap in the middle counts, of kernels that are files' [C,1,1]

    def rows(self, outputs: int) -> np.ndarray:
        """[O, phases*C*k*k]"""
        w = self.weight.reshape(-1, outputs, self.weight[0].size)
        return w.transpose(1, 0, 2).reshape(outputs, -1)

    def unrows(self, rows: np.ndarray) -> np.ndarray:
        """The inverse of `rows`, as int8."""
        phases = len(self.weight) // len(rows)
        w = rows.reshape(len(rows), phases, -1).transpose(1, 0, 2)
        return np.ascontiguousarray(w.reshape(self.weight.shape).astype(np.int8))

    def groups(self, outputs: int, of_kernel: Callable[[tuple], np.ndarray]) -> np.ndarray:
        """int [phases*C*k*k]: groups of a row's weights."""
        shape = self.weight.shape[1:]
        one = (own_groups if self.wide else of_kernel)((shape[0], 1, 1) if self.one_tap else shape)
        one = np.repeat(one, shape[1] * shape[2]) if self.one_tap else one
        phases = len(self.weight) // outputs
        return (one + np.arange(phases)[:, None] * (one.max() + 1)).reshape(-1)


@dataclass(frozen=True)
class Fit:
    """A layer's weights as blocks: the source's and perhaps the skip's, those of the network's
    input perhaps in two: its wide channels, then its narrow ones."""

    layer: Layer
    outputs: int
    blocks: tuple[Block, ...]

    @property
    def mixed(self) -> bool:
        return len({b.wide for b in self.blocks}) > 1

    def counts(self, shift: int) -> np.ndarray:
        """[K]: accumulator units per (weight step x code)."""
        return np.concatenate([
            np.full(b.weight.size // self.outputs, 2.0**-shift if b.wide else 1.0)
            for b in self.blocks])

    def rows(self) -> np.ndarray:
        return np.concatenate([b.rows(self.outputs) for b in self.blocks], 1)

    def unrows(self, rows: np.ndarray) -> list[np.ndarray]:
        """The source's weights, and the skip's if there is one."""
        ends = np.cumsum([b.weight.size // self.outputs for b in self.blocks])[:-1]
        parts = [b.unrows(r) for b, r in zip(self.blocks, np.split(rows, ends, 1), strict=True)]
        if not self.layer.skip:
            return [np.concatenate(parts, 1)]
        return [parts[0], np.concatenate(parts[1:], 1)]

    def _bound(self, of_kernel: Callable[[tuple], np.ndarray]) -> Bound:
        parts, first = [], 0
        for b in self.blocks:
            parts.append(b.groups(self.outputs, of_kernel) + first)
            first = parts[-1].max() + 1
        return Bound(np.concatenate(parts))

    def pairs(self) -> Bound:
        """What every integer layer must keep."""
        return self._bound(pair_groups)

    def words(self) -> Bound | None:
        """What lets sums over a run stay in 16 bits; None where a source is wide."""
        return None if any(b.wide for b in self.blocks) else self._bound(word_groups)


def make_fit(layer: Layer, weight: np.ndarray, steps: Mapping[str, np.ndarray],
             wide: Sequence[str], one_tap: bool = False, aux: int = 0) -> Fit:
    """Blocks of a layer's float weights [O,I+J,3,3]; steps: value per code of each channel;
    one_tap: Block's; aux: channels of the network's input, the last ones, that are narrow."""
    weight = np.asarray(weight, np.float64)
    split, blocks = len(steps[layer.source]), []
    for name, w in ((layer.source, weight[:, :split]), (layer.skip, weight[:, split:])):
        if name is None:
            continue
        w = w * steps[name][:, None, None]
        w = phase_kernels(w) if layer.up and name == layer.source else w
        top = WIDE_MAX if name in wide else NARROW_MAX
        for channels, most in kinds(name, w.shape[1], top, aux):
            blocks.append(Block(w[:, channels], most > NARROW_MAX, one_tap))
    return Fit(layer, len(weight), tuple(blocks))


def evenly(count: int, wanted: int) -> np.ndarray:
    """At most `wanted` of `count` indices, spread evenly and without a period."""
    if count <= wanted:
        return np.arange(count)
    return np.unique((np.arange(wanted) * GOLDEN % 1.0 * count).astype(np.int64))


def _taps(rows: np.ndarray, y: np.ndarray, x: np.ndarray, k: int) -> np.ndarray:
    """[n, C*k*k]: what a kernel whose first tap is at (y, x) of the padded map sees."""
    taps = [rows[y + dy, x + dx] for dy in range(k) for dx in range(k)]
    return np.stack(taps, -1).reshape(len(y), -1).astype(np.float64)


def designs(layer: Layer, maps: Mapping[str, np.ndarray],
            wanted: int) -> Iterator[tuple[int, np.ndarray]]:
    """(phase, inputs [n,K']) of sampled output pixels: the phase's source taps, then the skip's."""
    source = np.pad(maps[layer.source], ((1, 1), (1, 1), (0, 0)))
    h, w = maps[layer.source].shape[:2]
    skip = np.pad(maps[layer.skip], ((1, 1), (1, 1), (0, 0))) if layer.skip else None
    phases = 4 if layer.up else 1
    pick = evenly(h * w, wanted // phases)
    y, x = pick // w, pick % w
    for phase in range(phases):
        py, px = (phase >> 1, phase & 1) if layer.up else (0, 0)
        parts = [_taps(source, y + py, x + px, 2 if layer.up else 3)]
        if skip is not None:
            f = 2 if layer.up else 1
            parts.append(_taps(skip, f * y + py, f * x + px, 3))
        yield phase, np.concatenate(parts, 1)


def second_moments(fit: Fit, runs: Sequence[Mapping[str, np.ndarray]],
                   wanted: int) -> np.ndarray:
    """[K,K] mean of x x' over sampled pixels of all runs; codes as they are (shift 0)."""
    first = fit.blocks[0].weight[0].size
    phases = len(fit.blocks[0].weight) // fit.outputs
    rest = sum(b.weight[0].size for b in fit.blocks[1:])
    size = first * phases + rest
    total, pixels = np.zeros((size, size)), 0
    for maps in runs:
        for phase, x in designs(fit.layer, maps, wanted // len(runs)):
            own = np.arange(phase * first, (phase + 1) * first)
            index = np.concatenate((own, np.arange(first * phases, size)))
            total[np.ix_(index, index)] += x.T @ x
            pixels += len(x)
    return total / max(pixels, 1)
