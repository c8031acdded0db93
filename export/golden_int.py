"""Golden vectors of integer models: what the numpy reference computes, which the core must match.

    python -m export.golden_int [--out tests/golden] [--check]

One folder per case, tests/golden/int_<name>/:
    weights.tza   an integer model of random weights
    shape.txt     "H W Cin Cout" of the padded network tensors; H and W are multiples of 16
    input.f32     network input in [0,1], raw little endian float32, [H,W,Cin]; multiples of 2^-16,
                  so that a detour over [-1,1] leaves them as they are
    output.u15    codes of the last layer, little endian uint16, [H,W,Cout]
--check recomputes everything and compares instead of writing. Needs numpy only.
"""
from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from export.bounds import Bound, own_groups, pair_groups
from export.graph import Layer, Net, read_nets
from export.quantize import integer_tensors, write_integer
from export.reference import (
    MAIN_CHANNELS,
    MIDDLE_MAX,
    NARROW_MAX,
    WIDE_MAX,
    IntLayer,
    IntModel,
    kinds,
    load_model,
)

ROOT = Path(__file__).resolve().parent.parent
OUTPUTS = 3


@dataclass(frozen=True)
class Case:
    """A network of random weights; `widths` are those of all layers but the last."""

    name: str
    net: str
    height: int
    width: int
    inputs: int
    widths: tuple[int, ...]
    shift: int             # of layers with wide and narrow inputs
    wide: tuple[str, ...] = ()  # layers with wide outputs beside the compulsory ones
    middle: tuple[str, ...] = ()  # and with 13-bit ones
    narrow_aux: bool = False  # albedo and normals are narrow
    extreme: bool = False  # only the largest weights that are allowed, and inputs of 0 and 1

    @property
    def aux(self) -> int:
        return self.inputs - MAIN_CHANNELS if self.narrow_aux else 0


CASES = (
    Case("int_unet_9_mixed", "unet", 16, 48, 9,
         (5, 7, 8, 9, 11, 13, 16, 12, 10, 9, 8, 7, 6, 5, 7), 7, wide=("dec_conv1a",)),
    Case("int_unet_3_narrow", "unet", 16, 16, 3, (1, 2, 3, 1, 2, 3, 1, 2, 3, 1, 2, 3, 1, 2, 3), 0),
    Case("int_unet_6_wide", "unet", 16, 16, 6,
         (17, 9, 8, 8, 12, 8, 8, 8, 16, 8, 8, 24, 8, 33, 17), 9),
    Case("int_unet_9_extreme", "unet", 16, 32, 9,
         (5, 9, 8, 3, 16, 5, 12, 9, 11, 8, 7, 10, 5, 9, 32), 15, extreme=True),
    Case("int_unet_3_eights", "unet", 48, 16, 3, (8, 16, 8, 8, 8) * 3, 7),
    Case("int_unet_3_widest", "unet", 32, 16, 3, (3, 4, 5) * 5, 4,
         wide=("enc_conv0", "enc_conv5a", "enc_conv5b", "dec_conv4a", "dec_conv4b", "dec_conv3a",
               "dec_conv3b", "dec_conv2a", "dec_conv2b", "dec_conv1a")),
    Case("int_unet_9_patches", "unet", 32, 48, 9,
         (16, 16, 32, 48, 7, 8, 5, 6, 8, 16, 32, 16, 16, 16, 16), 7, middle=("dec_conv1a",)),
    Case("int_unet_3_patches_extreme", "unet", 16, 32, 3,
         (16, 48, 16, 16, 5, 4, 5, 6, 5, 48, 16, 16, 32, 48, 32), 3, middle=("dec_conv1a",),
         extreme=True),
    Case("int_unet_9_aux", "unet", 16, 48, 9,
         (16, 16, 32, 48, 7, 8, 5, 6, 8, 16, 32, 16, 16, 16, 16), 6, middle=("dec_conv1a",),
         narrow_aux=True),
    Case("int_unet_6_aux_extreme", "unet", 32, 16, 6,
         (5, 9, 8, 3, 16, 5, 12, 9, 11, 8, 7, 10, 5, 17, 32), 15, narrow_aux=True, extreme=True),
    Case("int_unet_large_9_mixed", "unet_large", 32, 16, 9,
         (5, 7, 8, 6, 9, 7, 8, 11, 12, 5, 9, 7, 8, 6, 7, 5, 6, 7), 6),
    Case("int_unet_large_3_wide", "unet_large", 16, 16, 3,
         (16, 9, 8, 8, 8, 8, 8, 8, 8, 8, 8, 8, 8, 8, 8, 16, 33, 17), 1),
    Case("int_unet_large_6_narrow", "unet_large", 16, 16, 6, (3, 1, 2, 5) * 4 + (3, 1), 7),
)


def random_weights(rng: np.random.Generator, shape: tuple[int, ...], narrow: bool,
                   extreme: bool) -> np.ndarray:
    """int8 [O,C,k,k]; on narrow inputs pair-safe."""
    if extreme:
        w = rng.choice((-127, -64, 64, 127), shape)
    else:
        w = np.clip(np.rint(rng.normal(4, 40, shape)), -127, 127)
    return Bound((pair_groups if narrow else own_groups)(shape[1:])).kernels(w)


def random_layer(rng: np.random.Generator, case: Case, net: Net, layer: Layer,
                 maps: dict[str, np.ndarray], o: int) -> IntLayer:
    """A layer whose output uses its range, given the codes of its inputs."""
    top = {name: WIDE_MAX if name in net.wide or name in case.wide
           else MIDDLE_MAX if name in case.middle else NARROW_MAX
           for name in (layer.source, layer.skip, layer.name)}
    rows, k = (4 * o, 2) if layer.up else (o, 3)

    def weights(name: str, rows: int, k: int) -> np.ndarray:
        return np.concatenate([
            random_weights(rng, (rows, c.stop - c.start, k, k), most == NARROW_MAX, case.extreme)
            for c, most in kinds(name, maps[name].shape[2], top[name], case.aux)], 1)

    weight = weights(layer.source, rows, k)
    skip = weights(layer.skip, o, 3) if layer.skip else None
    out_max = top[layer.name]
    trial = IntLayer(layer, weight, skip, np.zeros(o, np.int32), np.zeros(o, np.float32),
                     0, top[layer.source], top[layer.skip], out_max, case.aux)
    if len({part.wide for part in trial.parts()}) > 1:
        trial = replace(trial, shift=case.shift)
    height = maps[layer.source].shape[0] * (2 if layer.up else 1)
    a = trial.accumulate(maps, 0, height).reshape(-1, o)
    middle = np.sort(a, 0)[len(a) // 2]
    spread = np.maximum(np.abs(a - middle).max(0), 1)
    bias = (spread * rng.uniform(0.1, 0.5, o)).astype(np.int64) - middle
    most = np.maximum((a + bias).max(0), 1) * rng.uniform(0.8, 1.1, o)  # some saturate
    scale = np.minimum(out_max / most, 0.499).astype(np.float32)
    return replace(trial, bias=bias.astype(np.int32), scale=scale)


def random_input(case: Case) -> np.ndarray:
    """[H,W,Cin] float32: blocks of constant colour under noise, a black corner and a white one."""
    rng = np.random.default_rng([len(case.name), case.height, case.inputs])
    blocks = rng.uniform(0, 0.9, (case.height // 8, case.width // 8, case.inputs))
    x = np.kron(blocks, np.ones((8, 8, 1)))
    x += rng.uniform(0, 0.1, (case.height, case.width, case.inputs))
    x[:5, :5], x[-5:, -5:] = 0, 1
    if case.extreme:
        x = np.rint(x)
    return (np.rint(x * 65536) / 65536).astype(np.float32)


def random_model(case: Case, x: np.ndarray) -> IntModel:
    rng = np.random.default_rng([case.height, case.inputs, case.shift, len(case.widths)])
    net = next(n for n in read_nets() if n.name == case.net)
    scale = rng.uniform(2e4, 4e4, case.inputs).astype(np.float32)
    scale[case.inputs - case.aux:] /= 128
    model = IntModel(net, [], scale, 2.0**-15, case.aux)
    maps = {"input": model.codes(x)}
    for layer, o in zip(net.layers, (*case.widths, OUTPUTS), strict=True):
        x = random_layer(rng, case, net, layer, maps, o)
        maps[layer.name] = x.run(maps)
        model.layers.append(x)
    return model


def write_case(case: Case, folder: Path) -> None:
    x = random_input(case)
    model = random_model(case, x)
    codes = model.output_codes(x)
    alive = ((codes > 0) & (codes < WIDE_MAX)).mean((0, 1))
    if alive.min() < 0.2 or codes.std() < 500:
        raise SystemExit(f"golden_int: case {case.name} says little: alive {alive}, {codes.std()}")
    folder.mkdir(parents=True, exist_ok=True)
    write_integer(folder / "weights.tza", integer_tensors(model))
    (folder / "shape.txt").write_text(f"{case.height} {case.width} {case.inputs} {OUTPUTS}\n")
    x.astype("<f4").tofile(folder / "input.f32")
    codes.astype("<u2").tofile(folder / "output.u15")


def check(out: Path) -> list[str]:
    """Differences between the files in `out` and what the reference makes of them and anew."""
    problems = []
    for case in CASES:
        folder = out / case.name
        try:
            model = load_model(folder / "weights.tza")
            h, w, cin, cout = map(int, (folder / "shape.txt").read_text().split())
            x = np.fromfile(folder / "input.f32", "<f4").reshape(h, w, cin)
            y = np.fromfile(folder / "output.u15", "<u2").reshape(h, w, cout)
        except (OSError, ValueError) as e:
            problems.append(f"{case.name}: {e}")
            continue
        if not np.array_equal(model.output_codes(x), y):
            problems.append(f"{case.name}: the output differs")
        with tempfile.TemporaryDirectory() as tmp:
            write_case(case, Path(tmp))
            problems += [f"{case.name}: {f.name} is not what this tool writes"
                         for f in sorted(Path(tmp).iterdir())
                         if f.read_bytes() != (folder / f.name).read_bytes()]
    return problems


def command(doc: str, cases: Sequence[Case], write: Callable[..., None],
            check: Callable[[Path], list[str]], argv: list[str] | None) -> int:
    """The command of a module of golden vectors, whose docstring is `doc`; its exit status."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "tests" / "golden")
    parser.add_argument("--check", action="store_true")
    args = parser.parse_args(argv)
    if args.check:
        problems = check(args.out)
        print("\n".join(problems) or f"{len(cases)} cases as expected",
              file=sys.stderr if problems else sys.stdout)
        return 1 if problems else 0
    for case in cases:
        write(case, args.out / case.name)
    size = sum(f.stat().st_size for case in cases for f in (args.out / case.name).iterdir())
    print(f"{len(cases)} cases, {size / 1024:.0f} KiB in {args.out}")
    return 0


def main(argv: list[str] | None = None) -> int:
    return command(__doc__, CASES, write_case, check, argv)


if __name__ == "__main__":
    sys.exit(main())
