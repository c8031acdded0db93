"""oidnDenoise: what it refuses, how it says so, and names that only look like patterns."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from tests.apps import tools as t
from tests.apps.tools import ALL


@pytest.mark.parametrize(
    "arguments",
    [
        "--nonsense",
        "--hdr",
        "--hdr a.pfm -n 0",
        "--hdr a.pfm -n x",
        "--hdr a.pfm -q best",
        "--hdr a.pfm -t double",
        "--hdr a.pfm -d tpu",
        "--hdr a.pfm --threads -1",
        "-o x.pfm",
        "--hdr a.pfm --is inf",
        "--hdr a.pfm -f XX",
        "--hdr a.pfm -f rt",
        "--hdr a.pfm --is 1x",
        "--hdr a.pfm --buffer disk",
        "a.pfm b.pfm",
        "-",
        "--hdr a.pfm --srgb",
        "--alb a.pfm --nrm b.pfm",
        "--hdr a.pfm --affinity 2",
        "--srgb=1",
        "--hdr a.pfm --layer normals=N",
        "--hdr a.pfm --layer albedo",
        "--hdr a.pfm -o",
        "--hdr a.####.pfm --frames 1-3 -o b.pfm",
        "--hdr a.pfm -v 9",
    ],
)
def test_usage_errors(denoise, work, arguments):
    t.write_pfm(work / "a.pfm", t.noise(8, 8))
    done = denoise(*arguments.split())
    assert done.code == 1 and done.error
    assert done.out == ""


@pytest.mark.parametrize("value", ["1,5", "half", "inf"])
def test_values_that_are_no_numbers(denoise, value):
    """As people write them whose decimal sign is a comma."""
    done = denoise("a.pfm", "--is", value)
    assert done.code == 1 and value in done.error and "a number" in done.error


def test_too_many_outputs(denoise, work):
    t.write_pfm(work / "a.pfm", t.noise(8, 8))
    done = denoise("a.pfm", *[word for n in range(9) for word in ("-o", f"{n}.pfm")])
    assert done.code == 1 and "at most 8" in done.error


@pytest.mark.parametrize("arguments", ["--foo", "--hdr a.pfm -q best", "-f XX --hdr a.pfm"])
def test_json_of_a_usage_error(denoise, work, arguments):
    t.write_pfm(work / "a.pfm", t.noise(8, 8))
    for done in denoise(*arguments.split(), "--json"), denoise("--json", *arguments.split()):
        assert done.code == 1 and done.json == {"exit_code": 1, "error": done.error[7:]}


def test_names_are_patterns_of_sequences_alone(denoise, identity, work):
    """Without --frames a file is called what it is called."""
    image = t.noise(20, 24)
    for name in "shot#1.pfm", "x%d.pfm", "a 100%done.pfm":
        t.write_pfm(work / name, image)
        done = denoise("--hdr", name, "-w", identity[3], "-o", f"out {name}")
        assert done.code == 0, done.err
        assert (work / f"out {name}").exists()
    assert len(list(work.glob("out*"))) == 3


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_json_that_cannot_be_written(build, identity, frame, work):
    command = [build / "bin" / "oidnDenoise", *ALL, "-w", identity[9], "--json"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, cwd=work, text=True)
    assert done.returncode == 4 and "standard output" in done.stderr


@pytest.mark.parametrize("arguments", ["none.pfm", "color.pfm -v 2"])
def test_json_without_a_stderr(build, identity, frame, work, arguments):
    """What has nowhere to go does not go into the object."""
    done = subprocess.run(
        ["sh", "-c", f'exec "$0" --json -w "$1" {arguments} 2>&-', build / "bin" / "oidnDenoise",
         identity[3]], capture_output=True, text=True, check=False)
    assert json.loads(done.stdout)["exit_code"] == done.returncode


def test_messages_of_the_library_stay_out_of_json(denoise, benchmark, frame, monkeypatch):
    done = denoise("--hdr", "color.pfm", "-v", 2, "--json")
    assert done.code == 0 and done.json["exit_code"] == 0 and "Threads :" in done.err
    monkeypatch.setenv("OIDN_VERBOSE", "1")
    done = benchmark("-r", "RTLightmap.*", "-s", 32, 32, "-n", 1, "--json")
    assert done.code == 0 and done.json["exit_code"] == 0 and "Threads :" in done.err
    assert "Threads :" in denoise("--hdr", "color.pfm").out


@pytest.mark.parametrize("script", ["cat in.pfm | $0 --hdr /dev/stdin $@",
                                    "mkfifo fifo.pfm; cat in.pfm >fifo.pfm & $0 --hdr fifo.pfm $@"])
def test_images_from_pipes(build, identity, work, script):
    """As Open Image Denoise's program reads them; not OpenEXR, whose layers are read again."""
    image = t.noise(40, 50)
    t.write_pfm(work / "in.pfm", image)
    command = ["sh", "-c", script, build / "bin" / "oidnDenoise", "-w", identity[3], "-o", "o.pfm"]
    done = subprocess.run(command, cwd=work, capture_output=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert t.equal(t.read_pfm(work / "o.pfm"), image)
    told = subprocess.run(["sh", "-c", "cat in.pfm | $0 /dev/stdin", build / "bin" / "lullInfo"],
                          cwd=work, capture_output=True, text=True, timeout=60, check=False)
    assert "50x40" in told.stdout, told.stderr
    (work / "fifo.pfm").unlink(missing_ok=True)
    (work / "in.pfm").write_bytes(b"\x76\x2f\x31\x01" + bytes(100))
    done = subprocess.run(command, cwd=work, capture_output=True, timeout=60, check=False)
    assert done.returncode == 2 and (b"pipes" in done.stderr or b"not supported" in done.stderr)
