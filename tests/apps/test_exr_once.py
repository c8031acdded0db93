"""Colour, albedo and normals of one EXR file: its chunks are decoded once for all of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from tests.apps import tools as t
from tests.apps.conftest import runner

pytestmark = pytest.mark.usefixtures("exr")
ROLES = ("color", "albedo", "normal")
GROUPS = ["000", "010", "001", "122", "120", "012"]  # parts that the roles are in


def write_parts(path: Path, groups: str) -> Path:
    """Noise as colour, albedo and normals in their parts, which are in the order of their names."""
    head = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    parts = []
    for group in sorted(set(groups)):
        channels = {}
        for i, (role, mine) in enumerate(zip(ROLES, groups, strict=True)):
            prefix = "" if role == "color" else f"{role}."
            if mine == group:
                channels |= t.planes(prefix, t.noise(200, 240, seed=i), dtype=np.float32)
        parts.append(OpenEXR.Part(dict(head), channels, f"part{group}"))
    OpenEXR.File(parts).write(str(path))
    return path


def bytes_read() -> int:
    """Bytes that this process and those it waited for have read; 0 where nobody counts."""
    try:
        return int(Path("/proc/self/io").read_text().split()[1])
    except OSError:
        return 0


@pytest.mark.parametrize("groups", GROUPS)
def test_one_pass(build, work, groups):
    size = write_parts(work / "in.exr", groups).stat().st_size
    before = bytes_read()
    (work / "in.exr").read_bytes()
    if bytes_read() < before + size:
        pytest.skip("optional: this system does not count what is read")
    for program, *arguments in (("oidnDenoise", "in.exr", "--check"), ("lullInfo", "in.exr"),
                                ("ynlmdenoise", "-i", "in.exr", "-o", "out.pfm")):
        before = bytes_read()
        assert runner(build / "bin" / program)("-h").code == 1
        start = bytes_read() - before  # of an emulator, too
        done = runner(build / "bin" / program)(*arguments)
        assert done.code == 0, done.err
        assert bytes_read() - before - 2 * start < 1.5 * size, program


@pytest.mark.parametrize("groups", GROUPS)
def test_same_as_one_by_one(denoise, work, groups):
    write_parts(work / "in.exr", groups)
    done = denoise("in.exr", "--json", "--threads", 3)
    apart = denoise("in.exr", "--alb", "in.exr", "--nrm", "in.exr", "--json")
    assert done.json["runs"][0]["hash"] == apart.json["runs"][0]["hash"]
    assert all(done.json[role] == apart.json[role] for role in ROLES)


@pytest.mark.parametrize("groups", GROUPS)
def test_layer_that_is_not_there(denoise, identity, work, groups):
    write_parts(work / "in.exr", groups)
    named = "in.exr", "--layer", "albedo=none.such"
    done = denoise(*named)
    assert done.code == 2 and "'in.exr': no layer 'none.such' among the channels" in done.error
    done = denoise(*named, "--no_aux", "-w", identity[3])
    assert done.code == 2 and "no layer 'none.such'" in done.error


@pytest.mark.parametrize("groups", ["012", "021", "102"])
def test_layer_that_cannot_be_read(denoise, info, work, groups):
    """The others can; whoever wants it is told why it cannot."""
    path = write_parts(work / "in.exr", groups)
    data = path.read_bytes()
    at = data.index(b"albedo.G\0") + len(b"albedo.G\0")
    path.write_bytes(data[: at + 8] + b"\2\0\0\0" + data[at + 12 :])  # xSampling
    done, told = denoise("in.exr"), info("in.exr")
    assert (done.code, told.code) == (2, 2) and done.error == told.error
    assert "'in.exr': subsampled channels are not supported" in done.error
    assert "  color (R G B): float" in told.out and "albedo" not in told.out
    done = denoise("in.exr", "--layer", "albedo=none", "--json")
    assert done.code == 0 and "normal" in done.json


@pytest.mark.parametrize("groups", ["010", "001", "122", "012"])
def test_part_that_is_truncated(denoise, info, work, groups):
    """The last one: those before it can be read."""
    path = write_parts(work / "in.exr", groups)
    path.write_bytes(path.read_bytes()[:-400])
    is_color = groups[0] == max(groups)
    done, told = denoise("in.exr"), info("in.exr")
    assert (done.code, told.code) == (2, 2) and done.error == told.error
    assert "'in.exr': truncated or corrupt: " in done.error
    assert ("color" in told.out) == (not is_color)
    if not is_color:
        assert denoise("in.exr", "--no_aux").code == 0
