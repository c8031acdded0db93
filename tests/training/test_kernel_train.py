"""Family K through the normal commands: train, find_lr, infer, export, evaluate, visualize."""
from __future__ import annotations

import copy
import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
import torch

from export import export, kernel, quantize_kernel
from export.tza import Reader, write_weights
from tests.training.tools import core_and_infer, in_both, picture, write_features
from tests.training.test_train import Stop, compare_processes, losses, same, state
from training import (color, evaluate, find_lr, infer, nets, preprocess,
                      train, visualize)
from training.data import Augment, Batches, from_raw
from training.integer_stage import (calibration_pictures, kernel_input, quantize,
                                    spread_codes)
from training.kernel_integer import IntegerKernel
from training.loss import l1
from training.quantize_aware import fine_tune
from training.result import Result, load_model
from training.scan import scan
from training.settings import Settings, parse

GOLDEN = Path(__file__).resolve().parent.parent / "golden" / "kernel"
TINY = "kernel5:4,4,4,4,8,8,8,8,8,8,8,8,4,4"
QUICK = ["-m", TINY, "-b", "4", "--ts", "32", "-j", "0", "--threads", "1", "-d", "cpu", "-s", "3"]
RAW = ["hdr", "alb", "nrm", "--raw", "-t", "train", *QUICK]


def test_training_learns_and_is_exported(raw, work, capsys, build):
    """The whole way: K by the option --net's family, best and averaged weights, both exports."""
    train.main([*RAW, "-D", str(raw), "-v", "valid", "-r", "k", "-e", "20", "--max_lr", "5e-3",
                "--valid_epochs", "5"])
    out = capsys.readouterr().out
    psnr = [float(v) for v in re.findall(r"psnr=([\d.]+)", out)]
    noisy = float(re.search(r"noisy ([\d.]+)", out)[1])
    assert losses(out)[-1] < losses(out)[0] and len(psnr) == 4 and psnr[-1] > noisy + 8
    assert Path("results/k/checkpoints/best.pth").exists() and state("k")["ema_state"]
    infer.main(["-r", "k", "-D", str(raw), "-i", "valid"])
    assert "psnr_avg" in capsys.readouterr().out
    visualize.command(parse("visualize", ["-r", "k"]))
    export.main(["-r", "k"])
    export.main(["-r", "k", "--int8", "-o", "k8.tza"])
    assert all(t.dtype == np.float16 for t in Reader("results/k/k.tza").values())
    assert isinstance(kernel.load("k8.tza"), kernel.IntTrunk)
    # The integer model in the C core computes nearly the picture of the floating-point one.
    a, b = (color.display(v) for v in core_and_infer(build, raw, "k8.tza"))
    assert np.abs(a - b).mean() < 0.01


def test_resumed_run_equals_an_uninterrupted_one(raw, work):
    args = [*RAW, "-D", str(raw), "-v", "valid", "-e", "4", "--save_epochs", "1",
            "--valid_epochs", "2", "--exposure_jitter", "1", "--average_inputs", "0.3"]
    train.main([*args, "-r", "k", "-R", "whole"])
    with pytest.raises(Exception, match="interrupted after 5 steps"), Stop(after=5):
        train.main([*args, "-r", "k"])
    train.main([*args, "-r", "k"])
    assert same(Result("whole", "k").load(), state("k")) and state("k")["step"] == 12


def test_two_processes_equal_one(raw, work, root, capsys):
    curve, _ = compare_processes([*RAW, "-D", str(raw), "-e", "3"], root, capsys)
    assert len(curve) == 3


def test_quantisation_aware_training(raw, work, capsys, monkeypatch, fails):
    """A stage of its own after the training; interrupted and resumed it ends with equal bits."""
    from training import quantize_aware
    args = [*RAW, "-D", str(raw), "-e", "4", "-r", "k"]
    train.main(args)
    export.main(["-r", "k", "--int8", "-o", "plain.tza"])
    more = [*args, "--quantize_aware", "30", "--quantize_rate", "0.05"]
    monkeypatch.setattr(quantize_aware, "SAVE_EVERY", 10)
    train.main([*more, "-R", "whole"])
    kept = quantize_aware.Batches.__getitem__

    def stop(self, step):
        if step == 25:
            raise KeyboardInterrupt
        return kept(self, step)
    with monkeypatch.context() as patch:
        patch.setattr(quantize_aware.Batches, "__getitem__", stop)
        code, message = fails(train.main, more)
    assert code == 130 and message.endswith("in the integer stage; the same command resumes")
    export.main(["-r", "k", "--int8", "-o", "early.tza"])
    assert "training is not finished (step 20 of 30)" in capsys.readouterr().out
    assert Path("early.tza").read_bytes() == Path("plain.tza").read_bytes()
    train.main(more)
    out = capsys.readouterr().out
    assert "Integer model: 30 steps from 20" in out
    assert "on tiles held out" in out and "in floating point" in out
    train.main(more)
    assert "Integer model: trained before" in capsys.readouterr().out
    for results in ("whole", "results"):
        export.main(["-r", "k", "-R", results, "--int8", "-o", f"{results}.tza"])
    assert Path("whole.tza").read_bytes() == Path("results.tza").read_bytes()
    assert Path("whole.tza").read_bytes() != Path("plain.tza").read_bytes()


def test_silent_channels_are_left_out(raw, work, fails):
    """Not the others, nor more than keeps widths multiples of 8; codes of the heads stay but for
    the weights' rounding in pairs."""
    model = "kernel5:24,8,8,8,24,16,16,16,24,40,16,24,16,8"
    wide = nets.build(model, 0)
    dead = {"enc0a": 9, "enc1a": 3, "enc2a": 16, "enc4b": 10, "dec2": 8, "enc3b": 7}
    with torch.no_grad():
        for layer, count in dead.items():
            getattr(wide, layer).bias[-count:] = -100
    torch.save(wide.state_dict(), "wide.pt")
    train.main([*RAW[:-len(QUICK)], "-m", model, *QUICK[2:], "-D", str(raw), "-e", "1", "-r", "w",
                "--init", "wide.pt", "--max_lr", "1e-9"])
    export.main(["-r", "w", "--int8", "-o", "whole.tza"])
    export.main(["-r", "w", "--int8", "--prune", "3", "-o", "less.tza"])
    whole, less = (kernel.load(f"{name}.tza") for name in ("whole", "less"))
    left_out = {a.layer.name: a.outputs - b.outputs for a, b in zip(whole.layers, less.layers)}
    assert left_out["enc0a"] >= 8 and left_out["enc2a"] >= 16 and left_out["enc4b"] >= 8
    assert left_out["dec2"] >= 8 and left_out["enc1a"] == left_out["enc3b"] == 0
    assert not any(left_out[head] for head in whole.net.heads)
    settings = load_model(Result("results", "w"))[1]
    for i, codes in enumerate(spread_codes(calibration_pictures(settings, 3), 3)):
        x = whole.codes(kernel_input(codes, settings, i))
        a, b = whole.maps(x), less.maps(x)
        for head in whole.net.heads:
            off = np.abs(a[head].astype(int) - b[head])
            assert off.max() <= 2 and off.mean() < 0.1, (head, off.max(), off.mean())
    assert Path("less.tza").stat().st_size < Path("whole.tza").stat().st_size
    code, message = fails(export.main, ["-r", "w", "--prune", "3"])
    assert code == 2 and "--int8" in message


class Teacher:
    """Batches whose targets are what a model makes of them."""

    def __init__(self, model, batches):
        self.model, self.batches = model, batches

    def __getitem__(self, step: int):
        x, _ = self.batches[step]
        with torch.no_grad():
            return x, self.model(x)


def test_integer_training_repairs_a_spoilt_model(raw):
    """Weights disturbed after quantisation: the error falls on tiles that training has not seen."""
    features = ["hdr", "alb", "nrm"]
    pictures = from_raw(scan(raw / "train", features), features, "hdr", "pu")
    torch.manual_seed(1)
    settings = Settings({"family": "K", "main_feature": "hdr", "features": features,
                         "transfer": "pu", "result": "k"})
    start = nets.build(TINY, 0)
    with torch.no_grad():
        for head in start.heads:  # of strong opinions
            getattr(start, head.name).weight.mul_(30)
    net = IntegerKernel(quantize(start.state_dict(), settings, pictures), "pu")
    teacher = Teacher(copy.deepcopy(net), Batches(pictures, features, "hdr", "pu", 4, 32, 9,
                                                  family="K"))
    with torch.no_grad():
        for name, p in net.named_parameters():
            if not name.endswith("bias"):
                p += torch.randn_like(p) * 10

    def error() -> float:
        with torch.no_grad():
            return sum(float((net(x) - y).abs().mean()) for x, y in (teacher[900], teacher[901]))
    before = error()
    fine_tune(net, teacher, [teacher[800]], 30, 0.5, l1, log=lambda line: None)
    assert error() < 0.8 * before


def test_integer_heads_beyond_their_range_can_come_back():
    """A gradient reaches biases of codes below 0 if it leads upwards, and of those above 255."""
    head = IntegerKernel(kernel.load(GOLDEN / "weights.tza"), "linear").layers[-1]
    x = torch.zeros(1, head.weight.shape[1], 4, 4, dtype=torch.float64)
    for sign in (1, -1):
        with torch.no_grad():
            head.bias.fill_(-sign * 1e6)
        for wish, reached in ((sign, True), (-sign, False)):
            head.bias.grad = None
            (-wish * head(x, None)).sum().backward()
            assert bool((head.bias.grad != 0).all()) == reached


def test_integer_net_is_the_integer_model():
    """Heads to the bit, and the picture but for the rounding of fp32 sums."""
    model = kernel.load(GOLDEN / "weights.tza")
    net = IntegerKernel(model, "linear")
    rng = np.random.default_rng(1)
    codes = rng.integers(0, 256, (32, 48, 12)).astype(np.uint8)
    x = torch.from_numpy(codes.transpose(2, 0, 1)[None].astype(np.float32) / 255)
    with torch.no_grad():
        heads = net.trunk(x)
    maps = model.maps(codes)
    for name, head in zip(model.net.heads, heads, strict=True):
        assert np.array_equal((head[0] * 16).numpy().transpose(1, 2, 0), maps[name])
    assert same([t.weight.tolist() for t in net.integer_model().layers],
                [t.weight.tolist() for t in model.layers])


@pytest.mark.parametrize("height, width", [(37, 45), (16, 33), (5, 3)])
def test_any_size_equals_the_reference(height, width):
    """Padding to the trunk's multiples weighs nothing, as in the numpy reference."""
    _, want, got = in_both(kernel.load(GOLDEN / "weights.tza"), height, width)
    assert np.abs(got - want).mean() < 2e-3 and np.median(np.abs(got - want)) < 1e-5


def test_tiles_lose_features_and_highlights(raw):
    features = ["hdr", "alb", "nrm"]
    pictures = from_raw(scan(raw / "train", features), features, "hdr", "pu")
    batches = Batches(pictures, features, "hdr", "pu", 200, 16, 1, Augment(drop=0.5, clip=0.3),
                      family="K")
    x, y = batches[0]
    assert x.shape == (200, 12, 16, 16) and y.shape == (200, 3, 16, 16)
    flags = x[:, 9:, 0, 0].numpy()
    assert abs((flags[:, :2].min(1) == 0).mean() - 0.5) < 0.12  # half of them lack something
    assert abs((flags[:, :2].max(1) == 0).mean() - 0.25) < 0.1  # a quarter everything
    assert abs(flags[:, 2].mean() - 0.3) < 0.12
    for i in range(200):
        if not flags[i, 0]:
            assert not x[i, 3:6].any()
        if not flags[i, 1]:
            assert not x[i, 6:9].any()
        if flags[i, 2]:
            assert max(x[i, :3].max(), y[i].max()) <= color.pu_forward(np.float32(1)) + 1e-3
    again = batches[0]
    assert torch.equal(x, again[0]) and torch.equal(y, again[1])


def test_fewer_features_and_low_dynamic_range(raw, work):
    """K from colour alone, from preprocessed data, and of LDR colour."""
    preprocess.main(["hdr", "alb", "nrm", "-D", str(raw), "-t", "train"])
    train.main(["hdr", "-t", "train", *QUICK, "-e", "1", "-r", "a"])
    export.main(["-r", "a", "--int8"])
    for path in (raw / "train").rglob("*.hdr.exr"):
        name = str(path.relative_to(raw)).replace(".hdr.exr", ".ldr.exr")
        Path("ldr", name).parent.mkdir(parents=True, exist_ok=True)
        os.symlink(path, Path("ldr", name))
    train.main(["ldr", "--raw", "-D", "ldr", "-t", "train", *QUICK, "-e", "1", "-r", "b"])
    export.main(["-r", "b", "--int8"])
    infer.main(["-r", "b", "-D", "ldr", "-i", "train"])
    assert load_model(Result("results", "b"))[0].transfer == "srgb"


def test_find_lr(raw, work, capsys):
    find_lr.main([*RAW, "-D", str(raw), "-r", "sweep", "--num_steps", "12", "--lr", "1e-4",
                  "--max_lr", "1e-1"])
    assert "smoothed loss" in capsys.readouterr().out.splitlines()[-1]


def test_find_lr_has_the_precision_of_the_training(raw, work, fails):
    args = [*RAW, "-D", str(raw), "-s", "1", "--num_steps", "2"]
    for precision in ("fp32", "bf16"):
        find_lr.main([*args, "-r", precision, "-p", precision])
    assert Path("results/fp32.csv").read_text() != Path("results/bf16.csv").read_text()
    code, message = fails(find_lr.main, [*args, "-p", "mixed"])
    assert code == 2 and "needs a cuda device" in message


def test_weights_of_elsewhere(raw, work, fails, capsys):
    """A state dict (.pt), an fp16 file and an integer one: start a training; the former are
    quantised and evaluated."""
    torch.manual_seed(5)
    net = nets.build(TINY, 0)
    torch.save(net.state_dict(), "k.pt")
    write_weights("k.tza", {k: v.numpy() for k, v in net.state_dict().items()})
    for source in ("k.pt", "k.tza"):
        train.main([*RAW, "-D", str(raw), "-e", "1", "-r", source, "--init", source, "--max_lr",
                    "1e-9"])
        bias = state(source)["model_state"]["head0.bias"]
        assert torch.allclose(bias, net.head0.bias, atol=5e-3)
        quantize_kernel.main([source, f"{source}.int8.tza", "--data", str(raw / "train"),
                              "--count", "2"])
    assert Path("k.pt.int8.tza").read_bytes() == Path("k.tza.int8.tza").read_bytes()
    train.main([*RAW, "-D", str(raw), "-e", "1", "-r", "i", "--init", "k.tza.int8.tza", "--max_lr",
                "1e-9"])
    assert torch.allclose(state("i")["model_state"]["head0.bias"], net.head0.bias, atol=0.1)
    export.main(["-r", "k.pt", "-o", "again.tza"])
    assert Path("again.tza").read_bytes() == Path("k.tza").read_bytes()
    torch.save({f"module.{k}": v for k, v in net.state_dict().items()}, "other.pt")
    code, message = fails(export.main, ["-r", "other.pt", "-o", "x.tza"])
    assert code == 4 and message.startswith("other.pt: not the weights of a network")
    Path("bad.pt").write_bytes(b"x")
    data = ["--data", str(raw / "train"), "--count", "1"]
    torch.save({k: v.bfloat16() for k, v in net.state_dict().items()}, "short.pt")
    quantize_kernel.main(["short.pt", "short.tza", *data])
    for arguments, code in ((["bad.pt", "x.tza"], 4), (["none.tza", "x.tza"], 3),
                            (["k.tza", "k.pt/x.tza"], 5)):  # the output's folder is a file
        assert fails(quantize_kernel.main, [*arguments, *data])[0] == code
    write_features(Path("alone"), "a_4", picture(1))
    for name, text in ("nothing", "no such data set"), ("alone", "and a reference"):
        code, message = fails(quantize_kernel.main, ["k.tza", "x.tza", "--data", name])
        assert code == 3 and text in message
    code, message = fails(quantize_kernel.main, ["k.tza", "x.tza", *data, "--count", "0"])
    assert code == 2 and "--count 0" in message
    wild = {k: v * (1e4 if k in ("enc4b.weight", "head4.weight") else 1)
            for k, v in net.state_dict().items()}
    torch.save(wild, "wild.pt")
    code, message = fails(quantize_kernel.main, ["wild.pt", "x.tza", *data])
    assert code == 4 and "head4: the logits are too large" in message
    assert not Path("x.tza").exists()  # it was written, and the library refused it
    evaluate.main(["k.tza=hdr,alb", "--images", str(raw / "valid"), "--no_oidn", "--metric",
                   "psnr"])
    assert "4 of 4 pictures are better than their input in PSNR" in capsys.readouterr().out


@pytest.mark.parametrize("args, word", [
    (["hdr", "z", "--net", "kernel5"], "family K takes"),
    (["alb", "--net", "kernel5", "--bilateral", "3"], "is for colour"),
    (["hdr", "--net", "kernel5", "-m", "w16"], "not of the topology"),
    (["hdr", "-m", "w16", "--clip", "0.1"], "options of family K"),
    (["hdr", "-m", "kernel5:4"], "needs 14 widths"),
    (["hdr", "--quantize_aware", "-1"], "a whole number from 0")])
def test_wrong_options(fails, args, word):
    code, message = fails(lambda argv: parse("train", argv), args)
    assert code == 2 and word in message


def test_defaults_and_the_shipped_settings(root):
    s = parse("train", ["hdr", "alb", "nrm", "--net", "kernel5"])
    assert (s.model, s.family, s.batch_size, s.tile_size, s.loss) == (
        "k16", "K", 4, 128, "l1_grad")
    assert s.max_learning_rate == pytest.approx(2e-3) and s.grad_clip == 1.0
    files = sorted((root / "training" / "configs").glob("k*.json"))
    assert files
    for path in files:
        s = parse("train", ["-c", str(path), "-t", "x", "--time-budget", "30m"])
        drop = 0.35 if len(s.features) > 1 else 0
        assert (s.family, s.drop_features) == ("K", drop) and nets.build(s.model, 9).inputs == 12
        assert json.dumps(s.to_dict())


def test_onnx_is_refused(raw, work, fails):
    train.main([*RAW, "-D", str(raw), "-e", "1", "-r", "k"])
    code, message = fails(export.main, ["-r", "k", "onnx"])
    assert code == 2 and "family U" in message
    code, message = fails(export.main, ["-r", "k", "package", "--int8"])
    assert code == 2 and "--int8" in message
