"""Small synthetic pictures and data sets, and what several executors make of pictures."""

from __future__ import annotations

import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch

from export import grain, kernel, pixels
from training import kernel_model, kernel_net
from training.imageio import read_image, write_image
from training.kernel_integer import IntegerKernel

SIZE = (48, 64)  # height, width of the pictures
TINY = "unet:" + ",".join(["4"] * 15)  # a network that trains in no time
# Options of a training of seconds.
QUICK = ["-m", TINY, "-l", "l1", "-b", "4", "--ts", "32", "--max_lr", "2e-3", "-j", "0",
         "--threads", "1", "-d", "cpu"]


def picture(seed: int, height: int = SIZE[0], width: int = SIZE[1]) -> dict[str, np.ndarray]:
    """Noise-free features of a little scene of boxes: hdr, alb, nrm, [H,W,3] float32."""
    rng = np.random.default_rng(seed)
    alb = np.full((height, width, 3), 0.5, np.float32)
    nrm = np.zeros_like(alb)
    nrm[..., 2] = 1
    light = np.ones((height, width, 1), np.float32)
    for _ in range(6):
        y, x = rng.integers(0, height - 8), rng.integers(0, width - 8)
        cut = np.s_[y:y + rng.integers(6, 30), x:x + rng.integers(6, 30)]
        alb[cut] = rng.uniform(0.05, 0.9, 3)
        n = rng.normal(size=3)
        nrm[cut] = n / np.linalg.norm(n)
        light[cut] = rng.uniform(0.2, 3)
    return {"hdr": alb * light, "alb": alb, "nrm": nrm}


def noisy(clean: dict[str, np.ndarray], spp: int, seed: int) -> dict[str, np.ndarray]:
    """The same as `spp` samples per pixel might give it: gamma distributed radiance."""
    rng = np.random.default_rng([seed, spp])
    shape = clean["hdr"].shape[:2]
    factor = rng.gamma(0.5 * spp, 1 / (0.5 * spp), (*shape, 1)).astype(np.float32)
    return {"hdr": clean["hdr"] * factor,
            "alb": np.clip(clean["alb"] + rng.normal(0, 0.02, (*shape, 3)), 0, 1),
            "nrm": clean["nrm"]}


def write_features(folder: Path, stem: str, images: dict[str, np.ndarray]) -> None:
    for feature, image in images.items():
        write_image(folder / f"{stem}.{feature}.exr", image.astype(np.float32))


def make_raw(root: Path, groups: int = 5, spp: tuple[int, ...] = (1, 4), ref: str = "ref",
             height: int = SIZE[0], width: int = SIZE[1]) -> Path:
    """A raw data set of `groups` groups with noisy versions and a reference."""
    for g in range(groups):
        clean = picture(g, height, width)
        folder = root / f"scene{g}"
        write_features(folder, f"view{g}_{ref}", clean)
        for n in spp:
            write_features(folder, f"view{g}_{n:04}spp", noisy(clean, n, g))
    return root


def core_and_infer(build: Path, raw: Path, weights: str) -> tuple[np.ndarray, np.ndarray]:
    """A picture of `valid` by weights in the C core, and what infer made of it by the result k."""
    program = build / "bin" / "oidnDenoise"
    if not program.exists():
        pytest.skip("optional: the programs are not built")
    stem = raw / "valid/scene0/view0_0004spp"
    subprocess.run([program, "-w", weights, "-o", "c.pfm", "--hdr", f"{stem}.hdr.exr", "--alb",
                    f"{stem}.alb.exr", "--nrm", f"{stem}.nrm.exr"], check=True, capture_output=True)
    return (read_image(Path("c.pfm")),
            read_image(Path("infer/valid/scene0/view0_0004spp.k.hdr.exr")))


def clear_of_steps(images: dict[str, np.ndarray]) -> None:
    """Makes pixels a little darker whose input codes, before or after features lose their grain,
    the reference's logarithm, a polynomial, rounds otherwise than ours."""
    codes = kernel.encode(*images.values(), False)
    clean = grain.without_grain(images["albedo"], images["normal"], codes)
    seen = images | dict(zip(("albedo", "normal"), clean))
    for _ in range(20):
        off = rounded_otherwise(images) | rounded_otherwise(seen | {"color": images["color"]})
        assert off.mean() < 0.02
        images["color"][off] *= 0.99
    assert not off.any()


def input_codes(*images: np.ndarray) -> np.ndarray:
    """Codes that PyTorch makes of radiance, albedo and normal, [H,W,12]."""
    tensors = [torch.from_numpy(v.transpose(2, 0, 1)[None].copy()) for v in images]
    there = torch.ones_like(tensors[0][:, :1])
    codes = kernel_net.mixed_input(*tensors, there, there, 0 * there)
    return codes[0].numpy().transpose(1, 2, 0) * 255


def rounded_otherwise(images: dict[str, np.ndarray]) -> np.ndarray:
    """Pixels whose codes differ, bool [H,W]."""
    ours = np.rint(input_codes(*images.values()))
    return (ours != kernel.encode(*images.values(), False)).any(-1)


def in_both(model: kernel.IntTrunk, height: int, width: int) -> tuple[dict, np.ndarray, np.ndarray]:
    """A picture's images, and what the numpy reference and PyTorch's integers make of it."""
    rng = np.random.default_rng(2)
    images = {"color": rng.random((height, width, 3), np.float32),
              "albedo": rng.random((height, width, 3), np.float32),
              "normal": rng.random((height, width, 3), np.float32) * 2 - 1}
    clear_of_steps(images)
    want = kernel.run_frame(model, pixels.Frame(images, "hdr", 1.0))
    codes = np.concatenate([images["color"], images["albedo"], images["normal"] / 2 + 0.5], -1)
    x = kernel_model.planes(codes, ["hdr", "alb", "nrm"])
    net = IntegerKernel(model, "linear").eval()
    with torch.no_grad():
        got = net(torch.from_numpy(x.transpose(2, 0, 1).copy())[None])
    return images, want, got[0].numpy().transpose(1, 2, 0)


def read_fields(data: bytes) -> list[tuple[int, int | bytes]]:
    """The fields of a protobuf message, not descending."""
    fields, at = [], 0

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    while at < len(data):
        key = varint()
        if key & 7 == 0:
            fields.append((key >> 3, varint()))
        elif key & 7 == 2:
            size = varint()
            fields.append((key >> 3, data[at:at + size]))
            at += size
        elif key & 7 == 5:
            fields.append((key >> 3, struct.unpack_from("<I", data, at)[0]))
            at += 4
        else:
            raise ValueError(f"wire type {key & 7}")
    return fields
