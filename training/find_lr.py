#!/usr/bin/env python3
"""Learning rate range test: the rate grows at every step until the loss explodes.

    python -m training.find_lr hdr alb nrm -f RT -r sweep        -> results/sweep.csv

Prints a suggestion for --max_lr: a third of the rate at the lowest smoothed loss.
"""
from __future__ import annotations

if __name__ == "__main__" and not __package__:  # run as a file: go on as a module
    import runpy
    import sys
    sys.path[0] = __file__.rpartition("training")[0] or ".."
    sys.exit(runpy.run_module("training.find_lr", run_name="__main__", alter_sys=True))

import csv
import math
from pathlib import Path

import torch

from training import errors, parallel
from training.console import Bar
from training.errors import USAGE, ToolError
from training.imageio import replacing
from training.loss import loss_of_settings
from training.optimizer import Optimizer
from training.result import make_model
from training.settings import Settings, parse, unique_id
from training.pictures import make_batches, open_data

SMOOTHING, DIVERGED, MIN_STEPS = 0.98, 4.0, 100


def main(argv: list[str]) -> None:
    settings = parse("find_lr", argv, __doc__)
    settings = settings.replace(result=settings.result or unique_id())
    low, high = settings.learning_rate, settings.max_learning_rate
    if not 0 < low < high:
        raise ToolError(f"the sweep from {low} to {high} does not rise", USAGE)
    parallel.launch(worker, settings)


def worker(settings: Settings, team: parallel.Team) -> None:
    pictures, *_ = open_data(settings, print if team.rank == 0 else lambda *a: None)
    batches = make_batches(pictures, settings, team)
    steps = settings.num_steps or max(batches.steps_per_epoch, MIN_STEPS)
    torch.manual_seed(settings.seed)
    model = make_model(settings).to(team.device, memory_format=torch.channels_last)
    optimizer = Optimizer(model.parameters(), settings.learning_rate, settings.optimizer)
    loss_of, mixed = loss_of_settings(settings), parallel.Mixed(settings, team)
    growth = (settings.max_learning_rate / settings.learning_rate) ** (1 / (steps - 1))
    rows, smooth, best, bar = [], 0.0, math.inf, Bar(team.rank == 0)
    loader = parallel.loader(batches, range(steps), settings, team)
    for step, (x, y) in enumerate(loader):
        rate = settings.learning_rate * growth**step
        optimizer.schedule(rate)
        x, y = x.to(team.device), y.to(team.device)
        with mixed.autocast():
            loss = loss_of(model(x), y)
        optimizer.zero_grad()
        mixed.backward(loss)
        team.average([p.grad for p in model.parameters()])
        mixed.step(optimizer)
        value = float(team.mean(loss.detach()))
        smooth = SMOOTHING * smooth + (1 - SMOOTHING) * value
        unbiased = smooth / (1 - SMOOTHING ** (step + 1))
        rows.append((rate, unbiased, value))
        bar.show("Sweep", (step + 1) / steps)
        best = min(best, unbiased)
        if not math.isfinite(value) or unbiased > DIVERGED * best:
            break
    if team.rank == 0:
        bar.end(f"{len(rows)} steps")
        path = Path(settings.results_dir) / f"{settings.result}.csv"
        save(path, rows)
        print(f"Saved: {path}")
        print(advice(rows))


def advice(rows: list[tuple[float, float, float]]) -> str:
    """What a sweep says: rows of rate, smoothed loss and loss."""
    finite = [r for r in rows if math.isfinite(r[1])]
    lowest = min(finite, key=lambda r: r[1])[0] if finite else math.nan
    if not finite or lowest in (finite[0][0], finite[-1][0]):
        return (f"The smoothed loss has no minimum within {rows[0][0]:g} to {rows[-1][0]:g}: "
                "more steps (--num_steps) or another range will tell")
    return f"Lowest smoothed loss at lr={lowest:.3g}; try --max_lr {lowest / 3:.2g}"


def save(path: Path, rows: list[tuple[float, float, float]]) -> None:
    with replacing(path) as tmp, open(tmp, "w", newline="") as f:
        out = csv.writer(f, quoting=csv.QUOTE_NONNUMERIC)
        out.writerow(["learning_rate", "smoothed_loss", "loss"])
        out.writerows(rows)


if __name__ == "__main__":
    errors.run(main)
