"""Triangle meshes as numpy arrays: primitives, transforms, merging, binary PLY."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass
class Mesh:
    """v: positions (n,3), f: triangles (m,3), n: normals (n,3), uv: (n,2), c: colours (n,3)."""

    v: np.ndarray
    f: np.ndarray
    n: np.ndarray
    uv: np.ndarray
    c: np.ndarray | None = None

    def moved(self, m: np.ndarray) -> Mesh:
        """Transformed by a 4x4 matrix; normals by its inverse transpose."""
        v = self.v @ m[:3, :3].T + m[:3, 3]
        n = self.n @ np.linalg.inv(m[:3, :3])
        n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-20)
        f = self.f[:, ::-1] if np.linalg.det(m[:3, :3]) < 0 else self.f
        return Mesh(v, f, n, self.uv, self.c)

    def mapped(self, scale=(1.0, 1.0), offset=(0.0, 0.0)) -> Mesh:
        """Texture coordinates scaled and shifted."""
        return Mesh(self.v, self.f, self.n, self.uv * np.asarray(scale) + np.asarray(offset),
                    self.c)

    def area(self) -> float:
        """Of all triangles."""
        t = self.v[self.f]
        normals = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
        return float(np.linalg.norm(normals, axis=1).sum() / 2)

    def coloured(self, rgb) -> Mesh:
        """One colour for all vertices, or (n,3) colours."""
        c = np.broadcast_to(np.asarray(rgb, np.float32), (len(self.v), 3))
        return Mesh(self.v, self.f, self.n, self.uv, c)


def merge(parts: list[Mesh]) -> Mesh:
    """One mesh of many."""
    if len(parts) == 1:
        return parts[0]
    base = np.cumsum([0] + [len(p.v) for p in parts[:-1]])
    colours = [p.c if p.c is not None else np.full((len(p.v), 3), 0.5) for p in parts]
    return Mesh(np.concatenate([p.v for p in parts]),
                np.concatenate([p.f + b for p, b in zip(parts, base)]),
                np.concatenate([p.n for p in parts]),
                np.concatenate([p.uv for p in parts]),
                np.concatenate(colours))


def smooth_normals(v: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Area-weighted vertex normals."""
    fn = np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]])
    n = np.zeros_like(v)
    for k in range(3):
        for axis in range(3):
            n[:, axis] += np.bincount(f[:, k], fn[:, axis], len(v))
    length = np.linalg.norm(n, axis=1, keepdims=True)
    n /= np.maximum(length, 1e-20)
    n[length[:, 0] < 1e-18] = (0, 0, 1)
    return n


def faceted(m: Mesh) -> Mesh:
    """Flat shading: every triangle gets its own vertices; triangles without area are dropped."""
    t = m.v[m.f]
    fn = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    size = np.linalg.norm(fn, axis=1)
    f = m.f[size > 1e-12]
    fn = fn[size > 1e-12] / size[size > 1e-12, None]
    c = None if m.c is None else m.c[f].reshape(-1, 3)
    return Mesh(m.v[f].reshape(-1, 3), np.arange(f.size).reshape(-1, 3), np.repeat(fn, 3, 0),
                m.uv[f].reshape(-1, 2), c)


def grid_mesh(p: np.ndarray, close_u: bool = False) -> Mesh:
    """Smooth surface through a grid of points p (rows, columns, 3); uv runs 0..1 along both.

    close_u: the last column repeats the first one (normals are joined there).
    """
    rows, cols = p.shape[:2]
    i = np.arange(rows * cols).reshape(rows, cols)
    a, b, c, d = i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]
    f = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3),
                        np.stack([a, c, d], -1).reshape(-1, 3)])
    v = p.reshape(-1, 3).astype(np.float64)
    n = smooth_normals(v, f).reshape(rows, cols, 3)
    if close_u:
        n[:, 0] = n[:, -1] = n[:, 0] + n[:, -1]
    n /= np.maximum(np.linalg.norm(n, axis=-1, keepdims=True), 1e-20)
    u, w = np.meshgrid(np.linspace(0, 1, cols), np.linspace(0, 1, rows))
    return Mesh(v, f, n.reshape(-1, 3), np.stack([u, w], -1).reshape(-1, 2))


def translate(x: float, y: float, z: float) -> np.ndarray:
    m = np.eye(4)
    m[:3, 3] = (x, y, z)
    return m


def scale(x: float, y: float | None = None, z: float | None = None) -> np.ndarray:
    return np.diag([x, x if y is None else y, x if z is None else z, 1.0])


def rotate(axis, angle: float) -> np.ndarray:
    """Rotation about an axis by an angle in radians."""
    a = np.asarray(axis, float)
    a = a / np.linalg.norm(a)
    k = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    m = np.eye(4)
    m[:3, :3] += np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k)
    return m


def align_z(d) -> np.ndarray:
    """Rotation that takes +z to direction d."""
    z = np.asarray(d, float)
    z = z / np.linalg.norm(z)
    x = np.cross((0.0, 1.0, 0.0) if abs(z[1]) < 0.9 else (1.0, 0.0, 0.0), z)
    x /= np.linalg.norm(x)
    m = np.eye(4)
    m[:3, :3] = np.stack([x, np.cross(z, x), z], 1)
    return m


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    q = rng.normal(size=3)
    return rotate(q if np.linalg.norm(q) > 1e-6 else (0, 0, 1), rng.uniform(0, 2 * np.pi))


def write_ply(path: str, m: Mesh) -> None:
    """Binary little-endian PLY with normals, texture coordinates and vertex colours (r, g, b)."""
    fields = ["x", "y", "z", "nx", "ny", "nz", "u", "v"]
    cols = [m.v, m.n, m.uv]
    if m.c is not None:
        fields += ["r", "g", "b"]
        cols.append(m.c)
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(m.v)}"]
    head += [f"property float {x}" for x in fields]
    head += [f"element face {len(m.f)}", "property list uchar int vertex_indices", "end_header"]
    face = np.empty(len(m.f), dtype=[("k", "u1"), ("i", "<i4", 3)])
    face["k"], face["i"] = 3, m.f
    with open(path, "wb") as out:
        out.write(("\n".join(head) + "\n").encode())
        out.write(np.concatenate(cols, 1).astype("<f4").tobytes())
        out.write(face.tobytes())
