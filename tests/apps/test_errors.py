"""Bad inputs: the right exit code, one line that names the file and says why, nothing written."""

from __future__ import annotations

import errno
import os
import shutil
import struct
import subprocess
import tempfile
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from tests.apps import tools as t

H, W = 24, 33


def sample(work, kind: str):
    """A valid file of a kind."""
    image = t.noise(H, W)
    codes = (image * 255).astype(int)
    path = work / f"in.{kind.split('-')[0]}"
    makers = {
        "pfm": lambda: t.write_pfm(path, image),
        "phm": lambda: t.write_pfm(path, image, True),
        "ppm": lambda: t.write_ppm(path, codes),
        "png": lambda: t.write_png(path, codes),
        "png-interlaced": lambda: t.write_png(path, codes, interlaced=True),
        "hdr": lambda: t.write_hdr(path, t.to_rgbe(image)),
        "hdr-runs": lambda: t.write_hdr(path, t.to_rgbe(image), "runs"),
        "exr": lambda: t.write_exr(path, t.planes("", image)),
        "exr-piz": lambda: t.write_exr(
            path, t.planes("", image), compression=OpenEXR.PIZ_COMPRESSION
        ),
        "exr-none": lambda: t.write_exr(
            path, t.planes("", image), compression=OpenEXR.NO_COMPRESSION
        ),
    }
    return makers[kind]()


KINDS = [
    "pfm",
    "phm",
    "ppm",
    "png",
    "png-interlaced",
    "hdr",
    "hdr-runs",
    "exr",
    "exr-piz",
    "exr-none",
]


@pytest.fixture
def refuses(denoise, identity, work, formats):
    """Checks that denoising into an existing file fails with code and words, changing nothing."""

    def check(code: int, *arguments: object, words: tuple[str, ...] = (), inputs: int = 3) -> None:
        (work / "out.pfm").write_bytes(b"old")
        before = sorted(p.name for p in work.iterdir())
        done = denoise(*arguments, "-w", identity[inputs], "-o", "out.pfm")
        assert done.code == code, (done.code, done.err)
        assert all(word in done.error for word in words), done.error
        assert (work / "out.pfm").read_bytes() == b"old"
        assert sorted(p.name for p in work.iterdir()) == before

    return check


def skip_without(kind: str, formats) -> None:
    if kind[:3] in ("exr", "png") and kind[:3] not in formats:
        pytest.skip(f"optional: the programs were built without {kind[:3]}")


@pytest.mark.parametrize("kind", KINDS)
def test_truncated(refuses, work, formats, kind):
    skip_without(kind, formats)
    path = sample(work, kind)
    whole = path.read_bytes()
    for size in sorted({1, 2, 9, 30, len(whole) // 3, len(whole) // 2, len(whole) - 20}):
        path.write_bytes(whole[:size])
        refuses(2, "--hdr", path, words=(path.name,))


@pytest.mark.parametrize("kind", KINDS)
def test_empty_missing_directory(refuses, work, formats, kind):
    skip_without(kind, formats)
    path = sample(work, kind)
    path.write_bytes(b"")
    refuses(2, "--hdr", path, words=(path.name, "empty"))
    path.unlink()
    refuses(2, "--hdr", path, words=(path.name, "No such file"))
    path.mkdir()
    refuses(2, "--hdr", path, words=(path.name, "directory"))


@pytest.mark.parametrize(
    "content, word",
    [
        (b"\xff\xd8\xff\xe0 JFIF", "JPEG"),
        (b"version https://git-lfs.github.com/spec/v1\n", "LFS"),
        (b"hello, world", "format"),
        (bytes(100), "format"),
        (b"P3\n1 1\n255\n0 0 0\n", "format"),
    ],
)
def test_unknown_content(refuses, work, content, word):
    (work / "in.exr").write_bytes(content)
    refuses(2, "--hdr", "in.exr", words=("in.exr", word))


@pytest.mark.parametrize(
    "header",
    [
        b"PF\n0 0\n-1.0\n",
        b"PF\n0 5\n-1.0\n",
        b"PF\n5 0\n-1\n",
        b"Pf\n-1 5\n-1.0\n",
        b"PF\n4 4\n0\n",
        b"PF\n4 4\nnan\n",
        b"PF\n4.5 4\n-1\n",
        b"PF\n4 4 4 4",
        b"PF\n99999 99999\n-1.0\n",
        b"PF\n70000 1\n-1.0\n" + bytes(840000),
        b"PF\n4294967296 4294967296\n-1.0\n",
        b"PF\n1e30 1e30\n-1.0\n",
        b"Px\n2 2\n-1\n",
        b"P6\n0 0\n255\n",
        b"P6\n3 3\n0\n",
        b"P6\n3 3\n70000\n",
        b"P6\n99999999999 1\n255\n",
        b"P6\n60000 60000\n255\n",
        b"P6\n# endless comment",
        b"#?RADIANCE\n\n-Y 0 +X 0\n",
        b"#?RADIANCE\n\n-Y 60000 +X 60000\n",
        b"#?RADIANCE\n",
        b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n\0\0\0\0",
        b"#?RADIANCE\n\n+X 4 -Y 4\n" + bytes(64),
        b"#?RADIANCE\n\n-Y 1 -X 8\n" + bytes(64),
        b"#?RADIANCE\n\n-Y 1 +X 9\n\2\2\0\x08" + bytes(64),
        b"#?RADIANCE\n\n-Y 1 +X 9\n\2\2\0\x09\x8a" + bytes(64),
        b"#?RADIANCE\n\n-Y 1 +X 9\n\2\2\0\x09\0" + bytes(64),
        b"#?RADIANCE\n\n-Y 1 +X 5\n\1\1\1\1\1\1\1\xff" + bytes(64),
    ],
)
def test_hostile_headers(refuses, work, header):
    (work / "in.pfm").write_bytes(header)
    refuses(2, "--hdr", "in.pfm", words=("in.pfm",))


@pytest.mark.parametrize(
    "width, height", [(0, 0), (0, 7), (1 << 31, 1), (60000, 60000), (70000, 1)]
)
def test_hostile_png_sizes(refuses, work, png, width, height):
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = t.png_chunk(b"IHDR", head) + t.png_chunk(b"IDAT", zlib.compress(bytes(100)))
    (work / "in.png").write_bytes(b"\x89PNG\r\n\x1a\n" + body + t.png_chunk(b"IEND", b""))
    refuses(2, "--hdr", "in.png", words=("in.png",))


@pytest.mark.parametrize(
    "window",
    [
        (0, 0, 99999, 9),
        (0, 0, -1, -1),
        (5, 5, 4, 9),
        (-(1 << 31), -(1 << 31), (1 << 31) - 1, (1 << 31) - 1),
    ],
)
def test_hostile_exr_windows(refuses, work, exr, window):
    path = sample(work, "exr")
    data = path.read_bytes()
    at = data.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    path.write_bytes(data[:at] + struct.pack("<4i", *window) + data[at + 16 :])
    refuses(2, "--hdr", path, words=(path.name,))


@pytest.mark.parametrize("kind", ["lines", "tiles", "another part"])
def test_exr_compression_of_the_future(refuses, work, exr, kind):
    """What a later OpenEXR wrote is not called corrupt, nor kept as if it were ZIP."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if kind == "tiles":
        tiles = OpenEXR.TileDescription()
        tiles.xSize = tiles.ySize = 8
        header |= {"type": OpenEXR.tiledimage, "tiles": tiles}
    parts = [OpenEXR.Part(header | {"name": name}, t.planes("", np.ones((H, W, 3))), name)
             for name in ("one", "two")]
    OpenEXR.File(parts if kind == "another part" else parts[:1]).write(str(work / "in.exr"))
    start = b"compression\0compression\0\1\0\0\0"
    head, last = (work / "in.exr").read_bytes().rsplit(start, 1)
    (work / "in.exr").write_bytes(head + start + b"\x7f" + last[1:-9] + b"no deflate")
    refuses(2, "--hdr", "in.exr", words=("in.exr", "not supported by this OpenEXR"))


def test_corrupt_exr_chunk(refuses, work, exr):
    ramp = np.broadcast_to(np.linspace(0, 1, W)[None, :, None], (H, W, 3))
    path = t.write_exr(work / "in.exr", t.planes("", ramp))
    data = bytearray(path.read_bytes())
    data[-60:-30] = bytes(range(30))
    path.write_bytes(data)
    refuses(2, "--hdr", path, words=(path.name, "corrupt"))


def test_long_paths_leave_room_for_the_reason(denoise, work):
    folder = Path(*["d" * 200] * 15)
    (work / folder).mkdir(parents=True)
    assert "No such file" in denoise(folder / "in.pfm").error


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("role", ["--hdr", "--ldr", "--alb", "--nrm"])
def test_image_without_finite_values(refuses, work, value, role):
    t.write_pfm(work / "bad.pfm", np.full((H, W, 3), value, np.float32))
    refuses(2, role, "bad.pfm", words=("bad.pfm", "finite"))


def test_sizes_that_differ(refuses, work):
    t.write_pfm(work / "in.pfm", t.noise(H, W))
    t.write_pfm(work / "other.pfm", t.noise(H, W + 1))
    sizes = f"{W + 1}x{H}", f"{W}x{H}"
    refuses(
        2, "--hdr", "in.pfm", "--alb", "other.pfm", words=("other.pfm", "in.pfm", *sizes), inputs=6
    )


@pytest.mark.parametrize("role", ["--alb", "--nrm"])
def test_bad_auxiliary_files(refuses, work, role):
    t.write_pfm(work / "in.pfm", t.noise(H, W))
    refuses(2, "--hdr", "in.pfm", role, "none.pfm", words=("none.pfm",))
    (work / "bad.pfm").write_bytes(b"PF\n33 24\n-1\n")
    refuses(2, "--hdr", "in.pfm", role, "bad.pfm", words=("bad.pfm", "truncated"))


@pytest.mark.parametrize(
    "content, word",
    [(b"", "empty"), (b"\xd7\x41\x02\0", "bad.tza"), (b"hello", "bad.tza"), (None, "No such file")],
)
def test_bad_weights(denoise, work, content, word):
    t.write_pfm(work / "in.pfm", t.noise(H, W))
    if content is not None:
        (work / "bad.tza").write_bytes(content)
    done = denoise("--hdr", "in.pfm", "-w", "bad.tza", "-o", "out.pfm")
    assert done.code == 2 and "bad.tza" in done.error and word in done.error
    assert not (work / "out.pfm").exists()


def test_weights_for_other_inputs(denoise, identity, work):
    t.write_pfm(work / "in.pfm", t.noise(H, W))
    done = denoise("--hdr", "in.pfm", "-w", identity[9])
    assert done.code == 2 and "identity9.tza" in done.error
    assert "take 9 channels, the images have 3" in done.error and "no_aux" not in done.error


# ---- Outputs -------------------------------------------------------------------------------------


def test_outputs_that_cannot_be_written(denoise, identity, work):
    t.write_pfm(work / "in.pfm", t.noise(H, W))
    (work / "folder.pfm").mkdir()
    for target in ("none/out.pfm", "folder.pfm", "out.jpg", "out", "out.pfm/"):
        done = denoise("--hdr", "in.pfm", "-w", identity[3], "-o", target)
        assert done.code == 4 and target in done.error, (target, done.err)
        assert "Denoising" not in done.out and "Loading" not in done.out
    assert sorted(p.name for p in work.iterdir()) == ["folder.pfm", "in.pfm"]


def test_outputs_of_a_sequence_that_cannot_be_written(denoise, identity, work):
    for n in (1, 2):
        t.write_pfm(work / f"in{n}.pfm", t.noise(H, W))
    (work / "out2.pfm").mkdir()
    named = "--hdr", "in#.pfm", "-w", identity[3], "--frames", "1-2", "--json"
    done = denoise(*named, "-o", "out#.pfm")
    assert done.code == 4 and done.json["error"] == "cannot write 'out2.pfm': Is a directory"
    assert [list(f) for f in done.json["frames"]][1] == ["frame"]
    done = denoise(*named, "-o", "none/out#.pfm")
    assert done.code == 4 and "none/out#.pfm" in done.json["error"] and "frames" not in done.json


@pytest.mark.skipif(os.geteuid() == 0 and not shutil.which("setpriv"),
                    reason="optional: root may write everything, and setpriv is missing")
@pytest.mark.parametrize("target", ["old.pfm", "closed/new.pfm", "closed/old.pfm"])
def test_protected_files_stay(build, identity, target):
    """And folders that nothing may be made in, not even in place of a file that may be written."""
    drop = ["setpriv", "--reuid=65534", "--clear-groups"] if os.geteuid() == 0 else []
    with tempfile.TemporaryDirectory() as folder:  # that others may enter, as pytest's they may not
        os.chmod(folder, 0o777)
        t.write_pfm(Path(folder, "in.pfm"), t.noise(H, W))
        shutil.copy(identity[3], Path(folder, "w.tza"))
        shutil.copy(build / "bin" / "oidnDenoise", folder)
        Path(folder, "closed").mkdir()
        for old, mode in (("old.pfm", 0o444), ("closed/old.pfm", 0o666)):
            Path(folder, old).write_text("old")
            Path(folder, old).chmod(mode)
        Path(folder, "closed").chmod(0o555)
        done = subprocess.run([*drop, "./oidnDenoise", "--hdr", "in.pfm", "-w", "w.tza", "-o",
                               target], cwd=folder, capture_output=True, text=True, check=False)
        left = Path(folder, target).read_text() if "old" in target else "old"
        Path(folder, "closed").chmod(0o755)
        assert done.returncode == 4 and left == "old" and "Denoising" not in done.stdout
        assert done.stderr == f"Error: cannot write '{target}': Permission denied\n"


@pytest.mark.skipif(
    os.name != "posix" or not os.path.exists("/dev/full"), reason="optional: no /dev/full"
)
@pytest.mark.parametrize("extension", ["pfm", "exr", "png", "hdr", "ppm"])
def test_full_disk(denoise, identity, work, formats, extension):
    skip_without(extension, formats)
    t.write_pfm(work / "in.pfm", t.noise(256, 256))
    (work / f"full.{extension}").symlink_to("/dev/full")
    done = denoise("--hdr", "in.pfm", "-w", identity[3], "-o", f"full.{extension}")
    assert done.code == 4 and f"full.{extension}" in done.error
    assert os.strerror(errno.ENOSPC) in done.error


def test_output_replaces_what_a_link_points_to(denoise, identity, work):
    t.write_pfm(work / "in.pfm", t.noise(H, W))
    (work / "real.pfm").write_bytes(b"old")
    (work / "real.pfm").chmod(0o640)
    (work / "link.pfm").symlink_to("real.pfm")
    assert denoise("--hdr", "in.pfm", "-w", identity[3], "-o", "link.pfm").code == 0
    assert (work / "link.pfm").is_symlink() and t.read_pfm(work / "real.pfm").shape == (H, W, 3)
    assert (work / "real.pfm").stat().st_mode & 0o777 == 0o640


@pytest.mark.skipif(os.name != "posix", reason="optional: POSIX only")
def test_output_through_a_link_to_a_pipe(denoise, identity, frame, work):
    (work / "out.pfm").symlink_to("/dev/stdout")
    done = denoise("--hdr", "color.pfm", "-w", identity[3], "-o", "out.pfm")
    assert done.code == 0, done.err
    assert "Saving output\nPF\n64 48\n" in done.out
    assert (work / "out.pfm").is_symlink()


def test_device_error(denoise, identity, work):
    t.write_pfm(work / "in.pfm", t.noise(H, W))
    done = denoise("--hdr", "in.pfm", "-w", identity[3], "-d", "cuda")
    assert done.code == 3 and done.error
