"""Image files: EXR (OpenEXR package), PFM, PHM, Radiance HDR, PNG. [H,W,C], top row first.

Float formats come back as float32 as stored; 8 and 16 bit formats as float32 in [0,1], as encoded.
Writers go to a temporary name and rename, so that no half-written file is ever seen.
"""
from __future__ import annotations

import os
import struct
import sys
import zlib
from contextlib import contextmanager, suppress
from pathlib import Path
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from training.errors import DATA, DEPENDENCY, OUTPUT, USAGE, ToolError
from training.exr_channels import Channels, Origin, Window, names_of
from training.layers import find_own
from training.png import read_png, write_png

LINEAR_FORMATS = ("exr", "pfm", "phm", "hdr")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary name beside `path` that becomes `path` when the block ends well."""
    path = Path(path)
    tmp = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield tmp
        os.replace(tmp, path)
    except OSError as e:
        raise ToolError(f"{path}: cannot write ({e.strerror or e})", OUTPUT) from e
    finally:
        with suppress(OSError):
            tmp.unlink(missing_ok=True)


@contextmanager
def silent() -> Iterator[None]:
    """Nothing that C code prints to stderr gets out (OpenEXR reports its errors there as well)."""
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        with open(os.devnull, "w") as null:
            os.dup2(null.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _openexr():
    try:
        import OpenEXR
    except ImportError as e:
        raise ToolError("EXR files need the package OpenEXR", DEPENDENCY) from e
    return OpenEXR


def read_exr_channels(path: Path) -> Channels:
    """All channels of a file by name, [H,W] float32, deep ones left out."""
    exr = _openexr()
    try:
        path.open("rb").close()
    except OSError as e:
        raise ToolError(f"{path}: cannot read ({e.strerror})", DATA) from e
    try:
        with silent(), exr.File(str(path), separate_channels=True) as f:
            channels = Channels()
            for part in f.parts:
                if part.type() not in (exr.scanlineimage, exr.tiledimage):
                    continue
                if any((c.xSampling, c.ySampling) != (1, 1) for c in part.channels.values()):
                    raise ToolError(f"{path}: subsampled channels are not supported", DATA)
                origin = window_of(part.header, "dataWindow")[:2]
                channels.display = channels.display or window_of(part.header, "displayWindow")
                for name, full, plain in names_of(f.parts, part):
                    pixels = np.asarray(part.channels[name].pixels, np.float32)
                    channels.add(full, plain, pixels, origin)
    except ToolError:
        raise
    except Exception as e:  # the package raises plain RuntimeError and ValueError
        raise ToolError(f"{path}: cannot read ({str(e).splitlines()[0] if str(e) else e!r})",
                        DATA) from e
    if not channels:
        raise ToolError(f"{path}: cannot read (truncated, or no channels)", DATA)
    return channels


def window_of(header: dict, name: str) -> Window:
    """The data window or the display window of a header."""
    return tuple(int(v) for corner in header[name] for v in corner)


def read_display(path: Path) -> Window:
    """The display window of an EXR that can be read."""
    exr = _openexr()
    with silent(), exr.File(str(path), header_only=True) as f:
        return window_of(f.parts[0].header, "displayWindow")


def read_exr(path: Path) -> np.ndarray:
    """The picture of an EXR, as of read_placed."""
    return read_placed(path)[0]


def read_placed(path: Path, feature: str = "hdr") -> tuple[np.ndarray, Origin]:
    """The picture of an EXR and where its data window begins: the layer of its feature, else that
    of colour (plain R,G,B or X,Y,Z before named ones), else Z, else its only channels,
    [H,W,C<=3]."""
    channels = read_exr_channels(path)
    for names in (find_own(feature, channels), find_own("hdr", channels), ("Z",)):
        if names and all(n in channels for n in names):
            return stack(path, channels, names), channels.origins[names[0]]
    layers = {n.rpartition(".")[0] for n in channels}
    if len(layers) > 1:
        raise ToolError(f"{path}: several layers and no colour among them "
                        f"({', '.join(channels)})", DATA)
    tails = {n.rpartition(".")[2].upper(): n for n in channels}
    names = next(([tails[t] for t in tail] for tail in ("RGB", "XYZ") if set(tail) <= set(tails)),
                 list(channels)[:3])
    return stack(path, channels, names), channels.origins[names[0]]


def stack(path: Path, channels: Channels, names: Sequence[str]) -> np.ndarray:
    """[H,W,C] of the channels of these names."""
    if len({(channels[n].shape, channels.origins[n]) for n in names}) > 1:
        raise ToolError(f"{path}: {', '.join(names)} differ in their data windows", DATA)
    return np.stack([channels[n] for n in names], -1)


def _tokens(f, count: int) -> list[bytes]:
    """The next `count` whitespace separated words of a netpbm-like header."""
    words: list[bytes] = []
    while len(words) < count:
        line = f.readline(256)
        if not line:
            raise ValueError("truncated header")
        words += line.split(b"#")[0].split()
    return words


def read_pfm(path: Path) -> np.ndarray:
    """PFM (float) and PHM (half): PF/PH 3 channels, Pf/Ph 1, P=/P: 2; bottom row first."""
    with open(path, "rb") as f:
        magic, width, height, scale = _tokens(f, 4)
        kinds = {b"PF": (3, "f4"), b"Pf": (1, "f4"), b"P=": (2, "f4"),
                 b"PH": (3, "f2"), b"Ph": (1, "f2"), b"P:": (2, "f2")}
        if magic not in kinds:
            raise ValueError("not a PFM or PHM")
        channels, kind = kinds[magic]
        w, h, s = int(width), int(height), float(scale)
        dtype = np.dtype(("<" if s < 0 else ">") + kind)
        data = f.read(w * h * channels * dtype.itemsize)
        image = np.frombuffer(data, dtype).reshape(h, w, channels)
    return np.ascontiguousarray(image[::-1], np.float32) * np.float32(abs(s))


def read_hdr(path: Path) -> np.ndarray:
    """Radiance RGBE, run-length coded or flat; top row first (-Y h +X w)."""
    with open(path, "rb") as f:
        data = f.read()
    head, _, rest = data.partition(b"\n\n")
    size, _, body = rest.partition(b"\n")
    words = size.split()
    if not head.startswith(b"#?") or len(words) != 4 or words[0] != b"-Y" or words[2] != b"+X":
        raise ValueError("not a Radiance picture with rows from the top")
    h, w = int(words[1]), int(words[3])
    raw = np.frombuffer(body, np.uint8)
    if not (8 <= w < 32768 and raw[:2].tolist() == [2, 2] and raw[2] < 128):  # no blue pixel
        rgbe = raw[:h * w * 4].reshape(h, w, 4)
    else:
        rgbe, at = np.empty((h, 4, w), np.uint8), 0
        for row in rgbe:
            if raw[at:at + 4].tolist() != [2, 2, w >> 8, w & 255]:
                raise ValueError("broken scan line")
            at += 4
            for line in row:
                at = _unpack_line(raw, at, line)
        rgbe = rgbe.transpose(0, 2, 1)
    exponent = np.ldexp(np.float32(1), rgbe[..., 3:].astype(np.int32) - 136)
    return np.where(rgbe[..., 3:] > 0, rgbe[..., :3] * exponent, 0.0).astype(np.float32)


def _unpack_line(raw: np.ndarray, at: int, line: np.ndarray) -> int:
    """Decode one run-length coded component of a scan line; returns the position after it."""
    x = 0
    while x < len(line):
        count = int(raw[at])
        if count > 128:
            line[x:x + count - 128] = raw[at + 1]
            x, at = x + count - 128, at + 2
        else:
            line[x:x + count] = raw[at + 1:at + 1 + count]
            x, at = x + count, at + 1 + count
        if count == 0 or x > len(line):
            raise ValueError("broken scan line")
    return at


def write_exr(path: Path, image: np.ndarray, names: tuple[str, ...] | None = None,
              origin: Origin = (0, 0), display: Window | None = None) -> None:
    """float32 EXR, PIZ; channels R,G,B or Y. origin, display: where the data window begins, and
    the display window, else the data window."""
    exr = _openexr()
    image = np.asarray(image, np.float32)
    if names is None:
        names = {1: ("Y",), 2: ("R", "G"), 3: ("R", "G", "B")}.get(image.shape[-1], ())
    channels = {n: np.ascontiguousarray(image[..., i]) for i, n in enumerate(names)}
    header = {"compression": exr.PIZ_COMPRESSION, "type": exr.scanlineimage}
    (h, w), (x, y) = image.shape[:2], origin
    data = x, y, x + w - 1, y + h - 1
    for name, window in ("dataWindow", data), ("displayWindow", display or data):
        header[name] = np.array(window[:2], np.int32), np.array(window[2:], np.int32)
    try:
        with exr.File(header, channels) as f:
            f.write(str(path))
    except RuntimeError as e:  # what OpenEXR makes of a full disk
        raise OSError(str(e).splitlines()[0]) from e


def write_pfm(path: Path, image: np.ndarray) -> None:
    """PFM or, by extension, PHM; little endian, bottom row first."""
    half = path.suffix.lower() == ".phm"
    magic = {3: "PH", 1: "Ph", 2: "P:"} if half else {3: "PF", 1: "Pf", 2: "P="}
    h, w, c = image.shape
    with np.errstate(over="ignore"):  # infinite as half floats
        values = image[::-1].astype("<f2" if half else "<f4")
    with open(path, "wb") as f:
        f.write(f"{magic[c]}\n{w} {h}\n-1.0\n".encode())
        f.write(values.tobytes())


def write_hdr(path: Path, image: np.ndarray) -> None:
    """Radiance RGBE, flat."""
    image = np.maximum(_rgb(image), 0.0)
    peak = image.max(-1)
    exponent = np.where(peak > 1e-32, np.frexp(peak)[1], 0)
    mantissa = image * np.ldexp(np.float32(256), -exponent)[..., None]
    rgbe = np.concatenate([np.clip(np.rint(mantissa), 0, 255), exponent[..., None] + 128], -1)
    rgbe[peak <= 1e-32] = 0
    with open(path, "wb") as f:
        f.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n")
        f.write(f"-Y {image.shape[0]} +X {image.shape[1]}\n".encode())
        f.write(rgbe.astype(np.uint8).tobytes())


def _rgb(image: np.ndarray) -> np.ndarray:
    image = np.asarray(image, np.float32)
    return np.repeat(image, 3, -1) if image.shape[-1] == 1 else image[..., :3]


READERS = {"exr": read_exr, "pfm": read_pfm, "phm": read_pfm, "hdr": read_hdr, "png": read_png}
WRITERS = {"exr": write_exr, "pfm": write_pfm, "phm": write_pfm, "hdr": write_hdr,
           "png": write_png}


def read_image(path: Path) -> np.ndarray:
    """Any supported image by its extension, [H,W,C] float32."""
    path = Path(path)
    kind = path.suffix[1:].lower()
    if kind not in READERS:
        raise ToolError(f"{path}: unknown format (known: {' '.join(READERS)})", DATA)
    try:
        return READERS[kind](path)
    except ToolError:
        raise
    except OSError as e:
        raise ToolError(f"{path}: cannot read ({e.strerror or e})", DATA) from e
    except (ValueError, IndexError, struct.error, zlib.error) as e:
        raise ToolError(f"{path}: cannot read ({e or 'truncated'})", DATA) from e


def write_image(path: Path, image: np.ndarray, **place: Any) -> None:
    """Write by extension; png takes values in [0,1] as encoded, the others floats. place: origin
    and display of write_exr; other formats have no place for them."""
    path = Path(path)
    kind = path.suffix[1:].lower()
    if kind not in WRITERS:
        raise ToolError(f"{path}: unknown format (known: {' '.join(WRITERS)})", USAGE)
    with replacing(path) as tmp:
        WRITERS[kind](tmp, image, **(place if kind == "exr" else {}))
