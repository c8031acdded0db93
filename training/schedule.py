"""The course of a training: how many steps it has, and the learning rate at each of them.

All of it is a function of the step, so that a resumed training goes on as if it had never stopped.
With a time budget the number of steps is estimated from the first of them, and anew where an epoch
shows that the machine became faster or slower; checkpoints keep it.
"""
from __future__ import annotations

import math
import statistics
from dataclasses import dataclass, field

from training.settings import Settings

BETA1_HIGH, BETA1_LOW = 0.95, 0.85  # Adam's momentum runs against the learning rate
WARM, TIMED, SHARE = 3, 8, 0.02     # steps that do not count, that count at least, of the budget
MISSED = 0.05                       # of the budget: an end so early or late is worth a new plan


@dataclass
class Plan:
    """The number of steps; `planned` is None until it is known."""

    total: int                   # that --num_epochs allows
    budget: float | None         # seconds
    planned: int | None = None
    times: list[float] = field(default_factory=list)
    validation: float = 0.0              # seconds of validations for each step
    since: tuple[int, float] = (0, 0.0)  # step of this plan's beginning, and the progress there

    def __post_init__(self):
        if not self.budget:
            self.planned = self.total

    def progress(self, step: int) -> float:
        """Share of the training that is over before a step; 0 while its length is not known."""
        if not self.planned:
            return 0.0
        first, done = self.since
        return min(done + (1 - done) * (step - first) / (self.planned - first), 1.0)

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
        self.validation = validation / every if every else 0.0
        each = statistics.median(self.times[WARM:]) + self.validation
        return self.end(step, left - validation, each)

    def end(self, step: int, left: float, each: float) -> int:
        """Steps in all, if `left` seconds remain after `step` of them for steps of `each`."""
        return max(min(step + round(left / max(each, 1e-9)), self.total), step + 1)

    def revise(self, step: int, left: float, each: float) -> bool:
        """Whether the end is moved, because steps that take `each` seconds would miss by much the
        `left` ones that remain. The progress goes on from where it is. The epoch of the estimate
        itself, with its slow beginning, does not count."""
        if self.times:
            self.times = []
            return False
        each += self.validation
        end = self.end(step, left, each)
        if abs((self.planned - step) * each - left) <= MISSED * self.budget or end == self.planned:
            return False
        self.since = step, self.progress(step)
        self.planned = end
        return True


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
