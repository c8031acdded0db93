"""Options: names, defaults, derived defaults, precedence; files that ship with the project."""

import json
import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from export import golden, manifest
from export.tza import write_weights
from training import nets
from training.settings import OPTIONS, SCRIPTS, make_parser, parse, seconds

# Options of Open Image Denoise's toolkit: spellings and the scripts that take them.
THEIRS = """
--config -c|PTLIXVCQZ
--clean_aux|PTL
--filter -f|PTL
--quality -q|PTL
--preproc_dir -P|PTL
--train_data -t|PTL
--valid_data -v|PT
--transfer -x|PTL
--data_dir -D|PI
--results_dir -R|PTLIXV
--result -r|TLIXV
--aux_results -a|PTLI
--num_epochs --epochs -e|PTIX
--num_valid_epochs --valid_epochs|T
--num_save_epochs --save_epochs|T
--lr --learning_rate|TL
--max_lr --max_learning_rate|TL
--lr_warmup --learning_rate_warmup|T
--compile|T
--batch_size --bs -b|TL
--num_loaders --loaders -j|TL
--precision -p|TL
--model -m|TL
--loss -l|TL
--msssim_weights|TL
--tile_size --ts|TL
--seed -s|TL
--metric -M|IQ
--input_data -i|I
--output_dir -O|I
--output_suffix -o|I
--format -F|I
--save_all|I
--output -o|X
--exposure -E|CQ
--layer|Z
--device -d|PTLIX
--device_id -k|PTLIX
--num_devices -n|PTLIX
--deterministic --det|PTLIX
""".split("\n")[1:-1]


@pytest.mark.parametrize("row", THEIRS)
def test_their_options_exist(row):
    names, scripts = row.split("|")
    for script in (s for s, letter in SCRIPTS.items() if letter in scripts):
        taken = {n for a in make_parser(script)._actions for n in a.option_strings}
        assert set(names.split()) <= taken, script


def test_the_docs_have_every_option(root):
    """Their options row by row, ours by name, and nothing that does not exist."""
    text = (root / "docs" / "training.md").read_text().partition("## Options beside")[2]
    rows = [[c.strip() for c in line.split("|")[1:-1]] for line in text.splitlines()
            if line.startswith("| `--")]
    table = {frozenset(row[0].strip("`").split()): row[1].replace(" ", "") for row in rows}
    for row in THEIRS:
        names, scripts = row.split("|")
        key = frozenset(names.split())
        assert set(table[key]) == set(scripts) or table[key] == "all", names
    every = {n for o in OPTIONS for n in o.names.split()} | {"--help", "-h"}
    named = set(re.findall(r"`(--\w+)", text)) | {n for key in table for n in key}
    assert not {n for n in every if n.startswith("--")} - named - {"--time-budget"}
    assert not {n for n in named if n.startswith("--")} - every


@pytest.mark.parametrize("tool", [
    "export.bilateral", "export.manifest", "export.prune", "export.quantize",
    "export.quantize_kernel",
    "export.temper", "training.average", "training.evaluate", "training.quantize_aware",
    "training.scenes.leaves", "training.scenes.render", "training.scenes.render_scene",
    "training.scenes.sheet"])
def test_the_docs_have_the_options_of_tools(root, capsys, tool):
    """Those that are not of the table."""
    text = "".join((root / "docs" / f"{name}.md").read_text()
                   for name in ("training", "quantisation", "scenes"))
    with pytest.raises(SystemExit):
        importlib.import_module(tool).main(["--help"])
    options = set(re.findall(r"^ +(?:-\w.*, )?(--\w+)", capsys.readouterr().out, re.M)) - {"--help"}
    assert options or tool == "training.average"
    assert not {o for o in options if not re.search(rf"{o}\b", text)}


def test_options_do_not_collide():
    for script, letter in SCRIPTS.items():
        names = [n for o in OPTIONS if letter in o.scripts for n in o.names.split()]
        assert len(names) == len(set(names)), script


def test_defaults():
    s = parse("train", ["hdr", "albedo", "normal"])
    want = dict(features=["hdr", "alb", "nrm"], main_feature="hdr", model="unet_large",
                batch_size=16, tile_size=256, num_epochs=2000, num_valid_epochs=10,
                num_save_epochs=10, loss="l1_msssim", train_data="train", valid_data="valid",
                preproc_dir="preproc", results_dir="results", transfer="pu", num_loaders=4,
                learning_rate_warmup=0.15, msssim_weights=None, clean_aux=False)
    assert {k: s.get(k) for k in want} == want
    assert s.max_learning_rate == pytest.approx(4.286e-5, rel=1e-3)
    assert s.learning_rate == pytest.approx(s.max_learning_rate / 25)
    fast = parse("train", ["hdr", "-q", "fast", "-b", "8", "-f", "RT"])
    assert fast.model == "unet_small" and fast.msssim_weights == [0.2] * 5
    assert fast.max_learning_rate == pytest.approx(8 * 3.125e-6)
    sweep = parse("find_lr", ["hdr"])
    assert (sweep.learning_rate, sweep.max_learning_rate) == (1e-8, 0.1)
    infer = parse("infer", ["-r", "x"])
    assert (infer.input_data, infer.format, infer.metric) == ("test", ["exr"], ["psnr", "ssim"])


@pytest.mark.parametrize("args,transfer", [
    (["hdr"], "pu"), (["hdr", "-f", "RTLightmap"], "log"), (["ldr"], "srgb"), (["alb"], "srgb"),
    (["nrm"], "linear"), (["sh1"], "linear"), (["z"], "log"), (["hdr", "-x", "log"], "log")])
def test_transfer_follows_the_feature(args, transfer):
    assert parse("train", args).transfer == transfer


def test_data_sets_follow_each_other():
    def names(*args):
        s = parse("train", ["hdr", *args])
        return s.train_data, s.valid_data
    assert names() == ("train", "valid") and names("-t", "x") == ("x", None)
    assert names("-t", "x", "-v", "y") == ("x", "y") and names("--hold_out", "3")[1] is None


@pytest.mark.parametrize("script,args", [
    ("train", []), ("train", ["alb", "nrm"]), ("train", ["hdr", "ldr"]), ("train", ["rgb"]),
    ("train", ["hdr", "-b", "5", "-n", "2"]), ("train", ["hdr", "--ts", "50"]),
    ("train", ["hdr", "-e", "0"]), ("train", ["hdr", "--time-budget", "soon"]),
    ("train", ["hdr", "-l", "nope"]), ("train", ["hdr", "--epoch", "3"]),
    ("train", ["sh1", "--quantize_aware", "5"]), ("train", ["z", "--quantize_aware", "5"]),
    ("train", ["hdr", "z", "--quantize_aware", "5"]),
    ("preprocess", ["hdr", "--shard", "2/2"]), ("preprocess", ["hdr", "--layers", "alb"]),
    ("infer", []), ("visualize", []), ("export", ["-r", "x", "nothing"]),
    ("compare_image", ["a"]), ("split_exr", [])])
def test_wrong_options_are_refused(fails, script, args):
    code, message = fails(lambda argv: parse(script, argv), args)
    assert code == 2 and message


def test_settings_file(tmp_path, fails):
    path = tmp_path / "s.json"
    path.write_text(json.dumps({"features": ["hdr"], "batch_size": 8, "loss": "l1"}))
    s = parse("train", ["-c", str(path), "-l", "l2"])
    assert (s.features, s.batch_size, s.loss) == (["hdr"], 8, "l2")  # the command line wins
    with pytest.raises(AttributeError):
        s.loss = "l1"
    for text, code in (('{"bach_size": 8}', 2), ('{"loss": "none"}', 2), ("[1]", 3), ("{", 3)):
        path.write_text(text)
        got, message = fails(lambda argv: parse("train", argv), ["hdr", "-c", str(path)])
        assert got == code and str(path) in message
    assert fails(lambda argv: parse("train", argv), ["hdr", "-c", "missing.json"])[0] == 3


@pytest.mark.parametrize("script, args, text", [
    ("train", ["--seed", "-1"], "--seed: -1 is not a whole number from 0 to"),
    ("train", ["--seed", "99999999999999999999999"], "--seed: "),
    ("train", ["-j", "-1"], "--num_loaders: "),
    ("train", ["--exposure_jitter", "-3"], "--exposure_jitter: -3.0 is not a number from 0"),
    ("train", ["--average_inputs", "2"], "--average_inputs: 2.0 is not a number from 0 to 1"),
    ("train", ["--ema", "2"], "--ema: "), ("train", ["--grad_clip", "nan"], "--grad_clip: nan"),
    ("train", ["--large_tiles", "-3"], "--large_tiles: "), ("train", ["-n", "0"], "--num_devices"),
    ("train", ["--hold_out", "-2"], "--hold_out: "), ("train", ["-b", "0"], "--batch_size: "),
    ("train", ["--lr_warmup", "1"], "--learning_rate_warmup: 1.0 is not a number from 0, below 1"),
    ("train", ["--teacher_share", "3"], "--teacher_share: 3.0 is not a number above 0, to 1"),
    ("train", ["--balance", "inf"], "--balance: inf is not a number"),
    ("train", ["-e", "99999999999"], "--num_epochs: "), ("find_lr", ["--num_steps", "1"], "steps"),
    ("find_lr", ["--max_lr", "inf"], "--max_learning_rate: inf is not a number above 0")])
def test_numbers_out_of_range(fails, script, args, text):
    code, message = fails(lambda argv: parse(script, argv), ["hdr", *args])
    assert code == 2 and text in message


def test_numbers_at_their_bounds():
    s = parse("train", ["hdr", "--ema", "1", "--grad_clip", "inf", "--balance", "-0.5", "-j", "0",
                        "--seed", str(2**63 - 1), "--valid_epochs", "-1", "--lr_warmup", "0"])
    assert (s.ema, s.grad_clip, s.balance, s.num_valid_epochs) == (1, float("inf"), -0.5, -1)
    torch.manual_seed(s.seed)


@pytest.mark.parametrize("key, value, text", [
    ("raw", "false", "true or false"), ("raw", 0, "true or false"), ("batch_size", [4], "number"),
    ("batch_size", 4.0, "number"), ("batch_size", True, "number"), ("msssim_weights", 0.2, "list"),
    ("msssim_weights", ["a"], "number"), ("model", ["w8"], "text"), ("ema", None, "number"),
    ("features", [1], "text"), ("features", "hdr", "list"), ("loss", 1, "one of l1, "),
    ("bilateral", False, "one of 0, "), ("time_budget", ["1h"], "text"), ("seed", -1, "from 0 to"),
    ("layers", [["alb"]], "text"), ("teacher_share", 3, "above 0, to 1")])
def test_kinds_of_a_settings_file(work, fails, key, value, text):
    Path("s.json").write_text(json.dumps({"features": ["hdr"], key: value}))
    code, message = fails(lambda argv: parse("train", argv), ["-c", "s.json"])
    assert code == 2 and re.match(rf"s\.json: {key}: .* is not .*{text}", message), message


def test_what_a_settings_file_may_hold(work):
    held = {"features": ["hdr", "alb"], "raw": True, "ema": 0, "seed": None, "loss": None,
            "learning_rate": None, "time_budget": 90, "layers": {"albedo": "MyAlbedo"}}
    Path("s.json").write_text(json.dumps(held))
    s = parse("train", ["-c", "s.json"])
    assert s.raw is True and s.ema == 0 and s.time_budget == 90 and s.learning_rate > 0
    assert s.layers == {"alb": "MyAlbedo"} and s.loss == "l1_msssim"
    Path("s.json").write_text('{"num_epochs": null, "result": "a"}')
    assert parse("infer", ["-c", "s.json"]).num_epochs is None


@pytest.mark.parametrize("args", [
    ["hdr", "alb", "-m", "k8", "--raw", "--hold_out", "2", "-t", "a", "--layers", "alb=MyAlbedo"],
    ["hdr", "--time-budget", "45m", "-n", "2", "-b", "4"]])
def test_the_settings_of_a_result_train_another(work, args):
    """config.json says more than the options: what followed from them, and what is held out."""
    first = parse("train", [*args, "-r", "one"]).replace(held_out=["a", "b"])
    Path("config.json").write_text(json.dumps(first.to_dict()))
    again = parse("train", ["-c", "config.json", "-r", "two"])
    want = {**first.to_dict(), "config": "config.json", "result": "two"}
    assert again.to_dict() | {"held_out": ["a", "b"]} == want


def test_times():
    assert [seconds(t) for t in ("90", "90s", "1.5m", "2h", "1d")] == [90, 90, 90, 7200, 86400]


def test_shipped_settings_are_accepted(root):
    files = sorted((root / "training" / "configs").glob("rt_*.json"))
    assert files
    for path in files:
        if json.loads(path.read_text()).get("model") == "w16":
            assert parse("train", ["-c", str(path), "-t", "x"]).model == "w16"


def test_manifest_lists_the_weights(root, tmp_path):
    assert manifest.check(root / "weights") == []
    rows = manifest.read(root / "weights" / "MANIFEST")
    assert rows and all(r["licence"] == "Apache-2.0" for r in rows)
    for name in (rows[0]["file"], "MANIFEST"):
        (tmp_path / name).write_bytes((root / "weights" / name).read_bytes())
    (tmp_path / "new.tza").write_bytes(b"x")
    (tmp_path / rows[0]["file"]).write_bytes(b"y")
    problems = manifest.check(tmp_path)
    assert "new.tza: has no row" in problems and f"{rows[0]['file']}: sha256 differs" in problems


def test_rows_of_a_manifest(tmp_path, fails, monkeypatch):
    """Whole or not at all, and never such as cannot be read."""
    def add(file: str, **more: str) -> list[str]:
        told = {"features": "hdr", "data": "d", "config": "c", "scores": "s", **more}
        return ["--folder", str(tmp_path), "--add", file,
                *(v for k, x in told.items() for v in (f"--{k}", x))]

    for file, model in (("a.tza", "w8"), ("k.tza", "kernel5:" + ",".join(["8"] * 14))):
        tensors = nets.build(model, 3).state_dict()
        write_weights(tmp_path / file, {k: v.numpy() for k, v in tensors.items()})
    (tmp_path / "b.tza").write_bytes(b"x")
    for wrong, code, text in ((add("none.tza"), 3, "none.tza: cannot read"),
                              (add("b.tza"), 4, "b.tza: too short"), (add("k.tza"), 4, "k.tza: "),
                              (add("a.tza", data="two\nlines"), 2, "--data: tabs and line"),
                              (add("a.tza", scores="1\t2"), 2, "--scores: "),
                              (add("a.tza", net="ends\n"), 2, "--net: "),
                              (add("a.tza", data=""), 2, "--data: says nothing")):
        got, message = fails(manifest.main, wrong)
        assert got == code and text in message
        assert not (tmp_path / "MANIFEST").exists()
    (tmp_path / "b.tza").unlink()
    (tmp_path / "k.tza").unlink()
    manifest.main(add("a.tza"))
    assert [r["data"] for r in manifest.read(tmp_path / "MANIFEST")] == ["d"]
    before = (tmp_path / "MANIFEST").read_bytes()
    with monkeypatch.context() as patch:  # a full disk
        patch.setattr("os.replace", lambda *a: (_ for _ in ()).throw(OSError(28, "full")))
        assert fails(manifest.main, add("a.tza", data="new")) == (
            5, f"{tmp_path / 'MANIFEST'}: cannot write (full)")
    assert (tmp_path / "MANIFEST").read_bytes() == before
    (tmp_path / "MANIFEST").write_text("a\tb\n")
    code, message = fails(manifest.main, add("a.tza"))
    assert code == 4 and "MANIFEST:1: 2 fields" in message
    with pytest.raises(SystemExit) as stop:
        manifest.main(["--folder", str(tmp_path), "--check"])
    assert stop.value.code == 1


def test_golden_vectors_are_what_torch_computes(root, tmp_path):
    assert golden.check(root / "tests" / "golden") == []
    golden.write_case(golden.CASES[1], tmp_path / golden.CASES[1].name)
    image = tmp_path / golden.CASES[1].name / "output.f32"
    data = np.fromfile(image, "<f4")
    data[5] += 0.01
    data.tofile(image)
    assert any("output differs" in p for p in golden.check(tmp_path))


def test_no_work_at_import(root):
    """Importing every module prints nothing and opens no file in the working folder."""
    modules = [f"training.{p.stem}" for p in Path(root / "training").glob("*.py")
               if p.stem != "kernel_triton" or importlib.util.find_spec("triton")]
    code = "import sys\n" + "\n".join(f"import {m}" for m in sorted(modules))
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True,
                          timeout=600)
    assert done.returncode == 0 and done.stdout == "" and done.stderr == ""
