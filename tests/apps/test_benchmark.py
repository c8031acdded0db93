"""oidnBenchmark: the list, the result lines and the options."""

from __future__ import annotations

import re

import pytest

NAMES = [
    *(f"RT.{kind}.{size}" for size in ("1920x1080", "3840x2160", "1280x720")
      for kind in ("hdr_alb_nrm", "ldr_alb_nrm", "hdr_calb_cnrm", "ldr_calb_cnrm")),
    *(f"RTLightmap.hdr.{size}" for size in ("2048x2048", "4096x4096", "1024x1024")),
]  # fmt: skip
LINE = r"{} \.\.\. ([0-9.e+-]+) msec/image \(host ([0-9.e+-]+) msec/image\)\n"


@pytest.mark.parametrize("name", ["-l", "--list"])
def test_list(benchmark, name):
    done = benchmark(name)
    assert done.code == 0 and done.out.split() == NAMES


def test_list_of_a_size(benchmark):
    assert benchmark("-l", "-s", 64, 48).out.split() == [
        "RT.hdr_alb_nrm.64x48", "RT.ldr_alb_nrm.64x48", "RT.hdr_calb_cnrm.64x48",
        "RT.ldr_calb_cnrm.64x48", "RTLightmap.hdr.64x48"]  # fmt: skip


@pytest.mark.parametrize("pattern, expected", [
    (r"RT\.hdr.*", 6), ("RTLightmap.hdr.*", 3), (".*1280x720", 4), ("RT", 0), (".*", 15),
    ("RT.(hdr|ldr)_alb_nrm.1920x1080", 2), (r".*_c?alb_.*\.[0-9]+x720", 4),
    (r"RT\.[hl]dr_c?alb_c?nrm\.\d+x720", 4), ("[^.]+.hdr.1024x1024", 1),
    ("RT.hdr_a", 0)])  # fmt: skip
def test_pattern_takes_whole_names(benchmark, pattern, expected):
    found = benchmark("--list", "--run", pattern).out.split()
    assert len(found) == expected
    assert found == [n for n in NAMES if re.fullmatch(pattern, n)]


def test_nested_repetition_is_quick(benchmark):
    assert benchmark("--list", "--run", "(.*)*720").out.split() == [n for n in NAMES if "x720" in n]


def test_result_line(benchmark, identity):
    done = benchmark("-s", 32, 24, "-r", "RT.hdr_alb_nrm.*", "-w", identity[9], "-n", 3)
    assert done.code == 0 and done.err == ""
    found = re.fullmatch(LINE.format(r"RT\.hdr_alb_nrm\.32x24"), done.out)
    assert found and float(found[1]) >= float(found[2]) >= 0


def test_runs_without_a_number(benchmark, identity):
    done = benchmark("-s", 256, 256, "-r", "RTLightmap.hdr.*", "-w", identity[3], "--json")
    assert done.code == 0
    (result,) = done.json["benchmarks"]
    assert result["name"] == "RTLightmap.hdr.256x256" and result["runs"] >= 3
    assert result["msec"] >= result["host_msec"] > 0 and done.json["device"] == "CPU"


@pytest.mark.parametrize("option", [
    "-d cpu", "--dev cpu", "--device 0", "--run RT.ldr.*", "-t half", "--type f", "-q fast",
    "--quality b", "-q auto", "--threads 1", "--affinity 0", "--maxmem 500", "--maxMemoryMB 500",
    "--inplace", "--buffer host", "--buffer hostcopy", "--buffer device", "--buffer devicecopy",
    "--buffer managed", "--buffer managedcopy", "--buffer hostcopy --inplace", "-v 0",
    "-n 1", "--ensemble 2"])  # fmt: skip
def test_option_is_accepted(benchmark, identity, option):
    done = benchmark(
        "-n", 2, "-s", 16, 16, "-r", "RT.hdr_alb.*", "-w", identity[9], *option.split()
    )
    assert done.code == 0, done.err
    assert "msec/image" in done.out


@pytest.mark.parametrize("arguments", [
    "-s 64", "-s 0 0", "-s 64 x", "-n 0", "-r [", "-r (a", "-r *", "--buffer disk", "--nonsense",
    "x", "-s 16 16 -r nothing", "-q slow", "--ensemble 3"])  # fmt: skip
def test_usage_errors(benchmark, arguments):
    done = benchmark(*arguments.split())
    assert done.code == 1 and done.error


def test_help_and_devices(benchmark):
    done = benchmark("--help")
    assert done.code == 1 and "usage:" in done.out
    for (
        option
    ) in "-r -n -s -t -q --threads --affinity --maxmem --inplace --buffer -v --ld -l -d".split():
        assert option in done.out
    assert benchmark("--ld").out.startswith("Device 0\n")


def test_errors_of_the_device(benchmark, identity):
    done = benchmark("-s", 16, 16, "-n", 1, "-w", identity[3], "-r", "RT.hdr_alb.*")
    assert done.code == 3 and len(done.err.splitlines()) == 1
    assert benchmark("-s", 16, 16, "-d", "cuda").code == 3
    assert benchmark("-s", 16, 16, "-w", "/none.tza").code == 2
