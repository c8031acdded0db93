"""Processes of a training: none leaves threads behind when its group is closed."""
from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest
import torch

from tests.training.test_train import RAW, port
from training import parallel, train
from training.errors import ToolError
from training.settings import parse

MEMBER = """
import torch
from pathlib import Path
from training import parallel, train
from training.settings import parse

def work(settings, team):
    p = torch.nn.Parameter(torch.ones(4, 4))
    p.grad = torch.full((4, 4), float(team.rank))
    team.average([p.grad])
    assert float(p.grad[0, 0]) == 0.5
    torch.optim.AdamW([p]).step()

parallel.launch(work, parse("train", ["hdr", "--threads", "1", "-d", "cpu", "-b", "2"], ""))
print(sorted(t.read_text().strip() for t in Path("/proc/self/task").glob("*/comm")))
"""


def by_torchrun(script: str, root, tmp_path) -> str:
    """What two processes print."""
    (tmp_path / "member.py").write_text(script)
    env = dict(os.environ, PYTHONPATH=str(root), OMP_NUM_THREADS="1")
    run = subprocess.run([sys.executable, "-m", "torch.distributed.run", "--nproc_per_node=2",
                          f"--master_port={port()}", str(tmp_path / "member.py")],
                         env=env, capture_output=True, text=True, timeout=600)
    assert run.returncode == 0, run.stderr
    return run.stdout


@pytest.mark.skipif(sys.platform != "linux", reason="optional: reads /proc")
def test_closed_group_leaves_no_threads(root, tmp_path):
    """Threads of gloo that are left while the interpreter ends abort it, now and then."""
    said = by_torchrun(MEMBER, root, tmp_path)
    assert said.count("[") == 2 and "gloo" not in said


def test_graphs_are_for_gpus():
    model, team = torch.nn.Conv2d(3, 3, 1), parallel.Team(0, 1, torch.device("cpu"))
    s = parse("train", ["hdr", "-b", "1", "--compile", "graphs"])
    with pytest.raises(ToolError, match="--compile graphs needs a cuda device"):
        parallel.compiled(model, s, team)
    assert parallel.compiled(model, s.replace(compile=None), team) is model


SHORT = """
from datetime import timedelta
import torch.distributed.distributed_c10d as c10d
c10d.default_pg_timeout = timedelta(seconds=1)
import time
from training import parallel, train
from training.settings import parse

def work(settings, team):
    if team.rank == 0:
        time.sleep(4)
    team.wait()
    print("waited")

parallel.launch(work, parse("train", ["hdr", "--threads", "1", "-d", "cpu", "-b", "2"], ""))
"""


def test_processes_wait_for_what_one_does_alone(root, tmp_path):
    """However long, as validations and the integer stage are."""
    assert by_torchrun(SHORT, root, tmp_path).count("waited") == 2


SEEDS = """
import os
from training import parallel, train
from training.settings import parse

given = ["-s", str(2**62 + 1)] if "-s" in os.environ["SEEDS"] else []
parallel.launch(lambda settings, team: print(f"<{settings.seed}>\\n", end=""),
                parse("train", ["hdr", "--threads", "1", "-d", "cpu", "-b", "2", *given], ""))
"""


@pytest.mark.parametrize("given", ["", "-s"])
def test_processes_have_one_seed(root, tmp_path, monkeypatch, given):
    """Without --seed each took its own clock's, and so began with another model."""
    monkeypatch.setenv("SEEDS", given)
    seeds = re.findall(r"<(\d+)>", by_torchrun(SEEDS, root, tmp_path))
    assert len(seeds) == 2 and len(set(seeds)) == 1
    assert not given or seeds[0] == str(2**62 + 1)


def test_what_only_the_first_process_cannot_do(raw, work, root):
    """It saves alone. The others then lose the connection, which is nobody's concern."""
    (work / "results" / "a").mkdir(parents=True)
    (work / "results" / "a" / "checkpoints").touch()
    done = subprocess.run([sys.executable, "-m", "training.train", *RAW, "-D", str(raw), "-r", "a",
                           "-e", "2", "--save_epochs", "1", "-n", "2"], cwd=work, timeout=300,
                          capture_output=True, text=True,
                          env=os.environ | {"PYTHONPATH": str(root)})
    said = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
    assert done.returncode == 5 and "Traceback" not in done.stderr, done.stderr
    assert len(said) == 2 and "checkpoint_1.pth: cannot write" in said[0]


def test_an_interrupted_process_says_so(monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(parallel, "_member", interrupted)
    monkeypatch.setattr(parallel.signal, "signal", lambda *_: None)
    with pytest.raises(SystemExit) as ended:
        parallel._spawned(0, None, parse("train", ["hdr", "-n", "2"]))
    assert ended.value.code == 130 and capsys.readouterr().err == "Error: interrupted\n"


@pytest.mark.parametrize("arguments, text", [
    (["-b", "3"], "--batch_size 3 does not divide by 2 processes"),
    (["-b", "4", "--large_tiles", "2"], "a quarter of --batch_size 4 does not divide by 2")])
def test_batches_are_shared_out_by_torchrun(monkeypatch, arguments, text):
    """Each process takes whole tiles, of batches of large ones as well."""
    monkeypatch.setenv("WORLD_SIZE", "2")
    monkeypatch.setenv("RANK", "0")
    monkeypatch.setattr(parallel.dist, "init_process_group", lambda *_, **__: pytest.fail("late"))
    with pytest.raises(ToolError, match=text):
        parallel.launch(lambda *_: None, parse("train", ["hdr", "-d", "cpu", *arguments]))


def test_all_processes_resume_or_none(work):
    """Where machines have folders of their own, some would begin anew beside others that go on."""
    team = parallel.Team(1, 1, torch.device("cpu"))
    team.same = lambda value: 1.0  # the first one resumes
    settings = parse("train", ["hdr", "--raw", "-t", "train", "-r", "a"])
    with pytest.raises(ToolError, match="--results_dir must be one folder for all machines"):
        train.worker(settings, team)
