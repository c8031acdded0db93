"""Joint bilateral filter with albedo and normal: the classical baseline."""

from __future__ import annotations

import numpy as np

RADIUS = 7  # pixels
# Spreads of the weights: distance (pixels), colour (log radiance), albedo, normal.
SPACE, COLOR, ALBEDO, NORMAL = 3.5, 1.2, 0.08, 0.15


def joint_bilateral(radiance: np.ndarray, albedo: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """[H,W,3] each; filters radiance divided by albedo, guided by all three."""
    height, width, _ = radiance.shape
    demodulated = radiance / (albedo + 0.01)
    guide = np.concatenate([np.log1p(radiance) / COLOR, albedo / ALBEDO, normal / NORMAL], -1)
    pad = ((RADIUS, RADIUS), (RADIUS, RADIUS), (0, 0))
    values = np.pad(demodulated.astype(np.float32), pad, "edge")
    guides = np.pad(guide.astype(np.float32), pad, "edge")
    total = np.zeros_like(demodulated, np.float32)
    weights = np.zeros((height, width, 1), np.float32)
    for dy in range(-RADIUS, RADIUS + 1):
        for dx in range(-RADIUS, RADIUS + 1):
            window = (slice(RADIUS + dy, RADIUS + dy + height),
                      slice(RADIUS + dx, RADIUS + dx + width))
            distance = ((guides[window] - guide) ** 2).sum(-1, keepdims=True)
            weight = np.exp(-0.5 * distance - 0.5 * (dx * dx + dy * dy) / SPACE**2)
            total += weight * values[window]
            weights += weight
    return total / weights * (albedo + 0.01)
