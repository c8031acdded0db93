"""Golden vectors: what torch computes for small random networks, for tests that have no torch.

    python -m export.golden [--out tests/golden] [--check]

One folder per case, tests/golden/<name>/:
    weights.tza   fp16 weights, as any weights file
    shape.txt     "H W Cin Cout" of the padded network tensors; H and W are multiples of 16
    input.f32     network input, raw little endian float32, [H,W,Cin]
    output.f32    network output after the final ReLU, [H,W,Cout]
--check recomputes everything and compares instead of writing.
"""
from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from export.golden_int import command
from export.tza import Reader, write_weights
from training import nets

TOLERANCE = 1e-4  # between torch versions and machines; values are of the order of 1
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
    seed: int


CASES = (
    Case("unet_9_mixed", "unet", 32, 48, 9, (5, 7, 8, 9, 11, 13, 16, 12, 10, 9, 8, 7, 6, 5, 7), 1),
    Case("unet_3_narrow", "unet", 16, 16, 3, (1, 2, 3, 1, 2, 3, 1, 2, 3, 1, 2, 3, 1, 2, 3), 2),
    Case("unet_6_wide", "unet", 16, 32, 6, (17, 9, 8, 8, 12, 8, 8, 8, 16, 8, 8, 24, 8, 33, 17), 5),
    Case("unet_3_eights", "unet", 48, 16, 3, (8,) * 15, 7),
    Case("unet_9_tall", "unet", 64, 16, 9, (4, 6, 4, 6, 4, 6, 4, 6, 4, 6, 4, 6, 4, 6, 4), 7),
    Case("unet_large_9_mixed", "unet_large", 32, 32, 9,
         (5, 7, 8, 6, 9, 7, 8, 11, 12, 5, 9, 7, 8, 6, 7, 5, 6, 7), 10),
    Case("unet_large_3_wide", "unet_large", 16, 32, 3,
         (16, 9, 8, 8, 8, 8, 8, 8, 8, 8, 8, 8, 8, 8, 8, 16, 33, 17), 7),
    Case("unet_large_6_eights", "unet_large", 16, 16, 6, (8,) * 18, 10),
)


def random_model(case: Case) -> nets.DirectNet:
    """Weights that keep activations of the order of 1, rounded to fp16."""
    rng = np.random.default_rng(case.seed)
    model = nets.build(f"{case.net}:{','.join(map(str, case.widths))}", case.inputs, OUTPUTS)
    with torch.no_grad():
        for name, p in model.named_parameters():
            if name.endswith("bias"):
                values = rng.uniform(0.05, 0.25, p.shape)
            else:
                fan = p[0].numel()
                values = rng.normal(0.25 / fan, np.sqrt(1.5 / fan), p.shape)
            p.copy_(torch.from_numpy(values.astype(np.float16).astype(np.float32)))
    return model.eval()


def random_input(case: Case) -> np.ndarray:
    """[H,W,Cin] float32 in [0,1]: blocks of constant colour under noise."""
    rng = np.random.default_rng([case.seed, 1])
    blocks = rng.uniform(0, 0.8, (case.height // 8, case.width // 8, case.inputs))
    noise = rng.uniform(0, 0.2, (case.height, case.width, case.inputs))
    return (np.kron(blocks, np.ones((8, 8, 1))) + noise).astype(np.float32)


def run(model: nets.DirectNet, image: np.ndarray) -> np.ndarray:
    """[H,W,Cin] -> [H,W,Cout] after the final ReLU."""
    with torch.no_grad():
        y = model(torch.from_numpy(image.transpose(2, 0, 1).copy())[None]).clamp_(min=0)
    return y[0].numpy().transpose(1, 2, 0).copy()


def write_case(case: Case, folder: Path) -> None:
    model, image = random_model(case), random_input(case)
    output = run(model, image)
    alive = (output > 0).mean(axis=(0, 1))
    if alive.min() < 0.2 or output.std() < 0.02 or output.max() > 100:
        raise SystemExit(f"golden: case {case.name} says little: alive {alive}, {output.std()}")
    folder.mkdir(parents=True, exist_ok=True)
    write_weights(folder / "weights.tza", {k: v.numpy() for k, v in model.state_dict().items()})
    (folder / "shape.txt").write_text(f"{case.height} {case.width} {case.inputs} {OUTPUTS}\n")
    image.astype("<f4").tofile(folder / "input.f32")
    output.astype("<f4").tofile(folder / "output.f32")


def load_case(folder: Path) -> tuple[Reader, np.ndarray, np.ndarray]:
    """(weights, input [H,W,Cin], output [H,W,Cout]) of a case on disk."""
    h, w, cin, cout = map(int, (folder / "shape.txt").read_text().split())
    x = np.fromfile(folder / "input.f32", "<f4").reshape(h, w, cin)
    y = np.fromfile(folder / "output.f32", "<f4").reshape(h, w, cout)
    return Reader(folder / "weights.tza"), x, y


def check(out: Path) -> list[str]:
    """Differences between the files in `out` and what this torch computes from them and anew."""
    problems = []
    for case in CASES:
        folder = out / case.name
        try:
            tensors, x, y = load_case(folder)
        except (OSError, ValueError) as e:
            problems.append(f"{case.name}: {e}")
            continue
        error = float(np.abs(run(nets.from_tensors(tensors), x) - y).max())
        if error > TOLERANCE:
            problems.append(f"{case.name}: output differs by {error:.2e}")
        with tempfile.TemporaryDirectory() as tmp:
            write_case(case, Path(tmp))
            for name in ("weights.tza", "shape.txt", "input.f32"):
                if (Path(tmp) / name).read_bytes() != (folder / name).read_bytes():
                    problems.append(f"{case.name}: {name} is not what this tool writes")
    return problems


def main(argv: list[str] | None = None) -> int:
    return command(__doc__, CASES, write_case, check, argv)


if __name__ == "__main__":
    sys.exit(main())
