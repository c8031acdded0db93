"""Blender with this library in the place of the one it brings: its Python module bpy, Cycles'
denoiser and the compositor's node, in each of their qualities."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from training.imageio import read_image

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux") or importlib.util.find_spec("bpy") is None,
    reason="optional: bpy (Blender as a Python module) is not installed")

SCENE = """
import sys
import bpy
out, how, quality, prefilter, samples = sys.argv[1:]
bpy.ops.wm.read_factory_settings(use_empty=False)  # a cube, a lamp and a camera
bpy.ops.mesh.primitive_plane_add(size=40, location=(0, 0, -1))
bpy.data.lights[0].shadow_soft_size = 1.5
scene = bpy.context.scene
scene.render.engine = "CYCLES"
scene.cycles.device = "CPU"
scene.cycles.samples = int(samples)
scene.cycles.use_adaptive_sampling = False
scene.cycles.use_denoising = how == "cycles"
scene.render.threads_mode, scene.render.threads = "FIXED", 2
scene.render.resolution_x, scene.render.resolution_y = 96, 64
if how == "cycles":
    scene.cycles.denoiser = "OPENIMAGEDENOISE"
    scene.cycles.denoising_use_gpu = False
    scene.cycles.denoising_quality = quality.upper()
    scene.cycles.denoising_prefilter = prefilter.upper()
elif how == "node":
    scene.view_layers[0].cycles.denoising_store_passes = True
    tree = bpy.data.node_groups.new("denoised", "CompositorNodeTree")
    scene.compositing_node_group = tree
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    layers = tree.nodes.new("CompositorNodeRLayers")
    node = tree.nodes.new("CompositorNodeDenoise")
    result = tree.nodes.new("NodeGroupOutput")
    for source, target in (("Image", "Image"), ("Denoising Albedo", "Albedo"),
                           ("Denoising Normal", "Normal")):
        tree.links.new(layers.outputs[source], node.inputs[target])
    tree.links.new(node.outputs[0], result.inputs[0])
    node.inputs["Quality"].default_value = quality
    node.inputs["Prefilter"].default_value = prefilter
scene.render.image_settings.file_format = "OPEN_EXR"
scene.render.image_settings.color_depth = "32"
scene.render.filepath = out
bpy.ops.render.render(write_still=True)
"""


def render(build: Path, out: Path, *how: str) -> tuple[np.ndarray, str]:
    """The picture, and what the library says of its filters."""
    env = {**os.environ, "LD_LIBRARY_PATH": str(build / "lib"), "OIDN_VERBOSE": "2"}
    done = subprocess.run([sys.executable, "-c", SCENE, out, *how], capture_output=True, text=True,
                          env=env, timeout=600)
    assert done.returncode == 0 and out.exists(), done.stderr
    return read_image(out), done.stdout + done.stderr


@pytest.fixture(scope="module")
def plain(build: Path, tmp_path_factory) -> list[np.ndarray]:
    """The picture of 256 samples and of 2, not denoised."""
    images = []
    for samples in ("256", "2"):
        out = tmp_path_factory.mktemp("plain") / "out.exr"
        image, log = render(build, out, "none", "", "", samples)
        assert "kernel5" not in log
        images.append(image)
    return images


@pytest.mark.parametrize("how", ["cycles", "node"])
@pytest.mark.parametrize("quality, prefilter, filters", [
    ("High", "Accurate", 3), ("Balanced", "Fast", 1), ("Fast", "None", 1)])
def test_blender_denoises_with_it(build, tmp_path, plain, how, quality, prefilter, filters):
    image, log = render(build, tmp_path / "out.exr", how, quality, prefilter, "2")
    assert log.count("Network: kernel5") >= filters, log
    clean, noisy = plain
    assert np.isfinite(image).all()
    error, before = (float(np.abs(x - clean).mean()) for x in (image, noisy))
    assert error < before / 2
