"""Nearest upsampling folded into the convolution after it: four 2x2 kernels, one per phase."""
from __future__ import annotations

import numpy as np

# FOLD[p][d]: which of the three taps of an output row (or column) of parity p fall on source row d.
FOLD = np.array([[[1, 0, 0], [0, 1, 1]], [[1, 1, 0], [0, 0, 1]]], np.float64)


def phase_kernels(weight: np.ndarray) -> np.ndarray:
    """[O,C,3,3] -> [4*O,C,2,2]: row `phase * O + o`, phase = 2 * (y & 1) + (x & 1)."""
    folded = [np.einsum("ocyx,dy,ex->ocde", weight, FOLD[py], FOLD[px], optimize=True)
              for py in range(2) for px in range(2)]
    return np.concatenate(folded)
