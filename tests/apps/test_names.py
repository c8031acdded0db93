"""Files whose extension is none of the table's: what they hold counts."""

from __future__ import annotations

import numpy as np
import pytest

from tests.apps import tools as t
from tests.apps.conftest import runner

H, W = 20, 27


@pytest.mark.parametrize("name", ["beauty.pfm.1", "noisy"])
def test_names_that_say_nothing(denoise, info, identity, work, png, name):
    """What a file holds counts, as it does for /dev/stdin."""
    image, codes = t.noise(H, W), np.arange(H * W * 3).reshape(H, W, 3) % 256
    t.write_pfm(work / name, image)
    t.write_png(work / "codes", codes)
    weights = ("-w", identity[3], "-o", "out.pfm")
    for arguments, expected in (
        (("--hdr", name), image),
        (("--ldr", name), image),
        (("--ldr", "codes"), t.srgb_decode(codes / 255)),
        (("--nrm", "codes"), codes / 255 * 2 - 1),
        (("--nrm", name), image),
    ):
        done = denoise(*arguments, *weights)
        assert done.code == 0, done.err
        assert np.abs(t.read_pfm(work / "out.pfm") - expected).max() < 1e-5, arguments
    done = info("--compare", name, "out.pfm", "--json")
    assert done.json["files"][0]["avgerror"] < 1e-5, done.out


@pytest.mark.parametrize("program", ["oidnDenoise", "yimgdenoise"])
@pytest.mark.parametrize("name", ["beauty.pfm.1", "noisy"])
def test_light_above_one_in_names_that_say_nothing(build, denoise, identity, work, name, program):
    """It is not clipped as that of an LDR image is, unless that is asked for."""
    image = 20 * t.scene(H, W)["color"]
    t.write_pfm(work / name, image)
    t.write_pfm(work / "in.pfm", image)
    run = runner(build / "bin" / program)
    results = []
    for source in (name, "in.pfm"):
        done = run(*(("-i",) if program == "yimgdenoise" else ()), source, "-o", "out.pfm")
        assert done.code == 0, done.err
        results.append(t.read_pfm(work / "out.pfm"))
    assert (results[0] == results[1]).all() and results[0].max() > 5
    found = denoise(name, "--check", "--json").json["check"]
    assert found == denoise("in.pfm", "--check", "--json").json["check"]
    for asked in (("--ldr", name), (name, "--srgb")):
        assert denoise(*asked, "-w", identity[3], "-o", "out.pfm").code == 0
        assert t.read_pfm(work / "out.pfm").max() < 1.001
