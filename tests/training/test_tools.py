"""infer, export and the image tools, from results of trainings of seconds."""

import json
import os
import re
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

from export import export
from export.tza import Reader
from tests.training.tools import QUICK, make_raw, picture, read_fields, write_features
from training import (color, compare_image, convert_image, errors, evaluate, infer, metrics, peer,
                      split_exr, train, visualize)
from training.imageio import read_image, write_exr, write_image
from training.result import Result, load_model


@pytest.fixture(scope="module")
def results(raw, tmp_path_factory) -> Path:
    """A results folder: `a` (hdr alb nrm, epochs 4 and 8), `nrm`, `alb` (aux), `plain` (hdr)."""
    folder = tmp_path_factory.mktemp("results")
    args = ["--raw", "-D", str(raw), "-t", "train", "-s", "1", *QUICK, "-R", str(folder)]
    train.main(["hdr", "alb", "nrm", *args, "-r", "a", "-e", "8", "--save_epochs", "4", "-v",
                "valid", "--valid_epochs", "4"])
    train.main(["hdr", *args, "-r", "plain", "-e", "2"])
    for aux in ("alb", "nrm"):
        train.main([aux, *args, "-r", aux, "-e", "2"])
    return folder


def test_infer_writes_and_measures(raw, results, work, capsys):
    infer.main(["-r", "a", "-R", str(results), "-D", str(raw), "-i", "valid", "-F", "exr", "pfm",
                "png", "-M", "psnr", "ssim", "mse", "msssim", "--save_all"])
    out = capsys.readouterr().out
    rows = re.findall(r"^(\S+) \.\.\. psnr=([\d.]+), ssim=([\d.]+), mse=", out, re.M)
    assert [r[0] for r in rows] == ["scene0/view0_0001spp", "scene0/view0_0004spp",
                                    "scene1/view1_0001spp", "scene1/view1_0004spp"]
    mean = np.mean([float(r[1]) for r in rows])
    assert f"a: psnr_avg={mean:.2f}"[:-1] in out and out.rstrip().endswith("(4 images)")
    folder = Path("infer/valid/scene0")
    assert sorted(p.name for p in folder.iterdir()) == sorted(
        f"view0_{v}.hdr.{e}" for v in ("0001spp.a", "0001spp", "0004spp.a", "0004spp", "ref")
        for e in ("exr", "pfm", "png"))
    exr, pfm = (read_image(folder / f"view0_0004spp.a.hdr.{e}") for e in ("exr", "pfm"))
    assert np.array_equal(exr, pfm) and exr.shape == (48, 64, 3)
    shown = metrics.psnr(color.display(exr), color.display(picture(0)["hdr"]))
    assert f"{shown:.4f}" == f"{float(rows[1][1]):.4f}"


def test_infer_epoch_best_and_raw_weights(raw, results, work, fails):
    args = ["-R", str(results), "-D", str(raw), "-i", "valid", "-r", "a"]
    infer.main([*args, "-e", "4", "-o", "mine"])
    assert Path("infer/valid/scene0/view0_0001spp.mine_4.hdr.exr").exists()
    for i, more in enumerate((["-e", "8"], ["-e", "8", "--weights", "raw"], ["--best"])):
        infer.main([*args, "-O", str(i), *more])
    images = [read_image(next(Path(f"{i}/valid/scene0").glob("view0_0001*"))) for i in range(2)]
    assert not np.array_equal(*images)
    code, message = fails(infer.main, [*args, "-e", "5"])
    assert code == 4 and "checkpoint does not exist" in message
    assert fails(infer.main, ["-R", str(results), "-r", "none"])[0] == 4
    assert fails(infer.main, ["-R", str(results)])[0] == 2
    assert fails(infer.main, [*args, "-F", "bmp"])[0] == 2
    code, message = fails(infer.main, [*args[:4], "-i", "x", "-r", "a"])
    assert code == 3


def test_infer_beside_the_inputs_and_where_it_cannot_write(results, work, fails):
    make_raw(work / "data" / "test", 1)
    (work / "data" / "test" / "scene0" / "view0.json").write_text('{"exposure": 2.0}')
    args = ["-R", str(results), "-r", "a"]
    infer.main([*args, "-O", "data"])
    assert Path("data/test/scene0/view0_0001spp.a.hdr.exr").exists()
    code, message = fails(infer.main, [*args, "-O", "data/test/scene0/view0.json"])
    assert code == 5 and "view0.json/test/scene0/view0.json: cannot write" in message


def test_infer_leaves_out_what_it_cannot_read(results, work, capsys, fails):
    """A broken picture, and a reference of another size, do not keep others from being denoised."""
    root = make_raw(work / "data" / "test", 3)
    for broken in "scene0/view0_0001spp.alb", "scene1/view1_ref.hdr":
        (root / f"{broken}.exr").write_bytes(b"\x76\x2f\x31\x01")
    write_features(root / "scene2", "view2_ref", picture(2, 32, 32))
    args = ["-R", str(results), "-r", "a", "-M", "psnr"]
    infer.main(args)
    out = capsys.readouterr().out
    assert "left out scene0/view0_0001spp: " in out and "left out scene1/view1_ref: " in out
    assert "not measured: scene2/view2_0004spp: 64x48 pixels, its reference has 32x32" in out
    assert "(1 images)" in out and len([*Path("infer").rglob("*.exr")]) == 5
    for path in root.rglob("*spp.nrm.exr"):
        path.write_bytes(b"")
    code, message = fails(infer.main, args)
    assert code == 3 and message.endswith("data/test: no picture can be read")


def test_normals_are_remapped_once_per_picture(raw, results, work):
    """Two linear formats hold the same normals, in [-1,1]."""
    infer.main(["-r", "nrm", "-R", str(results), "-D", str(raw), "-i", "valid", "-F", "exr", "pfm"])
    a, b = (read_image(Path(f"infer/valid/scene0/view0_0001spp.nrm.nrm.{e}"))
            for e in ("exr", "pfm"))
    assert np.array_equal(a, b) and -1 <= a.min() < 0 and a.max() <= 1


def test_infer_and_compare_agree_on_normals(raw, results, work, capsys):
    infer.main(["-r", "nrm", "-R", str(results), "-D", str(raw), "-i", "valid"])
    printed = re.search(r"view0_0001spp \.\.\. psnr=([\d.]+), ssim=([\d.]+)",
                        capsys.readouterr().out).groups()
    compare_image.main(["infer/valid/scene0/view0_0001spp.nrm.nrm.exr",
                        str(raw / "valid/scene0/view0_ref.nrm.exr")])
    assert capsys.readouterr().out.strip() == f"psnr = {printed[0]}, ssim = {printed[1]}"


def test_infer_without_reference_odd_size_and_metadata(results, work, capsys):
    data = make_raw(work / "data" / "d", 1, spp=(4,), height=37, width=51)
    for path in data.glob("*/*_ref*"):
        path.unlink()
    (data / "scene0" / "view0.json").write_text('{"exposure": 2.0}')
    infer.main(["-r", "a", "-R", str(results), "-D", "data", "-i", "d", "-F", "exr", "png"])
    exr = read_image(Path("infer/d/scene0/view0_0004spp.a.hdr.exr"))
    png = read_image(Path("infer/d/scene0/view0_0004spp.a.hdr.png"))
    assert exr.shape == (37, 51, 3)
    assert np.abs(png - color.display(exr, 2.0)).max() < 1 / 250
    assert Path("infer/d/scene0/view0.json").exists()
    assert "psnr" not in capsys.readouterr().out
    assert infer.read_metadata(data, "scene0/view0_b_c")[0] == 2.0


def test_prefiltered_aux(raw, results, work, fails):
    """Prefilters change the aux channels of inputs only, in preprocessing and inference."""
    from training import preprocess
    from training.auxiliary import run_network
    args = ["hdr", "alb", "nrm", "-D", str(raw), "-t", "valid", "-R", str(results)]
    preprocess.main(args)
    preprocess.main([*args, "-P", "pre", "-a", "alb", "nrm"])
    plain, filtered = (Reader(next(Path(p).iterdir()) / "images.tza") for p in ("preproc", "pre"))
    name = "scene0/view0_0001spp"
    assert np.array_equal(plain[name][..., :3], filtered[name][..., :3])
    model = load_model(Result(results, "nrm"))[0]
    want = np.clip(run_network(model, plain[name][..., 6:].astype(np.float32)), 0, 1)
    assert np.abs(want - filtered[name][..., 6:]).max() < 2e-3
    assert np.abs(filtered[name][..., 3:6] - plain[name][..., 3:6].astype(np.float32)).max() > 0.01
    infer.main(["-r", "a", "-R", str(results), "-D", str(raw), "-i", "valid", "-a", "nrm"])
    infer.main(["-r", "a", "-R", str(results), "-D", str(raw), "-i", "valid", "-O", "plain"])
    a, b = (read_image(Path(f"{o}/valid/{name}.a.hdr.exr")) for o in ("infer", "plain"))
    assert not np.array_equal(a, b)
    code, message = fails(preprocess.main, [*args, "-a", "plain"])
    assert code == 4 and "does not correspond to an auxiliary feature" in message
    assert fails(preprocess.main, [*args, "--clean_aux", "-a", "alb"])[0] == 2


def test_exported_weights_are_the_model(results, work, capsys):
    export.main(["-r", "a", "-R", str(results), "-o", "a.tza"])
    assert "enc_conv0.weight (4, 9, 3, 3)" in capsys.readouterr().out
    file = Reader("a.tza")
    assert all(v.dtype == np.float16 for v in file.values())
    assert file.layouts["enc_conv0.weight"] == "oihw" and file.layouts["enc_conv0.bias"] == "x"
    model = load_model(Result(results, "a"))[0]
    for name, tensor in model.state_dict().items():
        assert np.array_equal(file[name], tensor.numpy().astype(np.float16))
    export.main(["-r", "a", "-R", str(results), "-e", "4"])
    assert (results / "a" / "a_4.tza").exists()
    export.main(["-r", "a", "-R", str(results), "-o", "raw.tza", "--weights", "raw"])
    assert Path("raw.tza").read_bytes() != Path("a.tza").read_bytes()


def test_exported_onnx_describes_the_network(results, work):
    """Graph, sizes and names, read back field by field; the file without weights is smaller."""
    for target in ("onnx", "onnx_noparams"):
        export.main(["-r", "a", "-R", str(results), target])
    whole, bare = results / "a" / "a.onnx", results / "a" / "a.noparams.onnx"
    assert whole.stat().st_size > bare.stat().st_size + 4 * 2000
    for path, held in ((whole, 32), (bare, 0)):
        model = dict(read_fields(path.read_bytes()))
        assert dict(read_fields(model[8]))[2] == 11
        graph = read_fields(model[7])
        ops = [dict(read_fields(v))[4].decode() for k, v in graph if k == 1]
        assert [ops.count(o) for o in ("Conv", "Relu", "MaxPool", "Resize", "Concat")] == [
            16, 15, 4, 4, 4]
        tensors = {dict(read_fields(v))[8].decode(): read_fields(v) for k, v in graph if k == 5}
        assert len(tensors) == 2 + held  # roi and scales of Resize
        inputs = [dict(read_fields(v))[1].decode() for k, v in graph if k == 11]
        assert inputs[0] == "input" and len(inputs) == 1 + 32 - held
        if held:
            fields = tensors["enc_conv0.weight"]
            assert [v for k, v in fields if k == 1] == [4, 9, 3, 3]
            state = load_model(Result(results, "a"))[0].state_dict()
            assert dict(fields)[9] == state["enc_conv0.weight"].numpy().tobytes()


def test_package_can_be_used_elsewhere(raw, results, work):
    export.main(["-r", "a", "-R", str(results), "-o", "a.zip", "package"])
    names = zipfile.ZipFile("a.zip").namelist()
    assert {"a/config.json", "a/checkpoints/latest", "a/checkpoints/checkpoint_8.pth"} <= set(names)
    zipfile.ZipFile("a.zip").extractall("moved")
    infer.main(["-r", "a", "-R", "moved", "-D", str(raw), "-i", "valid"])
    assert Path("infer/valid/scene0/view0_0001spp.a.hdr.exr").exists()


def test_names_with_folders(raw, results, work):
    """Files are called after the last part of proj/exp."""
    shutil.copytree(results / "a", "r/proj/exp")
    args = ["-r", "proj/exp", "-R", "r"]
    export.main(args)
    export.main([*args, "-e", "4"])
    export.main([*args, "package"])
    made = {str(p.relative_to("r")) for p in Path("r").rglob("*") if p.suffix in (".tza", ".zip")}
    assert made >= {"proj/exp/exp.tza", "proj/exp/exp_4.tza", "proj/exp.zip"}
    assert not [name for name in made if "proj/exp/proj" in name or "proj/proj" in name]
    zipfile.ZipFile("r/proj/exp.zip").extractall("moved")
    infer.main(["-r", "exp", "-R", "moved", "-D", str(raw), "-i", "valid", "-O", "other"])
    infer.main([*args, "-D", str(raw), "-i", "valid"])
    for folder in ("infer", "other"):
        assert Path(folder, "valid/scene0/view0_0001spp.exp.hdr.exr").exists()


def test_export_errors(results, work, fails):
    assert fails(export.main, ["-r", "none", "-R", str(results)])[0] == 4
    assert fails(export.main, ["-r", "a", "-R", str(results), "weird"])[0] == 2
    Path("file").touch()
    assert fails(export.main, ["-r", "a", "-R", str(results), "-o", "file/x.tza"])[0] == 5
    shutil.copytree(results / "a", "bad/a")
    path = Path("bad/a/checkpoints/checkpoint_8.pth")
    state = torch.load(path)
    state["ema_state"]["enc_conv0.bias"][0] = 1e6  # not a half float
    torch.save(state, path)
    code, message = fails(export.main, ["-r", "a", "-R", "bad"])
    assert code == 4 and "half float" in message and not Path("bad/a/a.tza").exists()


def test_split_exr(tmp_path, capsys, fails):
    clean = picture(2)
    names = [f"{layer}.{c}" for layer, cs in (("ViewLayer.Combined", "RGB"),
             ("ViewLayer.Denoising Albedo", "RGB"), ("N", "XYZ")) for c in cs]
    path = tmp_path / "x_0004spp.exr"
    write_exr(path, np.concatenate(list(clean.values()), -1), tuple(names))
    split_exr.main([str(path)])
    out = capsys.readouterr().out
    assert "N.X N.Y N.Z" in out and "Not found: a z" in out
    for feature, image in clean.items():
        assert np.array_equal(read_image(tmp_path / f"x_0004spp.{feature}.exr"), image)
    split_exr.main([str(path), "--layer", "ViewLayer"])
    code, message = fails(split_exr.main, [str(path), "--layer", "Nothing"])
    assert code == 3 and "no channels in layer" in message
    assert fails(split_exr.main, [str(tmp_path / "a.png")])[0] == 3
    assert fails(split_exr.main, [str(tmp_path / "none.exr")])[0] == 3
    assert fails(split_exr.main, [])[0] == 2


def test_convert_and_compare(tmp_path, capsys, fails, monkeypatch):
    monkeypatch.chdir(tmp_path)
    hdr = picture(1)["hdr"]
    write_features(tmp_path, "x", {"hdr": hdr, "alb": picture(1)["alb"], "nrm": picture(1)["nrm"]})
    convert_image.main(["x.hdr.exr", "y.srgb.png", "-E", "2"])
    assert np.abs(read_image("y.srgb.png") - color.display(hdr, 2)).max() < 1 / 250
    convert_image.main(["x.hdr.exr", "y.hdr.pfm"])
    assert np.array_equal(read_image("y.hdr.pfm"), hdr)
    convert_image.main(["x.nrm.exr", "n.png"])
    want = color.srgb_forward((picture(1)["nrm"] * 0.5 + 0.5) ** 6)
    assert np.abs(read_image("n.png") - want).max() < 1 / 250
    compare_image.main(["x.hdr.exr", "y.hdr.pfm", "-M", "psnr", "mse", "ssim"])
    assert capsys.readouterr().out.strip() == "psnr = inf, mse = 0.0000, ssim = 1.0000"
    write_image(Path("z.hdr.exr"), hdr * 1.1)
    compare_image.main(["z.hdr.exr", "x.hdr.exr"])
    want = metrics.psnr(color.display(hdr * np.float32(1.1)), color.display(hdr))
    assert capsys.readouterr().out.startswith(f"psnr = {want:.4f}, ssim = 0.99")
    assert fails(compare_image.main, ["x.hdr.exr", "x.alb.exr"])[0] == 2
    write_image(Path("w.hdr.exr"), hdr[:-1])
    assert fails(compare_image.main, ["x.hdr.exr", "w.hdr.exr"])[0] == 3
    assert fails(compare_image.main, ["x.hdr.exr"])[0] == 2
    assert fails(convert_image.main, ["x.hdr.exr", "x.bmp"])[0] == 2
    assert fails(convert_image.main, ["x.nrm.exr", "x.alb.exr"])[0] == 2


def test_visualize_quotes_nothing_through_a_shell(work, fails):
    from training.settings import parse
    name = "my result; touch x"
    assert fails(visualize.main, ["-r", name])[0] == 4
    (work / "results" / name / "log").mkdir(parents=True)
    call = visualize.command(parse("visualize", ["-r", name, "--port", "7007"]))
    assert f"--logdir=results/{name}/log" in call and "--port=7007" in call


def test_flip_if_installed():
    pytest.importorskip("flip_evaluator", reason="optional: flip-evaluator is not installed")
    a = np.random.default_rng(0).random((32, 32, 3)).astype(np.float32)
    assert metrics.flip(a, a) == pytest.approx(0, abs=1e-6)
    assert metrics.flip(np.clip(a + 0.2, 0, 1), a) > 0.01


def test_evaluation_report(raw, results, work, capsys):
    export.main(["-r", "a", "-R", str(results), "-o", "a.tza"])
    clean = picture(9)
    for stem in ("noisy", "ref"):
        names = tuple(f"{p}{c}" for p in ("", "albedo.", "normal.") for c in "RGB")
        Path("pictures/p").mkdir(parents=True, exist_ok=True)
        write_exr(Path(f"pictures/p/{stem}.exr"), np.concatenate(list(clean.values()), -1), names)
    Path("report.md").write_text("before\n<!-- scores -->\nold\n<!-- /scores -->\nafter\n")
    evaluate.main(["a.tza=hdr,alb,nrm", "--images", "pictures", "--held_out",
                   f"{raw / 'train'}:2", "--report", "report.md", "--json", "all.json",
                   "--no_oidn", "--metric", "psnr", "ssim"])
    text = Path("report.md").read_text()
    assert text.startswith("before\n") and text.endswith("after\n") and "old" not in text
    assert "| p |" in text and "**mean of 1**" in text and "pictures are better" in text
    figures = json.loads(Path("all.json").read_text())
    assert len(figures) == 5  # one picture, two held-out groups of two
    assert {f["set"] for f in figures} == {"pictures", "held out of train"}


@pytest.mark.skipif(peer.find_binary() is None, reason="optional: pyoidn is not installed")
def test_the_real_oidn_gives_the_same_picture(results, work):
    export.main(["-r", "a", "-R", str(results), "-o", "a.tza"])
    export.main(["-r", "plain", "-R", str(results), "-o", "plain.tza"])
    for file, features in (("a.tza", ["hdr", "alb", "nrm"]), ("plain.tza", ["hdr"])):
        ours = evaluate.load_denoiser(Path(file), features)
        images = {f: i for f, i in picture(7, 51, 67).items() if f in features}
        mean, outliers = peer.difference(
            ours.run(images), peer.denoise(peer.find_binary(), images, Path(file).resolve()))
        assert mean < 0.003 and outliers == 0


def test_errors_are_one_line_on_stderr_and_a_code(work, script, capfd):
    (work / "broken.exr").write_bytes(b"\x76\x2f\x31\x01 and no more")
    done = script("compare_image", "broken.exr", "b.exr", timeout=600)
    assert done.returncode == 3 and not done.stdout
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("Error: broken.exr: cannot read")
    for main, args, code in ((train.main, ["hdr", "--nonsense"], 2),
                             (infer.main, ["-r", "none"], 4),
                             (split_exr.main, ["none.exr"], 3)):
        with pytest.raises(SystemExit) as stop:
            errors.run(main, args)
        assert stop.value.code == code
        err = capfd.readouterr().err
        assert err.count("\n") == 1 and err.startswith("Error: ")


@pytest.mark.parametrize("name, option", [
    ("preprocess", "--shard"), ("train", "--time_budget"), ("infer", "--save_all"),
    ("export", "--int8"), ("find_lr", "--num_steps"), ("visualize", "--port"),
    ("split_exr", "--layer"), ("convert_image", "--exposure"), ("compare_image", "--metric")])
def test_help_of_a_file_run_from_elsewhere(script, work, root, name, option):
    assert os.access(root / "training" / f"{name}.py", os.X_OK)
    env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = script(name, "--help", env=env, timeout=600)
    assert done.returncode == 0 and option in done.stdout and not done.stderr
