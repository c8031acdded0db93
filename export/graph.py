"""Networks as lib/nets.def describes them, for tools without torch."""
from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

NETS_DEF = Path(__file__).resolve().parent.parent / "lib" / "nets.def"
ALIGN = 16  # networks run on heights and widths that are multiples of this


class ModelError(ValueError):
    """A weights file that is no model we can run; the message names file and tensor."""


@dataclass(frozen=True)
class Layer:
    """One LAYER row: a 3x3 convolution of the channels (source, skip), ReLU, perhaps pooling."""

    name: str
    source: str
    up: bool
    skip: str | None
    pool: bool


@dataclass(frozen=True)
class Net:
    """One NET row; a weights file that holds `<key>.weight` is of this topology."""

    name: str
    family: str
    key: str
    layers: tuple[Layer, ...]

    @property
    def last(self) -> Layer:
        return self.layers[-1]

    @property
    def wide(self) -> frozenset[str]:
        """Tensors of any integer model with 15-bit codes; its file may name other wide ones."""
        return frozenset(("input", self.last.source, self.last.name))


def read_nets(path: Path = NETS_DEF) -> list[Net]:
    """Topologies in the order in which a weights file is identified."""
    text = re.sub(r"/\*.*?\*/", "", path.read_text(), flags=re.S)
    rows = [[a.strip() for a in body.split(",")]
            for body in re.findall(r"^(?:NET|LAYER)\s*\((.*?)\)", text, flags=re.M)]
    return [Net(*row,
                tuple(Layer(r[1], r[2], r[3] == "2", None if r[4] == "none" else r[4], r[5] == "2")
                      for r in rows if len(r) == 6 and r[0] == row[0]))
            for row in rows if len(row) == 3]


def find_net(names: Collection[str], file: str) -> Net:
    """The topology of a weights file that holds the tensors `names`."""
    for net in read_nets():
        if f"{net.key}.weight" in names:
            if net.family != "U":
                raise ModelError(f"{file}: '{net.name}' is of family {net.family}, only U is known")
            missing = [n for x in net.layers for n in (f"{x.name}.weight", f"{x.name}.bias")
                       if n not in names]
            if missing:
                raise ModelError(f"{file}: tensor '{missing[0]}' is missing")
            return net
    raise ModelError(f"{file}: the tensors belong to no known network")
