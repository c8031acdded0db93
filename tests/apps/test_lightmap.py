"""oidnDenoise with the filter RTLightmap, and normals beside the light."""

from __future__ import annotations

import numpy as np

from tests.apps import tools as t


def test_normals_of_a_light_map(denoise, work, frame):
    """What texels without a normal hold does not matter, and is filled."""
    charts = frame["normal"].copy()
    charts[:, 20:28] = 0
    t.write_pfm(work / "charts.pfm", charts)
    results = []
    for value in (0, 9):
        light = frame["color"].copy()
        light[:, 20:28] = value
        t.write_pfm(work / "light.pfm", light)
        for options in ((), ("--nrm", "charts.pfm")):
            done = denoise("--hdr", "light.pfm", "-f", "RTLightmap", *options, "-o", "out.pfm")
            assert done.code == 0, done.err
            results.append(t.read_pfm(work / "out.pfm"))
    assert np.array_equal(results[1], results[3]) and not np.array_equal(results[0], results[2])
    assert results[1][:, 20:28].min() > 0 and not np.array_equal(results[0], results[1])
