"""How long the rest takes, and what is shown of it."""

from __future__ import annotations

import pytest

from serp.compare.progress import Display, RemainingTime
from serp.compare.records import Trial

STEPS = 1_000


class Clock:
    def __init__(self) -> None:
        self.now = 50.0

    def __call__(self) -> float:
        return self.now


def trials(**counts: int) -> list[Trial]:
    return [Trial(name, "walk", seed) for name, count in counts.items() for seed in range(count)]


@pytest.mark.parametrize("rate", [0.001, 0.02])
def test_the_estimate_is_exact_where_the_speed_is_constant(rate: float) -> None:
    clock, todo = Clock(), trials(serp=3, dqn=2)
    outlook = RemainingTime(todo, STEPS, 1, clock)
    assert outlook.seconds_left() is None
    total = rate * STEPS * len(todo)
    done = 0.0
    for trial in todo:
        for steps in (0, 1, 10, 300, 301, 999):
            clock.now = 50.0 + done + rate * steps
            outlook.notice(trial, steps)
            if done or steps:
                assert outlook.seconds_left() == pytest.approx(total - done - rate * steps)
                assert outlook.share == pytest.approx((done + rate * steps) / total)
        done += rate * STEPS
        clock.now = 50.0 + done
        outlook.end(trial, complete=True)
    assert outlook.seconds_left() == 0.0
    assert outlook.share == 1.0


def test_each_algorithm_takes_as_long_as_it_took() -> None:
    rates = {"serp": 0.01, "dqn": 0.001, "mrp": 0.004}
    clock, todo = Clock(), trials(serp=2, dqn=2, mrp=2)
    outlook = RemainingTime(todo, STEPS, 1, clock)
    for trial in todo[::2]:
        outlook.notice(trial, 0)
        clock.now += rates[trial.algorithm] * STEPS
        outlook.end(trial, complete=True)
    assert outlook.seconds_left() == pytest.approx(sum(rates.values()) * STEPS)


def test_one_that_was_not_seen_yet_takes_as_long_as_the_others() -> None:
    clock, todo = Clock(), trials(serp=1, dqn=1)
    outlook = RemainingTime(todo, STEPS, 1, clock)
    outlook.notice(todo[0], 0)
    clock.now += 10.0
    outlook.end(todo[0], complete=True)
    assert outlook.seconds_left() == pytest.approx(10.0)


def test_processes_share_what_is_left() -> None:
    clock, todo = Clock(), trials(serp=4)
    outlook = RemainingTime(todo, STEPS, 2, clock)
    for trial in todo[:2]:
        outlook.notice(trial, 0)
    clock.now += 8.0
    for trial in todo[:2]:
        outlook.notice(trial, 800)
    assert outlook.seconds_left() == pytest.approx(2.0 + 10.0)
    clock.now += 2.0
    for trial in todo[:2]:
        outlook.end(trial, complete=True)
    assert outlook.seconds_left() == pytest.approx(10.0)
    outlook.notice(todo[2], 0)
    clock.now += 10.0
    outlook.end(todo[2], complete=True)
    assert outlook.seconds_left() == pytest.approx(10.0)  # one alone cannot be shared


def test_one_that_failed_says_nothing_of_speed_and_is_over() -> None:
    clock, todo = Clock(), trials(serp=3)
    outlook = RemainingTime(todo, STEPS, 1, clock)
    outlook.notice(todo[0], 0)
    clock.now += 10.0
    outlook.end(todo[0], complete=True)
    outlook.notice(todo[1], 0)
    clock.now += 0.01
    outlook.end(todo[1], complete=False)
    assert outlook.seconds_left() == pytest.approx(10.0)
    assert outlook.share == pytest.approx(2 / 3)


def test_a_line_a_trial_is_shown_where_there_is_no_terminal(
    capsys: pytest.CaptureFixture[str],
) -> None:
    todo = trials(serp=1, dqn=1)
    with Display(RemainingTime(todo, STEPS, 1), 2, quiet=False) as display:
        display.notice(todo[0], 10)
        display.end(todo[0], None)
        display.end(todo[1], "[bold]cable[/] cut")
        display.say("a line")
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("[1/2] serp on walk, seed 0, about ")
    assert lines[1].startswith("[2/2] dqn on walk, seed 0: failed. [bold]cable[/] cut")
    assert lines[2] == "a line"


def test_quiet_is_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    (trial,) = trials(serp=1)
    with Display(RemainingTime([trial], STEPS, 1), 1, quiet=True) as display:
        display.notice(trial, 10)
        display.say("a line")
        display.end(trial, "failed")
    captured = capsys.readouterr()
    assert captured.out == captured.err == ""
