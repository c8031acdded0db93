"""Rooms furnished with the pieces of a library, as interior designers' scenes are."""

from __future__ import annotations

import numpy as np

from . import furniture as fu
from . import shapes as sh
from .mesh import rotate, translate
from .pieces import Piece, Prints, Reader
from .rooms import room_lights, shell
from .stage import Ground, Stage, spin

OUTSIDE = ("Vehicles", "Exterior")
SMALL = 0.6  # metres: what stands on other things


class _Shop:
    """Pieces to choose from; a model that does not load is not chosen again."""

    def __init__(self, rng: np.random.Generator, pieces: list[Piece], prints: Prints):
        self.rng, self.prints, self.bad = rng, prints, set()
        kinds = sorted({p.category for p in pieces} - set(OUTSIDE) - {"Characters"})
        chosen = set(rng.choice(kinds, min(3, len(kinds)), replace=False))
        self.pieces = [p for p in pieces if p.category in chosen
                       or (p.category not in OUTSIDE and rng.random() < 0.1)]

    def take(self, wanted) -> tuple[Piece, fu.Parts] | None:
        """A random piece for which wanted(piece) holds, and its parts."""
        stock = [p for p in self.pieces if p.model not in self.bad and wanted(p)]
        for _ in range(min(4, len(stock))):
            piece = stock[self.rng.integers(len(stock))]
            try:
                return piece, piece.parts(self.prints)
            except ValueError:
                self.bad.add(piece.model)
        return None


def _shine(rng, stage: Stage, piece: Piece, m: np.ndarray) -> None:
    """Bulbs where the piece has its lights, in half of the cases."""
    for at in piece.lights:
        if rng.random() < 0.5:
            stage.add([("light", sh.sphere(rng.uniform(0.01, 0.03), 12))], m @ translate(*at))


def _set_table(rng, stage: Stage, shop: _Shop, piece: Piece, m: np.ndarray) -> None:
    """Small things on top of a piece."""
    for _ in range(int(rng.integers(0, 5))):
        got = shop.take(lambda p: p.size.max() < SMALL and not p.elevation and not p.door)
        if got:
            at = rng.uniform(-0.4, 0.4, 2) * piece.size[:2]
            place = m @ translate(*at, piece.top) @ spin(rng)
            stage.add(got[1], place)
            _shine(rng, stage, got[0], place)


def home(rng: np.random.Generator, pieces: list[Piece], picture: Reader) -> Stage:
    """A room of 3 to 7 metres with 5 to 30 pieces."""
    w, d, h = rng.uniform(3, 7), rng.uniform(3, 7), rng.uniform(2.4, 3.4)
    st = Stage(sky=0.8, closed=True, extent=((-w / 2, -d / 2, 0), (w / 2, d / 2, h)),
               prints=Prints(picture))
    shell(rng, st, w, d, h)
    room_lights(rng, st, w, d, h)
    shop = _Shop(rng, pieces, st.prints)
    ground = Ground(rng, (-w / 2 + 0.4, -d / 2 + 0.4), (w / 2 - 0.4, d / 2 - 0.4))

    def stand(piece: Piece, parts: fu.Parts, m: np.ndarray) -> None:
        st.add(parts, m)
        _shine(rng, st, piece, m)
        if piece.top and 0.25 < piece.size[2] < 1.3 and piece.size[:2].min() > 0.25:
            _set_table(rng, st, shop, piece, m)

    for k in range(4):  # along the walls, backs to them
        length, depth = (w, d)[k % 2], (d, w)[k % 2] / 2
        x = -length / 2 + rng.uniform(0.1, 1)
        while x < length / 2 - 0.5:
            got = shop.take(lambda p, room=length / 2 - x: max(p.size[0], 0.4) < room
                            and p.size.max() > SMALL and p.size[1] < 1.2
                            and p.size[2] + p.elevation < h)
            if not got:
                break
            piece, parts = got
            at = (x + piece.size[0] / 2, depth - piece.size[1] / 2 - 0.01, piece.elevation)
            stand(piece, parts, rotate((0, 0, 1), k * np.pi / 2) @ translate(*at))
            x += piece.size[0] + rng.exponential(0.5)
    for _ in range(int(rng.integers(1, 6))):  # in the middle
        got = shop.take(lambda p: p.size.max() > 0.3 and not p.elevation and not p.door
                        and p.size[:2].max() < min(w, d) * 0.6 and p.size[2] < h)
        if got:
            before = len(ground.discs)
            if ground.put(Stage(), got[1]):
                x, y, _ = ground.discs[before]
                stand(*got, translate(x, y, 0) @ spin(rng))
    if rng.random() < 0.4:
        st.add(fu.rug(rng), translate(*rng.uniform(-0.2, 0.2, 2) * (w, d), 0) @ spin(rng))
    st.eyes = [(((-w * 0.46, -d * 0.46, 0.8), (w * 0.46, d * 0.46, 1.9)),
                ((-w * 0.45, -d * 0.45, 0.2), (w * 0.45, d * 0.45, 1.5)))]
    return st
