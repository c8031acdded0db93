"""Albedo as it counts in family K, in numpy, docs/kernel-prediction.md, to the bit."""
from __future__ import annotations

import numpy as np

F = np.float32
ALBEDO_MOST = F(64)    # of lamps, whose albedo is their light; what is above 4 counts as ...
LAMP = F(0.25)         # ... this part of it
EMPTY_ALBEDO = F(0.1)  # of pixels that show neither a surface nor light
EMPTY_RUN = 4          # pixels of a row that say together what is empty, and what a spark


def runs_of(image: np.ndarray) -> np.ndarray:
    """Rows [H,W,...] by runs of pixels, [H,R,EMPTY_RUN,...], with zeros behind the last."""
    more = ((0, 0), (0, -image.shape[1] % EMPTY_RUN), *((0, 0),) * (image.ndim - 2))
    return np.pad(image, more).reshape(len(image), -1, EMPTY_RUN, *image.shape[2:])


def without_sparks(albedo: np.ndarray) -> np.ndarray:
    """Albedo [H,W,3] whose pixels have beyond 1 no more than the others of their run together."""
    runs = runs_of(albedo)
    others = np.zeros_like(runs)
    for own in range(EMPTY_RUN):
        for i in range(EMPTY_RUN):
            if i != own:
                others[:, :, own] += runs[:, :, i]
    most = np.maximum(others, F(1)).reshape(len(albedo), -1, 3)[:, :albedo.shape[1]]
    return np.minimum(albedo, most)


def counted_albedo(albedo: np.ndarray, radiance: np.ndarray,
                   is_clean: bool = False) -> np.ndarray:
    """Sanitised albedo [H,W,3], up to ALBEDO_MOST, as it counts: lamps dimmed, sparks as bright as
    what is beside them, and where all channels are 0 it is 1, or, unless it is clean, EMPTY_ALBEDO
    where in runs of EMPTY_RUN pixels of a row none of these has radiance (or codes of it)
    [H,W,3]."""
    width = albedo.shape[1]
    albedo = without_sparks(np.where(albedo > 1, np.maximum(albedo * LAMP, F(1)), albedo))
    black = ~(albedo > 0).any(-1)
    light = runs_of(black & (radiance > 0).any(-1))
    is_lit = light.any(-1).repeat(EMPTY_RUN, 1)[:, :width]
    fill = np.where(is_lit | is_clean, F(1), EMPTY_ALBEDO)
    return np.where(black[..., None], fill[..., None], albedo)
