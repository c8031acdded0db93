"""What users get wrong, and what their files hold: one line that names it, or the right thing."""
from __future__ import annotations

import errno
import importlib
import json
import os
import re
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
import torch

from export import bilateral, export, manifest, quantize, quantize_kernel, temper
from tests.training.test_kernel_train import RAW, TINY
from tests.training.tools import QUICK, make_raw, picture, write_features
from training import (average, color, compare_image, convert_image, doctor, evaluate, infer, nets,
                      quantize_aware, train)
from training.errors import ToolError
from training.features import load
from training.imageio import read_image, write_image
from training.result import Result, save_state
from training.scan import scan
from training.scenes import leaves, sheet
from training.settings import SCRIPTS, make_parser
from export.tza import write_weights


def test_images_with_nan_are_not_compared(work, fails):
    image = picture(0)["hdr"]
    write_image(Path("a.hdr.pfm"), image)
    image[3, 4, 1] = np.nan
    write_image(Path("b.hdr.pfm"), image)
    for names in (["a.hdr.pfm", "b.hdr.pfm"], ["b.hdr.pfm", "a.hdr.pfm"]):
        code, message = fails(compare_image.main, names)
        assert code == 3 and message == "b.hdr.pfm: 1 values are no numbers"


@pytest.mark.parametrize("value", [np.inf, 1e20, 3e38])
def test_the_brightest_values_are_white(work, capsys, value):
    image = picture(0)["hdr"]
    write_image(Path("a.hdr.pfm"), image)
    image[3, 4] = value
    write_image(Path("b.hdr.pfm"), image)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert (color.display(image)[3, 4] > 0.999).all()
        compare_image.main(["a.hdr.pfm", "b.hdr.pfm", "-M", "psnr", "ssim"])
        assert (color.display(image, 8)[3, 4] > 0.999).all()
        for name in "c.png", "c.ldr.pfm", "c.hdr.phm":
            convert_image.main(["b.hdr.pfm", name, "-E", "8"])
    psnr = float(capsys.readouterr().out.split()[2].rstrip(","))
    assert 20 < psnr < 60
    assert np.isinf(read_image(Path("c.hdr.phm"))[3, 4]).all()


def test_a_measurement_of_nothing_is_an_error(work, fails):
    write_weights("a.tza", {k: v.numpy() for k, v in nets.build("w8", 3).state_dict().items()})
    write_features(Path("pictures"), "p_4", {"hdr": picture(0)["hdr"]})
    write_features(Path("pictures"), "p_ref", {"hdr": picture(0)["hdr"]})
    images = ["--images", "pictures", "--no_oidn"]
    for arguments, code, text in (
            (["a.tza=hdr"], 2, "--images"), (["a.tza", *images], 2, "a.tza=hdr,alb,nrm"),
            (["a.tza=hdr,alb", *images], 2, "input channels"),
            (["b.tza=hdr", *images], 3, "b.tza: cannot read")):
        got, message = fails(evaluate.main, arguments)
        assert got == code and text in message, arguments
    Path("b.tza").write_bytes(Path("a.tza").read_bytes()[:100])
    got, message = fails(evaluate.main, ["b.tza=hdr", *images])
    assert got == 4 and "b.tza" in message


def test_normals_of_pngs_are_those_of_data_sets(work):
    images = picture(0)
    write_features(Path("d"), "p_4", {"hdr": images["hdr"]})
    write_features(Path("n"), "x", {"nrm": images["nrm"]})
    convert_image.main(["n/x.nrm.exr", "d/p_4.nrm.png"])
    write_features(Path("d"), "p_ref", {"hdr": images["hdr"]})
    loaded = load(scan(Path("d"), ["hdr", "nrm"], ["hdr"]).groups[0].inputs[0], ["nrm"])["nrm"]
    assert np.abs(loaded - np.clip(images["nrm"], -1, 1)).max() < 0.01


def test_black_is_written_to_radiance_files_without_warnings(work):
    image = picture(0)["hdr"]
    image[:4] = 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_image(Path("a.hdr"), image)
    assert (read_image(Path("a.hdr"))[:4] == 0).all()


@pytest.mark.parametrize("arguments, text", [
    (["--lr", "nan"], "learning_rate"), (["--max_lr", "-1"], "max_learning_rate"),
    (["--max_lr", "inf"], "max_learning_rate"), (["-c", "c.json"], "batch_size: 'four'")])
def test_numbers_that_are_none(work, fails, arguments, text):
    Path("c.json").write_text(json.dumps({"batch_size": "four"}))
    code, message = fails(train.main, [*RAW, "-D", "d", *arguments])
    assert code == 2 and text in message


def test_an_epoch_or_the_best(work, fails):
    for main in (export.main, infer.main):
        code, message = fails(main, ["-r", "a", "-e", "1", "--best"])
        assert code == 2 and "--best" in message


def test_export_says_how_family_k_runs(work, capsys):
    make_raw(work / "d" / "train", 2)
    train.main([*RAW, "-D", "d", "-e", "1", "-r", "a"])
    export.main(["-r", "a", "-o", "a.tza"])
    assert "--int8" in capsys.readouterr().out and TINY


def test_termination_saves_like_an_interrupt(work):
    """As batch systems send it."""
    make_raw(work / "d" / "train", 2)
    command = [sys.executable, "-m", "training.train", *RAW, "-D", "d", "-e", "100000", "-r", "a",
               "--save_epochs", "0"]
    environment = os.environ | {"PYTHONPATH": str(nets.ROOT)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                          env=environment) as process:
        for _ in range(600):
            time.sleep(0.1)
            if list(work.glob("results/a/log/*")):
                break
        time.sleep(2)
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 130 and "the same command resumes" in err
    assert (work / "results/a/checkpoints/latest").exists()


def test_pictures_too_small_for_ssim(work, fails, capsys):
    """What infer made of them is kept."""
    make_raw(work / "data" / "train", 2)
    make_raw(work / "data" / "test", 1, spp=(4,), height=10, width=64)
    train.main([*RAW, "-e", "1", "-r", "a"])
    stem = "data/test/scene0/view0"
    output = Path("infer/test/scene0/view0_0004spp.a.hdr.exr")
    for call in ((compare_image, f"{stem}_0004spp.hdr.exr", f"{stem}_ref.hdr.exr"),
                 (infer, "-r", "a")):
        code, message = fails(call[0].main, list(call[1:]))
        assert code == 3 and "_0004spp" in message
        assert "64x10 pixels, SSIM needs 11x11 (--metric chooses others)" in message
    assert output.exists()
    infer.main(["-r", "a", "-M", "psnr"])
    assert "(1 images)" in capsys.readouterr().out


def test_doctor_compares_light_where_it_is_finite(work, fails, capsys):
    for name in ("p_4", "p_ref"):
        image = picture(0)["hdr"]
        image[3, 4 if name == "p_4" else 5], image[6, 7] = np.inf, np.nan
        write_features(Path("data/d"), name, {"hdr": image})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert fails(doctor.main, ["hdr", "-i", "d"])[0] == 3
    out = capsys.readouterr().out
    assert "p_4: hdr: 2 pixels with NaN or infinity" in out and "as bright" not in out


def test_pictures_of_one_pixel(work, capsys):
    """In one direction or both."""
    make_raw(work / "data" / "train", 2)
    for name, height, width in (("a", 1, 1), ("b", 1, 40), ("c", 40, 1), ("d", 2, 1)):
        images = {k: v[:height, :width] for k, v in picture(1).items()}
        for spp in (4, 64):
            write_features(work / "data" / "test", f"{name}_{spp}", images)
    train.main([*RAW, "-m", TINY, "-e", "1", "-r", "k"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        infer.main(["-r", "k", "-M", "mse"])
        assert "(4 images)" in capsys.readouterr().out
        with pytest.raises(ToolError, match="4 findings in 4 groups"):  # both are the same
            doctor.main(["hdr", "alb", "nrm", "-i", "test"])


def test_pictures_too_small_to_train_on(work, fails):
    """They are named, those for validation before the training begins."""
    make_raw(work / "data" / "train", 2)
    write_features(work / "data" / "train", "small_4", picture(0, 24, 64))
    write_features(work / "data" / "train", "small_64", picture(0, 24, 64))
    code, message = fails(train.main, [*RAW, "-r", "a"])
    assert code == 2 and message.startswith("small: ")
    assert message.endswith("(24 < 32): choose --tile_size 16 or less")
    tiny = {k: v[:8, :8] for k, v in picture(0).items()}
    for spp in (4, 64):
        write_features(work / "data" / "train", f"tiny_{spp}", tiny)
        write_features(work / "data" / "valid", f"tiny_{spp}", tiny)
    assert fails(train.main, [*RAW, "-r", "a"])[1].endswith("(8 < 32): leave it out")
    for path in (work / "data" / "train").glob("*.exr"):
        path.unlink()
    code, message = fails(train.main, [*RAW, "-v", "valid", "-r", "a"])
    assert code == 3 and message == "the validation pictures are smaller than 16x16 pixels"
    assert not Path("results/a").exists()


@pytest.mark.parametrize("at", ["add_scalar", "close"])
def test_training_outlives_a_log_that_cannot_be_written(work, capsys, monkeypatch, at):
    """Disks fill up: the log ends with a warning, the training with its checkpoint."""
    writer = pytest.importorskip("torch.utils.tensorboard").SummaryWriter

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(writer, at, full)
    make_raw(work / "data" / "train", groups=1)
    train.main(["hdr", "-D", "data", "-t", "train", "--raw", "-r", "a", "-e", "2", *QUICK])
    said = capsys.readouterr()
    assert "Finished" in said.out and Result("results", "a").latest_epoch() == 2
    assert said.err == (f"Warning: {Path('results/a/log')}: cannot write (No space left on device);"
                        " the log ends here\n")


def test_why_a_checkpoint_cannot_be_written_is_told(work):
    """As on a full disk, where PyTorch speaks of positions in its container."""
    resource = pytest.importorskip("resource")
    text = re.escape(f"a.pth: cannot write ({os.strerror(errno.EFBIG)})")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 12, before[1]))
    try:
        with pytest.raises(ToolError, match=text):
            save_state(Path("a.pth"), {"weight": torch.zeros(1 << 14)})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(work.iterdir())


@pytest.mark.parametrize("features", [["z"], ["hdr", "z"]])
def test_there_are_no_integers_with_depth(work, fails, features):
    """Neither of it nor beside it, as no program takes them, be the data there or not."""
    for version in "4", "ref":
        image = picture(0)["hdr"]
        write_features(Path("data/train"), f"p_{version}", {"hdr": image})
        write_image(Path(f"data/train/p_{version}.z.exr"), image[..., :1])
    train.main([*features, "-D", "data", "-t", "train", "--raw", "-r", "a", "-e", "1", *QUICK])
    for name in "data", "gone":
        code, message = fails(export.main, ["-r", "a", "--int8"])
        assert code == 4 and message.endswith("a: there are no integer models of z")
        if name == "data":
            Path("data").rename("gone")


def test_normals_of_nothing_in_8_bits_have_no_length_to_find(work):
    """n * 0.5 + 0.5 of 0 lies between two codes."""
    normals = np.zeros((8, 8, 3), np.float32)
    normals[:2, :, 2] = -1
    write_image(Path("n.png"), normals * 0.5 + 0.5)
    stored = read_image(Path("n.png")) * 2 - 1
    assert stored[4:].any() and not [*doctor.check_normals(stored)]
    assert [*doctor.check_normals(stored * 0.5)] == [
        "nrm: far from unit length (by 0.50 on average)"]


@pytest.mark.parametrize("tool", [average, bilateral, evaluate, leaves, manifest, quantize,
                                  quantize_aware, quantize_kernel, sheet, temper])
def test_wrong_options_of_all_tools_are_one_line(tool, fails):
    code, message = fails(tool.main, ["--nonsense"])
    assert code == 2 and "(--help lists the options)" in message


@pytest.mark.parametrize("name", SCRIPTS)
def test_the_calls_that_a_help_shows_can_be_copied(name):
    tool = importlib.import_module(f"training.{name}")
    doc = (tool.__doc__ or "").rstrip()
    assert doc and f"\n{doc}\n" in make_parser(name, doc).format_help()
