"""bench.options: what options of oidnDenoise bring, on EXR files as they are."""

import numpy as np
import pytest

from bench import oidn, options
from tests.apps import tools as t
from training import errors


def write(folder, spp: int, seed: int) -> None:
    found = t.scene(48, 64, seed)
    rng = np.random.default_rng(seed + spp)
    light = np.linspace(0.2, 1, 64, dtype=np.float32)[None, :, None]
    noisy = found["albedo"] * light * rng.gamma(spp, 1 / spp, (48, 64, 1)).astype(np.float32)
    name = folder / f"s{seed}_{spp:04d}spp.exr"
    t.write_exr(name, t.planes("", noisy) | t.planes("albedo.", found["albedo"])
                | t.planes("N.", found["normal"], "XYZ"))


@pytest.fixture
def pictures(work):
    folder = work / "pictures"
    folder.mkdir()
    for seed in (1, 2):
        for spp in (1, 4, 4096):
            write(folder, spp, seed)
    return folder


def test_table(pictures, capsys):
    """A row for each count and set of options; without the filter nothing is gained."""
    sets = ["--strength 0", "-q fast --no_aux"]
    assert options.main([str(pictures), *(f"--with={s}" for s in sets)]) == 0
    rows = [line.split(" | ") for line in capsys.readouterr().out.splitlines() if "|" in line][2:]
    assert [(r[0].strip("| "), r[1], r[2]) for r in rows] == [
        (spp, "2", name) for spp in ("1", "4") for name in ("-", *sets)]
    for k in range(0, 6, 3):
        plain, weak, alone = rows[k:k + 3]
        assert float(weak[3]) < min(float(plain[3]), float(alone[3])) and plain[3] != alone[3]
        assert plain[6] == "+0.00" and float(weak[6]) == pytest.approx(
            float(weak[3]) - float(plain[3]), abs=0.011)
        assert float(weak[7].strip("| ")) <= float(weak[6])


def test_what_cannot_be_measured(pictures, work):
    (work / "empty").mkdir()
    with pytest.raises(errors.ToolError, match="empty: no pictures with a reference"):
        options.main([str(work / "empty")])
    with pytest.raises(oidn.PeerError, match="has no passes of light"):
        options.main([str(pictures), "--with=--split"])
