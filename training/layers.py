"""Names that renderers give to the channels of a multichannel EXR, by feature."""
from __future__ import annotations

from collections.abc import Iterable

# feature -> channel triples (or singles), first match wins; compared without regard to case.
RGB, XYZ = ("R", "G", "B"), ("X", "Y", "Z")
WORDS = ("red", "green", "blue")


def _of(layer: str, *kinds: tuple[str, ...]) -> list[tuple[str, ...]]:
    return [tuple(f"{layer}.{c}" for c in kind) for kind in kinds]


def _with_view_layer(rows: list[tuple[str, ...]]) -> list[tuple[str, ...]]:
    return rows + [tuple(f"ViewLayer.{c}" for c in row) for row in rows]


CHANNEL_NAMES: dict[str, list[tuple[str, ...]]] = {
    "hdr": [RGB] + _of("Noisy Image", RGB) + _of("Beauty", RGB) + _of("Combined", RGB)
           + _of("Composite.Combined", RGB) + _of("ViewLayer.Combined", RGB),
    "alb": _of("albedo", RGB, WORDS) + _with_view_layer(_of("Denoising Albedo", RGB))
           + _of("VisibleDiffuse", RGB) + _of("diffuse", RGB) + _of("DiffCol", RGB),
    "nrm": _of("normal", XYZ, RGB, WORDS) + _of("N", XYZ, RGB)
           + _with_view_layer(_of("Denoising Normal", XYZ, RGB)) + _of("Normals", XYZ, RGB)
           + _of("VisibleNormals", XYZ, RGB) + _of("OptixNormals", XYZ, RGB),
    "z": _with_view_layer(_of("Denoising Depth", ("Z",))) + [("Z",)] + _of("depth", ("Z",), ("V",)),
    "a": [("A",)],
}
CHANNEL_NAMES["ldr"] = CHANNEL_NAMES["hdr"]


def find_channels(feature: str, available: Iterable[str],
                  layer: str | None = None) -> tuple[str, ...] | None:
    """The channels of `feature` among those of a file (exact spelling), or None.

    layer: the user's choice instead of the table: a prefix (`myalbedo` takes its R,G,B or X,Y,Z).
    """
    by_key = {name.lower(): name for name in available}
    rows = CHANNEL_NAMES.get(feature, [])
    if layer is not None:
        rows = _of(layer, RGB, XYZ, WORDS, ("Z",), ("Y",), ("V",)) + [(layer,)]
    for row in rows:
        if all(c.lower() in by_key for c in row):
            return tuple(by_key[c.lower()] for c in row)
    return None
