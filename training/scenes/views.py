"""Where to look at a scene from: the best of some random views by depth and detail."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .stage import Stage

RAYS = 32  # along each side of a view


@dataclass(frozen=True)
class View:
    """fov: degrees along the shorter side; roll: x of the up vector, whose z is 1; aperture: lens
    radius, 0 = pinhole, in focus at the distance `focus`."""

    eye: np.ndarray
    target: np.ndarray
    fov: float
    roll: float
    aperture: float = 0.0
    focus: float = 0.0


# From a place and unit vectors (n, 3): distances (n; inf = miss) and ids of the surfaces seen.
Probe = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def rays(eye: np.ndarray, target: np.ndarray, fov: float, n: int = RAYS) -> np.ndarray:
    """Unit vectors through n x n pixels of a view, (n * n, 3), row by row."""
    d = target - eye
    d = d / np.linalg.norm(d)
    x = np.cross(d, (0, 0, 1.0))
    x /= max(np.linalg.norm(x), 1e-9)
    y = np.cross(x, d)
    t = np.tan(np.radians(fov) / 2) * (2 * (np.arange(n) + 0.5) / n - 1)
    dirs = d + x * t[None, :, None] - y * t[:, None, None]
    return (dirs / np.linalg.norm(dirs, axis=-1, keepdims=True)).reshape(-1, 3)


def score(dist: np.ndarray, ids: np.ndarray, near: float) -> float:
    """How worth looking at a view (n, n) is; -1 for a bad one."""
    hit = np.isfinite(dist)
    if hit.mean() < 0.3 or np.percentile(dist, 3) < near:
        return -1.0
    log = np.log(np.where(hit, dist, dist[hit].max() * 2))
    edges = sum((np.abs(np.diff(log, axis=k)) > 0.1).mean() for k in (0, 1))
    return float(min(edges, 0.5) + 0.2 * log.std() + 0.1 * (np.diff(ids, axis=0) != 0).mean())


def choose(rng: np.random.Generator, stage: Stage, name: str, probe: Probe) -> View:
    """The best of 8 to 24 views of a stage; raises ValueError if none is any good."""
    best = (-2.0, None)
    near = 0.12 if name == "still" else 0.35
    for k in range(24):
        (elo, ehi), (tlo, thi) = stage.eyes[rng.integers(len(stage.eyes))]
        eye, target = rng.uniform(elo, ehi), rng.uniform(tlo, thi)
        fov = float(rng.uniform(30, 75))
        if np.hypot(*(eye - target)[:2]) < 0.4:
            continue
        dist, ids = (x.reshape(RAYS, RAYS) for x in probe(eye, rays(eye, target, fov)))
        s = score(dist, ids, near)
        if s > best[0]:
            best = (s, (eye, target, fov, dist))
        if k >= 7 and best[0] > 0:
            break
    if best[1] is None or best[0] < 0:
        raise ValueError("no view")
    eye, target, fov, dist = best[1]
    roll = float(rng.normal() * 0.03)
    if rng.random() >= 0.28:
        return View(eye, target, fov, roll)
    focus = float(rng.choice(dist[np.isfinite(dist)]))
    return View(eye, target, fov, roll, focus * float(rng.uniform(0.004, 0.035)), focus)
