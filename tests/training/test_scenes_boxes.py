"""Rooms of boxes: what the rays of a view meet, against walking along them in small steps."""
from __future__ import annotations

import numpy as np
import pytest

from training.scenes import boxes


STEP = 4e-3            # metres


def furnished(seed: int) -> boxes.Room:
    room = boxes.Room(np.random.default_rng(seed))
    room.furnish()
    return room


def walked(room: boxes.Room, eye, ray, panes: bool) -> float:
    """Distance at which a ray enters a box or leaves the room, within STEP."""
    t = np.arange(boxes.NEAR, 16, STEP)
    at = eye + t[:, None] * ray
    met = ((at < 0) | (at > room.size)).any(-1)
    for low, high, is_pane in zip(room.low, room.high, room.is_pane, strict=True):
        if (panes or not is_pane) and not ((low < eye) & (eye < high)).all():
            met |= ((at > low) & (at < high)).all(-1)
    return t[met.argmax()]


@pytest.mark.parametrize("seed", range(3))
def test_rays_meet_what_is_nearest(seed):
    room = furnished(seed)
    rng = np.random.default_rng(seed)
    seen = boxes.view(room, rng)
    rays = seen.rays(24, 32).astype(float)
    past, on = boxes.cast(room, seen, 24, 32)
    checked = 0
    for y, x in rng.integers(0, (24, 32), (12, 2)):
        for (_, depth), panes in ((past, False), (on, True)):
            wanted = walked(room, seen.eye, rays[y, x], panes)
            # Steps may miss what is thinner along the ray, never the other way.
            assert depth[y, x] <= wanted + 1e-3
            checked += abs(depth[y, x] - wanted) <= STEP + 1e-3
    assert checked >= 20 and (on[1] <= past[1]).all()


def test_other_points_see_the_same():
    room = furnished(5)
    seen = boxes.view(room, np.random.default_rng(5))
    assert np.allclose(seen.rays(72, 96)[1::3, 1::3], seen.rays(24, 32), atol=1e-5)
    faces = boxes.cast(room, seen, 24, 32)[1][0]
    assert (boxes.cast(room, seen, 72, 96)[1][0][1::3, 1::3] == faces).mean() > 0.995


def test_a_room_without_furniture_shows_its_walls():
    """From the middle, straight at the wall at the end of x: that wall, which looks back."""
    room = boxes.Room(np.random.default_rng(0))
    axes = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    number, depth = boxes.cast(room, boxes.View(room.size / 2, axes, 0.16), 16, 16)[0]
    assert (number == 2).all() and np.allclose(depth, room.size[0] / 2)


def test_faces_say_what_they_are():
    """Walls look inwards and boxes outwards: towards the eye, all of them; panes show both what
    is on them and what is behind; colours are those of pieces or of single boxes."""
    panes = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        room = boxes.paint(48, 64, rng)
        assert room.number.shape == (96, 64) and room.pane.shape == (48, 64)
        assert room.number.min() >= 0 and room.number.max() < len(room.axis)
        assert room.body.max() < len(room.axis) and room.body[0] == 0
        glass = room.pane > 0
        assert ((room.number[:48] != room.number[48:]) == glass).all()
        assert np.isfinite(room.u).all() and np.isfinite(room.v).all()
        panes += glass.sum()
    assert panes > 50
