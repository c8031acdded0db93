"""Golden vectors of family K: a small random model, a picture, and the numpy reference of it.

    python -m export.golden_kernel [tests/golden/kernel]

The folder gets weights.tza, {color,albedo,normal}.f32 ([H,W,3], little endian) and, for each set
of features and content, out_<features>_<content>.f32 (_clean: albedo and normals have no noise);
alone.tza is the same model for an albedo or normals alone, of out_alone_<features>_<content>.f32.
tests/core/test_kernel.c compares the C core with them to the bit.
"""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from export import kernel, pixels
from export.bounds import Bound, pair_groups, word_groups
from export.quantize_kernel import tensors_of
from export.reference import NARROW_MAX, IntLayer
from export.tza import Writer
from training import errors

WIDTHS = (5, 4, 6, 4, 8, 7, 8, 8, 9, 8, 8, 6, 6, 4)  # those that heads read are even
WORDS = ("0a", "1b", "2a", "4b", "dec2", "dec0", "head1")  # layers whose sums fit words
HEIGHT, WIDTH = 37, 45
CASES = ((7, "hdr"), (7, "hdr_clean"), (7, "ldr"), (7, "srgb"), (1, "hdr"), (3, "hdr"),
         (5, "lightmap-hdr"), (1, "lightmap-dir"), (2, "ldr"), (4, "ldr"))
ALONE_CASES = ((2, "ldr"), (2, "srgb"), (4, "ldr"))
FEATURE_BITS = {"color": 1, "albedo": 2, "normal": 4}


def weights(rng: np.random.Generator, groups: Callable, shape: tuple[int, ...]) -> np.ndarray:
    return Bound(groups(shape[1:])).kernels(rng.integers(-60, 70, shape))


def random_layers(rng: np.random.Generator, trunk: kernel.Trunk,
                  widths: tuple[int, ...]) -> list[IntLayer]:
    channels, layers = {"input": trunk.inputs}, []
    for layer, o in zip(trunk.layers, widths, strict=True):
        c, head = channels[layer.source], layer.name in trunk.heads
        shape = (4 * o, c, 2, 2) if layer.up else (o, c, 1, 1) if head else (o, c, 3, 3)
        groups = word_groups if layer.name.endswith(WORDS) else pair_groups
        weight, skip = weights(rng, groups, shape), None
        if layer.skip:
            skip = weights(rng, groups, (o, channels[layer.skip], 3, 3))
        taps = shape[1] * shape[2] * shape[3] + (skip.shape[1] * 9 if layer.skip else 0)
        scale = np.full(o, 1 / (40 * np.sqrt(taps)), np.float32)
        bias = rng.integers(0, int(128 / scale[0]), o).astype(np.int32)
        layers.append(IntLayer(layer, kernel.widened(weight) if head else weight, skip, bias, scale,
                               0, NARROW_MAX, NARROW_MAX, NARROW_MAX))
        channels[layer.name] = o
    return layers


def random_model(seed: int) -> kernel.IntTrunk:
    """A K model with random weights whose codes neither vanish nor all saturate."""
    rng = np.random.default_rng(seed)
    trunk = kernel.read_trunks()[0]
    layers = random_layers(rng, trunk, WIDTHS + (52, 27, 27, 27, 27))
    return kernel.IntTrunk(trunk, layers, bilateral=kernel.ALL_STEPS)


def pictures(seed: int) -> dict[str, np.ndarray]:
    """Noisy images with some values that are no colours."""
    rng = np.random.default_rng(seed)
    color = np.exp(rng.normal(-1, 1.5, (HEIGHT, WIDTH, 3))).astype(np.float32)
    quiet = np.array([0.7, 0.5, 0.6]) * np.exp(0.02 * rng.normal(size=(20, WIDTH, 3)))
    color[18:27], color[28:33, 20:33] = quiet[:9], quiet[9:14, 20:33]  # calm: input is mixed in
    color[3, 4], color[20, 9], color[11, 30] = np.nan, -np.inf, -1
    color[30, 40] = 1e7
    albedo = rng.random((HEIGHT, WIDTH, 3), np.float32) * np.float32(1.1)
    albedo[24:31, 15:28] = albedo[31:35, 15:] = 0.3, 0.5, 0.4  # and here it has no grain
    albedo[20:27] = 0.3, 0.5, 0.4  # all across: some of the input with clean features, too
    albedo[:5, 40:43], albedo[7, 3:5], albedo[8, 3:7, 1:] = 0, (-1, np.nan, 1e-39), 0
    albedo[10:16, 33:] = color[10:16, 32:] = 0  # nothing is here, but for one lamp
    color[2:4, 40:43], color[12, 37], color[14, 41] = (0, -1, 1e-39), 0.5, np.nan
    return {"color": color,
            "albedo": albedo,
            "normal": (rng.random((HEIGHT, WIDTH, 3), np.float32) * 2 - 1).astype(np.float32)}


def main(argv: list[str]) -> None:
    parser = errors.Parser("python -m export.golden_kernel", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("tests/golden/kernel"))
    write(parser.parse_args(argv).folder)


def write(folder: Path) -> None:
    """Model, picture and results into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    images = pictures(2)
    for name, image in images.items():
        image.astype("<f4").tofile(folder / f"{name}.f32")
    for name, steps, prefix, cases in (("weights", kernel.ALL_STEPS, "out", CASES),
                                       ("alone", kernel.ALONE, "out_alone", ALONE_CASES)):
        made = random_model(1)
        made.bilateral = steps
        with Writer(folder / f"{name}.tza") as w:
            for tensor, array in tensors_of(made).items():
                w.write(tensor, np.ascontiguousarray(array))
        model = kernel.load(folder / f"{name}.tza")
        for features, content in cases:
            chosen = {f: i for f, i in images.items() if features & FEATURE_BITS[f]}
            content, clean, _ = content.partition("_clean")
            out = kernel.run_frame(model, pixels.Frame(chosen, content, clean_aux=bool(clean)))
            content += clean
            out.astype("<f4").tofile(folder / f"{prefix}_{features}_{content}.f32")


if __name__ == "__main__":
    errors.run(main)
