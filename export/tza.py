"""TZA containers: named tensors in one file, little endian, each at a multiple of 64 bytes.

    0   uint16 magic 0x41D7, uint8 major 2, uint8 minor 0, uint64 offset of the table
    64  tensors, each start padded with zeros to a multiple of 64; then the table, equally aligned
    table: uint32 count; per tensor: uint16 name length, name (UTF-8), uint8 rank,
           uint32 dims[rank], rank layout letters, 1 type letter (f h b B i), uint64 offset

Weights files of Open Image Denoise hold `<layer>.weight` (oihw) and `<layer>.bias` (x) as fp16.
Data sets hold pictures (layout hwc). Needs numpy only.
"""
from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np

MAGIC, MAJOR, MINOR, ALIGN = 0x41D7, 2, 0, 64
TYPES = {"f": np.dtype("<f4"), "h": np.dtype("<f2"), "b": np.dtype("i1"), "B": np.dtype("u1"),
         "i": np.dtype("<i4")}
LETTERS = {dtype: letter for letter, dtype in TYPES.items()}
LAYOUTS = {1: "x", 3: "hwc", 4: "oihw"}  # by rank, unless the caller says otherwise


class TzaError(ValueError):
    """A file that is not a well-formed TZA, or an array that a TZA cannot hold."""


class Writer:
    """Writes tensors one by one; close() (or leaving the `with`) writes the table."""

    def __init__(self, path: Path | str):
        self.file = open(path, "wb")
        self.file.write(struct.pack("<HBBQ", MAGIC, MAJOR, MINOR, 0))
        self.table: list[bytes] = []
        self.names: set[str] = set()

    def write(self, name: str, array: np.ndarray, layout: str | None = None) -> None:
        array = np.ascontiguousarray(array)
        dtype = array.dtype.newbyteorder("<")
        layout = layout or LAYOUTS.get(array.ndim, "")
        if dtype not in LETTERS:
            raise TzaError(f"{name}: no TZA type for {array.dtype}")
        if len(layout) != array.ndim or not layout.isascii():
            raise TzaError(f"{name}: layout '{layout}' does not fit {array.ndim} dimensions")
        if name in self.names:
            raise TzaError(f"{name}: written twice")
        self.names.add(name)
        offset = self._align()
        self.file.write(array.astype(dtype, copy=False).tobytes())
        text = name.encode()
        self.table.append(
            struct.pack("<H", len(text)) + text + struct.pack("<B", array.ndim)
            + struct.pack(f"<{array.ndim}I", *array.shape) + layout.encode()
            + LETTERS[dtype].encode() + struct.pack("<Q", offset))

    def close(self) -> None:
        if self.file.closed:
            return
        offset = self._align()
        self.file.write(struct.pack("<I", len(self.table)) + b"".join(self.table))
        self.file.seek(4)
        self.file.write(struct.pack("<Q", offset))
        self.file.close()

    def _align(self) -> int:
        at = self.file.tell()
        self.file.write(b"\0" * (-at % ALIGN))
        return at + -at % ALIGN

    def __enter__(self) -> Writer:
        return self

    def __exit__(self, *exc) -> None:
        self.close()


class Reader(Mapping):
    """Tensors of a file by name, in file order; arrays are read-only views of a memory map."""

    def __init__(self, path: Path | str):
        self.path = Path(path)
        if self.path.stat().st_size < 12:
            raise TzaError(f"{path}: too short for a TZA")
        self.map = np.memmap(path, np.uint8, "r")
        self.layouts: dict[str, str] = {}
        self.arrays: dict[str, np.ndarray] = {}
        try:
            self._parse()
        except (struct.error, UnicodeDecodeError, IndexError) as e:
            raise TzaError(f"{path}: broken table ({e})") from e

    def _parse(self) -> None:
        magic, major, _, at = struct.unpack("<HBBQ", self.map[:12].tobytes())
        if magic != MAGIC:
            raise TzaError(f"{self.path}: not a TZA")
        if major != MAJOR:
            raise TzaError(f"{self.path}: TZA version {major}, only {MAJOR} is known")
        if at > self.map.size:
            raise TzaError(f"{self.path}: the table lies outside the file (truncated?)")
        table = self.map[at:].tobytes()
        (count,), at = struct.unpack_from("<I", table), 4
        for _ in range(count):
            (length,) = struct.unpack_from("<H", table, at)
            name = table[at + 2:at + 2 + length].decode()
            at += 2 + length
            rank = table[at]
            shape = struct.unpack_from(f"<{rank}I", table, at + 1)
            at += 1 + 4 * rank
            layout, letter = table[at:at + rank].decode(), chr(table[at + rank])
            (offset,) = struct.unpack_from("<Q", table, at + rank + 1)
            at += rank + 9
            self._add(name, shape, layout, letter, offset)

    def _add(self, name: str, shape: tuple, layout: str, letter: str, offset: int) -> None:
        if letter not in TYPES:
            raise TzaError(f"{self.path}: tensor '{name}' has the unknown type '{letter}'")
        if name in self.arrays:
            raise TzaError(f"{self.path}: tensor '{name}' is there twice")
        size = TYPES[letter].itemsize
        for dim in shape:
            size *= dim
        if offset + size > self.map.size:
            raise TzaError(f"{self.path}: tensor '{name}' lies outside the file")
        data = self.map[offset:offset + size]
        self.arrays[name] = np.ndarray(shape, TYPES[letter], data)
        self.layouts[name] = layout

    def __getitem__(self, name: str) -> np.ndarray:
        return self.arrays[name]

    def __iter__(self):
        return iter(self.arrays)

    def __len__(self) -> int:
        return len(self.arrays)


def write_weights(path: Path | str, tensors: Mapping[str, np.ndarray]) -> None:
    """A weights file as Open Image Denoise reads it: fp16, `oihw` and `x`."""
    with Writer(path) as w:
        for name, array in tensors.items():
            with np.errstate(over="ignore"):
                half = np.asarray(array, np.float32).astype(np.float16)
            if not np.isfinite(half).all():
                raise TzaError(f"{name}: values that a half float cannot hold")
            w.write(name, half)
