"""Small images, weights and files for the tests of the programs. Images: float arrays [H, W, C]."""

from __future__ import annotations

import re
import struct
import zlib
from pathlib import Path

import numpy as np
import OpenEXR


def equal(result: np.ndarray, expected: np.ndarray) -> bool:
    """Whether images are the same but for the rounding of the identity network, which is computed
    in Winograd's form; halves may round to the neighbour."""
    error = 2e-6 + (5e-4 if result.dtype == np.float16 else 0)
    result, expected = result.astype(np.float64), expected.astype(np.float64)
    error = error * np.maximum(np.abs(expected), 1)
    return result.shape == expected.shape and bool((np.abs(result - expected) <= error).all())


def noise(height: int, width: int, channels: int = 3, seed: int = 1) -> np.ndarray:
    """Uniform values in [0, 1)."""
    return np.random.default_rng(seed).random((height, width, channels)).astype(np.float32)


# The images of write_scene, for oidnDenoise.
ALL = ("--hdr", "color.pfm", "--alb", "albedo.pfm", "--nrm", "normal.pfm")


def scene(height: int = 96, width: int = 128, seed: int = 1) -> dict[str, np.ndarray]:
    """Noisy colour, albedo and normal of a picture with edges; clean colour."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:height, 0:width]
    albedo = np.full((height, width, 3), 0.5, np.float32)
    normal = np.zeros((height, width, 3), np.float32)
    normal[..., 2] = 1
    for _ in range(14):
        cy, cx, r = rng.uniform(0, height), rng.uniform(0, width), rng.uniform(5, 18)
        inside = (y - cy) ** 2 + (x - cx) ** 2 < r * r
        albedo[inside] = rng.uniform(0.05, 0.95, 3)
        tilt = rng.uniform(-1, 1, 3)
        normal[inside] = tilt / np.linalg.norm(tilt)
    light = 0.3 + 1.5 * (normal @ np.array([0.3, 0.5, 0.8], np.float32)).clip(0)[..., None]
    clean = (albedo * light).astype(np.float32)
    color = clean * rng.gamma(4.0, 0.25, (height, width, 1)).astype(np.float32)
    return {"color": color, "albedo": albedo, "normal": normal, "clean": clean}


# ---- Weights -------------------------------------------------------------------------------------


def write_scene(folder: Path, height: int, width: int) -> dict[str, np.ndarray]:
    """The images of `scene` as color.pfm, albedo.pfm, normal.pfm, clean.pfm; returns them."""
    images = scene(height, width)
    for name, image in images.items():
        write_pfm(folder / f"{name}.pfm", image)
    return images



def write_tza(path: Path, tensors: list[tuple[str, np.ndarray]]) -> Path:
    """TZA version 2 with fp16 tensors."""
    blob = bytearray(struct.pack("<HBBQ", 0x41D7, 2, 0, 0))
    entries = []
    for name, values in tensors:
        blob += bytes(-len(blob) % 64)
        entries.append((name, values.shape, "x" if values.ndim == 1 else "oihw", len(blob)))
        blob += values.astype("<f2").tobytes()
    blob += bytes(-len(blob) % 64)
    struct.pack_into("<Q", blob, 4, len(blob))
    blob += struct.pack("<I", len(entries))
    for name, shape, layout, offset in entries:
        blob += struct.pack("<H", len(name)) + name.encode() + struct.pack("<B", len(shape))
        blob += struct.pack(f"<{len(shape)}I", *shape) + layout.encode() + b"h"
        blob += struct.pack("<Q", offset)
    path.write_bytes(blob)
    return path


def identity_weights(path: Path, inputs: int, width: int = 4) -> Path:
    """A U-Net whose result is its first three inputs: only centre taps of the last three layers."""
    w = width
    layers = [("enc_conv0", inputs, w), *((f"enc_conv{n}", w, w) for n in "1 2 3 4 5a 5b".split())]
    for level in "432":
        layers += [(f"dec_conv{level}a", 2 * w, w), (f"dec_conv{level}b", w, w)]
    layers += [("dec_conv1a", w + inputs, w), ("dec_conv1b", w, w), ("dec_conv0", w, 3)]
    tensors = []
    for name, ic, oc in layers:
        weight = np.zeros((oc, ic, 3, 3), np.float32)
        if name in ("dec_conv1a", "dec_conv1b", "dec_conv0"):
            for c in range(3):
                weight[c, c + (w if name == "dec_conv1a" else 0), 1, 1] = 1
        tensors += [(f"{name}.weight", weight), (f"{name}.bias", np.zeros(oc, np.float32))]
    return write_tza(path, tensors)


# ---- PFM, PPM, HDR -------------------------------------------------------------------------------


def write_pfm(path: Path, image: np.ndarray, half: bool = False, scale: float = -1.0) -> Path:
    """PFM, or PHM if half. A positive scale makes it big endian."""
    height, width, channels = image.shape
    mark = ("h:H" if half else "f=F")[channels - 1]
    dtype = ("<" if scale < 0 else ">") + ("f2" if half else "f4")
    pixels = (image[::-1] / abs(scale)).astype(dtype).tobytes()
    path.write_bytes(f"P{mark}\n{width} {height}\n{scale}\n".encode() + pixels)
    return path


def read_pfm(path: Path) -> np.ndarray:
    data = path.read_bytes()
    mark, size, scale, pixels = data.split(b"\n", 3)
    width, height = map(int, size.split())
    channels = {b"F": 3, b"f": 1, b"=": 2, b"H": 3, b"h": 1, b":": 2}[mark[1:2]]
    assert float(scale) == -1
    dtype = "<f4" if mark[1:2] in b"Ff=" else "<f2"
    return np.frombuffer(pixels, dtype).reshape(height, width, channels)[::-1]


def write_ppm(path: Path, codes: np.ndarray, maximum: int = 255, comment: bool = False) -> Path:
    """codes: integers [H, W, 1 or 3]."""
    height, width, channels = codes.shape
    head = f"P{6 if channels == 3 else 5}\n{'# a comment' if comment else ''}\n{width} {height}\n"
    pixels = codes.astype(np.uint8 if maximum < 256 else ">u2").tobytes()
    path.write_bytes((head + f"{maximum}\n").encode() + pixels)
    return path


def read_ppm(path: Path) -> np.ndarray:
    mark, size, maximum, pixels = path.read_bytes().split(b"\n", 3)
    width, height = map(int, size.split())
    assert maximum == b"255"
    return np.frombuffer(pixels, np.uint8).reshape(height, width, 3 if mark == b"P6" else 1)


def to_rgbe(image: np.ndarray) -> np.ndarray:
    """[H, W, 3] floats to [H, W, 4] bytes."""
    exponent = np.frexp(np.maximum(image.max(-1), 1e-30))[1]
    mantissa = np.floor(np.ldexp(image, 8 - exponent[..., None]))
    return np.concatenate([mantissa, exponent[..., None] + 128], -1).astype(np.uint8)


def from_rgbe(rgbe: np.ndarray) -> np.ndarray:
    return np.ldexp(rgbe[..., :3].astype(np.float32), rgbe[..., 3:].astype(int) - 136)


def write_hdr(path: Path, rgbe: np.ndarray, coding: str = "flat", up: bool = False) -> Path:
    """coding: flat, runs (each component in runs) or repeats (the old (1,1,1,n) pixels)."""
    height, width, _ = rgbe.shape
    out = bytearray(b"#?RADIANCE\n# made by a test\nFORMAT=32-bit_rle_rgbe\n\n")
    out += f"{'+' if up else '-'}Y {height} +X {width}\n".encode()
    for row in rgbe[::-1] if up else rgbe:
        if coding == "flat":
            out += row.tobytes()
        elif coding == "runs":
            out += bytes([2, 2, width >> 8, width & 255])
            for c in range(4):
                out += runs_of(row[:, c])
        else:
            out += row[0].tobytes()
            x = 1
            while x < width:
                n = 0
                while x + n < width and n < 255 and (row[x + n] == row[x - 1]).all():
                    n += 1
                out += bytes([1, 1, 1, n]) if n else row[x].tobytes()
                x += max(n, 1)
    path.write_bytes(out)
    return path


def runs_of(values: np.ndarray) -> bytes:
    out, x = bytearray(), 0
    while x < len(values):
        n = 1
        while x + n < len(values) and n < 127 and values[x + n] == values[x]:
            n += 1
        out += bytes([128 + n, values[x]]) if n > 2 else bytes([n]) + values[x : x + n].tobytes()
        x += n
    return bytes(out)


def read_hdr(path: Path) -> np.ndarray:
    """RGBE codes of a file in the newer coding, or flat."""
    data = path.read_bytes()
    head, rest = data.split(b"\n\n", 1)
    assert head.startswith(b"#?RADIANCE") and b"FORMAT=32-bit_rle_rgbe" in head
    size, pixels = rest.split(b"\n", 1)
    _, height, _, width = size.split()
    height, width = int(height), int(width)
    out, at = np.zeros((height, width, 4), np.uint8), 0
    for y in range(height):
        if not 8 <= width <= 32767:
            out[y] = np.frombuffer(pixels[at : at + 4 * width], np.uint8).reshape(width, 4)
            at += 4 * width
            continue
        assert pixels[at : at + 4] == bytes([2, 2, width >> 8, width & 255])
        at += 4
        for c in range(4):
            x = 0
            while x < width:
                n = pixels[at]
                if n > 128:
                    out[y, x : x + n - 128, c] = pixels[at + 1]
                    x, at = x + n - 128, at + 2
                else:
                    out[y, x : x + n, c] = list(pixels[at + 1 : at + 1 + n])
                    x, at = x + n, at + 1 + n
    assert at == len(pixels)
    return out


# ---- PNG -----------------------------------------------------------------------------------------

PNG_COLOR = {1: 0, 2: 4, 3: 2, 4: 6}  # channels -> colour type
ADAM7 = [
    (0, 0, 8, 8),
    (4, 0, 8, 8),
    (0, 4, 4, 8),
    (2, 0, 4, 4),
    (0, 2, 2, 4),
    (1, 0, 2, 2),
    (0, 1, 1, 2),
]  # x, y, step x, step y


def png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png_rows(codes: np.ndarray, bits: int) -> bytes:
    return b"".join(
        b"\0" + row.astype(">u2" if bits == 16 else np.uint8).tobytes() for row in codes
    )


def write_png(
    path: Path,
    codes: np.ndarray,
    bits: int = 8,
    interlaced: bool = False,
    palette: np.ndarray | None = None,
) -> Path:
    """codes: integers [H, W, 1..4]; palette: [n, 3], then codes are [H, W, 1] indices."""
    height, width, channels = codes.shape
    color = 3 if palette is not None else PNG_COLOR[channels]
    head = struct.pack(">IIBBBBB", width, height, bits, color, 0, 0, interlaced)
    passes = [codes[y::sy, x::sx] for x, y, sx, sy in ADAM7] if interlaced else [codes]
    pixels = b"".join(png_rows(p, bits) for p in passes if p.size)
    out = b"\x89PNG\r\n\x1a\n" + png_chunk(b"IHDR", head)
    if palette is not None:
        out += png_chunk(b"PLTE", palette.astype(np.uint8).tobytes())
    path.write_bytes(out + png_chunk(b"IDAT", zlib.compress(pixels)) + png_chunk(b"IEND", b""))
    return path


def read_png(path: Path) -> tuple[np.ndarray, int]:
    """Integer codes [H, W, C] and the bit depth; any filter, no interlacing."""
    data, at, pixels = path.read_bytes(), 8, b""
    while at < len(data):
        (size,), kind = struct.unpack(">I", data[at : at + 4]), data[at + 4 : at + 8]
        body = data[at + 8 : at + 8 + size]
        assert struct.unpack(">I", data[at + 8 + size : at + 12 + size])[0] == zlib.crc32(
            kind + body
        )
        if kind == b"IHDR":
            width, height, bits, color, _, _, interlaced = struct.unpack(">IIBBBBB", body)
        pixels += body if kind == b"IDAT" else b""
        at += 12 + size
    channels = {v: k for k, v in PNG_COLOR.items()}[color]
    assert not interlaced and bits in (8, 16)
    step = channels * bits // 8
    raw = np.frombuffer(zlib.decompress(pixels), np.uint8).reshape(height, 1 + width * step)
    out = np.zeros((height, width * step), np.int64)
    for y in range(height):
        unfilter(out, y, raw[y, 0], raw[y, 1:], step)
    codes = out.reshape(height, width, channels, bits // 8)
    return (codes[..., 0] << 8 | codes[..., 1] if bits == 16 else codes[..., 0]), bits


def unfilter(out: np.ndarray, y: int, kind: int, row: np.ndarray, step: int) -> None:
    for x in range(len(row)):
        a = out[y, x - step] if x >= step else 0
        b = out[y - 1, x] if y else 0
        c = out[y - 1, x - step] if y and x >= step else 0
        paeth = min((abs(b - c), 0, a), (abs(a - c), 1, b), (abs(a + b - 2 * c), 2, c))[2]
        out[y, x] = (row[x] + (0, a, b, (a + b) // 2, paeth)[kind]) & 255


# ---- EXR -----------------------------------------------------------------------------------------


def planes(prefix: str, image: np.ndarray, names: str = "RGB", dtype=np.float16) -> dict:
    """EXR channels of an image: prefix "albedo." and names "RGB" give albedo.R, ..."""
    return {
        f"{prefix}{n}": np.ascontiguousarray(image[..., i].astype(dtype))
        for i, n in enumerate(names)
    }


def write_exr(path: Path, channels: dict, **header) -> Path:
    attributes = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File({**attributes, **header}, channels).write(str(path))
    return path


def read_exr(path: Path, part: int = 0) -> dict[str, np.ndarray]:
    channels = OpenEXR.File(str(path), separate_channels=True).parts[part].channels
    return {name: c.pixels for name, c in channels.items()}


def read_parts(path: Path) -> dict[str, np.ndarray]:
    """The channels of all parts."""
    found = {}
    for part in OpenEXR.File(str(path), separate_channels=True).parts:
        found |= {name: c.pixels for name, c in part.channels.items()}
    return found


def stack(channels: dict, *names: str) -> np.ndarray:
    return np.stack([channels[n].astype(np.float32) for n in names], -1)


def fnv1a(data: bytes) -> str:
    value = 0x811C9DC5
    for byte in data:
        value = (value ^ byte) * 0x1000193 & 0xFFFFFFFF
    return f"{value:08x}"


def srgb_encode(x: np.ndarray) -> np.ndarray:
    x = x.astype(np.float64)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0) ** (1 / 2.4) - 0.055)


def srgb_decode(x: np.ndarray) -> np.ndarray:
    x = x.astype(np.float64)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def built_in(root: Path) -> list[str]:
    """File names of the built-in weights, as weights/builtin.def lists them."""
    rows = (root / "weights" / "builtin.def").read_text()
    return re.findall(r'^BUILTIN\(\w+, "([^"]+)"', rows, re.MULTILINE)
