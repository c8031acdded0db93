"""Networks as lib/nets.def describes them."""
from __future__ import annotations

import re
from collections.abc import Collection, Sequence
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
class Head:
    """One HEAD row: a 1x1 convolution with ReLU, for the filter at 1/2^level resolution."""

    name: str
    source: str
    level: int


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

    def channels(self, inputs: int, widths: Sequence[int]) -> list[tuple[int, int]]:
        """Input and output channels of each layer; `widths` holds one number per layer."""
        out, chain = {"input": inputs}, []
        for layer, width in zip(self.layers, widths, strict=True):
            chain.append((out[layer.source] + (out[layer.skip] if layer.skip else 0), width))
            out[layer.name] = width
        return chain

    def areas(self) -> list[float]:
        """Pixels that each layer makes, before pooling, per pixel of the input."""
        after, areas = {"input": 1.0}, []
        for layer in self.layers:
            areas.append(after[layer.source] * (4 if layer.up else 1))
            after[layer.name] = areas[-1] / (4 if layer.pool else 1)
        return areas

    @property
    def wide(self) -> frozenset[str]:
        """Tensors of any integer model with 15-bit codes; its file may name other wide ones."""
        return frozenset(("input", self.last.source, self.last.name))


def _rows(macro: str, path: Path) -> list[list[str]]:
    """The arguments of each row of this macro."""
    text = re.sub(r"/\*.*?\*/", "", path.read_text(), flags=re.S)
    return [[a.strip() for a in body.split(",")]
            for body in re.findall(rf"^{macro}\s*\((.*?)\)", text, flags=re.M)]


def read_nets(path: Path = NETS_DEF) -> list[Net]:
    """Topologies in the order in which a weights file is identified."""
    layers = _rows("LAYER", path)
    return [Net(name, family, key,
                tuple(Layer(r[1], r[2], r[3] == "2", None if r[4] == "none" else r[4], r[5] == "2")
                      for r in layers if r[0] == name))
            for name, family, key in _rows("NET", path)]


def read_heads(net: str) -> list[Head]:
    """The heads of a net of family K."""
    return [Head(name, source, int(level))
            for of, name, source, level in _rows("HEAD", NETS_DEF) if of == net]


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
