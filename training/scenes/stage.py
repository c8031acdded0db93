"""What a layout fills, and placing things on its floor. Lengths are about metres, z is up."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from . import furniture as fu
from . import shapes as sh
from .mesh import Mesh, grid_mesh, merge, rotate, translate
from .pieces import Prints
from .plants import Parts


@dataclass
class Stage:
    """What a layout makes. eyes: pairs of boxes (lo, hi) for the camera and for its target."""

    parts: Parts = field(default_factory=list)
    lamps: list[dict] = field(default_factory=list)   # Mitsuba emitters without a shape
    eyes: list[tuple] = field(default_factory=list)
    sky: float = 0.0                                  # chance of an environment
    closed: bool = False
    extent: tuple = ((-5, -5, 0), (5, 5, 3))          # where fog may be
    prints: Prints | None = None                      # of slot "print"

    def add(self, parts: Parts, m: np.ndarray | None = None) -> None:
        self.parts += parts if m is None else fu.move(parts, m)

    def by_slot(self) -> dict[str, Mesh]:
        """One mesh for each material slot, in the order of their names."""
        parts: dict[str, list[Mesh]] = {}
        for slot, mesh in self.parts:
            parts.setdefault(str(slot), []).append(mesh)
        return {slot: merge(meshes) for slot, meshes in sorted(parts.items())}


def spin(rng: np.random.Generator) -> np.ndarray:
    return rotate((0, 0, 1), rng.uniform(0, sh.TAU))


def surface(rng: np.random.Generator, w: float, d: float) -> Mesh:
    """Floor or wall of w x d in z = 0 with uv in metres; a fifth of them with uneven normals."""
    if rng.random() < 0.8:
        return sh.quad(w, d).mapped((w, d))
    n = 150
    x, y = np.meshgrid(np.linspace(-w / 2, w / 2, n), np.linspace(-d / 2, d / 2, n))
    m = grid_mesh(np.stack([x, y, 0 * x], -1)).mapped((w, d))
    kind, strength = rng.integers(3), rng.uniform(0.02, 0.25)
    if kind == 0:    # waves
        height = sh.bumps(m.v, rng, 14, rng.uniform(2, 8)).reshape(n, n)
        slope = np.stack(np.gradient(height), -1) * n / max(w, d) * 0.3
    elif kind == 1:  # slabs, each tilted a little
        k = rng.normal(size=(40, 40, 2))
        size = rng.uniform(0.2, 0.8)
        slope = k[(y / size).astype(int) % 40, (x / size).astype(int) % 40]
    else:            # hammered
        slope = rng.normal(size=(n, n, 2))
    m.n = m.n - np.concatenate([slope.reshape(-1, 2)[:, ::-1] * strength, 0 * m.n[:, :1]], 1)
    m.n /= np.linalg.norm(m.n, axis=1, keepdims=True)
    return m


class Ground:
    """Places things on a floor without overlap; remembers discs."""

    def __init__(self, rng: np.random.Generator, lo, hi):
        self.rng, self.lo, self.hi = rng, np.asarray(lo, float), np.asarray(hi, float)
        self.discs: list[tuple[float, float, float]] = []

    def put(self, stage: Stage, parts: Parts, tries: int = 12, at=None, turn: bool = True,
            height=None) -> bool:
        """Stands parts somewhere free; height: function (x, y) -> z. False when nothing fits."""
        lo, hi = fu.bounds(parts)
        r = 0.5 * float(np.hypot(*(hi - lo)[:2])) * 0.9
        for _ in range(tries):
            x, y = self.rng.uniform(self.lo, self.hi) if at is None else at
            if all(np.hypot(x - a, y - b) > r + s for a, b, s in self.discs):
                self.discs.append((x, y, r))
                z = height(x, y) if height else 0.0
                stage.add(parts, translate(x, y, z) @ (spin(self.rng) if turn else np.eye(4)))
                return True
            if at is not None:
                return False
        return False
