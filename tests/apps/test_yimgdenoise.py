"""yimgdenoise: other options, the same denoiser. Runs with the built-in weights."""

from __future__ import annotations

import pytest

from tests.apps.conftest import runner


@pytest.fixture(scope="module")
def yimgdenoise(build):
    """Runs yimgdenoise."""
    return runner(build / "bin" / "yimgdenoise")


@pytest.mark.parametrize(
    "options",
    [
        ("--input-image", "--output-image", "--albedo", "--normal"),
        ("-i", "-o", "-a", "-n"),
    ],
)
def test_same_result_as_oidndenoise(yimgdenoise, denoise, frame, work, options):
    i, o, a, n = options
    files = i, "color.pfm", o, "y.pfm", a, "albedo.pfm", n, "normal.pfm"
    done = yimgdenoise(*files, "--numThreads", 1, "--maxMemoryMB", 500, "--setAffinity", "false")
    assert done.code == 0, done.err
    files = "--hdr", "color.pfm", "--alb", "albedo.pfm", "--nrm", "normal.pfm", "-o", "o.pfm"
    assert denoise(*files).code == 0
    assert (work / "y.pfm").read_bytes() == (work / "o.pfm").read_bytes()


def test_errors(yimgdenoise, frame):
    assert yimgdenoise().code == 1 and yimgdenoise("--help").code == 1
    assert yimgdenoise("-i", "color.pfm").code == 1
    assert yimgdenoise("-i", "none.pfm", "-o", "y.pfm").code == 2
    assert yimgdenoise("-i", "color.pfm", "-o", "y.jpg").code == 4
    assert yimgdenoise("-i", "color.pfm", "-o", "none/y.pfm").code == 4
