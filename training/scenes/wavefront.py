"""Wavefront OBJ files with their materials: one mesh per material (Mitsuba's own reader merges
them). The parts of the format that furniture uses: v, vt, vn, f of any number of corners, usemtl;
of materials Kd, Ks, Ns, d, Tr and map_Kd."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from .mesh import Mesh, faceted, rotate


@dataclass
class Material:
    """colour, shine: Kd and Ks as written, about sRGB; picture: path of map_Kd or None."""

    name: str = ""
    colour: tuple[float, ...] = (0.6, 0.6, 0.6)
    shine: float = 0.0
    exponent: float = 0.0
    opacity: float = 1.0
    picture: str | None = None


def _lines(path: str):
    with open(path, encoding="latin-1") as f:
        for line in f.read().replace("\\\n", " ").splitlines():
            key, _, rest = line.strip().partition(" ")
            if key and not key.startswith("#"):
                yield key, rest.strip()


def materials(path: str) -> dict[str, Material]:
    """The materials of an MTL file by name; raises OSError, ValueError."""
    out: dict[str, Material] = {}
    m = Material()
    for key, rest in _lines(path):
        if key == "newmtl":
            m = out[rest] = Material(rest)
        elif key == "Kd":
            m.colour = tuple(float(x) for x in rest.split()[:3])
        elif key == "Ks":
            m.shine = float(np.mean([float(x) for x in rest.split()[:3]]))
        elif key == "Ns":
            m.exponent = float(rest)
        elif key == "d":
            m.opacity = float(rest.split()[-1])
        elif key == "Tr":
            m.opacity = 1 - float(rest)
        elif key == "map_Kd":
            names = (x.replace("\\", "/") for x in (rest, *rest.split()[-1:]))  # or behind options
            paths = (os.path.join(os.path.dirname(path), x) for x in names)
            m.picture = next(filter(os.path.isfile, paths), None)
    return out


def _corner(text: str, counts) -> tuple[int, int, int]:
    """Indices of position, texture coordinates and normal from 0; -1 = none."""
    parts = text.split("/") + ["", ""]
    out = []
    for part, n in zip(parts, counts):
        k = int(part) if part else 0
        out.append(n + k if k < 0 else k - 1)
    return out[0], out[1], out[2]


def read(path: str) -> list[tuple[Material, Mesh]]:
    """The parts of an OBJ file, y up turned to z up; raises OSError, ValueError, IndexError."""
    points: tuple[list, list, list] = ([], [], [])
    kinds = {"v": 0, "vt": 1, "vn": 2}
    table: dict[str, Material] = {}
    faces: dict[str, list] = {}
    now = faces.setdefault("", [])
    for key, rest in _lines(path):
        if key in kinds:
            n = 2 if key == "vt" else 3
            points[kinds[key]].append([float(x) for x in (rest.split() + ["0"])[:n]])
        elif key == "f":
            counts = [len(p) for p in points]
            c = [_corner(x, counts) for x in rest.split()]
            now.extend((c[0], c[k], c[k + 1]) for k in range(1, len(c) - 1))
        elif key == "usemtl":
            now = faces.setdefault(rest, [])
        elif key == "mtllib":
            lib = os.path.join(os.path.dirname(path), rest)
            if os.path.isfile(lib):
                table |= materials(lib)
    v, vt, vn = (np.array(p, np.float64).reshape(-1, n) for p, n in zip(points, (3, 2, 3)))
    turn = rotate((1, 0, 0), np.pi / 2)
    out = []
    for name, corners in faces.items():
        if corners:
            index = np.array(corners).reshape(-1, 3)
            if index[:, 0].min() < 0:
                raise ValueError(f"{name}: a face before its vertices")
            unique, f = np.unique(index, axis=0, return_inverse=True)
            flat = len(vn) == 0 or (unique[:, 2] < 0).any()
            uv = vt[unique[:, 1]] if len(vt) and (unique[:, 1] >= 0).all() else (
                np.zeros((len(unique), 2)))
            m = Mesh(v[unique[:, 0]], f.reshape(-1, 3),
                     np.zeros((len(unique), 3)) if flat else vn[unique[:, 2]],
                     uv * (1, -1) + (0, 1))  # v downwards, as bitmaps are read
            out.append((table.get(name, Material(name)), (faceted(m) if flat else m).moved(turn)))
    return out
