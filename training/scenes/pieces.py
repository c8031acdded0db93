"""Furniture of Sweet Home 3D libraries (.sh3f): zip archives with a catalogue and OBJ models, whose
pieces have true sizes, materials and pictures. Debian's sweethome3d-furniture has 800, CC-BY and
CC0."""

from __future__ import annotations

import functools
import os
import re
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from . import wavefront
from .furniture import bounds
from .mesh import Mesh, scale, translate
from .plants import Parts

MAX_BYTES = 2_000_000  # of an OBJ file
CELLS, TEXELS = 6, 256  # pictures of one scene, along each side of their atlas, and their size
REPEATS = 4             # a picture that a mesh repeats more often is only its mean colour
METAL = re.compile(r"metal|chrom|steel|alumin|inox|brass|silver|gold|iron|mirror", re.I)


_model = functools.lru_cache(512)(wavefront.read)  # most of a scene's time else
Reader = Callable[[str], np.ndarray]  # from a path to linear RGB (h, w, 3)


class Prints:
    """The pictures of one scene's pieces, in one bitmap."""

    def __init__(self, picture: Reader) -> None:
        self.picture = picture
        self.bitmap = np.full((CELLS * TEXELS, CELLS * TEXELS, 3), 0.5, np.float32)
        self.cells: dict[tuple, tuple[int, int]] = {}

    def mean(self, path: str) -> np.ndarray:
        return self.picture(path).reshape(-1, 3).mean(0)

    def place(self, path: str, m: Mesh) -> Mesh | None:
        """The mesh with its texture coordinates in a cell; None if it does not fit."""
        uv = m.uv - np.floor(m.uv.min(0) + 1e-4)
        times = np.maximum(np.ceil(uv.max(0) - 1e-3), 1).astype(int)
        key = (path, *times)
        if times.max() > REPEATS or (key not in self.cells and len(self.cells) == CELLS ** 2):
            return None
        if key not in self.cells:
            k = len(self.cells)
            self.cells[key] = y, x = k // CELLS * TEXELS, k % CELLS * TEXELS
            a = self.picture(path)
            rows, cols = (((np.arange(TEXELS) + 0.5) / TEXELS * t % 1 * n).astype(int)
                          for t, n in zip(times[::-1], a.shape))
            self.bitmap[y:y + TEXELS, x:x + TEXELS] = a[rows][:, cols]
        y, x = self.cells[key]
        inside = np.clip(uv / times * TEXELS, 0.5, TEXELS - 0.5)
        return Mesh(m.v, m.f, m.n, (inside + (x, y)) / (CELLS * TEXELS), m.c)


@dataclass
class Piece:
    """One piece: size (width, depth, height) in metres, back at +y; top: height of what stands on
    it, None for nothing; lights: where it shines, from the middle of its floor."""

    category: str
    size: np.ndarray
    elevation: float
    top: float | None
    door: bool
    turn: np.ndarray
    model: str
    source: Library
    lights: list[np.ndarray] = field(default_factory=list)

    def parts(self, prints: Prints) -> Parts:
        """Its meshes by material slot, standing on z = 0; raises ValueError for unusable models."""
        try:
            made = _model(self.source.extract(self.model))
        except (OSError, IndexError, KeyError, zipfile.BadZipFile) as err:
            raise ValueError(f"{self.model}: {err}") from None
        if not made:
            raise ValueError(f"{self.model}: no faces")
        made = [(m, mesh.moved(self.turn)) for m, mesh in made]
        lo, hi = bounds(made)
        fit = scale(*(self.size / np.maximum(hi - lo, 1e-6))) @ translate(
            *(-(lo + hi) / 2 * (1, 1, 0) - lo * (0, 0, 1)))
        return [_dress(material, mesh.moved(fit), prints) for material, mesh in made]


def _dress(m: wavefront.Material, mesh: Mesh, prints: Prints) -> tuple[str, Mesh]:
    """The slot that stands for a material, and the mesh in its colours."""
    rgb = np.clip(np.asarray(m.colour, float), 0, 1) ** 2.2 * 0.9
    if m.picture:
        placed = prints.place(m.picture, mesh)
        if placed:
            return "print", placed.coloured(np.ones(3))
        rgb = prints.mean(m.picture)
    elif m.opacity < 0.7:
        return "glass", mesh.coloured(np.ones(3))
    if METAL.search(m.name):
        return "metal", mesh.coloured(np.maximum(rgb, 0.3))
    return ("gloss" if m.shine > 0.2 and m.exponent > 40 else "paint"), mesh.coloured(rgb)


class Library:
    """An .sh3f file. Models are unpacked when they are first wanted, and deleted with it."""

    def __init__(self, path: str) -> None:
        """Raises OSError, ValueError, zipfile.BadZipFile."""
        self.zip = zipfile.ZipFile(path)
        self.folder = tempfile.TemporaryDirectory(prefix="lull-pieces-")
        self.names = set(self.zip.namelist())
        self.unpacked: set[str] = set()
        self.pieces = self._catalogue()

    def extract(self, name: str) -> str:
        folder = os.path.dirname(name)
        if folder not in self.unpacked:
            self.unpacked.add(folder)
            for other in self.names:
                if os.path.dirname(other) == folder and not other.endswith("/"):
                    self.zip.extract(other, self.folder.name)
        return os.path.join(self.folder.name, name)

    def _catalogue(self) -> list[Piece]:
        text = self.zip.read("PluginFurnitureCatalog.properties").decode("latin-1")
        rows: dict[int, dict[str, str]] = {}
        for key, k, value in re.findall(r"^(\w+)#(\d+)\s*=\s*(.*?)\s*$", text, re.M):
            rows.setdefault(int(k), {})[key] = value
        out = []
        for _, row in sorted(rows.items()):
            model = row.get("model", "").lstrip("/")
            if (not model.lower().endswith(".obj") or model not in self.names
                    or self.zip.getinfo(model).file_size > MAX_BYTES):
                continue
            size = np.array([float(row[x]) for x in ("width", "depth", "height")]) / 100
            turn = np.eye(4)
            if "modelRotation" in row:
                y_up = np.array([float(x) for x in row["modelRotation"].split()]).reshape(3, 3)
                swap = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)  # y up to z up
                turn[:3, :3] = swap @ y_up @ swap.T
            top = float(row.get("dropOnTopElevation", row["height"])) / 100
            at = ([float(x) / 100 for x in row.get(f"lightSource{a}", "").split()] for a in "XYZ")
            lights = [np.array([x - size[0] / 2, size[1] / 2 - y, z]) for x, y, z in zip(*at)]
            out.append(Piece(row.get("category", ""), size, float(row.get("elevation", 0)) / 100,
                             top if top > 0 else None, row.get("doorOrWindow") == "true",
                             turn, model, self, lights))
        if not out:
            raise ValueError("no piece of furniture with an OBJ model")
        return out

    def pictures(self, count: int) -> list[str]:
        """Paths of the largest pictures of its pieces, unpacked: stuff for floors and walls."""
        folders = {os.path.dirname(p.model) for p in self.pieces if p.category != "Characters"}
        jpgs = sorted((x for x in self.names if x.lower().endswith(".jpg")
                       and os.path.dirname(x) in folders),
                      key=lambda x: (-self.zip.getinfo(x).file_size, x))
        return [self.extract(x) for x in jpgs[:count]]
