"""Training throughput of a family K model: our step against eager PyTorch's of the same model.

    python -m bench.training [--model k16] [--rounds 5] [--threads 1] [--data DIR]

A step is forward, loss, backward, clipping and Adam on a batch of tiles. Variants take turns of two
steps, of which the second one counts (as in a training, the caches have seen its like), so that a
busy machine hurts all of them; medians of the rounds; each has a process of its own. The eager ones
are plain PyTorch in fp32 as it comes, the filter by unfold, as published code has it, or by a loop
over its taps. Then the cost of making batches beside that of a step, and a whole training loop with
and without loader processes.
"""
from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
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
from training.optimizer import Optimizer
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


class Stepper:
    """One way to train; `run` does a step. plain: the sums over the filter's taps in PyTorch's
    operations, which then serve everywhere and with the memory settings that they find."""

    def __init__(self, settings: Settings, plain: Callable | None, precision: str):
        if plain:
            fused.module, kernel_filter.kernel_filter = lambda: None, plain
        else:
            parallel.keep_memory()
        torch.manual_seed(1)
        self.settings = settings
        self.format = torch.contiguous_format if plain else torch.channels_last
        self.model = make_model(settings).to(memory_format=self.format)
        params = list(self.model.parameters()), settings.max_learning_rate
        self.optimizer = Optimizer(*params)
        if plain:
            self.optimizer.parts = [torch.optim.Adam(*params)]
        self.loss_of = make_loss(settings.loss)
        self.mixed = parallel.Mixed(settings.replace(precision=precision),
                                    parallel.Team(0, 1, torch.device("cpu")))

    def run(self, x: Tensor, y: Tensor) -> float:
        with self.mixed.autocast():
            loss = self.loss_of(self.model(x), y)
        self.optimizer.zero_grad()
        loss.backward()
        self.mixed.step(self.optimizer, self.settings.grad_clip)
        return loss.item()


VARIANTS = {"lull, bf16": (None, "bf16"), "lull, fp32": (None, "fp32"),
            "eager PyTorch, unfold": (unfolded, "fp32"),
            "eager PyTorch, loop over taps": (kernel_filter.kernel_filter, "fp32")}


def serve(calls, name: str, settings: Settings, batches, threads: int) -> None:
    """A process that does as it is told: ("step", k) or ("loop", loaders, steps) -> seconds."""
    torch.set_num_threads(threads)
    np.seterr(all="ignore")
    stepper = Stepper(settings, *VARIANTS[name])
    while (call := calls.recv())[0] != "end":
        if call[0] == "step":
            x, y = batches[call[1]]
            stepper.run(x, y)
            calls.send(seconds(lambda x=x, y=y: stepper.run(x, y)))
        else:
            calls.send(loop(stepper, batches, *call[1:]))


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


def loop(stepper: Stepper, batches, loaders: int, steps: int) -> float:
    """Seconds per step of a loop that loads its batches; the loaders' start does not count."""
    settings = stepper.settings.replace(num_loaders=loaders)
    start = 0.0
    for k, (x, y) in enumerate(parallel.loader(batches, range(200, 202 + steps), settings)):
        if k == 2:
            start = time.perf_counter()
        stepper.run(x, y)
    return (time.perf_counter() - start) / steps


def report(settings: Settings, batches, rounds: int, threads: int) -> list[str]:
    """Markdown, from a process per variant."""
    context = torch.multiprocessing.get_context("spawn")
    calls = {}
    for name in VARIANTS:
        calls[name], theirs = context.Pipe()
        context.Process(target=serve, args=(theirs, name, settings, batches, threads)).start()
    try:
        return measure(calls, settings, batches, rounds, threads)
    finally:
        for pipe in calls.values():
            pipe.send(("end",))


def measure(calls: dict, settings: Settings, batches, rounds: int, threads: int) -> list[str]:
    """A line per variant, then what data costs; calls: pipes to the processes."""
    def ask(name: str, *call) -> float:
        calls[name].send(call)
        return calls[name].recv()

    times: dict[str, list[float]] = {name: [] for name in VARIANTS}
    for k in range(rounds + 1):
        for name in VARIANTS:
            spent = ask(name, "step", k)
            if k:  # the first round compiles and warms up
                times[name].append(spent)
    ours = list(VARIANTS)[0]
    pixels = settings.batch_size * settings.tile_size**2
    lines = [f"{settings.model}, {settings.batch_size} tiles of {settings.tile_size}x"
             f"{settings.tile_size}, {threads} thread(s)", "",
             "| whole step | ms | Mpx/s | lull is |", "|---|---:|---:|---:|"]
    median = {name: statistics.median(t) for name, t in times.items()}
    for name, spent in median.items():
        ratio = statistics.median(a / b for a, b in zip(times[name], times[ours]))
        lines.append(f"| {name} | {spent * 1e3:.1f} | {pixels / spent / 1e6:.2f} | {ratio:.1f}x |")
    loading = statistics.median(seconds(lambda k=k: batches[k]) for k in range(100, 108))
    share = loading / median[ours]
    lines += ["", f"Making a batch: {loading * 1e3:.1f} ms, {share:.0%} of a step."]
    for loaders in (0, 1, 2):
        spent = ask(ours, "loop", loaders, 2 * rounds)
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
    print("\n".join(report(settings, batches, args.rounds, args.threads)))


if __name__ == "__main__":
    main()
