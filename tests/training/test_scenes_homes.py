"""Rooms of furniture libraries: OBJ files with materials, .sh3f catalogues, pieces, homes."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from training.imageio import read_image, write_image
from training.scenes import furniture, homes, pieces, wavefront

from .test_scenes_render import SMALL, command, one_line

MTL = """newmtl wood
Kd 1 1 1
map_Kd wood plank.png
newmtl chrome_leg
Kd 0.5 0.5 0.5
newmtl pane
Kd 1 1 1
d 0.2
newmtl lacquer
Kd 1 0 0
Ks 0.5 0.5 0.5
Ns 100
"""


def cuboid(material: str, lo, hi, base: int, uv: float = 1.0) -> str:
    """Six quads with counted corners, y up, as OBJ text; base: vertices before."""
    corners = [[(lo, hi)[k >> a & 1][a] for a in range(3)] for k in range(8)]
    faces = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)]
    lines = [f"v {a} {b} {c}" for a, b, c in corners]
    if base == 0:
        lines += ["vt 0 0", f"vt {uv} 0", f"vt {uv} {uv}", f"vt 0 {uv}"]
    lines += [f"usemtl {material}"]
    lines += ["f " + " ".join(f"{base + v}/{k + 1}" for k, v in enumerate(f)) for f in faces]
    return "\n".join(lines) + "\n"


def catalogue(*rows: dict) -> str:
    out = ["id=Test", "# a comment"]
    for k, row in enumerate(rows, 1):
        given = {"category": "Kitchen", "width": 100, "depth": 50, "height": 80} | row
        out += [f"{key}#{k}={value}" for key, value in given.items()]
    return "\n".join(out)


@pytest.fixture
def library(tmp_path):
    """A folder with one library: a table of two materials, a cup, a lamp, and a broken model."""
    stock = tmp_path / "stock"
    stock.mkdir()
    write_image(tmp_path / "a.png", np.float32([[[1, 0, 0]] * 2, [[0, 0, 1]] * 2]))
    table = ("mtllib t.mtl\n" + cuboid("wood", (-2, 1, -1), (2, 1.2, 1), 0, 2)
             + cuboid("chrome_leg", (-0.1, 0, -0.1), (0.1, 1, 0.1), 8))
    cup = "mtllib ../t/t.mtl\n" + cuboid("lacquer", (0, 0, 0), (1, 1, 1), 0)
    with zipfile.ZipFile(stock / "few.sh3f", "w") as z:
        z.write(tmp_path / "a.png", "t/wood plank.png")
        z.writestr("t/t.mtl", MTL)
        z.writestr("t/table.obj", table)
        z.writestr("c/cup.obj", cup)
        z.writestr("b/broken.obj", "v 0 0 0\nf 1 2 3\n")
        z.writestr("PluginFurnitureCatalog.properties", catalogue(
            {"model": "/t/table.obj", "dropOnTopElevation": 75},
            {"model": "/c/cup.obj", "width": 8, "depth": 9, "height": 10, "lightSourceX": "4",
             "lightSourceY": "0", "lightSourceZ": "10"},
            {"model": "/b/broken.obj"},
            {"model": "/none.obj"}, {"model": "/t/table.dae"},
            {"model": "/t/table.obj", "modelRotation": "0 0 1 0 1 0 -1 0 0", "elevation": 120}))
    return stock / "few.sh3f"


def picture(path: str) -> np.ndarray:
    return read_image(Path(path))


def test_faces_keep_their_materials(library):
    shelf = pieces.Library(str(library))
    (wood, top), (leg, post) = wavefront.read(shelf.extract("t/table.obj"))
    assert wood.picture.endswith("wood plank.png") and leg.picture is None
    assert len(top.f) == len(post.f) == 12
    assert top.v[:, 2].min() == pytest.approx(1) == post.v[:, 2].max(), "y up turned to z up"
    t = top.v[top.f]
    face = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    middle = (t.mean(1) - top.v.mean(0))
    assert ((face * middle).sum(-1) > 0).all(), "faces look outwards as in the file"
    assert np.allclose(np.linalg.norm(top.n, axis=1), 1), "without normals: flat ones"


def test_negative_indices_and_polygons(tmp_path):
    path = tmp_path / "x.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv -1 1 0\nf -5 -4 -3 \\\n-2 -1\n")
    (_, m), = wavefront.read(str(path))
    assert len(m.f) == 3
    with pytest.raises((ValueError, IndexError)):
        path.write_text("v 0 0 0\nf 1 2 x\n")
        wavefront.read(str(path))


def test_pieces_have_the_size_of_the_catalogue(library):
    shelf = pieces.Library(str(library))
    table, cup, broken, turned = shelf.pieces
    prints = pieces.Prints(picture)
    for piece in (table, cup, turned):
        lo, hi = furniture.bounds(piece.parts(prints))
        assert np.allclose(hi - lo, piece.size) and lo[2] == pytest.approx(0)
        assert np.allclose((lo + hi)[:2], 0, atol=1e-9)
    assert table.top == 0.75 and cup.top == 0.1 and turned.elevation == 1.2
    assert np.allclose(cup.lights, [(0, 0.045, 0.1)]), "at its back"
    post = turned.parts(prints)[1][1]  # the thin leg, turned about the height
    assert np.ptp(post.v[:, 0]) / 1.0 == pytest.approx(0.1)
    assert np.ptp(post.v[:, 1]) / 0.5 == pytest.approx(0.05)
    with pytest.raises(ValueError, match="broken"):
        broken.parts(prints)


def test_materials_become_slots(library):
    prints = pieces.Prints(picture)
    table, cup, _, _ = pieces.Library(str(library)).pieces
    assert [slot for slot, _ in table.parts(prints)] == ["print", "metal"]
    (slot, m), = cup.parts(prints)
    assert slot == "gloss" and np.allclose(m.c, (0.9, 0, 0))
    assert pieces._dress(wavefront.Material(opacity=0.2), m, prints)[0] == "glass"


def test_a_repeated_picture_lies_in_one_cell(library):
    prints = pieces.Prints(picture)
    (_, m), _ = pieces.Library(str(library)).pieces[0].parts(prints)
    assert list(prints.cells.values()) == [(0, 0)]
    n = pieces.TEXELS
    cell = prints.bitmap[:n, :n]
    assert (cell[: n // 4] == (1, 0, 0)).all() and (cell[n // 4: n // 2] == (0, 0, 1)).all()
    assert (cell[n // 2: 3 * n // 4] == (1, 0, 0)).all(), "twice, as the mesh asks"
    assert m.uv.min() > 0 and m.uv.max() * pieces.CELLS < 1
    m.uv = m.uv * 9
    many = wavefront.Material(picture=next(iter(prints.cells))[0])
    far = pieces.Mesh(m.v, m.f, m.n, np.array([[0, 0], [9, 9]]), None)
    slot, plain = pieces._dress(many, far, prints)
    assert slot == "paint" and np.allclose(plain.c[0], (0.5, 0, 0.5)), "too often: its mean"


def test_a_home_stands_on_its_floor(library):
    shelf = pieces.Library(str(library))
    for seed in range(6):
        rng = np.random.default_rng(seed)
        st = homes.home(rng, shelf.pieces, picture)
        (x0, y0, _), (x1, y1, h) = st.extent
        slots = {slot for slot, _ in st.parts}
        assert "print" in slots and "floor" in slots
        for slot, m in st.parts:
            if slot in ("print", "gloss"):
                lo, hi = m.v.min(0), m.v.max(0)
                assert lo[2] >= -1e-6 and hi[2] <= h
                assert x0 - 0.6 < lo[0] and hi[0] < x1 + 0.6 and y0 - 0.6 < lo[1]


def test_libraries_are_rendered(root, library, tmp_path):
    run = command(root, "render", tmp_path / "out", "--seeds", "3,4,5", "--assets", library.parent,
                  *SMALL)
    assert run.returncode == 0, run.stderr
    assert " home " in run.stdout
    (library.parent / "bad.sh3f").write_text("no archive")
    run = command(root, "render", tmp_path / "new", "--seeds", "3", "--assets", library.parent,
                  *SMALL)
    one_line(run, 3, "bad.sh3f")
