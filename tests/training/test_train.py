"""Training: learning, resuming, data parallel runs, budgets, and what goes wrong."""

import json
import math
import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from tests.training.tools import QUICK, TINY, make_raw
from training import find_lr, preprocess, schedule, train
from training.result import Result

RAW = ["hdr", "alb", "nrm", "--raw", "-t", "train", "-s", "3", *QUICK]


def state(result: str = "a", epoch: int | None = None) -> dict:
    return Result("results", result).load(epoch)


def losses(out: str) -> list[float]:
    return [float(v) for v in re.findall(r"Train.*?: loss=([\d.]+)", out)]


def same(a, b) -> bool:
    """Equal to the last bit, tensors and all."""
    if isinstance(a, torch.Tensor):
        return torch.equal(a, b)
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[k], b[k]) for k in a if k != "elapsed")
    if isinstance(a, (list, tuple)):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b


def test_training_learns_and_leaves_its_files(raw, work, capsys):
    train.main([*RAW, "-D", str(raw), "-v", "valid", "-r", "a", "-e", "12", "--valid_epochs", "4",
                "--save_epochs", "6"])
    out = capsys.readouterr().out
    assert "Training images: 10\nValidation images: 4\n" in out and "Finished (" in out
    assert "5 groups, 10 (input, target) pairs" in out
    values = losses(out)
    assert len(values) == 12 and values[-1] < 0.5 * values[0]
    valid = [float(v) for v in re.findall(r"valid_loss=([\d.]+)", out)]
    assert len(valid) == 3 and valid[-1] < valid[0]
    folder = Path("results/a")
    assert json.loads((folder / "config.json").read_text())["model"] == TINY
    assert sorted(p.name for p in (folder / "checkpoints").iterdir()) == [
        "best.pth", "checkpoint_12.pth", "checkpoint_6.pth", "latest"]
    assert (folder / "checkpoints" / "latest").read_text().strip() == "12"
    assert {"epoch", "step", "model_state", "optimizer_state", "ema_state"} <= state().keys()


def test_log_has_scalars_and_pictures(raw, work):
    reader = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    train.main([*RAW, "-D", str(raw), "-v", "valid", "-r", "a", "-e", "2", "--valid_epochs", "1"])
    log = reader.EventAccumulator("results/a/log")
    log.Reload()
    assert {"loss", "learning_rate", "valid_loss", "valid_psnr", "valid_ssim",
            "valid_psnr/1spp", "valid_psnr/4spp"} <= set(log.Tags()["scalars"])
    assert [e.step for e in log.Scalars("loss")] == [1, 2]
    assert log.Tags()["images"]


@pytest.mark.parametrize("optimizer", ["adam", "muon"])
def test_resumed_run_equals_an_uninterrupted_one(raw, work, capsys, optimizer):
    args = [*RAW, "-D", str(raw), "--hold_out", "1", "-e", "6", "--save_epochs", "1",
            "--valid_epochs", "2", "--exposure_jitter", "1", "--average_inputs", "0.3",
            "--optimizer", optimizer]
    train.main([*args, "-r", "whole"])
    # the first half in a process that is stopped by its time budget of the schedule: by hand here
    stop = Stop(after=5)
    with pytest.raises(Exception, match="interrupted after 5 steps; the same command resumes"):
        with stop:
            train.main([*args, "-r", "parts"])
    assert state("parts")["step"] == 5  # 2 steps an epoch: in the middle of the third
    capsys.readouterr()
    train.main([*args, "-r", "parts"])
    assert "Resuming result: parts (epoch 2)" in capsys.readouterr().out
    a, b = state("whole"), state("parts")
    assert a["step"] == b["step"] == 12
    assert same(a, b)
    assert same(state("whole", 4), state("parts", 4))


class Stop:
    """Ctrl-C in step number `after` of a training."""

    def __init__(self, after: int):
        self.after, self.count = after, 0

    def __enter__(self):
        self.kept = train.one_cycle

        def one_cycle(*args):
            self.count += 1
            if self.count == self.after:
                signal.raise_signal(signal.SIGINT)
            return self.kept(*args)
        train.one_cycle = one_cycle

    def __exit__(self, *exc):
        train.one_cycle = self.kept


def test_loaders_do_not_change_the_result(raw, work):
    args = [*RAW, "-D", str(raw), "-e", "2", "--save_epochs", "2"]
    train.main([*args, "-r", "none"])
    train.main([*args, "-r", "two", "-j", "2"])
    assert same(state("none"), state("two"))


def test_preprocessed_and_raw_give_the_same_training(raw, work):
    preprocess.main(["hdr", "alb", "nrm", "-D", str(raw), "-t", "train"])
    args = ["hdr", "alb", "nrm", "-t", "train", "-s", "3", *QUICK, "-e", "2"]
    train.main([*args, "-r", "a"])
    train.main([*args, "-r", "b", "--raw", "-D", str(raw)])
    assert same(state("a"), state("b"))


def port() -> str:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return str(s.getsockname()[1])


def compare_processes(args: list[str], root: Path, capsys) -> tuple[list[float], str]:
    """Trains with 2 processes of torchrun and with one; returns the one's losses and the two's
    output, after comparing losses and weights."""
    env = dict(os.environ, PYTHONPATH=str(root), OMP_NUM_THREADS="1")
    run = subprocess.run([sys.executable, "-m", "torch.distributed.run", "--nproc_per_node=2",
                          f"--master_port={port()}", "-m", "training.train", *args, "-r", "two"],
                         env=env, capture_output=True, text=True, timeout=600)
    assert run.returncode == 0, run.stderr
    train.main([*args, "-r", "one"])
    a, b = losses(capsys.readouterr().out), losses(run.stdout)
    assert len(a) == len(b)
    assert max(abs(x - y) for x, y in zip(a, b)) <= 1e-5
    p, q = state("one")["model_state"], state("two")["model_state"]
    assert max(float((p[k] - q[k]).abs().max()) for k in p) < 5e-5
    return a, run.stdout


def test_two_processes_equal_one(raw, work, root, capsys):
    """torchrun with 2 processes on the CPU: the loss curve of one process at equal batch."""
    curve, out = compare_processes([*RAW, "-D", str(raw), "-e", "4"], root, capsys)
    assert len(curve) == 4
    assert out.count("Finished") == 1  # only one process talks


def test_own_processes_without_torchrun(raw, work, script):
    done = script("train", *RAW, "-D", str(raw), "-e", "2", "-n", "2", "-r", "a", timeout=600)
    assert done.returncode == 0, done.stderr
    assert state()["step"] == 6


def test_failed_start_leaves_no_result(raw, work, fails):
    """The same name can be used again once the reason is gone."""
    code, message = fails(train.main, [*RAW, "-D", "nowhere", "-r", "a"])
    assert code == 3 and "no such data set folder" in message
    assert not Path("results").exists()
    train.main([*RAW, "-D", str(raw), "-r", "a", "-e", "1"])
    assert state()["epoch"] == 1


def test_resume_checks_its_settings(raw, work, fails, capsys):
    args = [*RAW, "-D", str(raw), "-r", "a"]
    train.main([*args, "-e", "1"])
    for change, word in ((["-l", "l2"], "loss was l1, is l2"), (["-m", "w8"], "model was"),
                         (["-b", "8"], "batch_size was 4, is 8"), (["-x", "log"], "transfer was"),
                         (["--ts", "16"], "tile_size was")):
        code, message = fails(train.main, [*args, "-e", "2", *change])
        assert code == 4 and word in message
    train.main([*args, "-e", "1"])  # nothing left to do
    capsys.readouterr()
    train.main([*args, "-e", "3", "--max_lr", "1e-9"])
    out = capsys.readouterr().out
    assert "Changed setting: max_learning_rate was 0.002, is 1e-09" in out
    assert json.loads(Path("results/a/config.json").read_text())["max_learning_rate"] == 1e-9
    assert state()["optimizer_state"]["param_groups"][0]["lr"] < 1e-9  # the new rate was used


@pytest.mark.parametrize("stored", [False, True])
def test_resume_holds_out_the_same_groups(work, fails, stored):
    """A group that is added moves the others, and what was learnt would judge."""
    make_raw(work / "d" / "train", 4, spp=(4,))
    args = [*RAW, "-D", "d", "--hold_out", "1", "-r", "a", "--valid_epochs", "1"]
    if stored:
        args.remove("--raw")
        preprocess.main([*RAW[:3], "-D", "d", "-t", "train"])
    train.main([*args, "-e", "1"])
    config = Path("results/a/config.json")
    assert json.loads(config.read_text())["held_out"] == ["scene2/view2"]
    train.main([*args, "-e", "2"])
    make_raw(work / "d" / "train", 7, spp=(4,))
    if stored:
        for shard in "0/2", "1/2":
            preprocess.main([*RAW[:3], "-D", "d", "-t", "train", "--shard", shard])
    code, message = fails(train.main, [*args, "-e", "3"])
    assert code == 4 and "held out scene2/view2; " in message and " scene4/view4;" in message
    old = json.loads(config.read_text())
    del old["held_out"]  # as results were written before they said
    config.write_text(json.dumps(old))
    train.main([*args, "-e", "3"])


def test_damaged_checkpoint(raw, work, fails):
    args = [*RAW, "-D", str(raw), "-r", "a"]
    train.main([*args, "-e", "1"])
    path = Path("results/a/checkpoints/checkpoint_1.pth")
    path.write_bytes(path.read_bytes()[:1000])
    code, message = fails(train.main, [*args, "-e", "2"])
    assert code == 4 and "damaged checkpoint" in message


def test_more_batch_than_data_and_small_validation(raw, work, capsys):
    """Fewer pairs than a batch, validation pictures smaller than a tile: both work."""
    make_raw(work / "small" / "valid", 1, height=24, width=40)
    make_raw(work / "small" / "train", 1)
    train.main([*RAW, "-D", "small", "-v", "valid", "-b", "16", "-e", "1", "-r", "a"])
    out = capsys.readouterr().out
    assert len(losses(out)) == 1 and "valid_loss=" in out


def test_time_budget_ends_with_the_schedule(raw, work, monkeypatch, capsys):
    monkeypatch.setattr(schedule.Plan, "revise", lambda *a: False)
    train.main([*RAW, "-D", str(raw), "-r", "a", "--time-budget", "2s", "-e", "1000000"])
    out = capsys.readouterr().out
    planned = state()["planned"]
    assert "Finished" in out and f"{planned} steps fit into 2.0s" in out
    assert state()["step"] == planned > 11
    settings = Result("results", "a").config()
    last, _ = train.one_cycle(1 - 1 / planned, settings)
    assert state()["optimizer_state"]["param_groups"][0]["lr"] == last < 1e-4  # the cycle's end


def test_slower_training_ends_in_time(raw, work, monkeypatch, capsys):
    """Steps that were estimated ten times too fast: the first epochs tell."""
    estimate, found = schedule.Plan.estimate, []

    def wrong(*args):
        found.append(10 * estimate(*args))
        return found[0]

    monkeypatch.setattr(schedule.Plan, "estimate", wrong)
    train.main([*RAW, "-D", str(raw), "-r", "a", "--time-budget", "2s", "-e", "1000000"])
    end = state()
    assert "steps fit now" in capsys.readouterr().out and end["since"][0] > 0
    assert end["step"] == end["planned"] < found[0]
    assert end["optimizer_state"]["param_groups"][0]["lr"] < 1e-4  # the cycle's end


def test_resumed_budget_equals_an_uninterrupted_run(raw, work, monkeypatch, capsys):
    """The resumed run keeps the number of steps, and ends with equal bits if it did not change."""
    monkeypatch.setattr(schedule.Plan, "estimate", lambda self, step, *rest: 40)
    monkeypatch.setattr(schedule.Plan, "revise", lambda *a: False)
    args = [*RAW, "-D", str(raw), "-r", "a", "--time-budget", "0.01s", "-v", "valid"]
    train.main([*args[:-2], "-v", "valid", "-R", "whole"])
    with pytest.raises(Exception, match="interrupted after 20 steps"), Stop(after=20):
        train.main(args)
    assert state()["planned"] == 40
    monkeypatch.setattr(schedule.Plan, "estimate", lambda *a: pytest.fail("estimated again"))
    train.main(args)
    assert state()["step"] == 40 and same(Result("whole", "a").load(), state())


def test_diverging_training_says_so(raw, work, fails):
    code, message = fails(train.main, [*RAW, "-D", str(raw), "-r", "a", "-e", "30", "--max_lr",
                                       "1e30", "--lr", "1e30"])
    assert code == 4 and "lower --max_lr" in message


def test_find_lr(raw, work, fails, capsys):
    args = ["hdr", "--raw", "-D", str(raw), "-t", "train", "-s", "1", *QUICK[:8], "-j", "0"]
    find_lr.main([*args, "-r", "sweep", "--num_steps", "30", "--lr", "1e-5", "--max_lr", "1e-1"])
    lines = Path("results/sweep.csv").read_text().splitlines()
    assert lines[0] == '"learning_rate","smoothed_loss","loss"'
    rates = [float(row.split(",")[0]) for row in lines[1:]]
    assert rates[0] == pytest.approx(1e-5) and 2 <= len(rates) <= 30
    assert rates[1] / rates[0] == pytest.approx(1e4 ** (1 / 29), rel=1e-6)
    assert "smoothed loss" in capsys.readouterr().out.splitlines()[-1]
    assert fails(find_lr.main, [*args, "--num_steps", "1"])[0] == 2


def test_advice_of_a_sweep():
    """A third of the rate at the lowest loss; none where it falls or rises all the way."""
    rows = [(rate, loss, loss) for rate, loss in ((1e-4, 3.0), (3e-4, 2.0), (1e-3, 2.5))]
    assert "lr=0.0003; try --max_lr 0.0001" in find_lr.advice(rows)
    for part in rows[:2], rows[1:], [(1e-4, math.nan, math.nan)]:
        assert "no minimum" in find_lr.advice(part)


def test_depth_lightmap_and_single_aux_trainings(raw, work):
    """sh1 in three channels at a time, one-channel depth, aux features on their own."""
    import numpy as np

    from training.imageio import write_image
    rng = np.random.default_rng(0)
    for g in range(2):
        for v in ("4", "ref"):
            for axis in "xyz":
                write_image(Path(f"d/t/g{g}_{v}.sh1{axis}.exr"), rng.uniform(-1, 1, (32, 32, 3)))
            write_image(Path(f"d/t/g{g}_{v}.z.exr"), rng.uniform(0, 9, (32, 32, 1)))
    for name, feature, channels in (("s", "sh1", (3, 3)), ("z", "z", (1, 1))):
        train.main([feature, "--raw", "-D", "d", "-t", "t", "--hold_out", "1", "-s", "3", *QUICK,
                    "-e", "1", "-r", name])
        tensors = state(name)["model_state"]
        assert (tensors["enc_conv0.weight"].shape[1], tensors["dec_conv0.weight"].shape[0]
                ) == channels
    for feature in ("alb", "nrm"):
        train.main([feature, "--raw", "-D", str(raw), "-t", "train", "-s", "3", *QUICK, "-e", "1",
                    "-r", feature])
        config = json.loads(Path(f"results/{feature}/config.json").read_text())
        assert config["transfer"] == {"alb": "srgb", "nrm": "linear"}[feature]


def test_no_image_is_left_out_silently(work, capsys):
    make_raw(work / "d" / "train", 2)
    path = work / "d" / "train" / "scene1" / "view1_0001spp.hdr.exr"
    path.write_bytes(b"broken")
    (work / "d" / "train" / "scene0" / "view0_0001spp.nrm.exr").unlink()
    train.main([*RAW, "-D", "d", "-e", "1", "-r", "a"])
    out = capsys.readouterr().out
    assert "left out: 1 x lacks nrm (e.g. scene0/view0_0001spp)" in out
    assert re.search(r"left out scene1/view1_0001spp: .*view1_0001spp.hdr.exr: cannot read", out)
    assert "Training images: 2\n" in out
