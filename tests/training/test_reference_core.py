"""The built program gives the numpy reference's pictures, bit for bit, with integer models."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from export import denoise as command
from export.pixels import Frame
from export.reference import denoise, load_model
from export.synthetic import noisy
from export.tza import Writer
from tests.training.test_reference import BREAKS, MIXED, model_tensors
from training.imageio import read_image, read_pfm, write_exr, write_pfm

GOLDEN = Path(__file__).resolve().parent.parent / "golden"


def run(build: Path, work: Path, images: dict[str, np.ndarray], model: Path, *args: str):
    """oidnDenoise on PFM files; `args` holds the option that takes the main image."""
    command = [build / "bin" / "oidnDenoise", "-w", model, "-t", "float", "-o", "out.pfm",
               "--threads", "2"]
    for feature, option in (("color", args[0]), ("albedo", "--alb"), ("normal", "--nrm")):
        if feature in images:
            write_pfm(work / f"{feature}.pfm", images[feature])
            command += [option, f"{feature}.pfm"]
    done = subprocess.run([*map(str, command), *args[1:]], cwd=work, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return read_pfm(work / "out.pfm")


@pytest.mark.parametrize("name,content,args", [
    ("int_unet_9_mixed", "hdr", ("--hdr",)), ("int_unet_9_mixed", "ldr", ("--ldr",)),
    ("int_unet_9_extreme", "srgb", ("--ldr", "--srgb")), ("int_unet_6_wide", "hdr", ("--hdr",)),
    ("int_unet_large_3_wide", "hdr", ("--hdr",)),
    ("int_unet_9_aux", "hdr", ("--hdr",)), ("int_unet_6_aux_extreme", "ldr", ("--ldr",)),
    ("int_unet_3_widest", "lightmap-hdr", ("--hdr", "-f", "RTLightmap")),
    ("int_unet_3_eights", "lightmap-dir", ("--dir", "-f", "RTLightmap")),
])
def test_same_picture(name, content, args, build, work):
    model = load_model(GOLDEN / name / "weights.tza")
    images = {k: v[:53, :70] for k, v in noisy(70, 5, 2).items()}
    if content == "lightmap-dir":
        images["color"] = images["normal"]
    images["color"][3, 4] = np.nan, np.inf, -7
    images["color"][9:20, :] *= 1e-6
    images["color"][20:30, :] *= 1e5
    images = {k: images[k] for k in ("color", "albedo", "normal")[:model.inputs // 3]}
    wanted = denoise(model, Frame(images, content))
    got = run(build, work, images, GOLDEN / name / "weights.tza", *args)
    assert got.shape == wanted.shape and wanted.std() > 0
    assert (got.view(np.uint32) == wanted.astype(np.float32).view(np.uint32)).all()


@pytest.mark.parametrize("aux", [True, False])
def test_the_command_denoises_with_models_of_family_k(aux, build, work):
    weights = GOLDEN / "kernel" / "weights.tza"
    images = {k: v[:40, :50] for k, v in noisy(64, 5, 2).items() if aux or k == "color"}
    for short, feature in (("hdr", "color"), ("alb", "albedo"), ("nrm", "normal")):
        if feature in images:
            write_exr(work / f"x.{short}.exr", images[feature])
    command.main([str(weights), str(work / "x.hdr.exr"), str(work / "k.pfm")])
    images = {f: read_image(work / f"x.{s}.exr") for f, s in
              (("color", "hdr"), ("albedo", "alb"), ("normal", "nrm")) if f in images}
    got = run(build, work, images, weights, "--hdr")
    assert (read_pfm(work / "k.pfm").view(np.uint32) == got.view(np.uint32)).all()


def test_the_program_refuses_what_the_reference_refuses(build, work):
    write_pfm(work / "color.pfm", noisy(16, 1, 1)["color"])
    for feature in ("albedo", "normal"):
        write_pfm(work / f"{feature}.pfm", noisy(16, 1, 1)[feature])
    command = [str(build / "bin" / "oidnDenoise"), "--hdr", "color.pfm", "--alb", "albedo.pfm",
               "--nrm", "normal.pfm", "-w", "model.tza", "-o", "out.pfm"]

    def code(tensors) -> int:
        with Writer(work / "model.tza") as w:
            for name, tensor in tensors.items():
                w.write(name, tensor)
        return subprocess.run(command, cwd=work, capture_output=True).returncode

    assert MIXED.exists() and code(model_tensors()) == 0
    for change, word in BREAKS:
        tensors = model_tensors()
        change(tensors)
        assert code(tensors) > 0, word
