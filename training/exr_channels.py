"""The channels of an EXR file by name, with the views of stereo files, as apps/exr_channels.c."""
from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

Origin = tuple[int, int]  # column and row where a data window begins
Window = tuple[int, int, int, int]  # first column and row, last ones


class Channels(dict[str, np.ndarray]):
    """Channels by full name, [H,W]. plain: the full names by those without the view of stereo
    files; other views than the default one begin with theirs, as if they were view layers
    ("albedo.R", "right.albedo.R"). origins: where data windows begin, by full name; display: the
    display window."""

    def __init__(self):
        super().__init__()
        self.plain: dict[str, str] = {}
        self.origins: dict[str, Origin] = {}
        self.display: Window | None = None

    def add(self, name: str, plain: str, pixels: np.ndarray, origin: Origin) -> None:
        """Of equal names the first one counts."""
        if name not in self:
            self[name] = pixels
            self.origins[name] = origin
            self.plain.setdefault(plain, name)

    def called(self, names: Mapping[str, str]) -> Channels:
        """Some of the channels under other names, those of `names` by the new ones."""
        channels = Channels()
        channels.display = self.display
        for name, full in names.items():
            channels.add(name, name, self[full], self.origins[full])
        return channels


def names_of(parts: Sequence[Any], part: Any) -> Iterator[tuple[str, str, str]]:
    """(name in the part, full name, plain name) of its channels, those of the default view first.

    In a file of several parts the channels of one without a layer name stand under its name."""
    views = part.header.get("multiView") or []
    title = part.name() or "" if len(parts) > 1 else ""
    view = _view_of(part) if len(parts) > 1 else ""
    first = next(filter(None, map(_view_of, parts)), "")
    other = view if view != first else ""
    bare = title
    if view and title.endswith(view):
        if title == view or title[-len(view) - 1] in ".-_ ":
            bare = title[:-len(view) - 1]
    later = []
    for name in part.channels:
        owner, _, component = name.rpartition(".")
        rest, _, own = owner.rpartition(".")
        if owner and own in views:
            prefix = "" if own == views[0] else own
            found = name, name, _join(prefix, rest, component)
            if prefix:
                later.append(found)
                continue
        elif owner:
            found = name, _join(owner, other, component), _join(other, owner, component)
        else:
            found = name, _join(title, component), _join(other, bare, component)
        yield found
    yield from later


def _view_of(part: Any) -> str:
    """The view of a part; empty if it has none or several."""
    return "" if part.header.get("multiView") else part.header.get("view") or ""


def _join(*names: str) -> str:
    return ".".join(filter(None, names))
