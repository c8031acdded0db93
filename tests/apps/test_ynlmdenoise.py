"""ynlmdenoise: the classical denoiser as a program."""

from __future__ import annotations

import contextlib
import os
import subprocess

import numpy as np
import pytest

from tests.apps import tools as t
from tests.apps.conftest import runner


@pytest.fixture(scope="module")
def nlm(build):
    """Runs ynlmdenoise."""
    return runner(build / "bin" / "ynlmdenoise")


@pytest.fixture
def frame(work):
    return t.write_scene(work, 96, 128)


FILES = "-i", "color.pfm", "-o", "out.pfm", "-a", "albedo.pfm", "-n", "normal.pfm"


def error(image: np.ndarray, clean: np.ndarray) -> float:
    return float(((np.log1p(image) - np.log1p(clean)) ** 2).mean())


def test_less_noise_with_every_set_of_images(nlm, frame, work):
    noisy = error(frame["color"], frame["clean"])
    errors = []
    for files in FILES[:4], FILES[:6], FILES:
        done = nlm(*files)
        assert done.code == 0, done.err
        errors.append(error(t.read_pfm(work / "out.pfm"), frame["clean"]))
    assert errors[0] < 0.7 * noisy and errors[1] < errors[0] and errors[2] < 0.2 * noisy


def test_strength(nlm, frame, work):
    changes = []
    for k in 0.1, 0.5, 1:
        assert nlm(*FILES, "-k", k).code == 0
        changes.append(np.abs(t.read_pfm(work / "out.pfm") - frame["color"]).mean())
    assert changes == sorted(changes) and changes[0] < 0.8 * changes[2]


def test_threads_do_not_matter(nlm, frame, work):
    results = set()
    for threads in 1, 2, 5:
        assert nlm(*FILES, "--numThreads", threads).code == 0
        results.add((work / "out.pfm").read_bytes())
    assert len(results) == 1


def test_long_names_and_unused_options(nlm, frame, work):
    assert nlm(*FILES).code == 0
    expected = (work / "out.pfm").read_bytes()
    files = "--input-image", "color.pfm", "--output-image", "out.pfm", "--albedo", "albedo.pfm"
    more = "--normal", "normal.pfm", "--Ds", 3, "--ds", 3, "--sigma-s", 5, "--sigma-r", 5
    assert nlm(*files, *more, "--strength", 1).code == 0
    assert (work / "out.pfm").read_bytes() == expected


def test_layers_are_found_and_kept(nlm, frame, work, exr):
    channels = t.planes("", frame["color"]) | t.planes("albedo.", frame["albedo"])
    channels |= t.planes("N.", frame["normal"], "XYZ")
    t.write_exr(work / "in.exr", channels)
    done = nlm("-i", "in.exr", "-o", "out.exr")
    assert done.code == 0 and "albedo=in.exr" in done.out and "normal=in.exr" in done.out
    result = t.read_exr(work / "out.exr")
    assert np.array_equal(result["N.Y"], frame["normal"][..., 1].astype(np.float16))
    color = t.stack(result, "R", "G", "B")
    assert error(color, frame["clean"]) < 0.2 * error(frame["color"], frame["clean"])


def test_errors(nlm, frame, work):
    t.write_pfm(work / "small.pfm", t.noise(8, 8))
    assert nlm().code == 1 and nlm("--help").code == 1 and nlm("-i", "color.pfm").code == 1
    assert nlm(*FILES, "-k", 0).code == 1 and nlm(*FILES, "-k", "x").code == 1
    assert nlm(*FILES, "-k", 1000).code == 0 and nlm(*FILES, "-k", 1001).code == 1
    assert nlm("-i", "none.pfm", "-o", "out.pfm").code == 2
    assert nlm("-i", "color.pfm", "-o", "out.pfm", "-a", "small.pfm").code == 2
    assert nlm("-i", "color.pfm", "-o", "none/out.pfm").code == 4
    assert nlm("-i", "color.pfm", "-o", "out.jpg").code == 4


def test_image_without_a_number(nlm, work):
    t.write_pfm(work / "color.pfm", np.full((8, 8, 3), np.nan, np.float32))
    done = nlm("-i", "color.pfm", "-o", "out.pfm")
    assert done.code == 2 and "color.pfm" in done.error and "no finite value" in done.error
    assert not (work / "out.pfm").exists()


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="optional: no affinity masks")
def test_threads_are_as_many_as_processors_that_it_may_use(build, work):
    """It took all of the machine's."""
    allowed = os.sched_getaffinity(0)
    if len(allowed) < 2:
        pytest.skip("optional: one processor")
    t.write_scene(work, 320, 400)
    process = subprocess.Popen([build / "bin" / "ynlmdenoise", *FILES], cwd=work,
                               preexec_fn=lambda: os.sched_setaffinity(0, {min(allowed)}),
                               stdout=subprocess.DEVNULL)
    most, tasks = 0, f"/proc/{process.pid}/task"
    while process.poll() is None:
        with contextlib.suppress(OSError):
            most = max(most, len(os.listdir(tasks)))
    assert process.returncode == 0 and most == 1
