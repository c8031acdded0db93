"""Names that renderers give to the layers of a multichannel EXR, by feature.

The names of colour, albedo and normals are those of apps/layers.c, in its order.
"""
from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from training.exr_channels import Channels

# Layers by feature, in order of preference; "" is a layer without a name (plain R, G, B).
LAYERS: dict[str, tuple[str, ...]] = {
    "hdr": ("", "Noisy Image", "Beauty", "Combined", "Image", "rgba", "rgb", "color", "C"),
    "alb": ("Denoising Albedo", "albedo", "VisibleDiffuse", "DiffCol", "Diffuse Color",
            "diffuse_albedo", "OptixAlbedo", "DiffuseFilter", "VRayDiffuseFilter", "diffuse"),
    "nrm": ("Denoising Normal", "normal", "sh_normal", "Ns", "N", "Nn", "Normals",
            "VisibleNormals", "OptixNormals", "BumpNormals", "VRayNormals"),
    "motion": ("Vector", "motion", "motionvector", "Motion Vector", "MotionVectors", "velocity"),
    "z": ("Denoising Depth", "", "depth"),
    "a": ("",),
}
LAYERS["ldr"] = LAYERS["hdr"]
COMPONENTS = (("r", "g", "b"), ("x", "y", "z"), ("red", "green", "blue"))
SINGLE = {"z": (("z",), ("v",)), "a": (("a",),)}  # components of features of one channel
BESIDE = ("alb", "nrm", "z")  # those of the colour's view layer come first
ANY = (*COMPONENTS, ("z",), ("y",), ("v",))
NO_COLOR = tuple(layer.lower() for f in ("alb", "nrm", "motion") for layer in LAYERS[f])
GREY = ("y", "l", "grey", "gray", "luminance")


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
    if layer is None:
        return _find_any_color(names) if layers is LAYERS["hdr"] else None
    return next(((n,) for n in names if n.lower() == layer.lower()), None)


def find_own(feature: str, channels: Channels) -> tuple[str, ...] | None:
    """As find_channels, without the views of stereo files: of the default one."""
    names = find_channels(feature, channels.plain)
    return names and tuple(channels.plain[n] for n in names)


def find_images(feature: str, channels: Channels,
                layers: dict[str, str] | None = None) -> tuple[str, ...] | None:
    """As find_own, of a file that was read: what has the prefix of the colour comes before all
    others, and a layer called diffuse is no albedo where it is light, as it is to most renderers.
    layers: the user's choices by feature."""
    chosen = layers or {}
    if feature in chosen:
        return find_channels(feature, channels, chosen[feature])
    if feature not in BESIDE:
        return find_own(feature, channels)
    picked = chosen.get("hdr") or chosen.get("ldr")
    color = (find_channels("hdr", channels, picked) if picked else find_own("hdr", channels))
    names = (color and _find_beside(feature, color[0], channels) or find_own(feature, channels))
    if feature == "alb" and names and color and _may_be_light(names[0]):
        albedo, light = (np.stack([channels[n] for n in found], -1) for found in (names, color))
        return None if _is_light(albedo, light) else names
    return names


def _find_beside(feature: str, color: str, channels: Channels) -> tuple[str, ...] | None:
    """The channels of a feature with the longest prefix of the colour's: for Char.Combined.R those
    of the view layer Char."""
    plain = channels.plain
    prefix = next((p for p, name in plain.items() if name == color), color).rpartition(".")[0]
    while prefix:
        own = {p[len(prefix) + 1:]: n for p, n in plain.items()
               if p.lower().startswith(f"{prefix}.".lower())}
        for layer in filter(None, LAYERS[feature]):
            whole = [n for n in own if n.lower().rpartition(".")[0] == layer.lower()]
            if found := _find_layer(layer, whole, SINGLE.get(feature, COMPONENTS)):
                return tuple(own[n] for n in found)
        prefix = prefix.rpartition(".")[0]
    return None


def _find_any_color(names: list[str]) -> tuple[str, ...] | None:
    """Colour under a name we do not know, grey, R and G alone, or the only channel."""
    by_key = {n.lower(): n for n in reversed(names)}
    for name in names:
        owner, _, component = name.lower().rpartition(".")
        kind = next((k for k in COMPONENTS if k[0] == component != "x"), None)
        if kind and owner and not _is_auxiliary(owner):
            keys = [f"{owner}.{c}" for c in kind]
            if all(k in by_key for k in keys):
                return tuple(by_key[k] for k in keys)
    for key in GREY:
        if key in by_key:
            return (by_key[key],)
    if len(names) == 2 and set(by_key) == {"r", "g"}:
        return by_key["r"], by_key["g"]
    return tuple(names) if len(names) == 1 else None


def _is_auxiliary(layer: str) -> bool:
    """Whether a layer, in lower case, is known for something else than colour, or of Cryptomatte,
    whose values are names."""
    return (layer.rpartition(".")[2].startswith("crypto")
            or any(f".{layer}".endswith(f".{name}") for name in NO_COLOR))


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
