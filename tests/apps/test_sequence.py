"""oidnDenoise: numbered files, progress and interruption."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import time

import pytest

from tests.apps import tools as t

# ---- Sequences -----------------------------------------------------------------------------------


@pytest.mark.parametrize("pattern", ["f.####.pfm", "f.%04d.pfm"])
def test_sequence(denoise, identity, work, pattern):
    images = {n: t.noise(16, 24, seed=n) for n in (3, 4, 5, 9)}
    for n, image in images.items():
        t.write_pfm(work / f"f.{n:04}.pfm", image)
    done = denoise(
        "--ldr",
        pattern,
        "--srgb",
        "-w",
        identity[3],
        "-o",
        "out_##.pfm",
        "--frames",
        "3-5,9",
        "--json",
        "--ref",
        pattern,
    )
    assert done.code == 0, done.err
    assert [f["frame"] for f in done.json["frames"]] == [3, 4, 5, 9]
    assert all(f["reference"]["file"] == f["color"]["file"] for f in done.json["frames"])
    for n, image in images.items():
        assert t.equal(t.read_pfm(work / f"out_{n:02}.pfm"), image)


def test_sequence_with_step_stops_at_a_missing_frame(denoise, identity, work):
    for n in (2, 4):
        t.write_pfm(work / f"f{n}.pfm", t.noise(16, 24, seed=n))
    done = denoise("--hdr", "f#.pfm", "-w", identity[3], "-o", "out#.pfm", "--frames", "2-8x2")
    assert done.code == 2 and "f6.pfm" in done.error
    assert sorted(p.name for p in work.glob("out*")) == ["out2.pfm", "out4.pfm"]


# ---- Progress ------------------------------------------------------------------------------------


def test_progress_is_shown_to_a_person_only(build, denoise, identity, work):
    t.write_pfm(work / "in.pfm", t.noise(256, 256))
    arguments = ["--hdr", "in.pfm", "-w", str(identity[3])]
    try:
        master, slave = os.openpty()
    except OSError:
        pytest.skip("optional: no pseudo-terminals here")
    done = subprocess.run(
        [build / "bin" / "oidnDenoise", *arguments], stdout=subprocess.PIPE, stderr=slave, text=True
    )
    os.close(slave)
    shown = os.read(master, 65536).decode()
    os.close(master)
    assert done.returncode == 0 and "%" not in done.stdout
    percents = [int(n) for n in re.findall(r"\rDenoising (\d+)%", shown)]
    assert percents == sorted(percents) and percents[-1] == 100 and len(percents) > 3
    assert denoise(*arguments).err == ""


# ---- Interruption --------------------------------------------------------------------------------


def heed_signals():
    """In a new process: nohup has the one ignored, background jobs of scripts the other."""
    for number in (signal.SIGHUP, signal.SIGINT):
        signal.signal(number, signal.SIG_DFL)


def test_interrupt_cancels(build, identity, work):
    t.write_pfm(work / "in.pfm", t.noise(512, 512))
    (work / "out.pfm").write_text("old")
    command = [
        build / "bin" / "oidnDenoise",
        "--hdr",
        "in.pfm",
        "-w",
        str(identity[3]),
        "-n",
        "100000",
        "-o",
        "out.pfm",
    ]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=heed_signals
    ) as run:
        for line in run.stdout:
            if "hash=" in line:
                break
        run.send_signal(signal.SIGINT)
        _, err = run.communicate(timeout=600)
    assert run.returncode == 130 and err == "Error: interrupted\n"
    assert (work / "out.pfm").read_text() == "old"
    assert sorted(p.name for p in work.iterdir()) == ["in.pfm", "out.pfm"]


def test_background_jobs_are_not_interrupted(build, identity, work):
    """Shells without job control start them with the signal ignored."""
    t.write_pfm(work / "in.pfm", t.noise(64, 64))
    with subprocess.Popen(
        [build / "bin" / "oidnDenoise", "--hdr", "in.pfm", "-w", identity[3], "-n", "200"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    ) as run:
        run.stdout.readline()
        run.send_signal(signal.SIGINT)
        _, err = run.communicate(timeout=600)
    assert run.returncode == 0 and err == ""


def save_slowly(build, identity, work, output="out.exr"):
    """oidnDenoise at the beginning of a write of a second or more, over a file that is there."""
    t.write_pfm(work / "in.pfm", t.noise(1800, 1800))
    (work / output).write_text("old")
    command = [build / "bin" / "oidnDenoise", "--hdr", "in.pfm", "-w", identity[3], "-o", output]
    run = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=heed_signals
    )
    for line in run.stdout:
        if "Saving" in line:
            break
    while not list(work.glob("lull-*.tmp")) and run.poll() is None:
        time.sleep(0.002)
    return run


@pytest.mark.parametrize("name", "SIGINT SIGTERM SIGHUP SIGALRM SIGUSR1 SIGPIPE SIGABRT".split())
def test_signals_while_saving(build, identity, work, exr, name):
    number = getattr(signal, name)
    with save_slowly(build, identity, work) as run:
        run.send_signal(number)
        _, err = run.communicate(timeout=600)
    assert run.returncode == (130 if number == signal.SIGINT else -number)
    assert err == ("Error: interrupted\n" if number == signal.SIGINT else "")
    assert (work / "out.exr").read_text() == "old"
    assert sorted(p.name for p in work.iterdir()) == ["in.pfm", "out.exr"]


def test_second_interrupt_while_saving(build, identity, work):
    """It ends the program at once, which takes its temporary file along."""
    with save_slowly(build, identity, work, "out.hdr") as run:
        run.send_signal(signal.SIGINT)
        time.sleep(0.01)
        run.send_signal(signal.SIGINT)
        run.communicate(timeout=600)
    assert run.returncode == -signal.SIGINT
    assert (work / "out.hdr").read_text() == "old"
    assert sorted(p.name for p in work.iterdir()) == ["in.pfm", "out.hdr"]


def test_files_that_may_not_grow(build, identity, work):
    """A limit of file sizes is an error as a full disk is."""
    t.write_pfm(work / "in.pfm", t.noise(64, 64))
    done = subprocess.run(
        ["sh", "-c", 'ulimit -f 8; exec "$0" --hdr in.pfm -w "$1" -o out.pfm',
         build / "bin" / "oidnDenoise", identity[3]],
        capture_output=True, text=True, check=False,
    )
    assert done.returncode == 4 and "File too large" in done.stderr
    assert [p.name for p in work.iterdir()] == ["in.pfm"]
