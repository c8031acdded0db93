"""Training throughput of a family K model: our step against eager PyTorch's of the same model.

    python -m bench.training [--model k16] [--rounds 5] [--threads 1] [--data DIR]

A step is forward, loss, backward, clipping and Adam on a batch of tiles. Variants take turns of two
steps, of which the second one counts (as in a training, the caches have seen its like), so that a
busy machine hurts all of them; medians of the rounds. The eager ones are plain PyTorch in fp32,
the filter by unfold, as published code has it, or by a loop over its taps. Then the cost of
making batches beside that of a step, and a whole training loop with and without loader processes.
"""
from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from export import synthetic
from training import fused, kernel_filter, parallel
from training.data import from_raw
from training.imageio import write_image
from training.loss import make_loss
from training.result import make_model
from training.scan import scan
from training.settings import Settings, parse
from training.train import make_batches

SCENES, SIDE = 8, 192  # of the synthetic data set


def unfolded(logits: Tensor, v: Tensor) -> Tensor:
    """The filter as a product with the columns of unfold."""
    n, c, h, w = v.shape
    columns = F.unfold(v, 5, padding=2).view(n, c, 25, h * w)
    return (columns * logits.exp().view(n, 1, 25, h * w)).sum(2).view(n, c, h, w)


@contextmanager
def eager(plain: Callable | None):
    """PyTorch's operations instead of the fused ones; plain: the sums over the taps."""
    kept = fused.module, kernel_filter.kernel_filter
    if plain:
        fused.module, kernel_filter.kernel_filter = lambda: None, plain
    try:
        yield
    finally:
        fused.module, kernel_filter.kernel_filter = kept


class Stepper:
    """One way to train; `run` does a step."""

    def __init__(self, settings: Settings, plain: Callable | None, precision: str):
        torch.manual_seed(1)
        self.plain, self.settings = plain, settings
        self.format = torch.contiguous_format if plain else torch.channels_last
        self.model = make_model(settings).to(memory_format=self.format)
        self.optimizer = (torch.optim.Adam if plain else parallel.adam)(
            self.model.parameters(), settings.max_learning_rate)
        self.loss_of = make_loss(settings.loss)
        self.mixed = parallel.Mixed(settings.replace(precision=precision),
                                    parallel.Team(0, 1, torch.device("cpu")))

    def run(self, x: Tensor, y: Tensor) -> float:
        with eager(self.plain):
            with self.mixed.autocast():
                loss = self.loss_of(self.model(x), y)
            self.optimizer.zero_grad(set_to_none=True)
            loss.backward()
            self.mixed.step(self.optimizer, self.settings.grad_clip)
        return loss.item()


def write_scenes(folder: Path) -> None:
    """A small data set of synthetic pictures in the layout of training."""
    for seed in range(SCENES):
        for spp in (1, 4, 64):
            images = synthetic.noisy(SIDE, seed, spp)
            for feature, name in (("hdr", "color"), ("alb", "albedo"), ("nrm", "normal")):
                write_image(folder / f"s{seed}_{spp:04}spp.{feature}.exr", images[name])


def seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def loop(stepper: Stepper, batches, loaders: int, first: int, steps: int) -> float:
    """Seconds per step of a loop that loads its batches; the loaders' start does not count."""
    settings = stepper.settings.replace(num_loaders=loaders)
    start = 0.0
    for k, (x, y) in enumerate(parallel.loader(batches, range(first, first + steps + 2), settings)):
        if k == 2:
            start = time.perf_counter()
        stepper.run(x, y)
    return (time.perf_counter() - start) / steps


def report(variants: dict[str, Stepper], batches, rounds: int) -> list[str]:
    """Markdown: a line per variant, then what data costs."""
    times: dict[str, list[float]] = {name: [] for name in variants}
    for k in range(rounds + 1):
        x, y = batches[k]
        for name, stepper in variants.items():
            stepper.run(x, y)
            spent = seconds(lambda s=stepper, x=x, y=y: s.run(x, y))
            if k:  # the first round compiles and warms up
                times[name].append(spent)
    ours = list(variants)[0]
    settings = variants[ours].settings
    pixels = settings.batch_size * settings.tile_size**2
    lines = [f"{settings.model}, {settings.batch_size} tiles of {settings.tile_size}x"
             f"{settings.tile_size}, {torch.get_num_threads()} thread(s)", "",
             "| whole step | ms | Mpx/s | lull is |", "|---|---:|---:|---:|"]
    median = {name: statistics.median(t) for name, t in times.items()}
    for name, spent in median.items():
        ratio = statistics.median(a / b for a, b in zip(times[name], times[ours]))
        lines.append(f"| {name} | {spent * 1e3:.1f} | {pixels / spent / 1e6:.2f} | {ratio:.1f}x |")
    loading = statistics.median(seconds(lambda k=k: batches[k]) for k in range(100, 108))
    share = loading / median[ours]
    lines += ["", f"Making a batch: {loading * 1e3:.1f} ms, {share:.0%} of a step."]
    for loaders in (0, 1, 2):
        spent = loop(variants[ours], batches, loaders, 200, 2 * rounds)
        lines.append(f"Loop with {loaders} loader process(es): {spent * 1e3:.1f} ms a step.")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser("python -m bench.training", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", default="k16")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--data", type=Path, help="raw data set instead of synthetic pictures")
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    parallel.keep_memory()
    np.seterr(all="ignore")
    features = ["hdr", "alb", "nrm"]
    settings = parse("train", [*features, "-m", args.model, "-s", "1", "--exposure_jitter", "2",
                               "--average_inputs", "0.1", "--blend_target", "0.15",
                               "--mix_clean_aux", "0.15", "--normal_signs", "0.5"])
    with tempfile.TemporaryDirectory() as tmp:
        if not args.data:
            write_scenes(Path(tmp))
        pictures = from_raw(scan(args.data or Path(tmp), features), features, "hdr", "pu")
    batches = make_batches(pictures, settings, parallel.Team(0, 1, torch.device("cpu")))
    variants = {
        "lull, bf16": Stepper(settings, None, "bf16"),
        "lull, fp32": Stepper(settings, None, "fp32"),
        "eager PyTorch, unfold": Stepper(settings, unfolded, "fp32"),
        "eager PyTorch, loop over taps": Stepper(settings, kernel_filter.kernel_filter, "fp32")}
    print("\n".join(report(variants, batches, args.rounds)))


if __name__ == "__main__":
    main()
