"""Still lifes for Blender's Cycles: objects on a floor with what rooms lack, one or two of EXTRAS
in each. Wants the module bpy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from . import textures as tx
from .blender import Material, look, new_sky, paint_sky, shining, texture, warm
from .furniture import colour

Rng = np.random.Generator
SHAPES = ("cube", "uv_sphere", "torus", "monkey", "cone", "cylinder", "ico_sphere")
ROUND = ("uv_sphere", "torus", "monkey")
NODES = ("ShaderNodeTexChecker", "ShaderNodeTexNoise", "ShaderNodeTexVoronoi",
         "ShaderNodeTexMagic", "ShaderNodeTexBrick")


class Table:
    """The scene under construction: what is put into it is drawn from `rng`."""

    def __init__(self, bpy, rng: Rng, pictures: list[np.ndarray]) -> None:
        self.bpy, self.rng, self.pictures = bpy, rng, pictures
        self.scene = bpy.context.scene
        self.is_lit = False        # an extra has brought the light along
        self.objects: list = []    # that may move

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def power(self, low: float, high: float) -> float:
        """The same, with equal chances for equal ratios."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def place(self, low: float, high: float, side: float = 2.2) -> tuple[float, float, float]:
        return self.between(-side, side), self.between(-side, side), self.between(low, high)

    def shape(self) -> str:
        return SHAPES[self.rng.integers(len(SHAPES))]

    def put(self, kind: str, at, size, material, turned: bool = True):
        """A primitive of this half size, or three of them."""
        turn = self.rng.uniform(0, 6.3, 3).tolist() if turned else (0, 0, 0)
        getattr(self.bpy.ops.mesh, f"primitive_{kind}_add")(location=at, rotation=turn)
        made = self.bpy.context.object
        made.scale = [size] * 3 if np.isscalar(size) else size
        made.data.materials.append(material)
        if kind in ROUND:
            self.bpy.ops.object.shade_smooth()
        return made

    def surface(self, **values) -> Material:
        """A material of any kind; values: of principled inputs that are given."""
        rng = self.rng
        kinds = ({}, {}, {"Metallic": 1.0}, {"Coat_Weight": 1.0, "Coat_Roughness": 0.05},
                 {"Sheen_Weight": 0.5})
        m = Material(self.bpy, "surface", **{
            "Roughness": self.between(0.05, 0.9), **kinds[rng.integers(len(kinds))],
            "Base_Color": (*colour(rng), 1), **values})
        if rng.random() < 0.3:
            m.picture(texture(rng, self.pictures, 256, tx.PATTERNS), self.between(0.5, 3))
        elif rng.random() < 0.4:
            node = m.nodes.new(NODES[rng.integers(len(NODES))])
            node.inputs["Scale"].default_value = self.power(2, 30)
            m.link(node.outputs["Color"], m.inputs["Base Color"])
        return m

    def glow(self, strength: float):
        """A material that shines in any colour."""
        return shining(self.bpy, "glow", self.rng.uniform(0.1, 1, 3), strength)

    def lamp(self, kind: str, energy: float, at, size: float) -> None:
        light = self.bpy.data.lights.new("lamp", kind)
        light.energy, light.color = energy, warm(self.rng)
        if kind == "AREA":
            light.size = size
        elif kind == "SUN":
            light.angle = size
        else:
            light.shadow_soft_size = size
        look(self.bpy, self.bpy.data.objects.new("lamp", light), at,
              (self.between(-1, 1), self.between(-1, 1), 0.5))

    def lights(self) -> None:
        """Of a studio, or the sun; and the sky."""
        if self.rng.random() < 0.3:
            self.lamp("SUN", self.power(1, 6), (self.between(-5, 5), self.between(-5, 5), 5),
                      self.power(0.005, 0.3))
        for _ in range(self.rng.integers(0 if self.is_lit else 1, 3)):
            self.lamp(("AREA", "POINT", "SPOT")[self.rng.integers(3)], self.power(60, 700),
                      (self.between(-4, 4), self.between(-4, 4), self.between(2, 5)),
                      self.power(0.05, 2))

    def light_sky(self, strength: float) -> None:
        back = new_sky(self.bpy)
        if self.rng.random() < 0.4:
            paint_sky(self.bpy, back, tx.sky(self.rng, 256))
        else:
            back.inputs["Color"].default_value = (*self.rng.uniform(0.2, 1, 3), 1)
        back.inputs["Strength"].default_value = strength


def _volume(t: Table, density: float, clouds: float = 0.0):
    """A material that fills a body; clouds: how fine they are, 0 for even fog."""
    made = t.bpy.data.materials.new("volume")
    made.use_nodes = True
    nodes, link = made.node_tree.nodes, made.node_tree.links.new
    nodes.remove(nodes["Principled BSDF"])
    node = nodes.new("ShaderNodeVolumePrincipled")
    node.inputs["Color"].default_value = (*t.rng.uniform(0.5, 1, 3), 1)
    node.inputs["Density"].default_value = density
    node.inputs["Anisotropy"].default_value = t.between(-0.2, 0.7)
    if clouds:
        noise, steps = nodes.new("ShaderNodeTexNoise"), nodes.new("ShaderNodeMapRange")
        at = nodes.new("ShaderNodeTexCoord")
        noise.inputs["Scale"].default_value = clouds
        for key, value in (("From Min", 0.45), ("From Max", 0.7), ("To Max", density)):
            steps.inputs[key].default_value = value
        link(at.outputs["Object"], noise.inputs["Vector"])
        link(noise.outputs[0], steps.inputs["Value"])
        link(steps.outputs[0], node.inputs["Density"])
    link(node.outputs[0], nodes["Material Output"].inputs["Volume"])
    return made


def fog(t: Table) -> None:
    t.put("cube", (0, 0, 2), (5, 5, 2.4), _volume(t, t.power(0.03, 0.3)), turned=False)
    t.lamp("SPOT", t.power(300, 2000), (t.between(-2, 2), t.between(-2, 2), 3.8), 0.1)


def smoke(t: Table) -> None:
    for _ in range(t.rng.integers(1, 4)):
        size = t.rng.uniform(0.6, 1.6, 3).tolist()
        t.put("cube", t.place(0.8, 1.8, 1), size, _volume(t, t.power(2, 20), t.between(1, 4)))


def hair(t: Table) -> None:
    """Balls of strands that stand out and bend. (Blender's own hair differs from run to run.)"""
    for _ in range(t.rng.integers(1, 4)):
        at, size, surface = t.place(0.4, 1.0), t.between(0.2, 0.6), t.surface().made
        t.put("uv_sphere", at, size, surface)
        count, joints = int(t.power(300, 5000)), 5
        way, bend = t.rng.normal(size=(2, count, 1, 3))
        way /= np.linalg.norm(way, axis=-1, keepdims=True)
        along = np.linspace(0, 1, joints)[:, None]
        points = way * (size + t.between(0.1, 0.6) * along) + bend * along**2 * t.between(0, 0.1)
        strands = t.bpy.data.hair_curves.new("hair")
        strands.add_curves([joints] * count)
        strands.attributes["position"].data.foreach_set("vector", (points + at).ravel())
        strands.attributes.new("radius", "FLOAT", "POINT").data.foreach_set(
            "value", np.full(count * joints, t.power(0.001, 0.006)))
        strands.materials.append(surface)
        t.bpy.context.collection.objects.link(t.bpy.data.objects.new("hair", strands))


def motion(t: Table) -> None:
    t.scene.render.use_motion_blur = True
    t.scene.render.motion_blur_shutter = t.between(0.3, 1)
    t.scene.frame_set(1)
    for made in t.objects:
        if t.rng.random() < 0.5:
            continue
        for frame, way in ((0, -0.5), (2, 0.5)):
            made.location = np.add(made.location, way * t.rng.uniform(-1.2, 1.2, 3)).tolist()
            made.rotation_euler = np.add(made.rotation_euler,
                                         way * t.rng.uniform(-2, 2, 3)).tolist()
            for what in ("location", "rotation_euler"):
                made.keyframe_insert(what, frame=frame)


def glass(t: Table) -> None:
    t.scene.cycles.blur_glossy = t.between(0, 1)
    for _ in range(t.rng.integers(3, 10)):
        tint = 1 - 0.6 * t.rng.random(3) ** 3
        m = Material(t.bpy, "glass", Transmission_Weight=1.0, IOR=t.between(1.3, 1.8),
                     Roughness=float(t.rng.choice([0, 0, 0.15])), Base_Color=(*tint, 1)).made
        t.put(t.shape(), t.place(0.2, 1), t.between(0.2, 0.6), m)


def beads(t: Table) -> None:
    """Many small lights, and little else."""
    t.is_lit = True
    for _ in range(t.rng.integers(10, 100)):
        t.put("ico_sphere", t.place(0.1, 3, 4), t.power(0.02, 0.08), t.glow(t.power(5, 150)))


def wax(t: Table) -> None:
    for _ in range(t.rng.integers(3, 9)):
        m = t.surface(Subsurface_Weight=1.0, Subsurface_Scale=t.between(0.05, 0.5), Metallic=0.0)
        t.put(t.shape(), t.place(0.2, 1), t.between(0.3, 0.6), m.made)


def signs(t: Table) -> None:
    """Letters, some of which shine."""
    for _ in range(t.rng.integers(4, 14)):
        t.bpy.ops.object.text_add(location=t.place(0.2, 2), rotation=(1.57, 0, t.between(0, 6)))
        made = t.bpy.context.object
        made.data.body = "".join(t.rng.choice(list("ABCDEFGabcdefg0123 %"), 9))
        made.data.size = t.between(0.15, 0.6)
        made.data.materials.append(t.glow(t.power(0.5, 8)) if t.rng.random() < 0.5
                                   else t.surface().made)


def blur(t: Table) -> None:
    t.scene.camera.data.dof.use_dof = True
    t.scene.camera.data.dof.focus_distance = t.between(3, 7)
    t.scene.camera.data.dof.aperture_fstop = t.power(0.1, 2)


def cards(t: Table) -> None:
    """Planes with holes."""
    t.scene.cycles.transparent_max_bounces = 32
    for _ in range(t.rng.integers(2, 5)):
        m = t.surface()
        holes, cut = m.nodes.new("ShaderNodeTexVoronoi"), m.nodes.new("ShaderNodeMath")
        holes.inputs["Scale"].default_value = t.power(3, 15)
        cut.operation, cut.inputs[1].default_value = "LESS_THAN", t.between(0.25, 0.5)
        m.link(holes.outputs["Distance"], cut.inputs[0])
        m.link(cut.outputs[0], m.inputs["Alpha"])
        for _ in range(t.rng.integers(5, 25)):
            t.put("plane", t.place(0.2, 2, 3), t.between(0.3, 0.9), m.made)


def bumps(t: Table) -> None:
    for _ in range(t.rng.integers(5, 15)):
        m = t.surface().bumps(t.power(4, 50), t.between(0.3, 1))
        t.put(t.shape(), t.place(0.2, 1.2), t.between(0.2, 0.6), m.made)


def mirrors(t: Table) -> None:
    t.scene.cycles.max_bounces = 16
    m = Material(t.bpy, "mirror", Metallic=1.0, Roughness=float(t.rng.choice([0.0, 0.02, 0.1])),
                 Base_Color=(0.9, 0.9, 0.9, 1)).made
    for _ in range(t.rng.integers(1, 5)):
        t.put("cube", t.place(0.8, 1.6, 3.2), (0.03, t.between(0.6, 2), t.between(0.6, 1.5)), m)


def water(t: Table) -> None:
    m = Material(t.bpy, "water", Transmission_Weight=1.0, IOR=1.33, Roughness=0.0)
    m.bumps(t.power(1, 8), t.between(0.1, 0.7))
    t.put("plane", (0, 0, t.between(0.2, 0.7)), 8, m.made, turned=False)


EXTRAS: tuple[Callable[[Table], None], ...] = (
    fog, smoke, hair, motion, glass, beads, wax, signs, blur, cards, bumps, mirrors, water)


def arrange(bpy, rng: Rng, pictures: list[np.ndarray]) -> str:
    """Fills the current, empty scene, camera and all; the names of its extras. pictures: linear RGB
    (h, w, 3), or none."""
    t = Table(bpy, rng, pictures)
    extras = [EXTRAS[k] for k in rng.choice(len(EXTRAS), rng.integers(1, 3), replace=False)]
    size = 12.0 if rng.random() < 0.7 else 3.5
    t.put("plane", (0, 0, 0), size, t.surface(Metallic=0.0).made, turned=False)
    if size < 12 or rng.random() < 0.3:  # a room, or before a wall
        walls = t.surface(Roughness=0.9, Metallic=0.0).made
        t.put("plane", (0, 3.5, 3), (size, 3, 1), walls, turned=False).rotation_euler = (1.57, 0, 0)
        if size < 12:
            t.put("plane", (-3.5, 0, 3), (3.5, 3, 1), walls,
                  turned=False).rotation_euler = (1.57, 0, 1.57)
    surfaces = [t.surface().made for _ in range(rng.integers(3, 9))]
    for _ in range(rng.integers(5, 35)):
        t.objects.append(t.put(t.shape(), t.place(0.1, 1.6),
                               t.power(0.1, 0.6), surfaces[rng.integers(len(surfaces))]))
    _place_camera(t)
    for extra in extras:
        extra(t)
    t.lights()
    t.light_sky(t.power(0.002, 0.02) if t.is_lit else t.power(0.05, 1.5))
    return "-".join(["objects", *(extra.__name__ for extra in extras)])


def _place_camera(t: Table) -> None:
    data = t.bpy.data.cameras.new("camera")
    data.lens = t.between(24, 70)
    made, way = t.bpy.data.objects.new("camera", data), t.between(-2.6, -0.5)
    far = t.between(3.5, 6.5)
    eye = far * np.cos(way), far * np.sin(way), t.between(0.6, 3.5)
    look(t.bpy, made, eye, (t.between(-0.6, 0.6), t.between(-0.6, 0.6), t.between(0.3, 1)),
          (t.between(-0.1, 0.1), 0, 1))
    t.scene.camera = made
