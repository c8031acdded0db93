#!/usr/bin/env python3
"""Writes the seeds of fuzz_tza: make_tza_seeds.py [FOLDER]. Only the standard library."""

from __future__ import annotations

import struct
import sys
from math import prod
from pathlib import Path

SIZES = {"f": 4, "h": 2, "b": 1, "B": 1, "i": 4}
Tensor = tuple[str, tuple[int, ...], str, bytes]  # name, shape, type, payload

# (layer, its skip: 0 none, 1 a layer, 2 the input) of the `unet` of lib/nets.def.
UNET = [("enc_conv0", 0), ("enc_conv1", 0), ("enc_conv2", 0), ("enc_conv3", 0), ("enc_conv4", 0),
        ("enc_conv5a", 0), ("enc_conv5b", 0), ("dec_conv4a", 1), ("dec_conv4b", 0),
        ("dec_conv3a", 1), ("dec_conv3b", 0), ("dec_conv2a", 1), ("dec_conv2b", 0),
        ("dec_conv1a", 2), ("dec_conv1b", 0), ("dec_conv0", 0)]


def tza(tensors: list[Tensor], *, major: int = 2) -> bytes:
    """A file in the layout of docs/arithmetic.md."""
    body = bytearray(12)
    table = struct.pack("<I", len(tensors))
    for name, shape, dtype, payload in tensors:
        body += bytes(-len(body) % 64)
        layout = "oihw" if len(shape) == 4 else "x"
        table += struct.pack("<H", len(name)) + name.encode() + bytes([len(shape)])
        table += struct.pack(f"<{len(shape)}I", *shape) + (layout + dtype).encode()
        table += struct.pack("<Q", len(body))
        body += payload
    body += bytes(-len(body) % 64)
    struct.pack_into("<HBBQ", body, 0, 0x41D7, major, 0, len(body))
    return bytes(body) + table


def tensor(name: str, shape: tuple[int, ...], dtype: str) -> Tensor:
    n = prod(shape)
    if dtype == "h":
        payload = struct.pack(f"<{n}e", *(((i * 7) % 11 - 5) / 16 for i in range(n)))
    elif dtype == "f":
        payload = struct.pack(f"<{n}f", *(0.125 for _ in range(n)))
    else:
        payload = bytes(i % 5 for i in range(n * SIZES[dtype]))
    return name, shape, dtype, payload


def unet(inputs: int) -> list[Tensor]:
    """A U-Net of one channel; the first layer reads `inputs`, the last one writes three."""
    tensors = []
    for i, (name, skip) in enumerate(UNET):
        fan_in = inputs if i == 0 else 1 + (0, 1, inputs)[skip]
        fan_out = 3 if i == len(UNET) - 1 else 1
        tensors += [tensor(f"{name}.weight", (fan_out, fan_in, 3, 3), "h"),
                    tensor(f"{name}.bias", (fan_out,), "h")]
    return tensors


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent / "seeds/tza")
    folder.mkdir(parents=True, exist_ok=True)
    kinds = [tensor("enc_conv0.weight", (2, 3, 3, 3), "b"), tensor("enc_conv0.bias", (2,), "i"),
             tensor("enc_conv0.scale", (2,), "f"), tensor("a", (3,), "B"),
             tensor("a.bias", (1,), "h")]
    seeds = {"empty": b"", "magic": b"\xd7\x41", "no_tensors": tza([]), "kinds": tza(kinds),
             "version_3": tza(kinds, major=3), "unet_color": tza(unet(3)),
             "unet_all": tza(unet(9)), "unet_cut": tza(unet(3))[:-20],
             "unet_layer_missing": tza(unet(3)[:-2]),
             "twice": tza([kinds[0], kinds[0]])}
    for name, data in seeds.items():
        (folder / f"{name}.tza").write_bytes(data)


if __name__ == "__main__":
    main()
