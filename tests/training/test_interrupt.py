"""Ctrl-C and SIGTERM: at whatever moment they come, a resumed training ends as one that was left
alone."""
from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import torch

from tests.training.test_train import RAW, same, state
from training import find_lr, interrupt, nets, optimizer, schedule, train, validate
from training.data import Batches
from training.interrupt import Interrupted, Interrupts
from training.result import Result


def ask() -> None:
    signal.raise_signal(signal.SIGINT)


def test_a_second_request_ends_at_once(monkeypatch):
    before = signal.getsignal(signal.SIGTERM)
    with Interrupts() as interrupts:
        interrupts.check()
        for number in (signal.SIGINT, signal.SIGTERM):  # one request, as a launcher passes it on
            signal.raise_signal(number)
        assert interrupts.asked
        with pytest.raises(Interrupted):
            interrupts.check()
        with pytest.raises(Interrupted), interrupts.at_once():
            pytest.fail("not reached")
        monkeypatch.setattr(interrupt, "AGAIN", 0.0)
        with pytest.raises(KeyboardInterrupt) as caught:
            ask()
        assert caught.type is KeyboardInterrupt
    assert signal.getsignal(signal.SIGTERM) is before


averaged = validate.averaged


def interrupted(args: list[str]) -> None:
    with pytest.raises(Exception, match=r"interrupted after \d+ steps; the same command resumes"):
        train.main(args)


def at_call(number: int, real):
    """The function, with a request in the given one of its calls."""
    calls = []

    def call(*args):
        calls.append(1)
        if len(calls) == number:
            ask()
        return real(*args)
    return call


@pytest.mark.parametrize("call", [18, 25])
def test_a_step_is_made_whole(raw, work, monkeypatch, call):
    args = [*RAW, "-D", str(raw), "-m", "w8", "--optimizer", "muon", "-e", "2", "-r", "a"]
    train.main([*args, "-R", "whole"])
    with monkeypatch.context() as patch:
        patch.setattr(optimizer, "orthogonal", at_call(call, optimizer.orthogonal))
        interrupted(args)
    assert 0 < state()["step"] < 6
    train.main(args)
    assert same(Result("whole", "a").load(), state())


def validations(out: str) -> list[str]:
    return re.findall(r"valid_loss=.*", out)


@pytest.mark.parametrize("number", [1, 2])
def test_a_validation_is_made_again(raw, work, monkeypatch, capsys, number):
    """In the middle of a training, and the last; after a look at dead channels."""
    monkeypatch.setattr("training.dead.STEPS", 4)
    args = [*RAW, "-D", str(raw), "-v", "valid", "-e", "4", "--valid_epochs", "2",
            "--save_epochs", "4", "-r", "a"]
    train.main([*args, "-R", "whole"])
    want = validations(capsys.readouterr().out)
    with monkeypatch.context() as patch:
        patch.setattr(validate, "averaged", at_call(number, averaged))
        interrupted(args)
    assert state()["step"] == 6 * number and state()["ending"]
    train.main(args)
    assert validations(capsys.readouterr().out) == want and len(want) == 2
    whole = Result("whole", "a")
    assert same(whole.load(), state()) and not state()["ending"]
    assert same(whole.load(best=True), Result("results", "a").load(best=True))


def test_the_validation_that_is_timed(raw, work, monkeypatch, capsys):
    """At the end of an epoch, which has a validation of its own."""
    monkeypatch.setattr(schedule, "TIMED", 3)
    monkeypatch.setattr(schedule.Plan, "estimate", lambda *a: 12)
    monkeypatch.setattr(schedule.Plan, "revise", lambda *a: False)
    args = [*RAW, "-D", str(raw), "-v", "valid", "-r", "a", "--time_budget", "0.01s",
            "--valid_epochs", "2"]
    with monkeypatch.context() as patch:
        patch.setattr(validate, "averaged", at_call(1, averaged))
        interrupted(args)
    assert state()["step"] == 6 and state()["planned"] is None and state()["ending"]
    train.main(args)
    assert len(validations(capsys.readouterr().out)) == 3  # epochs 2 and 4, and the timed one
    assert state()["step"] == 12 and not state()["ending"]


def test_a_loader_that_hangs(raw, work, monkeypatch):
    kept = Batches.__getitem__

    def hang(self, step):
        if step == 4:
            threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
            time.sleep(60)
        return kept(self, step)
    monkeypatch.setattr(Batches, "__getitem__", hang)
    start = time.monotonic()
    interrupted([*RAW, "-D", str(raw), "-e", "4", "-r", "a"])
    assert time.monotonic() - start < 30 and state()["step"] == 4


class Unsendable:
    """What cannot be handed over, as a batch where /dev/shm is full."""

    def __reduce__(self):
        raise OSError(28, "No space left on device")


@pytest.mark.parametrize("main", [train.main, find_lr.main])
@pytest.mark.parametrize("die", [lambda: os.kill(os.getpid(), signal.SIGKILL), Unsendable])
def test_a_loader_that_dies(raw, work, monkeypatch, fails, main, die):
    """Like one that runs out of memory; it is neither waited for nor told of by a traceback."""
    kept = Batches.__getitem__
    monkeypatch.setattr(Batches, "__getitem__",
                        lambda self, step: die() if step == 4 else kept(self, step))
    code, message = fails(main, [*RAW, "-D", str(raw), "-r", "a", "-j", "1"])
    assert code == 4 and message.startswith("a loader process has died")


def wait_for(path: Path, process: subprocess.Popen) -> None:
    while not path.exists():
        assert process.poll() is None, process.communicate()
        time.sleep(0.1)


@pytest.mark.parametrize("more, number, all_of_them", [
    (["-n", "2"], signal.SIGTERM, False), (["-n", "2", "-j", "1"], signal.SIGINT, True),
    (["-j", "2"], signal.SIGTERM, True)])
def test_all_processes_end_and_have_saved(raw, work, more, number, all_of_them):
    """What a terminal and batch systems send, to the first process or to each; twice at once, as
    those do that pass it on."""
    command = [sys.executable, "-m", "training.train", *RAW, "-D", str(raw), "-e", "100000", "-r",
               "a", "--save_epochs", "10", *more]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                          env=os.environ | {"PYTHONPATH": str(nets.ROOT)},
                          start_new_session=True) as process:
        wait_for(work / "results/a/checkpoints/latest", process)
        for _ in range(2):
            (os.killpg if all_of_them else os.kill)(process.pid, number)
        _, err = process.communicate(timeout=120)
    assert process.returncode == 130
    said = [line for line in err.splitlines() if not line.startswith("[W")]  # PyTorch's warnings
    found = re.fullmatch(r"Error: interrupted after (\d+) steps; the same command resumes", *said)
    assert found and state()["step"] == int(found[1]), err
    assert all(torch.isfinite(v).all() for v in state()["model_state"].values())
    with pytest.raises(ProcessLookupError):  # nobody is left, if not for a moment
        for _ in range(100):
            os.killpg(process.pid, 0)
            time.sleep(0.1)


def test_a_result_is_written_by_one_training(work, raw, root, fails):
    """Of two with one name each wrote checkpoints over the other's, and resuming took a mixture."""
    args = [*RAW, "-D", str(raw), "-r", "same", "-s", "3", "--num_save_epochs", "1"]
    train.main([*args, "-e", "1"])
    before = Path("results/same/config.json").read_bytes()
    first = subprocess.Popen([sys.executable, root / "training/train.py", *args, "-e", "100000"],
                             stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        while "2/100000" not in (line := first.stdout.readline()):
            assert line, "it has ended"
        config = Path("results/same/config.json").read_bytes()
        code, message = fails(train.main, [*args, "-e", "2"])
        assert code == 4 and "'same': another training writes to results" in message
        assert Path("results/same/config.json").read_bytes() == config != before
    finally:
        first.kill()
        first.wait()
    done = int(Path("results/same/checkpoints/latest").read_text())
    train.main([*args, "-e", str(done + 1)])
    assert Path(f"results/same/checkpoints/checkpoint_{done + 1}.pth").exists()
    assert not Path("results/same/lock").exists()
