"""The course of a training: its length and its learning rate."""
from __future__ import annotations

import pytest

from training import schedule
from training.settings import parse


def test_estimate_of_the_steps_that_fit():
    """Slow first steps do not count; validations do; one step is the least."""
    plan = schedule.Plan(10**6, 100.0)
    ready = [plan.timed(t) for t in [9.0, 5.0, 1.0] + [0.1] * 8]
    assert ready == [False] * 10 + [True] and plan.progress(11) == 0
    assert plan.estimate(11, 84.0, 4.0, 0) == 11 + 800
    assert plan.estimate(11, 84.0, 4.0, 10) == 11 + round(80 / 0.5)
    assert plan.estimate(11, -1.0, 4.0, 0) == 12
    assert schedule.Plan(50, 100.0, times=plan.times).estimate(11, 84.0, 0.0, 0) == 50
    assert not schedule.Plan(10**6, 1000.0).timed(0.1)  # too short a share of the budget


def test_the_end_moves_with_the_speed():
    """The rate goes on from where it is, and still ends where the cycle does."""
    plan = schedule.Plan(10**6, 100.0, planned=1000)
    assert not plan.revise(300, 70.0, 0.1) and not plan.revise(300, 70.0, 0.107)  # 4.9 s late
    assert plan.revise(300, 70.0, 0.2) and plan.planned == 300 + 350
    assert plan.progress(300) == 0.3 and plan.progress(300 + 175) == pytest.approx(0.65)
    assert plan.progress(650) == 1 and plan.over(650)
    assert plan.revise(475, 40.0, 0.1) and plan.planned == 475 + 400  # faster again
    assert plan.progress(475) == pytest.approx(0.65) and plan.progress(875) == 1
    assert plan.revise(500, -3.0, 0.1) and plan.planned == 501  # no time is left: one more
    plan = schedule.Plan(600, 100.0, planned=500, validation=0.1)
    assert not plan.revise(300, 40.0, 0.1) and plan.revise(300, 90.0, 0.1)
    assert plan.planned == 600  # that --num_epochs allows


def test_one_cycle():
    s = parse("train", ["hdr", "--max_lr", "1"])
    assert schedule.one_cycle(0, s) == pytest.approx((1 / 25, 0.95))
    assert schedule.one_cycle(0.15, s) == pytest.approx((1, 0.85))
    assert schedule.one_cycle(1, s) == pytest.approx((1 / 25e4, 0.95))
    rates = [schedule.one_cycle(i / 100, s)[0] for i in range(101)]
    assert rates[:16] == sorted(rates[:16]) and rates[15:] == sorted(rates[15:], reverse=True)
