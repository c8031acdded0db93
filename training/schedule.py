"""The course of a training: how many steps it has, and the learning rate at each of them.

All of it is a function of the step, so that a resumed training goes on as if it had never stopped.
With a time budget the number of steps is estimated once, from the first steps; checkpoints keep it.
"""
from __future__ import annotations

import math
import statistics
from dataclasses import dataclass, field

from training.settings import Settings

BETA1_HIGH, BETA1_LOW = 0.95, 0.85  # Adam's momentum runs against the learning rate
WARM, TIMED, SHARE = 3, 8, 0.02     # steps that do not count, that count at least, of the budget


@dataclass
class Plan:
    """The number of steps; `planned` is None until it is known."""

    total: int                   # that --num_epochs allows
    budget: float | None         # seconds
    planned: int | None = None
    times: list[float] = field(default_factory=list)

    def __post_init__(self):
        if not self.budget:
            self.planned = self.total

    def progress(self, step: int) -> float:
        """Share of the training that is over before a step; 0 while its length is not known."""
        return min(step / self.planned, 1.0) if self.planned else 0.0

    def over(self, step: int) -> bool:
        return step >= (self.planned or self.total)

    def timed(self, seconds: float) -> bool:
        """Takes the time of a step; True once there are enough of them for an estimate."""
        self.times.append(seconds)
        counted = self.times[WARM:]
        return len(counted) >= TIMED and sum(self.times) >= SHARE * (self.budget or 0)

    def estimate(self, step: int, left: float, validation: float, every: int) -> int:
        """Steps in all, if `left` seconds remain after `step` of them and every so many steps (0:
        only at the end) a validation takes `validation` seconds."""
        each = statistics.median(self.times[WARM:]) + (validation / every if every else 0.0)
        more = (left - validation) / max(each, 1e-9)
        return max(min(step + max(round(more), 0), self.total), step + 1)


def one_cycle(progress: float, settings: Settings) -> tuple[float, float]:
    """(learning rate, Adam's beta1) at `progress` in [0,1]: cosine up over the warm-up, cosine down
    to a 10000th of the start; beta1 runs the other way."""
    first, peak = settings.learning_rate, settings.max_learning_rate
    warmup = settings.learning_rate_warmup
    if progress < warmup:
        up = 0.5 - 0.5 * math.cos(math.pi * progress / warmup)
        return first + (peak - first) * up, BETA1_HIGH + (BETA1_LOW - BETA1_HIGH) * up
    down = 0.5 - 0.5 * math.cos(math.pi * (progress - warmup) / (1 - warmup))
    return peak + (first / 1e4 - peak) * down, BETA1_LOW + (BETA1_HIGH - BETA1_LOW) * down
