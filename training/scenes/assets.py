"""A user's folder of meshes (.ply, .obj), pictures (.png, .jpg), environments (.exr, .hdr) and
furniture libraries (.sh3f)."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from training.errors import DATA, ToolError

from .homes import home
from .mesh import Mesh, rotate, scale, smooth_normals, translate
from .pieces import Library, Piece, Reader
from .stage import Stage

MAX_TRIANGLES = 400_000
HOMES = 0.8               # share of rooms of pieces, where there are libraries of them
LIBRARY_PICTURES = 24     # of each library, for floors and walls


@dataclass
class Assets:
    """What was found. meshes stand on z = 0 and fit a unit cube."""

    meshes: list[Mesh] = field(default_factory=list)
    pictures: list[np.ndarray] = field(default_factory=list)
    skies: list[np.ndarray] = field(default_factory=list)
    pieces: list[Piece] = field(default_factory=list)
    picture: Reader | None = None  # of the pieces' own

    def home(self, rng: np.random.Generator) -> tuple[str, Stage] | None:
        """A room of the libraries' pieces, in four scenes of five; None without any."""
        if not self.pieces or rng.random() > HOMES:
            return None
        return "home", home(rng, self.pieces, self.picture)

    def add(self, path: str) -> None:
        """The pieces of a library, and some of its pictures."""
        library = Library(path)
        self.pieces += library.pieces
        self.pictures += [self.picture(p) for p in library.pictures(LIBRARY_PICTURES)]

    def read(self, folder: str, readers: dict[tuple[str, ...], Callable[[str], object]]) -> None:
        """The files of a folder and its subfolders, in sorted order: libraries, and what there are
        readers for, by the ends of names. Raises ToolError for unreadable ones."""
        if not os.path.isdir(folder):
            raise ToolError(f"--assets: {folder} is not a folder", DATA)
        readers = {**readers, (".sh3f",): self.add}
        read = 0
        for path in sorted(os.path.join(d, x) for d, _, files in os.walk(folder) for x in files):
            for ends, reader in readers.items():
                if path.lower().endswith(ends):
                    read += 1
                    try:
                        reader(path)
                    except (RuntimeError, ValueError, KeyError, OSError,
                            zipfile.BadZipFile) as err:
                        raise ToolError(f"--assets: {path}: {str(err).splitlines()[0]}",
                                        DATA) from None
        if not read:
            ends = ", ".join(x for e in readers for x in e)
            raise ToolError(f"--assets: {folder} holds no file that is of use ({ends})", DATA)

    def furnish(self, rng: np.random.Generator, stage) -> None:
        """Stands some of the meshes on the floor of a stage."""
        if not self.meshes:
            return
        (lo, hi) = (np.asarray(x, float) for x in stage.extent)
        half = (hi - lo)[:2] * 0.3
        for _ in range(int(rng.integers(1, 6))):
            m = self.meshes[rng.integers(len(self.meshes))]
            size = float(rng.uniform(0.08, 0.3) * min(hi - lo))
            at = translate(*rng.uniform(-half, half), 0.0)
            slot = ("paint", "gloss", "metal", "special", "glass")[rng.integers(5)]
            m = m.moved(at @ rotate((0, 0, 1), rng.uniform(0, 2 * np.pi)) @ scale(size))
            stage.add([(slot, m.coloured(rng.uniform(0.05, 0.9, 3)))])


def _mesh(mi, path: str) -> Mesh:
    kind = "ply" if path.lower().endswith(".ply") else "obj"
    p = mi.traverse(mi.load_dict({"type": kind, "filename": path}))
    v = np.array(p["vertex_positions"], np.float64).reshape(-1, 3)
    f = np.array(p["faces"], np.int64).reshape(-1, 3)
    if len(f) == 0 or len(f) > MAX_TRIANGLES:
        raise ValueError(f"{len(f)} triangles; between 1 and {MAX_TRIANGLES} are wanted")
    n = np.array(p["vertex_normals"], np.float64).reshape(-1, 3)
    uv = np.array(p["vertex_texcoords"], np.float64).reshape(-1, 2)
    if kind == "obj":  # y is up by custom
        turn = rotate((1, 0, 0), np.pi / 2)[:3, :3]
        v, n = v @ turn.T, n @ turn.T
    lo, hi = v.min(0), v.max(0)
    v = (v - ((lo + hi) / 2 * (1, 1, 0) + lo * (0, 0, 1))) / max(float((hi - lo).max()), 1e-9)
    n = n if len(n) else smooth_normals(v, f)
    uv = uv if len(uv) else v[:, :2] + 0.5
    return Mesh(v, f, n, uv)


def _image(mi, path: str) -> np.ndarray:
    from . import backend
    with backend.reading():
        b = mi.Bitmap(path).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
    return np.nan_to_num(np.array(b), posinf=6e4, neginf=0.0).clip(0, 6e4)


def load(mi, folder: str | None) -> Assets:
    """Reads a folder (with subfolders), in sorted order. Raises ToolError for unreadable files."""
    out = Assets(picture=lambda path: np.clip(_image(mi, path), 0.0, 1.0))
    if folder is not None:
        out.read(folder, readers={
            (".ply", ".obj"): lambda path: out.meshes.append(_mesh(mi, path)),
            (".png", ".jpg", ".jpeg"): lambda path: out.pictures.append(out.picture(path)),
            (".exr", ".hdr"): lambda path: out.skies.append(_image(mi, path))})
    return out
