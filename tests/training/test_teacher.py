"""Training on the results of another model (--teacher)."""
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from export import export
from export.bilateral import main as bilateral
from tests.training.test_kernel_train import RAW
from tests.training.test_train import Stop, same, state
from training import nets, train
from training.data import Batches, from_raw
from training.result import Result, load_model, read_weights
from training.scan import scan
from training.settings import Settings
from training.teacher import VIEWS, Teacher, turned, turned_back

FEATURES = ["hdr", "alb", "nrm"]
NARROW = ["-m", "kernel5:" + ",".join(["4"] * 14)]


def settings(**changes) -> Settings:
    return Settings({"family": "K", "main_feature": "hdr", "features": FEATURES, "transfer": "pu",
                     "results_dir": "results", "teacher_share": 1.0, "seed": 5, **changes})


def test_views_are_eight_and_can_be_undone():
    x = torch.rand(2, 3, 16, 16)
    views = [turned(x, view) for view in range(VIEWS)]
    for i, view in enumerate(views):
        assert torch.equal(turned_back(view, i), x)
        assert not any(torch.equal(view, other) for other in views[:i])


def test_targets_move_to_results_that_are_closer_to_them_than_the_input(work):
    """A model that halves each pixel: in one tile that is nearly right, in the other the input is.
    """
    torch.save(nets.build(NARROW[1], 0).state_dict(), "t.pt")
    x = torch.rand(2, 12, 32, 32)
    y = torch.stack((0.5 * x[0, :3], x[1, :3])) + 0.01 * torch.rand(2, 3, 32, 32)
    seen = []
    for share in (1.0, 0.25):
        teacher = Teacher(settings(teacher="t.pt", teacher_share=share), torch.device("cpu"))
        teacher.model = lambda v: seen.append(v) or 0.5 * v[:, :3]
        for step in range(20):
            target = teacher.target(x, y, step)
            assert torch.allclose(target[0], torch.lerp(y[0], 0.5 * x[0, :3], share))
            assert torch.equal(target[1], y[1])
    views = {next(i for i in range(VIEWS) if torch.equal(turned(x, i), v)) for v in seen}
    assert len(views) > 5 and all(torch.equal(a, b) for a, b in zip(seen, seen[20:]))


def test_students_follow_their_teacher(raw, work):
    """Ever closer; further from it is one that learnt from the references alone, as long."""
    train.main([*RAW, "-D", str(raw), "-r", "teacher", "-e", "20", "--max_lr", "5e-3"])
    args = [*RAW, *NARROW, "-D", str(raw), "-e", "40", "--max_lr", "5e-3"]
    train.main([*args, "-r", "alone"])
    train.main([*args, "-r", "taught", "--teacher", "teacher", "--teacher_share", "1"])
    pictures = from_raw(scan(raw / "valid", FEATURES), FEATURES, "hdr", "pu")
    x, _ = Batches(pictures, FEATURES, "hdr", "pu", 8, 32, 1, family="K")[0]
    with torch.no_grad():
        made = {name: load_model(Result("results", name))[0](x)
                for name in ("teacher", "taught", "alone")}
    off = {k: float((made[k] - made["teacher"]).abs().mean()) for k in ("taught", "alone")}
    assert off["taught"] < 0.8 * off["alone"]


def test_resumed_run_equals_an_uninterrupted_one(raw, work):
    torch.save(nets.build(RAW[RAW.index("-m") + 1], 0).state_dict(), "t.pt")
    args = [*RAW, "-D", str(raw), "-e", "3", "--save_epochs", "1", "--teacher", "t.pt", "-r", "k"]
    train.main([*args, "-R", "whole"])
    with pytest.raises(Exception, match="interrupted after 5 steps"), Stop(after=5):
        train.main(args)
    train.main(args)
    assert same(Result("whole", "k").load(), state("k"))
    with pytest.raises(Exception, match="other settings"):
        train.main([*args, "--teacher_share", "0.5"])


def test_integer_models_teach_with_what_follows_their_filter(raw, work):
    train.main([*RAW, "-D", str(raw), "-r", "k", "-e", "1"])
    export.main(["-r", "k", "--int8", "-o", "k.tza"])
    bilateral(["k.tza", "smooth.tza"])
    plain, smooth = (Teacher(settings(teacher=f"{n}.tza"), torch.device("cpu")).model
                     for n in ("k", "smooth"))
    assert smooth.bilateral and not plain.bilateral
    for name, value in read_weights(Path("smooth.tza")).items():
        assert np.array_equal(plain.state_dict()[name], value)


def test_unfit_teachers_are_refused(raw, work, fails):
    other = nets.build("unet:" + ",".join(["4"] * 15), 9)
    torch.save(other.state_dict(), "u.pt")
    torch.save({"a": torch.ones(1)}, "none.pt")
    args = [*RAW, "-D", str(raw), "-e", "1", "-r", "k", "--teacher"]
    for more, text in ((["u.pt"], "inputs or outputs"), (["none.pt"], "no known network"),
                       (["gone.tza"], "gone.tza"), (["gone"], "does not exist"),
                       (["u.pt", "--teacher_share", "0"], "above 0, to 1")):
        code, message = fails(train.main, [*args, *more])
        assert code in (2, 4) and text in message, message
    assert not Path("results/k").exists()
