"""Data sets that weights files are quantised on: layers of other names, and unreadable pictures."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from export import golden_kernel, quantize_kernel
from export.kernel import LEVELS
from export.quantize_kernel import calibration_set
from export.tza import Reader, write_weights
from tests.training.tools import TINY, make_raw, noisy, picture
from training import nets, quantize_aware
from training.features import parse_layers
from training.imageio import write_exr

LAYERS = ["hdr=mine", "albedo=colour", "nrm=up"]


def write_layers(root):
    """The pictures of make_raw with layers of names that are not known."""
    root.mkdir()
    for g in range(3):
        for spp, images in ("0004spp", noisy(picture(g), 4, g)), ("ref", picture(g)):
            names = tuple(f"{layer.partition('=')[2]}.{c}" for layer in LAYERS for c in "RGB")
            write_exr(root / f"view{g}_{spp}.exr", np.concatenate([*images.values()], -1), names)


def test_layers_of_other_names_calibrate(work):
    make_raw(work / "plain", 3, spp=(4,))
    write_layers(work / "layers")
    plain = calibration_set(work / "plain", 3)
    for a, b in zip(plain, calibration_set(work / "layers", 3, layers=parse_layers(LAYERS))):
        assert np.array_equal(a, b)


def test_weights_files_are_quantised_on_layers_of_other_names(work, fails):
    write_layers(work / "layers")
    torch.manual_seed(5)
    for name, widths, inputs in ("u", TINY, 9), ("k", "kernel5:" + ",".join(["4"] * 14), 0):
        tensors = nets.build(widths, inputs).state_dict()
        write_weights(f"{name}.tza", {k: v.numpy() for k, v in tensors.items()})
    for tool, args in ((quantize_kernel, ["k.tza", "out.tza", "--data", "layers"]),
                       (quantize_aware, ["u.tza", "out.tza", "-D", ".", "-t", "layers", "--steps",
                                         "1", "--ts", "32", "-b", "2"])):
        assert fails(tool.main, args)[0] == 3
        tool.main([*args, "--layers", *LAYERS])
        assert len(Reader(Path("out.tza"))) > LEVELS
        Path("out.tza").unlink()


def test_pictures_that_cannot_be_read_do_not_calibrate(work, capsys):
    """The first one ended it."""
    make_raw(work / "d", 3, spp=(4,))
    (work / "d/scene1/view1_0004spp.alb.exr").write_bytes(b"broken")
    assert len(calibration_set(work / "d", 3)) == 2
    assert "left out scene1/view1_0004spp: " in capsys.readouterr().out


def test_help_writes_nothing(work):
    """export.golden_kernel took it for a folder."""
    with pytest.raises(SystemExit) as ended:
        golden_kernel.main(["--help"])
    assert ended.value.code == 0 and not list(work.iterdir())


def test_products_of_numpy_take_one_thread(root):
    """In every module of both packages, unless the environment says otherwise; numpy's threads spin
    while they wait, which made quantising take three times the time of a busy machine."""
    env = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    for package in "export", "training":
        said = subprocess.run([sys.executable, "-c", f"import os, sys, {package}\n"
                               "print(os.environ['OPENBLAS_NUM_THREADS'], 'numpy' in sys.modules)"],
                              cwd=root, env=env, capture_output=True, text=True, check=True)
        assert said.stdout.split() == ["1", "False"]
