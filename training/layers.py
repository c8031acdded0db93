"""Names that renderers give to the layers of a multichannel EXR, by feature.

The names of colour, albedo and normals are those of apps/layers.c, in its order.
"""
from __future__ import annotations

from collections.abc import Iterable

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
