"""A palette: one BSDF per material slot, so that a scene of any size has few BSDF instances.

Every BSDF instance is traced and compiled by Dr.Jit, which costs far more than objects or
triangles do; colours therefore come from vertices and from an atlas of pictures.
"""

from __future__ import annotations

import numpy as np

from . import textures as tx
from .furniture import colour
from .mesh import Mesh

METALS = ("Au", "Cu", "Al", "Ag", "W", "Cr", "none")


def bitmap(mi, a: np.ndarray, **extra) -> dict:
    """Bitmap texture (linear values) of an (n, m) or (n, m, 3) array."""
    a = np.ascontiguousarray(a[..., None] if a.ndim == 2 else a, np.float32)
    return {"type": "bitmap", "bitmap": mi.Bitmap(a), "raw": True, **extra}


def _vertex_colour() -> dict:
    return {"type": "mesh_attribute", "name": "vertex_color"}


def _tiled(mi, a: np.ndarray, repeat: float) -> dict:
    s = mi.ScalarTransform4f().scale([repeat, repeat, 1.0])
    return bitmap(mi, a, to_uv=s)


def _alpha(rng) -> float:
    return float(np.exp(rng.uniform(np.log(0.015), np.log(0.5))))


def two(bsdf: dict) -> dict:
    return {"type": "twosided", "nested": bsdf}


def coat(rng, reflectance: dict) -> dict:
    """Dielectric-coated diffuse surface, one-sided."""
    kind = str(rng.choice(["plastic", "roughplastic", "principled"]))
    if reflectance["type"] == "mesh_attribute":  # the plastics want a texture with a mean
        kind = "principled"
    if kind == "principled":
        return {"type": "principled", "base_color": reflectance, "roughness": _alpha(rng) ** 0.5,
                "specular": 0.5, "metallic": float(rng.choice([0.0, 0.0, 0.5])),
                "clearcoat": float(rng.choice([0.0, 0.8])), "clearcoat_gloss": 0.9}
    out = {"type": kind, "diffuse_reflectance": reflectance, "nonlinear": bool(rng.random() < 0.5),
           "int_ior": float(rng.uniform(1.3, 1.8))}
    if kind == "roughplastic":
        out |= {"alpha": _alpha(rng), "distribution": str(rng.choice(["ggx", "beckmann"]))}
    return out


def metal(rng, tint: dict | None) -> dict:
    """Smooth or rough conductor; tint: reflectance texture or None for the metal's own colour."""
    out = {"type": "conductor", "material": str(rng.choice(METALS))}
    if rng.random() < 0.7:
        a = _alpha(rng)
        b = a * (float(rng.uniform(2, 6)) if rng.random() < 0.25 else 1.0)
        out |= {"type": "roughconductor", "alpha_u": a, "alpha_v": min(b, 0.8),
                "distribution": str(rng.choice(["ggx", "beckmann"]))}
    if tint:
        out["specular_reflectance"] = tint
    return out


def glass(rng) -> dict:
    """Smooth, thin or rough dielectric."""
    ior = float(rng.uniform(1.3, 1.8))
    kind = rng.choice(["dielectric"] * 5 + ["thindielectric"] * 2 + ["roughdielectric"] * 2)
    out = {"type": str(kind), "int_ior": ior}
    if kind == "roughdielectric":
        out |= {"alpha": float(rng.uniform(0.03, 0.3)), "distribution": "ggx"}
    elif rng.random() < 0.4:
        out["specular_transmittance"] = {"type": "rgb", "value": [float(x) for x in
                                                                 rng.uniform(0.6, 1, 3)]}
    return out


def special(mi, rng) -> dict:
    """Something unlike the rest: bumps, normal maps, blends, mirrors, metallic paint."""
    kind = rng.choice(["bump", "normal", "blend", "mirror", "worn", "brushed"])
    vc = _vertex_colour()
    if kind == "bump":
        return two({"type": "bumpmap", "nested": coat(rng, vc), "scale": float(rng.uniform(1, 6)),
                    "arbitrary": _tiled(mi, tx.mask(rng, 256, tx.HEIGHTS) * 0.02, 2.0)})
    if kind == "normal":
        n = tx.normal_map(tx.fbm(rng, 256, 6, 4), float(rng.uniform(0.3, 2)))
        nested = metal(rng, None) if rng.random() < 0.4 else coat(rng, vc)
        return two({"type": "normalmap", "normalmap": _tiled(mi, n, 2.0), "bsdf": nested})
    if kind == "blend":
        return two({"type": "blendbsdf", "weight": _tiled(mi, tx.mask(rng, 256), 1.0),
                    "a": {"type": "diffuse", "reflectance": vc}, "b": metal(rng, None)})
    if kind == "mirror":
        return two({"type": "conductor", "material": str(rng.choice(["Ag", "none", "Al"]))})
    if kind == "worn":
        rough = 0.08 + 0.6 * tx.mask(rng, 256)
        return two({"type": "principled", "base_color": vc, "roughness": _tiled(mi, rough, 1.0),
                    "metallic": _tiled(mi, tx.mask(rng, 256), 1.0), "specular": 0.5})
    return two({"type": "principled", "base_color": vc, "roughness": 0.35, "metallic": 1.0,
                "anisotropic": 0.8, "specular": 0.5})


def floor(mi, rng, tex: np.ndarray, repeat: float) -> dict:
    """Ground: mostly matt, sometimes polished, wet, metallic or bumped."""
    t = _tiled(mi, tex, repeat)
    kind = rng.choice(["diffuse"] * 4 + ["coat"] * 3 + ["worn", "metal", "bump"])
    if kind == "diffuse":
        return two({"type": "diffuse", "reflectance": t})
    if kind == "coat":
        return two(coat(rng, t))
    if kind == "worn":
        rough = 0.05 + 0.5 * tx.fbm(rng, 256)
        return two({"type": "principled", "base_color": t, "roughness": _tiled(mi, rough, repeat),
                    "specular": 0.5})
    if kind == "metal":
        return two(metal(rng, t))
    height = _tiled(mi, tex.mean(-1) * 0.02, repeat)
    return two({"type": "bumpmap", "nested": coat(rng, t), "arbitrary": height,
                "scale": float(rng.uniform(0.5, 3))})


def wall(mi, rng, tex: np.ndarray, repeat: float) -> dict:
    """Walls and ceilings: plain paint, patterned, plaster bumps."""
    kind = rng.choice(["vertex", "picture", "coat"], p=[0.45, 0.4, 0.15])
    if kind == "vertex":
        return two({"type": "diffuse", "reflectance": _vertex_colour()})
    t = _tiled(mi, tex, repeat)
    return two({"type": "diffuse", "reflectance": t} if kind == "picture" else coat(rng, t))


def leaf(rng) -> dict:
    """Foliage: matt, shiny, or letting light through."""
    vc = _vertex_colour()
    kind = rng.random()
    if kind < 0.15:
        return {"type": "principledthin", "base_color": vc, "roughness": 0.5, "diff_trans": 0.8,
                "spec_trans": 0.0}
    return two({"type": "diffuse", "reflectance": vc} if kind < 0.7 else
               {"type": "principled", "base_color": vc, "roughness": 0.4, "specular": 0.5})


def cutout(mi, rng) -> dict:
    """Alpha mask over foliage."""
    return {"type": "mask", "opacity": bitmap(mi, tx.leaf_mask(rng, 128), filter_type="nearest"),
            "nested": two({"type": "diffuse", "reflectance": _vertex_colour()})}


def colours_to_texels(m: Mesh) -> tuple[Mesh, np.ndarray]:
    """Moves vertex colours into a bitmap (n, n, 3) that the new texture coordinates point at."""
    values, index = np.unique(np.asarray(m.c, np.float32), axis=0, return_inverse=True)
    n = int(np.ceil(np.sqrt(len(values))))
    table = np.zeros((n * n, 3), np.float32)
    table[: len(values)] = values
    index = index.reshape(-1)
    uv = (np.stack([index % n, index // n], 1) + 0.5) / n
    return Mesh(m.v, m.f, m.n, uv, m.c), table.reshape(n, n, 3)


def palette(mi, rng: np.random.Generator, slots, pictures: list[np.ndarray], gloss: np.ndarray,
            fine: bool, prints: np.ndarray | None = None) -> dict[str, dict]:
    """BSDF dictionaries of the slots in use; a slot's material does not depend on the others.

    pictures: the user's textures (linear RGB), may be empty; gloss: texels of slot "gloss" from
    colours_to_texels; fine: large bitmaps; prints: the bitmap of slot "print".
    """
    root = int(rng.integers(1 << 31))
    n = 512 if fine else 256

    def texture(r, kinds):
        if pictures and r.random() < 0.5:
            return pictures[r.integers(len(pictures))]
        return tx.picture(r, n, colour, kinds)

    def atlas(r):
        pics = bitmap(mi, tx.atlas(r, 2 * n, colour))
        return two({"type": "diffuse", "reflectance": pics} if r.random() < 0.6
                   else coat(r, pics))

    makers = {
        "atlas": atlas,
        "floor": lambda r: floor(mi, r, texture(r, tx.FLOORS), float(r.uniform(0.2, 0.8))),
        "wall": lambda r: wall(mi, r, texture(r, tx.PATTERNS), float(r.uniform(0.15, 0.8))),
        "paint": lambda r: two({"type": "diffuse", "reflectance": _vertex_colour()}),
        "gloss": lambda r: two(coat(r, bitmap(mi, gloss, filter_type="nearest"))),
        "metal": lambda r: two(metal(r, _vertex_colour() if r.random() < 0.5 else None)),
        "glass": glass,
        "leaf": leaf,
        "mask": lambda r: cutout(mi, r),
        "special": lambda r: special(mi, r),
    }
    out = {slot: make(np.random.default_rng([root, k]))
           for k, (slot, make) in enumerate(sorted(makers.items())) if slot in slots}
    if prints is not None:  # numbered behind the others, whose seeds stay
        r, t = np.random.default_rng([root, len(makers)]), bitmap(mi, prints)
        out["print"] = two({"type": "diffuse", "reflectance": t} if r.random() < 0.6
                           else coat(r, t))
    return out
