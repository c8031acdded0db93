"""The programs on an OpenCL device: the same files as on the CPU, and what they say without one."""

from __future__ import annotations

import json
import os
import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.apps.tools import identity_weights, scene, write_pfm

Run = Callable[..., subprocess.CompletedProcess]


@pytest.fixture
def run(build: Path, tmp_path: Path) -> Run:
    """Runs a program in an empty folder; keywords: environment."""
    def start(program: str, *arguments: object, **environment: str):
        environment = {"POCL_CACHE_DIR": str(build / "opencl"), **environment}
        return subprocess.run([build / "bin" / program, *map(str, arguments)], cwd=tmp_path,
                              env={**os.environ, **environment}, text=True, capture_output=True,
                              timeout=300)
    return start


@pytest.fixture
def device(run: Run) -> str:
    """Name of the device that would be used; without one the test is skipped."""
    told = run("lullInfo", "--opencl", "--json")
    if told.returncode < 0:
        pytest.skip("optional: the driver of OpenCL ends programs here")
    name = json.loads(told.stdout)["opencl"]
    if not name:
        why = run("lullInfo", "--opencl").stdout.partition("OpenCL: none (")[2].splitlines()[0]
        pytest.skip("optional: " * ("without OpenCL" in why) + why)
    return name


@pytest.fixture
def picture(tmp_path: Path) -> list[str]:
    """Options that name a picture of three images."""
    images = scene(75, 91)
    for name in ("color", "albedo", "normal"):
        write_pfm(tmp_path / f"{name}.pfm", images[name])
    return ["--hdr", "color.pfm", "--alb", "albedo.pfm", "--nrm", "normal.pfm"]


@pytest.mark.parametrize("options", ["-q fast", "-q balanced -t half", "-q high --inplace -n 3",
                                     "--buffer device --maxmem 64"])
def test_denoise_writes_the_same_file(run, device, picture, tmp_path, options):
    for name in ("cpu", "opencl"):
        done = run("oidnDenoise", *picture, "-o", f"{name}.pfm", "-d", name, *options.split())
        assert (done.returncode, done.stderr) == (0, "")
    assert "device=OpenCL, version=" in done.stdout
    assert (tmp_path / "cpu.pfm").read_bytes() == (tmp_path / "opencl.pfm").read_bytes()


def test_verbose_names_the_hardware(run, device, picture):
    done = run("oidnDenoise", *picture, "-o", "out.pfm", "-d", "opencl", "-v", 2)
    assert f"Device  : {device}\n    Type  : OpenCL\n" in done.stdout
    assert "Network: kernel5" in done.stdout
    assert int(re.search(r"Memory : .*plan (\d+),", done.stdout)[1]) > 75 * 91 * 100


def test_benchmark(run, device):
    done = run("oidnBenchmark", "-d", "opencl", "-s", 64, 48, "-n", 2, "-r", "RT.hdr_alb_nrm.*",
               "--json")
    report = json.loads(done.stdout)
    assert done.returncode == 0 and report["device"] == "OpenCL"


def test_info_names_the_device(run, device):
    assert f"\nOpenCL: {device}\n" in run("lullInfo", "--opencl").stdout
    assert "OpenCL:" not in run("lullInfo").stdout and "opencl" not in json.loads(
        run("lullInfo", "--json").stdout)


def test_without_a_library(run, picture):
    missing = {"LULL_OPENCL_LIBRARY": "/nowhere/libNone.so"}
    done = run("oidnDenoise", *picture, "-o", "out.pfm", "-d", "opencl", **missing)
    assert done.returncode == 3 and "OpenCL" in done.stderr
    assert run("oidnDenoise", *picture, "-o", "out.pfm", **missing).returncode == 0
    assert "\nOpenCL: none (" in run("lullInfo", "--opencl", **missing).stdout


def test_refuses_networks_in_floating_point(run, device, picture, tmp_path):
    weights = identity_weights(tmp_path / "identity9.tza", 9)
    done = run("oidnDenoise", *picture, "-w", weights, "-o", "out.pfm", "-d", "opencl")
    assert done.returncode == 2 and "use a CPU device" in done.stderr
