"""Names that renderers give to the layers of a multichannel EXR, by feature.

The names of colour, albedo and normals are those of apps/layers.c, in its order.
"""
from __future__ import annotations

from collections.abc import Iterable

import numpy as np

# Layers by feature, in order of preference; "" is a layer without a name (plain R, G, B).
LAYERS: dict[str, tuple[str, ...]] = {
    "hdr": ("", "Noisy Image", "Beauty", "Combined", "Image", "rgba", "rgb", "color", "C"),
    "alb": ("Denoising Albedo", "albedo", "VisibleDiffuse", "DiffCol", "Diffuse Color",
            "diffuse_albedo", "OptixAlbedo", "DiffuseFilter", "VRayDiffuseFilter", "diffuse"),
    "nrm": ("Denoising Normal", "normal", "sh_normal", "Ns", "N", "Nn", "Normals",
            "VisibleNormals", "OptixNormals", "BumpNormals", "VRayNormals"),
    "z": ("Denoising Depth", "", "depth"),
    "a": ("",),
}
LAYERS["ldr"] = LAYERS["hdr"]
COMPONENTS = (("r", "g", "b"), ("x", "y", "z"), ("red", "green", "blue"))
SINGLE = {"z": (("z",), ("v",)), "a": (("a",),)}  # components of features of one channel
BESIDE = ("alb", "nrm", "z")  # those of the colour's view layer come first
ANY = (*COMPONENTS, ("z",), ("y",), ("v",))


def find_channels(feature: str, available: Iterable[str],
                  layer: str | None = None) -> tuple[str, ...] | None:
    """The channels of `feature` among those of a file (exact spelling), or None.

    layer: the user's choice instead of the table: a layer (`myalbedo` has R,G,B or X,Y,Z), or a
    channel. Names are compared without regard to case, as a whole, then after any prefix
    (`ViewLayer.DiffCol`).
    """
    names = list(available)
    layers = LAYERS.get(feature, ()) if layer is None else (layer,)
    kinds = SINGLE.get(feature, COMPONENTS) if layer is None else ANY
    for wanted in layers:
        if found := _find_layer(wanted, names, kinds):
            return found
    return next(((n,) for n in names if layer is not None and n.lower() == layer.lower()), None)


def find_images(feature: str, channels: dict[str, np.ndarray],
                layers: dict[str, str] | None = None) -> tuple[str, ...] | None:
    """As find_channels, of a file that was read: what has the prefix of the colour comes before all
    others, and a layer called diffuse is no albedo where it is light, as it is to most renderers.
    layers: the user's choices by feature."""
    chosen = layers or {}
    if feature in chosen or feature not in BESIDE:
        return find_channels(feature, channels, chosen.get(feature))
    color = find_channels("hdr", channels, chosen.get("hdr") or chosen.get("ldr"))
    names = (color and _find_beside(feature, color[0], channels)
             or find_channels(feature, channels))
    if feature == "alb" and names and color and _may_be_light(names[0]):
        albedo, light = (np.stack([channels[n] for n in found], -1) for found in (names, color))
        return None if _is_light(albedo, light) else names
    return names


def _find_beside(feature: str, color: str, names: Iterable[str]) -> tuple[str, ...] | None:
    """The channels of a feature with the longest prefix of the colour's: for Char.Combined.R those
    of the view layer Char."""
    prefix = color.rpartition(".")[0]
    while prefix:
        own = {n[len(prefix) + 1:]: n for n in names if n.lower().startswith(f"{prefix}.".lower())}
        for layer in filter(None, LAYERS[feature]):
            whole = [n for n in own if n.lower().rpartition(".")[0] == layer.lower()]
            if found := _find_layer(layer, whole, SINGLE.get(feature, COMPONENTS)):
                return tuple(own[n] for n in found)
        prefix = prefix.rpartition(".")[0]
    return None


def _may_be_light(channel: str) -> bool:
    return f".{channel.lower()}".rpartition(".")[0].endswith(".diffuse")


def _is_light(albedo: np.ndarray, color: np.ndarray) -> bool:
    """image_is_light of apps/compare.c: light that is part of the colour is hardly ever brighter;
    where the colour is brighter than any albedo it tells nothing, unless the other is, too."""
    if albedo.shape[:2] != color.shape[:2]:
        return False
    a, c = (np.where(np.isfinite(i), i, 0).mean(-1, dtype=np.float64) for i in (albedo, color))
    told = c < 1
    if not told.any():
        return bool((a > 1.02).any())
    return 100 * np.count_nonzero(a[told] > 1.02 * c[told] + 0.001) < np.count_nonzero(told)


def _find_layer(layer: str, names: list[str],
                kinds: Iterable[tuple[str, ...]]) -> tuple[str, ...] | None:
    """The first complete layer of that name: its channels of one of `kinds`."""
    layer, by_key = layer.lower(), {n.lower(): n for n in reversed(names)}
    owners = [n.lower().rpartition(".")[0] for n in names]
    whole = [o for o in owners if o == layer]
    prefixed = [o for o in owners if layer and o.endswith(f".{layer}")]
    for owner in dict.fromkeys(whole + prefixed):
        for kind in kinds:
            keys = [f"{owner}.{c}" if owner else c for c in kind]
            if all(k in by_key for k in keys):
                return tuple(by_key[k] for k in keys)
    return None
