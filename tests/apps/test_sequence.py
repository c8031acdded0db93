"""oidnDenoise: numbered files, progress and interruption."""

from __future__ import annotations

import os
import re
import signal
import subprocess

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
    )
    assert done.code == 0, done.err
    assert [f["frame"] for f in done.json["frames"]] == [3, 4, 5, 9]
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
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as run:
        for line in run.stdout:
            if "hash=" in line:
                break
        run.send_signal(signal.SIGINT)
        _, err = run.communicate(timeout=600)
    assert run.returncode == 130 and err == "Error: interrupted\n"
    assert (work / "out.pfm").read_text() == "old"
    assert sorted(p.name for p in work.iterdir()) == ["in.pfm", "out.pfm"]
