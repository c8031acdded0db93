"""Stages and materials of the procedural scenes as Blender has them. Wants the module bpy."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from training import color

from . import textures as tx
from .furniture import colour
from .mesh import Mesh
from .stage import Stage
from .views import View

SHINE = ("light", "panel")


def picture(bpy: ModuleType, path: str) -> np.ndarray:
    """Linear RGB (h, w, 3) in [0, 1] of an 8-bit image file, first row on top; ValueError."""
    try:
        image = bpy.data.images.load(path)
    except RuntimeError as err:
        raise ValueError(str(err).strip()) from None
    w, h = image.size
    flat = np.empty(w * h * 4, np.float32)
    image.pixels.foreach_get(flat)
    bpy.data.images.remove(image)
    return color.srgb_inverse(flat.reshape(h, w, 4)[::-1, :, :3].clip(0, 1))


def _image(bpy, name: str, a: np.ndarray):
    """A float image of linear RGB (h, w, 3)."""
    h, w = a.shape[:2]
    image = bpy.data.images.new(name, w, h, float_buffer=True, is_data=True)
    rgba = np.concatenate([a[::-1], np.ones((h, w, 1))], -1).astype(np.float32)
    image.pixels.foreach_set(np.ascontiguousarray(rgba).ravel())
    return image


class Material:
    """A principled material under construction: values of inputs, and nodes that feed them."""

    def __init__(self, bpy, name: str, **values) -> None:
        self.bpy, self.made = bpy, bpy.data.materials.new(name)
        self.made.use_nodes = True
        self.nodes, self.link = self.made.node_tree.nodes, self.made.node_tree.links.new
        self.inputs = self.nodes["Principled BSDF"].inputs
        for key, value in values.items():
            self.inputs[key.replace("_", " ")].default_value = value

    def colours(self) -> Material:
        """The base colour from the vertices."""
        node = self.nodes.new("ShaderNodeAttribute")
        node.attribute_name = "colour"
        self.link(node.outputs["Color"], self.inputs["Base Color"])
        return self

    def picture(self, a: np.ndarray, repeat: float = 1.0) -> Material:
        """The base colour from linear RGB (h, w, 3), `repeat` times along each unit of uv."""
        node, uv = self.nodes.new("ShaderNodeTexImage"), self.nodes.new("ShaderNodeTexCoord")
        scale = self.nodes.new("ShaderNodeMapping")
        scale.inputs["Scale"].default_value = (repeat, repeat, 1)
        node.image = _image(self.bpy, self.made.name, a)
        self.link(uv.outputs["UV"], scale.inputs["Vector"])
        self.link(scale.outputs["Vector"], node.inputs["Vector"])
        self.link(node.outputs["Color"], self.inputs["Base Color"])
        return self

    def bumps(self, scale: float, strength: float) -> Material:
        node, noise = self.nodes.new("ShaderNodeBump"), self.nodes.new("ShaderNodeTexNoise")
        noise.inputs["Scale"].default_value, node.inputs["Strength"].default_value = scale, strength
        self.link(noise.outputs[0], node.inputs["Height"])
        self.link(node.outputs["Normal"], self.inputs["Normal"])
        return self


def texture(rng: np.random.Generator, pictures: list[np.ndarray], texels: int,
            kinds: tuple) -> np.ndarray:
    """One of the pictures, if there are some, or one that is drawn: linear RGB (h, w, 3)."""
    if pictures and rng.random() < 0.5:
        return pictures[rng.integers(len(pictures))]
    return tx.picture(rng, texels, colour, kinds)


def shining(bpy, name: str, tint: np.ndarray, strength: float) -> object:
    """A material that shines, and is black otherwise."""
    return Material(bpy, name, Base_Color=(0, 0, 0, 1), Specular_IOR_Level=0.0,
                    Emission_Color=(*tint, 1), Emission_Strength=strength).made


def new_sky(bpy) -> object:
    """The background node of a new sky of the current scene."""
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    bpy.context.scene.world = world
    return world.node_tree.nodes["Background"]


def paint_sky(bpy, back, a: np.ndarray) -> None:
    """Gives such a node the colours of linear RGB (h, w, 3), all around."""
    tree = back.id_data
    node = tree.nodes.new("ShaderNodeTexEnvironment")
    node.image = _image(bpy, "sky", a)
    tree.links.new(node.outputs["Color"], back.inputs["Color"])


def material(bpy, rng: np.random.Generator, slot: str, mesh: Mesh, stage: Stage,
             pictures: list[np.ndarray], texels: int) -> object:
    """What a slot of materials.palette is in Blender, for all of its mesh; texels: along a side of
    textures."""
    rough = float(rng.choice([0.05, 0.2, 0.4, 0.8]))
    if slot in SHINE:
        tint, power = warm(rng), np.exp(rng.uniform(np.log(2), np.log(60)))
        return shining(bpy, slot, tint, power / (np.pi * max(mesh.area(), 1e-5)))
    if slot in ("floor", "wall") and rng.random() < (1.0 if slot == "floor" else 0.5):
        m = Material(bpy, slot, Roughness=rough if slot == "floor" else 0.9)
        kinds = tx.FLOORS if slot == "floor" else tx.PATTERNS
        m.picture(texture(rng, pictures, texels, kinds),
                  float(rng.uniform(0.2, 0.8)))
        return m.made
    if slot in ("print", "atlas"):
        a = stage.prints.bitmap if slot == "print" else tx.atlas(rng, 2 * texels, colour)
        return Material(bpy, slot, Roughness=float(rng.choice([0.3, 0.9]))).picture(a).made
    if slot == "glass":
        return Material(bpy, slot, Transmission_Weight=1.0, IOR=float(rng.uniform(1.3, 1.8)),
                        Roughness=float(rng.choice([0, 0, 0, 0.2]))).made
    kinds = {"metal": {"Metallic": 1.0, "Roughness": rough}, "gloss": {"Roughness": rough / 2},
             "leaf": {"Roughness": 0.5}, "special": {"Roughness": rough, "Coat_Weight": 0.8}}
    m = Material(bpy, slot, **kinds.get(slot, {"Roughness": 0.95})).colours()
    if slot == "special" and rng.random() < 0.6:
        m.bumps(float(rng.uniform(5, 40)), float(rng.uniform(0.1, 0.6)))
    return m.made


def warm(rng: np.random.Generator) -> np.ndarray:
    """Colour of a lamp: white, warm or cold."""
    return np.array([[1, 1, 1], [1, 0.8, 0.55], [0.7, 0.85, 1]][rng.integers(3)], float)


def _object(bpy, name: str, m: Mesh) -> object:
    """An object of triangles with normals, uv (downwards, as bitmaps are read) and colours."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(m.v.tolist(), [], m.f.tolist())
    data.validate()  # drops triangles without an area, on which Blender's normals crash
    corners = np.empty(len(data.loops), np.int32)
    data.loops.foreach_get("vertex_index", corners)
    uv = np.stack([m.uv[:, 0], 1 - m.uv[:, 1]], 1)[corners]
    data.uv_layers.new(name="uv").data.foreach_set("uv", uv.astype(np.float32).ravel())
    rgba = np.ones((len(m.v), 4), np.float32)
    rgba[:, :3] = 0.5 if m.c is None else m.c
    data.color_attributes.new("colour", "FLOAT_COLOR", "POINT").data.foreach_set(
        "color", rgba.ravel())
    data.normals_split_custom_set_from_vertices(m.n.tolist())
    made = bpy.data.objects.new(name, data)
    bpy.context.collection.objects.link(made)
    return made


def look(bpy, made: object, eye, target, up=(0.0, 0.0, 1.0)) -> None:
    """Turns a camera or a lamp, which look along -z, and adds it to the scene."""
    import mathutils
    z = np.asarray(eye, float) - np.asarray(target, float)
    z /= np.linalg.norm(z)
    x = np.cross(up, z)
    x = np.array([1.0, 0, 0]) if np.linalg.norm(x) < 1e-6 else x / np.linalg.norm(x)
    m = np.eye(4)
    m[:3, :3], m[:3, 3] = np.stack([x, np.cross(z, x), z], 1), eye
    made.matrix_world = mathutils.Matrix(m.tolist())
    bpy.context.collection.objects.link(made)


def furnish(bpy, rng: np.random.Generator, stage: Stage, pictures: list[np.ndarray],
            texels: int) -> None:
    """A stage's meshes, lamps and sky in the current, empty scene."""
    meshes = stage.by_slot()
    for slot, mesh in meshes.items():
        made = material(bpy, rng, slot, mesh, stage, pictures, texels)
        _object(bpy, slot, mesh).data.materials.append(made)
    for k, lamp in enumerate(stage.lamps):
        light = bpy.data.lights.new(f"lamp{k}", "SPOT" if lamp["type"] == "spot" else "POINT")
        light.energy, light.color = float(lamp["power"]) * 12, warm(rng)
        light.shadow_soft_size = float(rng.choice([0.01, 0.1, 0.3]))
        if lamp["type"] == "spot":
            light.spot_size = float(np.radians(2 * lamp["angle"]))
        look(bpy, bpy.data.objects.new(f"lamp{k}", light), lamp["from"],
              lamp.get("to", (0, 0, 0)))
    back = new_sky(bpy)
    lit = stage.lamps or any(slot in SHINE for slot in meshes)
    if rng.random() < stage.sky or not lit:
        paint_sky(bpy, back, tx.sky(rng, 512) if rng.random() < 0.9 else
                  np.ones((2, 4, 3)) * warm(rng))
        back.inputs["Strength"].default_value = float(np.exp(rng.uniform(-1.5, 1.5)))
    else:
        back.inputs["Color"].default_value = (0, 0, 0, 1)


def probe(bpy, eye: np.ndarray, dirs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """views.Probe of the current scene."""
    scene, graph = bpy.context.scene, bpy.context.evaluated_depsgraph_get()
    dist, ids = np.full(len(dirs), np.inf), np.zeros(len(dirs), np.int64)
    for k, d in enumerate(dirs):
        hit, at, _, index, _, _ = scene.ray_cast(graph, eye.tolist(), d.tolist())
        if hit:
            dist[k], ids[k] = np.linalg.norm(np.asarray(at) - eye), index
    return dist, ids


def place_camera(bpy, view: View, is_panorama: bool = False) -> None:
    """A camera for a view, or one there that sees all around, level (equirectangular)."""
    data = bpy.data.cameras.new("camera")
    made = bpy.data.objects.new("camera", data)
    scene = bpy.context.scene
    data.sensor_fit = ("VERTICAL" if scene.render.resolution_y < scene.render.resolution_x
                       else "HORIZONTAL")
    data.angle = float(np.radians(view.fov))
    data.clip_start, data.clip_end = 0.01, 1000.0
    if view.aperture:
        data.dof.use_dof, data.dof.focus_distance = True, view.focus
        data.dof.aperture_fstop = data.lens / 1000 / (2 * view.aperture)
    look(bpy, made, view.eye, view.target, (view.roll, 0.0, 1.0))
    if is_panorama:
        data.type, made.rotation_euler[0], made.rotation_euler[1] = "PANO", np.pi / 2, 0.0
        place = data if hasattr(data, "panorama_type") else data.cycles  # before Blender 5
        place.panorama_type = "EQUIRECTANGULAR"
    scene.camera = made
