"""A data set laid out for Open Image Denoise's toolkit all the way to its runtime and ours, with
its documented option names; and what bad data leads to, row by row."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from export import export
from tests.training.tools import QUICK, TINY, make_raw, picture, write_features
from training import compare_image, doctor, infer, peer, preprocess, split_exr, train
from training.imageio import read_image, write_image

FEATURES = ["hdr", "alb", "nrm"]
RAW = [*FEATURES, "--raw", "-t", "train", "-s", "3", *QUICK, "-e", "1", "-r", "a", "-D", "data"]


def run_program(program: Path, images: list[str], weights: str, out: str) -> np.ndarray:
    """An oidnDenoise with weights on a picture's features."""
    options = [x for f, i in zip(("--hdr", "--alb", "--nrm"), images) for x in (f, i)]
    done = subprocess.run([program, "-d", "cpu", *options, "-w", weights, "-o", out],
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return read_image(Path(out))


@pytest.fixture(scope="module")
def trained(tmp_path_factory) -> Path:
    """A folder in which their documented sequence has been run."""
    work = tmp_path_factory.mktemp("oidn")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(work)
        for name, groups in (("rt_train", 4), ("rt_valid", 1), ("rt_test", 1)):
            make_raw(Path("data") / name, groups, spp=(1, 4), ref="4096spp")
        preprocess.main([*FEATURES, "--filter", "RT", "--train_data", "rt_train",
                         "--valid_data", "rt_valid", "--data_dir", "data", "--preproc_dir",
                         "preproc"])
        train.main([*FEATURES, "--filter", "RT", "--train_data", "rt_train", "--valid_data",
                    "rt_valid", "--result", "rt_hdr_alb_nrm", "--results_dir", "results",
                    "--model", TINY, "--loss", "l1_msssim", "--batch_size", "4", "--tile_size",
                    "32", "--max_lr", "2e-3", "--num_epochs", "6", "--num_valid_epochs", "3",
                    "--num_save_epochs", "3", "--num_loaders", "1", "--precision", "fp32",
                    "--device", "cpu", "--num_devices", "1", "--seed", "1", "--deterministic"])
        infer.main(["--result", "rt_hdr_alb_nrm", "--input_data", "rt_test", "--output_dir",
                    "infer", "--output_suffix", "out", "--format", "exr", "png", "--metric",
                    "psnr", "ssim", "--num_epochs", "3", "--save_all"])
        infer.main(["--result", "rt_hdr_alb_nrm", "--input_data", "rt_test"])
        export.main(["--result", "rt_hdr_alb_nrm", "--output", "weights.tza"])
    return work


def test_their_sequence_leaves_their_files(trained):
    (folder,) = (trained / "preproc").glob("rt_train.*")
    assert {p.name for p in folder.iterdir()} == {"images.tza", "samples.json", "config.json"}
    result = trained / "results" / "rt_hdr_alb_nrm"
    assert {p.name for p in result.iterdir()} >= {"config.json", "checkpoints", "log"}
    assert (result / "checkpoints" / "checkpoint_6.pth").exists()
    names = {p.name for p in (trained / "infer" / "rt_test" / "scene0").iterdir()}
    assert {"view0_0001spp.out_3.hdr.exr", "view0_0001spp.out_3.hdr.png", "view0_4096spp.hdr.exr",
            "view0_0001spp.rt_hdr_alb_nrm.hdr.exr"} <= names


def test_compare_image(trained, capsys, monkeypatch):
    monkeypatch.chdir(trained)
    stem = "rt_test/scene0/view0_"
    compare_image.main([f"infer/{stem}0004spp.rt_hdr_alb_nrm.hdr.exr",
                        f"data/{stem}4096spp.hdr.exr", "--metric", "psnr", "ssim", "mse",
                        "--exposure", "1"])
    assert re.fullmatch(r"psnr = [\d.]+, ssim = [\d.]+, mse = [\d.]+\n", capsys.readouterr().out)


@pytest.mark.parametrize("whose", ["lull", "oidn"])
def test_exported_weights_give_the_picture_of_infer(trained, build, whose, monkeypatch):
    """lull and the real Open Image Denoise, within the latter's own tolerance."""
    monkeypatch.chdir(trained)
    program = build / "bin" / "oidnDenoise" if whose == "lull" else peer.find_binary()
    if program is None or not program.exists():
        pytest.skip("optional: " + ("pyoidn is not installed" if whose == "oidn"
                                    else "the programs are not built"))
    stem = "rt_test/scene0/view0_0004spp"
    for f in FEATURES:  # formats that every build reads
        write_image(Path(f"{f}.pfm"), read_image(Path(f"data/{stem}.{f}.exr")))
    got = run_program(program.resolve(), [f"{f}.pfm" for f in FEATURES], "weights.tza",
                      f"{whose}.pfm")
    mean, outliers = peer.difference(got, read_image(
        Path(f"infer/{stem}.rt_hdr_alb_nrm.hdr.exr")))
    assert mean < 0.003 and outliers == 0


# ---- Bad data: one clear line, a distinct status, nothing half-written ---------------------------

@pytest.fixture
def data(work) -> Path:
    """A good data set `train` of two groups that a test spoils."""
    return make_raw(work / "data" / "train", 2)


def nothing_written() -> bool:
    return not [p for p in Path(".").rglob("*") if p.parts[0] in ("results", "preproc", "infer")
                and p.is_file()]


def spoil(folder: Path, pattern: str, change) -> None:
    for path in folder.rglob(pattern):
        change(path)


def test_truncated_exr(data, fails, capsys):
    spoil(data, "*_ref.hdr.exr", lambda p: p.write_bytes(p.read_bytes()[:400]))
    code, message = fails(train.main, RAW)
    assert code == 3 and "no training images" in message
    assert "left out scene0/view0: " in capsys.readouterr().out  # names the file and the reason
    code, message = fails(preprocess.main, [*FEATURES, "-t", "train"])
    assert code == 3 and nothing_written()
    assert fails(split_exr.main, [str(next(data.rglob("*_ref.hdr.exr")))])[0] == 3


def test_missing_feature(data, fails, capsys):
    spoil(data, "*spp.nrm.exr", Path.unlink)
    for main, args in ((train.main, RAW), (preprocess.main, [*FEATURES, "-t", "train"])):
        code, message = fails(main, args)
        assert code == 3 and ("no training images" in message or "no usable group" in message)
        assert "left out: 4 x lacks nrm (e.g. scene0/view0_0001spp)" in capsys.readouterr().out
    assert nothing_written()


def test_two_sizes_in_a_group(data, fails, capsys):
    shutil.rmtree(data / "scene1")
    write_features(data / "scene0", "view0_0001spp", picture(0, 32, 64))
    for path in (data / "scene0").glob("view0_0004spp*"):
        path.unlink()
    code, message = fails(preprocess.main, [*FEATURES, "-t", "train"])
    assert code == 3 and nothing_written()
    assert "view0_0001spp: 64x32 pixels, its reference has 64x48" in capsys.readouterr().out
    code, _ = fails(doctor.main, [*FEATURES, "-i", "train"])
    assert code == 3


def test_not_a_number(data, fails, capsys):
    """doctor finds it; training goes on with zeros there, and its weights stay finite."""
    path = data / "scene0" / "view0_0004spp.hdr.exr"
    image = read_image(path)
    image[3, 4] = np.nan
    write_image(path, image)
    code, message = fails(doctor.main, [*FEATURES, "-i", "train"])
    assert code == 3 and message == "1 findings in 2 groups"
    assert "view0_0004spp: hdr: 1 pixels with NaN or infinity" in capsys.readouterr().out
    train.main(RAW)
    assert "nan" not in capsys.readouterr().out.lower()


def test_no_reference(data, fails, capsys):
    spoil(data, "*_ref.*", Path.unlink)
    spoil(data, "*_0004spp.*", Path.unlink)
    code, message = fails(train.main, RAW)
    assert code == 3 and "no training images" in message and nothing_written()
    assert "2 x no reference (a single version)" in capsys.readouterr().out


def test_unwritable_output(data, fails):
    for folder in ("results", "preproc"):
        Path(folder).write_text("a file where a folder belongs")
    for main, args in ((train.main, RAW), (preprocess.main, [*FEATURES, "-t", "train"])):
        code, message = fails(main, args)
        assert code == 5 and "cannot write" in message
    assert Path("results").read_text().startswith("a file")


def test_wrong_option(data, script):
    done = script("train", *RAW, "--bach_size", "4", timeout=600)
    assert done.returncode == 2 and not Path("results").exists()
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("Error: ") and "--bach_size" in lines[0]
