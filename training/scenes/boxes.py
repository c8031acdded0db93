"""Rooms of boxes, drawn without a renderer: walls, cupboards, windows, stairs, shelves, rails.

Everything is an axis-aligned box, seen through a pinhole: a ray meets it where it has entered all
three pairs of its planes. Edges are long and straight and lines often finer than a pixel, as in
pictures of interiors. Lengths are in metres, x and y along the floor, z up.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

NEAR = 0.05            # of the camera


class Seen(NamedTuple):
    """What the points of a picture show; faces are counted from 1, 0 is outside, a sky.

    number [2h,w] int32: faces, as seen past panes of glass, and below as seen on them; u, v
    [2h,w]: places on the faces, metres; pane [h,w]: share of the samples that see the second;
    body [count + 1]: whose colours the faces have, at most count; axis, sign [count + 1]: where
    they look.
    """
    number: np.ndarray
    u: np.ndarray
    v: np.ndarray
    pane: np.ndarray
    body: np.ndarray
    axis: np.ndarray
    sign: np.ndarray


class Room:
    """Boxes that furnish a room of a size: lists of low and high corners; holes show the sky,
    panes are of glass."""

    def __init__(self, rng: np.random.Generator):
        self.rng = rng
        self.size = rng.uniform((3, 3, 2.3), (8, 8, 4))
        self.low, self.high, self.is_hole, self.is_pane = [], [], [], []
        self.body = []
        self.wall = self.piece = 0

    def add(self, at, to, is_hole: bool = False, is_pane: bool = False,
            is_own: bool = False) -> None:
        """A box from `at` to `to`: (along the wall, away from it, up); of a colour of its own or
        that of the piece."""
        (a0, d0, z0), (a1, d1, z1) = at, to
        axis, far = self.wall % 2, self.wall // 2  # of the way along the wall; at which end
        depth = self.size[1 - axis]
        if far:
            d0, d1 = depth - d1, depth - d0
        low, high = ((a0, d0, z0), (a1, d1, z1)) if axis == 0 else ((d0, a0, z0), (d1, a1, z1))
        self.low.append(np.minimum(low, high))
        self.high.append(np.maximum(low, high))
        self.is_hole.append(is_hole)
        self.is_pane.append(is_pane)
        self.body.append(7 + len(self.low) if is_own else self.piece)

    def span(self, least: float, most: float) -> tuple[float, float]:
        """A stretch of the wall."""
        whole = self.size[self.wall % 2]
        length = min(self.rng.uniform(least, most), whole)
        start = self.rng.uniform(0, whole - length)
        return start, start + length

    def frame(self, a0, a1, z0, z1, d0, d1, width) -> None:
        """Four bars around a field of a wall."""
        self.add((a0, d0, z0), (a0 + width, d1, z1))
        self.add((a1 - width, d0, z0), (a1, d1, z1))
        self.add((a0 + width, d0, z1 - width), (a1 - width, d1, z1))
        self.add((a0 + width, d0, z0), (a1 - width, d1, z0 + width))

    def cupboard(self) -> None:
        """Doors with gaps between them, some with a raised frame, some with handles."""
        rng = self.rng
        a0, a1 = self.span(0.6, 5)
        z0 = rng.choice([0.0, 0.1, rng.uniform(1.2, 1.6)])
        z1, depth = z0 + rng.uniform(0.4, 2), rng.uniform(0.25, 0.7)
        self.add((a0, 0, z0), (a1, depth, z1))
        gap, thick = rng.uniform(0.002, 0.015), rng.uniform(0.01, 0.03)
        nx, nz = max(1, int((a1 - a0) / rng.uniform(0.35, 0.9))), int(rng.integers(1, 5))
        border = rng.uniform(0.03, 0.09) if rng.random() < 0.5 else 0
        handle = rng.integers(0, 4)
        xs, zs = np.linspace(a0, a1, nx + 1), np.linspace(z0, z1, nz + 1)
        for x0, x1 in zip(xs, xs[1:], strict=False):
            for y0, y1 in zip(zs, zs[1:], strict=False):
                self.add((x0 + gap, depth, y0 + gap), (x1 - gap, depth + thick, y1 - gap))
                front = depth + thick
                if border:
                    self.frame(x0 + gap, x1 - gap, y0 + gap, y1 - gap, front,
                               front + rng.uniform(0.004, 0.02), border)
                middle, upper = (x0 + x1) / 2, y1 - 0.2 * (y1 - y0)
                if handle == 1:
                    self.add((middle - 0.07, front, upper), (middle + 0.07, front + 0.03,
                                                             upper + 0.012))
                elif handle == 2:
                    self.add((x1 - 0.06, front, upper - 0.15), (x1 - 0.048, front + 0.03, upper))
                elif handle == 3:
                    self.add((middle - 0.02, front, upper), (middle + 0.02, front + 0.03,
                                                             upper + 0.04))

    def window(self) -> None:
        """A hole with a frame and glazing bars, some with a sill, a blind or a pane."""
        rng = self.rng
        a0, a1 = self.span(0.6, 3)
        z0 = rng.uniform(0.0, 1.0)
        z1 = min(z0 + rng.uniform(0.8, 2.5), self.size[2] - 0.1)
        self.add((a0, 0, z0), (a1, 0.004, z1), is_hole=rng.random() < 0.7)
        width = rng.uniform(0.02, 0.1)
        self.frame(a0, a1, z0, z1, 0, 0.06, width)
        bar = rng.uniform(0.008, 0.04)
        for x in np.linspace(a0, a1, int(rng.integers(1, 6)) + 1)[1:-1]:
            self.add((x - bar / 2, 0, z0), (x + bar / 2, 0.04, z1))
        for z in np.linspace(z0, z1, int(rng.integers(1, 6)) + 1)[1:-1]:
            self.add((a0, 0, z - bar / 2), (a1, 0.04, z + bar / 2))
        if rng.random() < 0.5:
            self.add((a0 - 0.1, 0, z0 - 0.03), (a1 + 0.1, 0.15, z0))
        if rng.random() < 0.25:
            pitch = rng.uniform(0.02, 0.06)
            for z in np.arange(z0 + (z1 - z0) * rng.uniform(0, 0.7), z1, pitch):
                self.add((a0, 0.07, z), (a1, 0.07 + pitch * 0.7, z + 0.003))
        elif rng.random() < 0.4:
            self.add((a0, 0.045, z0), (a1, 0.05, z1), is_pane=True)

    def shelf(self) -> None:
        """Boards, and books of all widths and heights."""
        rng = self.rng
        a0, a1 = self.span(0.5, 3)
        z0, depth, thick = rng.choice([0.0, 1.0]), rng.uniform(0.2, 0.4), rng.uniform(0.01, 0.04)
        levels = int(rng.integers(1, 7))
        step = rng.uniform(0.25, 0.4)
        for k in range(levels + 1):
            z = z0 + k * step
            self.add((a0, 0, z), (a1, depth, z + thick))
            x = a0
            while k < levels and x < a1 - 0.06 and rng.random() < 0.96:
                width = rng.uniform(0.012, 0.06)
                self.add((x, 0, z + thick), (x + width * 0.95, depth * rng.uniform(0.5, 0.95),
                                             z + step * rng.uniform(0.5, 0.9)),
                         is_own=True)
                x += width if rng.random() < 0.9 else rng.uniform(0.05, 0.4)
        for x in (a0, a1 - thick):
            self.add((x, 0, z0), (x + thick, depth, z0 + levels * step))

    def stairs(self) -> None:
        """Steps along the wall, solid or not, with or without a railing of bars or of glass."""
        rng = self.rng
        a0, a1 = self.span(2, 5)
        count = int(rng.integers(4, 18))
        rise, run = min(0.19, (self.size[2] - 0.3) / count), (a1 - a0) / count
        near = rng.uniform(0, 1.5)
        width, is_solid = rng.uniform(0.7, 1.5), rng.random() < 0.4
        thick = rng.uniform(0.03, 0.08)
        turn = rng.random() < 0.5
        rail = rng.integers(0, 3)
        for k in range(count):
            x0 = a1 - (k + 1) * run if turn else a0 + k * run
            z = (k + 1) * rise
            self.add((x0, near, 0 if is_solid else z - thick), (x0 + run, near + width, z))
            if rail == 1:
                self.add((x0 + run / 2, near + width - 0.03, z),
                         (x0 + run / 2 + 0.02, near + width - 0.01, z + 0.9))
        if rail == 2:
            self.add((a0, near + width, 0), (a1, near + width + 0.01, count * rise + 0.5),
                     is_pane=True)

    def table(self) -> None:
        """A plate on four legs, with small things on it; large, or a chair."""
        rng = self.rng
        length, width, height = rng.uniform((0.4, 0.4, 0.35), (2.2, 1.1, 0.9))
        a0, _ = self.span(length, length)
        near = rng.uniform(0.2, max(0.3, self.size[1 - self.wall % 2] - width - 0.2))
        thick, leg = rng.uniform(0.015, 0.06), rng.uniform(0.015, 0.07)
        self.add((a0, near, height - thick), (a0 + length, near + width, height))
        for x in (a0 + 0.03, a0 + length - 0.03 - leg):
            for d in (near + 0.03, near + width - 0.03 - leg):
                self.add((x, d, 0), (x + leg, d + leg, height - thick))
        if rng.random() < 0.4:  # the back of a chair
            for z in np.linspace(height + 0.1, height + 0.5, int(rng.integers(1, 6))):
                self.add((a0, near, z), (a0 + length, near + 0.02, z + 0.03))
            for x in (a0, a0 + length - leg):
                self.add((x, near, height), (x + leg, near + 0.02, height + 0.55))
        for _ in range(int(rng.integers(0, 8))):
            x, d = a0 + rng.random() * length, near + rng.random() * width
            w, b, z = rng.uniform(0.01, 0.25, 3)
            self.add((x, d, height), (x + w, d + b, height + z), is_own=True)

    def lines(self) -> None:
        """Lines on a wall or a floor: boards, tiles, mouldings, pictures."""
        rng = self.rng
        kind = rng.integers(0, 4)
        whole, height, depth = self.size[self.wall % 2], self.size[2], self.size[1 - self.wall % 2]
        if kind == 0:  # boards or tiles of the wall: strips with gaps
            pitch, gap = rng.uniform(0.08, 0.6), rng.uniform(0.002, 0.02)
            top = rng.uniform(0.8, height)
            for x in np.arange(0, whole, pitch):
                self.add((x, 0, 0), (x + pitch - gap, 0.012, top))
        elif kind == 1:  # joints of the floor
            pitch, gap = rng.uniform(0.1, 0.8), rng.uniform(0.002, 0.012)
            for x in np.arange(0, whole, pitch):
                self.add((x, 0, -0.01), (x + gap, depth, 0.002))
            if rng.random() < 0.6:
                for d in np.arange(0, depth, pitch):
                    self.add((0, d, -0.01), (whole, d + gap, 0.002))
        elif kind == 2:  # skirting, picture rail
            for z in (0, rng.uniform(0.8, height - 0.1)):
                self.add((0, 0, z), (whole, rng.uniform(0.008, 0.04),
                                     z + rng.uniform(0.01, 0.12)))
        else:
            for _ in range(int(rng.integers(1, 6))):
                a0, a1 = self.span(0.15, 1)
                z0 = rng.uniform(0.8, max(0.9, height - 0.8))
                z1 = z0 + rng.uniform(0.15, 0.7)
                self.add((a0, 0, z0), (a1, 0.015, z1))
                self.frame(a0, a1, z0, z1, 0.015, 0.03, rng.uniform(0.004, 0.05))

    def furnish(self) -> None:
        """Pieces of furniture, many of which stand in one another."""
        kinds = (self.cupboard, self.window, self.shelf, self.stairs, self.table, self.lines)
        for _ in range(int(self.rng.integers(6, 30))):
            self.wall, self.piece = int(self.rng.integers(4)), 7 + len(self.low)
            kinds[self.rng.choice(6, p=[0.25, 0.2, 0.1, 0.08, 0.2, 0.17])]()


class View(NamedTuple):
    """A camera: its place; unit vectors [3,3] to the right, down and ahead; and how many metres, a
    metre ahead, the longer side of its picture is wide."""
    eye: np.ndarray
    axes: np.ndarray
    width: float

    def rays(self, h: int, w: int) -> np.ndarray:
        """Of the points of [h,w], float32 [h,w,3], in metres for each metre ahead."""
        x, y = ((np.arange(n) + 0.5 - n / 2) * (self.width / max(h, w)) for n in (w, h))
        side, down, ahead = self.axes
        rays = ahead + x[None, :, None] * side + y[:, None, None] * down
        return rays.astype(np.float32)


def view(room: Room, rng: np.random.Generator) -> View:
    """A camera somewhere in a room."""
    eye = room.size * rng.uniform((0.1, 0.1, 0.3), (0.9, 0.9, 0.75))
    yaw, pitch, roll = rng.uniform(0, 2 * np.pi), rng.normal(-0.1, 0.15), rng.normal(0, 0.02)
    if rng.random() < 0.3:  # straight at a wall, as pictures of rooms often are
        yaw, pitch, roll = np.round(yaw / (np.pi / 2)) * (np.pi / 2) + rng.normal(0, 0.01), 0, 0
    ahead = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
    side = np.array([np.sin(yaw), -np.cos(yaw), 0])
    up = np.cross(side, ahead)
    side, up = side * np.cos(roll) + up * np.sin(roll), up * np.cos(roll) - side * np.sin(roll)
    width = 2 * np.tan(np.exp(rng.uniform(*np.log((0.15, 0.75)))))
    return View(eye, np.stack([side, -up, ahead]), width)


def region(low, high, seen: View, h: int, w: int):
    """Rows and columns of [h,w] that may see a box; None: none of them."""
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), -1)
    x, y, z = seen.axes @ (corners.reshape(8, 3) - seen.eye).T
    if z.max() < NEAR:
        return None
    if z.min() < NEAR:
        return slice(0, h), slice(0, w)
    points = max(h, w) / seen.width  # to the metre, a metre ahead
    x, y = x / z * points + w / 2, y / z * points + h / 2
    rows = slice(max(0, int(y.min()) - 1), min(h, int(y.max()) + 2))
    columns = slice(max(0, int(x.min()) - 1), min(w, int(x.max()) + 2))
    return (rows, columns) if rows.start < rows.stop and columns.start < columns.stop else None


def pick(a: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Of [...,3] the one that axis [...] says."""
    return np.take_along_axis(a, axis[..., None], -1)[..., 0]


def cast(room: Room, seen: View, h: int, w: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Faces [h,w] and distances that rays meet: past panes of glass, and not past them."""
    eye = seen.eye.astype(np.float32)
    rays = seen.rays(h, w)
    rays = np.moveaxis(np.where(rays == 0, np.float32(1e-12), rays), -1, 0)
    inverse = np.float32(1) / np.ascontiguousarray(rays)   # [3,h,w]: numpy is quick that way
    away = inverse > 0
    # The room itself, from inside: the first plane that a ray leaves by.
    size = room.size.astype(np.float32)[:, None, None]
    leave = (np.where(away, size, 0) - eye[:, None, None]) * inverse
    axis, depth = leave.argmin(0), leave.min(0)
    number = 1 + 2 * axis + np.take_along_axis(away, axis[None], 0)[0]
    layers = []
    for is_pane in (False, True):
        for k in np.flatnonzero(np.array(room.is_pane) == is_pane):
            low, high = room.low[k].astype(np.float32), room.high[k].astype(np.float32)
            at = region(low, high, seen, h, w)
            if at is None or ((low < eye) & (eye < high)).all():
                continue
            enters, leaves = [], []
            for side in range(3):
                a, b = ((t[side] - eye[side]) * inverse[(side, *at)] for t in (low, high))
                enters.append(np.minimum(a, b))
                leaves.append(np.maximum(a, b))
            near = np.maximum(np.maximum(enters[0], enters[1]), enters[2])
            far = np.minimum(np.minimum(leaves[0], leaves[1]), leaves[2])
            hit = np.nonzero((near < far) & (near > NEAR) & (near < depth[at]))
            axis = np.argmax([t[hit] for t in enters], 0)
            facing = ~away[(slice(None), *at)][(axis, *hit)]
            number[at][hit] = 0 if room.is_hole[k] else 7 + 6 * k + 2 * axis + facing
            depth[at][hit] = near[hit]
        layers.append((number.copy(), depth.copy()))
    return layers


def paint(h: int, w: int, rng: np.random.Generator) -> Seen:
    """A room seen at the points of [h,w], where a few views are tried for many edges."""
    room = Room(rng)
    room.furnish()

    def edges(tried: View) -> int:
        number = cast(room, tried, max(h // 8, 1), max(w // 8, 1))[1][0]
        return (np.diff(number, axis=0) != 0).sum() + (np.diff(number, axis=1) != 0).sum()

    seen = max([view(room, rng) for _ in range(rng.integers(1, 9))], key=edges)
    layers = cast(room, seen, h, w)
    count = 6 + 6 * len(room.low)
    faces = np.arange(-1, count)
    axes = np.where(faces >= 0, faces % 6 // 2, 2)
    # The room's walls look inwards, boxes outwards.
    sign = np.where(faces < 6, 1 - 2 * (faces % 2), 2 * (faces % 2) - 1)
    number = np.concatenate([n for n, _ in layers]).astype(np.int32)
    places = np.concatenate([seen.eye + seen.rays(h, w) * d[..., None] for _, d in layers])
    u = pick(places, np.where(axes == 0, 1, 0)[number]).astype(np.float32)
    v = pick(places, np.where(axes == 2, 1, 2)[number]).astype(np.float32)
    body = np.concatenate([np.arange(7), np.repeat(room.body, 6)])
    is_glass = number[:h] != number[h:]
    shares = rng.uniform(0.05, 0.7, count + 1)[number[h:]]
    return Seen(number, u, v, (is_glass * shares).astype(np.float32), body, axes, sign)
