"""EXR files by several threads: the bytes and the messages of one."""

from __future__ import annotations

import errno
import os
import resource
import subprocess

import numpy as np
import OpenEXR
import pytest

from tests.apps import tools as t

pytestmark = pytest.mark.usefixtures("exr")

H, W = 1100, 24  # so that DWAB has more than one chunk for each of two threads
COMPRESSIONS = ["NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB"]
LOSSLESS = COMPRESSIONS[:5]


def channels(dtype, height: int = H) -> dict:
    rng = np.random.default_rng(3)
    image = rng.integers(0, 64, (height, W, 7)) / 64
    return {**t.planes("", image[..., :3], dtype=dtype), "A": image[..., 6].astype(dtype),
            **t.planes("albedo.", image[..., 3:6], dtype=dtype)}


def outputs(denoise, identity, source, threads: int) -> list[bytes]:
    done = denoise(source, "-w", identity[3], "--no_aux", "--strength", 0, "--threads", threads,
                   "-o", "out.exr", "-o", "out.pfm")
    if "not supported by this OpenEXR" in done.err:
        pytest.skip("optional: " + done.err)
    assert done.code == 0, done.err
    with open("out.exr", "rb") as exr, open("out.pfm", "rb") as pfm:
        return [exr.read(), pfm.read()]


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize("tile", [0, 16])
@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_same_bytes(denoise, identity, work, compression, tile, dtype):
    header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION")}
    if tile:
        header |= {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
        header["tiles"].xSize = header["tiles"].ySize = tile
    t.write_exr(work / "in.exr", channels(dtype), **header)
    one = outputs(denoise, identity, "in.exr", 1)
    for threads in (2, 7):
        assert outputs(denoise, identity, "in.exr", threads) == one
    if compression in LOSSLESS:
        before, after = t.read_exr(work / "in.exr"), t.read_exr(work / "out.exr")
        assert all(np.array_equal(before[name], after[name]) for name in before)


@pytest.mark.parametrize("half", [False, True])
def test_same_bytes_of_files_of_their_own(denoise, identity, work, half):
    t.write_pfm(work / "in.pfm", t.noise(200, 40), half)
    one = outputs(denoise, identity, "in.pfm", 1)
    for threads in (0, 2, 7):
        assert outputs(denoise, identity, "in.pfm", threads) == one


def test_same_bytes_of_parts(denoise, identity, work):
    plain = channels(np.float16)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    parts = [OpenEXR.Part(dict(header), {c: plain[prefix + c] for c in "RGB"}, name)
             for prefix, name in (("albedo.", "albedo"), ("", "beauty"), ("albedo.", "spare"))]
    OpenEXR.File(parts).write(str(work / "in.exr"))
    one = outputs(denoise, identity, "in.exr", 1)
    for threads in (2, 7):
        assert outputs(denoise, identity, "in.exr", threads) == one


@pytest.mark.parametrize("compression", ["ZIP", "ZIPS", "PIZ", "NO"])
def test_the_first_damage_counts(denoise, identity, work, compression):
    """Chunks are damaged from the middle on, each in another way, and the last ones are missing."""
    path = t.write_exr(work / "in.exr", channels(np.float16),
                       compression=getattr(OpenEXR, f"{compression}_COMPRESSION"))
    (work / "out.exr").write_bytes(b"old")
    data = bytearray(path.read_bytes())
    for percent in (90, 80, 70, 60, 50, 40):
        at = len(data) * percent // 100
        if percent == 90:
            del data[at:]
        else:
            data[at : at + 60] = bytes(range(percent, percent + 60))
        path.write_bytes(data)
        runs = [denoise("in.exr", "-w", identity[3], "--no_aux", "--threads", threads, "-o",
                        "out.exr") for threads in (1, 2, 7, 7)]
        assert runs[0].code == 2 and "in.exr" in runs[0].error
        assert {(run.code, run.err) for run in runs} == {(2, runs[0].err)}
        assert sorted(p.name for p in work.iterdir()) == ["in.exr", "out.exr"]
    assert (work / "out.exr").read_bytes() == b"old"


@pytest.mark.skipif(os.name != "posix", reason="optional: no limits on files")
@pytest.mark.parametrize("source", ["in.exr", "in.pfm"])
@pytest.mark.parametrize("threads", [1, 7])
def test_files_that_grow_too_large(build, identity, work, source, threads):
    """The reason is the system's, whichever thread it told."""
    t.write_exr(work / "in.exr", channels(np.float32), compression=OpenEXR.NO_COMPRESSION)
    t.write_pfm(work / "in.pfm", t.noise(600, 200))
    limit = 200_000
    done = subprocess.run(
        [build / "bin" / "oidnDenoise", source, "-w", identity[3], "--no_aux", "--threads",
         str(threads), "-o", "out.exr"],
        capture_output=True, text=True, timeout=600,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
    assert done.returncode == 4, done.stderr
    assert os.strerror(errno.EFBIG) in done.stderr
    assert sorted(p.name for p in work.iterdir()) == ["in.exr", "in.pfm"]
