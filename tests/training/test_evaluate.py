"""training.evaluate with references that have noise themselves, and on clipped inputs."""

import json
from pathlib import Path

import numpy as np
import pytest

from export.tza import write_weights
from tests.training.tools import QUICK, make_raw, noisy, picture, write_features
from training import color, evaluate, nets, preprocess, train
from training.errors import ToolError
from training.features import load
from training.imageio import write_exr


def scored(work, name, *more):
    evaluate.main([*more, "--no_oidn", "--metric", "psnr", "--json", name])
    return json.loads((work / name).read_text())


def test_scores_without_the_noise_of_references(work, root):
    """--less_reference: what the reference's own noise adds to every error is taken off. Here the
    truth is known: the input's error is that of its 16 samples, and no longer 16/15 of it."""
    rng, truth = np.random.default_rng(3), np.full((64, 64, 3), 0.5, np.float32)
    (work / "set" / "a").mkdir(parents=True)
    for spp in (16, 240):
        image = truth * (1 + 0.1 * rng.normal(size=truth.shape).astype(np.float32) * spp**-0.5)
        write_exr(work / "set" / "a" / f"a_{spp:04d}spp.hdr.exr", image)
    args = [f"{root / 'weights' / 'rt_hdr_w16.tza'}=hdr", "--images", str(work / "set")]
    plain, less = (scored(work, f"{len(more)}.json", *args, *more)[0]
                   for more in ((), ("--less_reference",)))
    for method in ("noisy", "lull"):
        apart = [10 ** (-row[method]["psnr"] / 10) for row in (plain, less)]
        noise = 10 ** (-plain["noisy"]["psnr"] / 10) / 16
        assert apart[0] - apart[1] == pytest.approx(noise, rel=1e-6)
    assert less["noisy"]["psnr"] - plain["noisy"]["psnr"] == pytest.approx(0.28, abs=0.001)


def test_only_psnr_is_scored_without_the_noise_of_references(raw, root):
    with pytest.raises(ToolError, match="--less_reference: is about psnr"):
        evaluate.main([f"{root / 'weights' / 'rt_hdr_w16.tza'}=hdr", "--images", str(raw),
                       "--less_reference", "--metric", "ssim"])


def test_references_without_a_count_have_no_known_noise(raw):
    case = evaluate.find_cases(raw / "valid")[0]
    with pytest.raises(ToolError, match=f"{case.name}: --less_reference needs sample counts"):
        evaluate.noise_of_reference(case, 20.0)


def test_folders_with_a_reference_behind_links(tmp_path):
    """As the groups of the naming scheme."""
    (tmp_path / "renders" / "a").mkdir(parents=True)
    for name in "noisy.exr", "ref.exr":
        write_exr(tmp_path / "renders" / "a" / name, np.ones((4, 4, 3), np.float32))
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "b").symlink_to("../renders/a")
    assert [c.name for c in evaluate.find_cases(tmp_path / "set")] == ["b"]


def test_clipped_inputs_are_made_of_hdr_pictures(raw, root):
    """ldr: exposed for the reference, clipped after the noise; metrics are taken on that."""
    case = evaluate.find_cases(raw / "valid")[0]
    source, target = (load(v, ["hdr"])["hdr"] for v in (case.source, case.target))
    exposure = color.autoexposure(target)
    seen = {}

    class Network:
        features = ["ldr", "alb"]

        def run(self, images):
            seen.update(images)
            return np.clip(target * exposure, 0, 1)

    pictures = load(case.source, ["hdr", "alb"]), load(case.target, ["hdr"])
    row = evaluate.evaluate(case, *pictures, Path("any.tza"), Network(), None, ["psnr", "mse"])
    assert sorted(seen) == ["alb", "ldr"]
    assert np.array_equal(seen["ldr"], np.clip(source * exposure, 0, 1))
    assert row["lull"]["mse"] == 0 and row["noisy"]["psnr"] < 40


def test_clipped_pictures_through_the_program(raw, work, root):
    evaluate.main([f"{root / 'weights' / 'kernel5_8.tza'}=ldr,alb,nrm", "--images",
                   str(raw / "valid"), "--no_oidn", "--metric", "psnr", "--spp", "4",
                   "--json", "ldr.json"])
    rows = json.loads(Path("ldr.json").read_text())
    assert len(rows) == 2 and all(r["lull"]["psnr"] > r["noisy"]["psnr"] + 2 for r in rows)


def test_pictures_of_ldr_alone_lack_the_radiance(work, fails):
    """They have ldr, of which an error spoke; what is measured is made of hdr."""
    for version in "4", "ref":
        for g in range(2):
            write_features(work / "data", f"p{g}_{version}", {"ldr": picture(g)["hdr"].clip(0, 1)})
    weights("a.tza", ["ldr"])
    code, message = fails(evaluate.main, ["a.tza=ldr", "--held_out", "data:1", "--no_oidn"])
    assert code == 3 and message.endswith("a.tza: no picture has hdr")


def weights(name, features):
    """An untrained model of family U."""
    tensors = nets.build("w8", 3 * len(features)).state_dict()
    write_weights(name, {k: v.numpy() for k, v in tensors.items()})


def test_normals_without_an_albedo_are_measured_without_oidn(raw, work, monkeypatch, capsys):
    """It refuses them, and so ended the measurement of all models."""
    asked = []
    monkeypatch.setattr(evaluate.peer, "find_binary", lambda: Path("oidnDenoise"))
    monkeypatch.setattr(evaluate.peer, "denoise", lambda binary, images, *_: asked.append(
        sorted(images)) or images["hdr"])
    for features in ["hdr", "nrm"], ["hdr", "alb"]:
        weights("a.tza", features)
        evaluate.main([f"a.tza={','.join(features)}", "--images", str(raw / "valid"), "--metric",
                       "psnr", "--report", f"{features[1]}.md"])
    assert asked == [["alb", "hdr"]] * len(asked) and asked
    assert "a: OIDN takes normals beside an albedo only" in capsys.readouterr().out
    assert "OIDN" not in Path("nrm.md").read_text() and "OIDN" in Path("alb.md").read_text()


def gappy(folder):
    """Eight groups of some inputs without normals, without albedo in their layers, or broken."""
    make_raw(folder, 8, spp=(4,))
    for g in (0, 1):
        (folder / f"scene{g}" / f"view{g}_0004spp.nrm.exr").unlink()
    for f in ("hdr", "alb", "nrm"):
        (folder / "scene3" / f"view3_0004spp.{f}.exr").unlink()
    write_features(folder / "scene3", "view3_0004spp", {"hdr": picture(3)["hdr"]})
    (folder / "scene3" / "view3_0004spp.hdr.exr").rename(folder / "scene3" / "view3_0004spp.exr")
    (folder / "scene5" / "view5_0004spp.hdr.exr").write_bytes(b"broken")


@pytest.mark.parametrize("features", [["hdr"], ["hdr", "alb", "nrm"]])
def test_what_was_held_out_is_measured(work, features):
    """By a training on raw data and by one on shards, with the model's features."""
    gappy(work / "d" / "train")
    data = [*features, "-D", "d", "-t", "train"]
    common = [*data, "-s", "3", *QUICK, "-e", "1", "--hold_out", "2"]
    train.main([*common, "--raw", "-r", "raw"])
    for shard in "0/2", "1/2":
        preprocess.main([*data, "--shard", shard])
    train.main([*common, "-r", "shards"])
    raw, shards = (json.loads(Path(f"results/{r}/config.json").read_text())["held_out"]
                   for r in ("raw", "shards"))
    cases = evaluate.held_out_cases(work / "d" / "train", 2, features)
    assert raw == shards == sorted({c.name.removesuffix("_0004spp") for c in cases})
    assert len(raw) == 2


def test_models_are_measured_on_what_each_left_out(work):
    gappy(work / "d")
    weights("a.tza", ["hdr"])
    weights("b.tza", ["hdr", "alb", "nrm"])
    rows = scored(work, "all.json", "a.tza=hdr", "b.tza=hdr,alb,nrm", "--held_out", "d:2")
    assert [(r["weights"], r["case"]) for r in rows] == [
        (f"{w}.tza", f"scene{g}/view{g}_0004spp") for w, g in ("a2", "a6", "b4", "b6")]


def test_what_train_cannot_read_is_not_measured(work, capsys):
    gappy(work / "d")
    weights("a.tza", ["hdr"])
    rows = scored(work, "all.json", "a.tza=hdr", "--held_out", "d:4")
    assert [r["case"] for r in rows] == [f"scene{g}/view{g}_0004spp" for g in (1, 3, 7)]
    assert "left out scene5/view5_0004spp: " in capsys.readouterr().out


def test_pictures_without_a_count_have_a_row(work):
    make_raw(work / "d", 2)
    for path in (work / "d").rglob("*_0001spp.*"):
        path.rename(path.with_name(path.name.replace("_0001spp", "")))
    weights("a.tza", ["hdr"])
    scored(work, "all.json", "a.tza=hdr", "--held_out", "d:1", "--report", "r.md")
    rows = [line.split(" | ")[0] for line in Path("r.md").read_text().splitlines()]
    assert "| ? spp (1)" in rows and "| 4 spp (1)" in rows


def test_models_are_there_before_any_is_measured(work, fails, capsys):
    make_raw(work / "d", 2)
    weights("a.tza", ["hdr"])
    for text, code in (("b.tza=hdr", 3), ("a.tza=hdr,alb", 2)):
        assert fails(evaluate.main, ["a.tza=hdr", text, "--images", "d", "--no_oidn"])[0] == code
    assert capsys.readouterr().out == ""


def test_family_k_was_trained_with_all_features(root):
    file = root / "weights" / "kernel5_8.tza"
    assert evaluate.trained_features(file, ["ldr"]) == ["ldr", "alb", "nrm"]
    assert evaluate.trained_features(root / "weights" / "rt_hdr_w16.tza", ["hdr"]) == ["hdr"]


def test_features_are_taken_in_any_order(root):
    """The networks' is the one they are given in."""
    assert evaluate.parse_model("a.tza=hdr,normal,alb") == (Path("a.tza"), ["hdr", "alb", "nrm"])


@pytest.mark.parametrize("arguments, code, text", [
    (["a.tza=hdr", "--held_out", "d"], 2, "--held_out d: not DIR:N"),
    (["a.tza=hdr", "--held_out", "d:x"], 2, "--held_out d:x: not DIR:N"),
    (["a.tza=hdr", "--held_out", "d:0"], 2, "--held_out d:0: not DIR:N"),
    (["a.tza=hdr", "--held_out", "d:2"], 3, "d: no such data set folder"),
    (["a.tza=hdr,light", "--images", "d"], 2, "unknown feature 'light'"),
    (["a.tza=nrm", "--images", "d"], 2, "only results for hdr and ldr")])
def test_arguments_that_cannot_be(work, fails, arguments, code, text):
    weights("a.tza", ["hdr"])
    got, message = fails(evaluate.main, [*arguments, "--no_oidn"])
    assert got == code and text in message


def test_clipped_pictures_have_the_transfer_of_their_training(work):
    for content, transfer in ("hdr", "pu"), ("ldr", "srgb"):
        weights("a.tza", ["hdr"])
        assert evaluate.load_denoiser(Path("a.tza"), [content]).transfer == transfer


def test_figures_are_kept_where_the_report_cannot_be(work, raw, fails):
    """Folders are made; a report without marks, or what cannot be written, is an error."""
    weights("a.tza", ["hdr"])
    args = ["a.tza=hdr", "--images", str(raw / "valid")]
    Path("report.md").write_text("no marks")
    Path("file").touch()
    with pytest.raises(ToolError, match="has no marks"):
        scored(work, "new/x.json", *args, "--report", "report.md")
    assert len(json.loads(Path("new/x.json").read_text())) == 4
    code, message = fails(evaluate.main, [*args, "--no_oidn", "--metric", "psnr", "--report",
                                          "new.md", "--json", "file/x.json"])
    assert code == 5 and "file/x.json" in message and Path("new.md").exists()


def test_means_with_a_black_picture_are_numbers(work, root, capsys, fails):
    """Equal pictures have 100 dB there, so that JSON can say it and --least_gain still holds."""
    for name, light in (("black", 0.0), ("grey", 0.5)):
        for spp in (4, 64):
            image = np.full((32, 32, 3), light * (1 + 0.1 * (spp == 4)), np.float32)
            write_features(work / "set", f"{name}_{spp}spp", {"hdr": image})
    model = f"{root / 'weights' / 'rt_hdr_w16.tza'}=hdr"
    rows = scored(work, "a.json", model, "--images", str(work / "set"))
    assert [row["noisy"]["psnr"] == 100 for row in rows] == [True, False]
    assert "inf" not in capsys.readouterr().out and "Infinity" not in Path("a.json").read_text()
    code, message = fails(evaluate.main, [model, "--images", str(work / "set"), "--no_oidn",
                                          "--metric", "psnr", "--least_gain", "99"])
    assert code == 4 and "dB gained, 99 wanted" in message


def test_pictures_that_cannot_be_read_are_named_and_left_out(work, fails, capsys):
    """The first one ended the measurement, and all figures were lost."""
    make_raw(work / "d", 3, spp=(4,))
    (work / "d/scene0/view0_0004spp.hdr.exr").write_bytes(b"broken")
    write_features(work / "d/scene1", "view1_0004spp", {"hdr": picture(1)["hdr"][:-2]})
    weights("a.tza", ["hdr"])
    weights("b.tza", ["hdr"])
    code, message = fails(evaluate.main, ["a.tza=hdr", "b.tza=hdr", "--images", "d", "--no_oidn",
                                          "--metric", "psnr", "--json", "x.json"])
    assert code == 3 and message == "pictures left out that cannot be read: 2"
    out = capsys.readouterr().out
    assert "left out scene0/view0_0004spp: " in out
    assert "left out scene1/view1_0004spp: scene1/view1_0004spp: 64x46 pixels, its reference" in out
    rows = json.loads(Path("x.json").read_text())
    assert [r["weights"] for r in rows] == ["a.tza", "b.tza"]
    assert {r["case"] for r in rows} == {"scene2/view2_0004spp"}


def test_figures_are_kept_where_a_gain_is_too_small(work, fails):
    make_raw(work / "d", 2, spp=(4,))
    weights("a.tza", ["hdr"])
    weights("b.tza", ["hdr"])
    code, message = fails(evaluate.main, [
        "a.tza=hdr", "b.tza=hdr", "--images", "d", "--no_oidn", "--metric", "psnr", "--json",
        "x.json", "--report", "x.md", "--least_gain", "99"])
    assert code == 4 and message.count("dB gained, 99 wanted") == 2
    assert len(json.loads(Path("x.json").read_text())) == 4 and Path("x.md").exists()


def test_layers_of_other_names_are_measured(work, fails):
    """As train --layers takes them, held out or not; each file is read once."""
    for g in range(2):
        for spp, images in ("4", noisy(picture(g), 4, g)), ("ref", picture(g)):
            (work / "d").mkdir(exist_ok=True)
            names = [(f"{f}.{c}", image[..., i]) for f, image in
                     (("mine", images["hdr"]), ("colour", images["alb"])) for i, c in
                     enumerate("RGB")]
            write_exr(work / "d" / f"p{g}_{spp}.exr", np.stack([i for _, i in names], -1),
                      tuple(n for n, _ in names))
    weights("a.tza", ["hdr", "alb"])
    args = ["a.tza=hdr,alb", "--images", "d"]
    assert fails(evaluate.main, [*args, "--no_oidn"])[0] == 3
    layers = ["--layers", "hdr=mine", "albedo=colour"]
    rows = scored(work, "x.json", *args, *layers)
    assert [r["case"] for r in rows] == ["p0_4", "p1_4"]
    held = scored(work, "y.json", "a.tza=hdr,alb", "--held_out", "d:1", *layers)
    assert held[0]["noisy"] == rows[1]["noisy"]
