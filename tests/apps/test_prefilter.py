"""oidnDenoise --prefilter: the albedo is denoised by itself first."""

from __future__ import annotations

import re

import numpy as np

from tests.apps import tools as t
from tests.apps.tools import ALL


def test_prefilter_denoises_the_albedo_first(denoise, frame, work):
    """The same bytes as two calls, whatever memory is used, however often, and in sequences."""
    rng = np.random.default_rng(3)
    for k in (1, 2):
        noisy = np.clip(frame["albedo"] + rng.normal(0, 0.3, frame["albedo"].shape), 0, 1)
        t.write_pfm(work / f"a{k}.pfm", noisy.astype(np.float32))

    def run(*options) -> np.ndarray:
        done = denoise("--hdr", "color.pfm", "--nrm", "normal.pfm", "-q", "fast", *options)
        assert done.code == 0, done.err
        return t.read_pfm(work / "out.pfm")

    plain = run("--alb", "a1.pfm", "-o", "out.pfm")
    once = run("--alb", "a1.pfm", "-o", "out.pfm", "--prefilter")
    assert denoise("--alb", "a1.pfm", "-o", "clean.pfm", "-q", "fast").code == 0
    assert np.array_equal(once, run("--alb", "clean.pfm", "-o", "out.pfm"))
    assert not np.array_equal(once, plain)
    for more in (["--inplace"], ["-n", 2], ["--buffer", "device"], ["--threads", 1]):
        assert np.array_equal(run("--alb", "a1.pfm", "-o", "out.pfm", "--prefilter", *more), once)
    run("--alb", "a#.pfm", "-o", "out#.pfm", "--frames", "1-2", "--prefilter")
    second = run("--alb", "a2.pfm", "-o", "out.pfm", "--prefilter")
    assert np.array_equal(t.read_pfm(work / "out1.pfm"), once)
    assert np.array_equal(t.read_pfm(work / "out2.pfm"), second)
    assert not np.array_equal(once, second)


def test_prefilter_says_what_it_does(denoise, frame):
    done = denoise(*ALL, "-q", "fast", "--prefilter")
    assert re.search(r"\nPrefiltering albedo\n  msec=[0-9.e+-]+\nInitializing filter\n", done.out)
    assert denoise(*ALL, "-q", "fast", "--prefilter", "--json").json["prefilter_msec"] > 0
    for files in (ALL[:2], ALL[2:4]):  # a colour without albedo; the albedo is what is denoised
        done = denoise(*files, "-q", "fast", "--prefilter")
        assert done.code == 0 and "Prefiltering albedo\n  there is none" in done.out
        assert "prefilter_msec" not in denoise(*files, "-q", "fast", "--prefilter", "--json").json
