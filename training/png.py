"""PNG without a library: 8 and 16 bit grey, RGB, palette, with or without alpha, not interlaced."""
from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

SIGNATURE = b"\x89PNG\r\n\x1a\n"
CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # by colour type


def read_png(path: Path) -> np.ndarray:
    """[H,W,1 or 3] float32 in [0,1] as encoded (usually sRGB); alpha is dropped."""
    data = Path(path).read_bytes()
    if not data.startswith(SIGNATURE):
        raise ValueError("not a PNG")
    header, palette, packed, at = None, None, b"", 8
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        body = data[at + 8:at + 8 + length]
        at += 12 + length
        if kind == b"IHDR":
            header = struct.unpack(">IIBBBBB", body)
        elif kind == b"PLTE":
            palette = np.frombuffer(body, np.uint8).reshape(-1, 3)
        elif kind == b"IDAT":
            packed += body
        elif kind == b"IEND":
            break
    if header is None:
        raise ValueError("truncated")
    width, height, depth, color, _, _, interlace = header
    if depth not in (8, 16) or color not in CHANNELS or interlace:
        raise ValueError(f"kind of PNG not supported ({depth} bit, colour type {color}, "
                         f"interlace {interlace})")
    size = CHANNELS[color] * depth // 8
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + width * size)
    flat = _unfilter(rows, size)
    image = flat.view(">u2") if depth == 16 else flat
    image = image.reshape(height, width, CHANNELS[color])
    if color == 3:
        if palette is None:
            raise ValueError("no palette")
        image = palette[image[..., 0]]
    elif color in (4, 6):
        image = image[..., :-1]
    return image.astype(np.float32) / (65535 if depth == 16 else 255)


def _unfilter(rows: np.ndarray, size: int) -> np.ndarray:
    """Undo the scan line filters: [H, 1 + bytes] -> [H, bytes]."""
    out = np.zeros((rows.shape[0] + 1, rows.shape[1] - 1), np.uint8)
    for y, row in enumerate(rows):
        kind, line, up = int(row[0]), row[1:], out[y]
        if kind == 0:
            out[y + 1] = line
        elif kind == 1:  # left neighbour: a running sum per byte of the pixel
            out[y + 1] = np.cumsum(line.reshape(-1, size), 0, np.uint8).reshape(-1)
        elif kind == 2:
            out[y + 1] = line + up
        elif kind in (3, 4):
            out[y + 1] = _unfilter_slow(kind, line, up, size)
        else:
            raise ValueError("broken filter")
    return out[1:].copy()


def _unfilter_slow(kind: int, line: np.ndarray, up: np.ndarray, size: int) -> np.ndarray:
    """Average (3) and Paeth (4) filters, byte by byte."""
    above, result = up.tobytes(), bytearray(line.tobytes())
    for i in range(len(result)):
        a = result[i - size] if i >= size else 0
        b = above[i]
        if kind == 3:
            guess = (a + b) >> 1
        else:
            c = above[i - size] if i >= size else 0
            pa, pb, pc = abs(b - c), abs(a - c), abs(a + b - 2 * c)
            guess = a if pa <= pb and pa <= pc else b if pb <= pc else c
        result[i] = (result[i] + guess) & 255
    return np.frombuffer(result, np.uint8)


def write_png(path: Path, image: np.ndarray) -> None:
    """8 bit PNG of [H,W,1 or 3] values in [0,1]."""
    codes = (np.clip(np.nan_to_num(image), 0.0, 1.0) * 255 + 0.5).astype(np.uint8)
    h, w, c = codes.shape
    rows = np.concatenate([np.zeros((h, 1), np.uint8), codes.reshape(h, w * c)], 1)
    with open(path, "wb") as f:
        f.write(SIGNATURE)
        for kind, body in (
                (b"IHDR", struct.pack(">IIBBBBB", w, h, 8, 0 if c == 1 else 2, 0, 0, 0)),
                (b"IDAT", zlib.compress(rows.tobytes(), 3)), (b"IEND", b"")):
            f.write(struct.pack(">I", len(body)) + kind + body
                    + struct.pack(">I", zlib.crc32(kind + body)))
