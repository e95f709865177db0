"""The estimate of the time that is left, and what is shown of a comparison's progress."""

from __future__ import annotations

import pytest

from serp.comparison.progress import Display, RemainingTime
from serp.comparison.trial_records import Trial

STEPS = 1_000


class Clock:
    now = 50.0

    def __call__(self) -> float:
        return self.now


def trials(**counts: int) -> list[Trial]:
    return [Trial(name, "walk", seed) for name, count in counts.items() for seed in range(count)]


def test_the_estimate_is_exact_where_the_speed_is_constant() -> None:
    rate, clock, todo = 0.02, Clock(), trials(serp=3, dqn=2)
    remaining = RemainingTime(todo, STEPS, 1, clock)
    assert remaining.seconds_left() is None
    total, done = rate * STEPS * len(todo), 0.0
    for trial in todo:
        for steps in (0, 1, 300, 999):
            clock.now = 50.0 + done + rate * steps
            remaining.notice(trial, steps)
            if done or steps:
                assert remaining.seconds_left() == pytest.approx(total - done - rate * steps)
                assert remaining.share == pytest.approx((done + rate * steps) / total)
        done += rate * STEPS
        clock.now = 50.0 + done
        remaining.end(trial, complete=True)
    assert (remaining.seconds_left(), remaining.share) == (0.0, 1.0)


def test_each_algorithm_takes_as_long_as_it_took_and_an_unknown_one_as_all() -> None:
    rates = {"serp": 0.01, "dqn": 0.001}
    clock, todo = Clock(), trials(serp=2, dqn=2, mrp=1)
    remaining = RemainingTime(todo, STEPS, 1, clock)
    for trial in (todo[0], todo[2]):
        remaining.notice(trial, 0)
        clock.now += rates[trial.algorithm] * STEPS
        remaining.end(trial, complete=True)
    mean = sum(rates.values()) / 2
    assert remaining.seconds_left() == pytest.approx((sum(rates.values()) + mean) * STEPS)


def test_processes_share_what_is_left_but_no_trial_is_shared() -> None:
    clock, todo = Clock(), trials(serp=4)
    remaining = RemainingTime(todo, STEPS, 2, clock)
    for trial in todo[:2]:
        remaining.notice(trial, 0)
    clock.now += 8.0
    for trial in todo[:2]:
        remaining.notice(trial, 800)
    assert remaining.seconds_left() == pytest.approx(2.0 + 10.0)
    clock.now += 2.0
    for trial in todo[:3]:
        remaining.end(trial, complete=True)
    assert remaining.seconds_left() == pytest.approx(10.0)


def test_a_trial_that_failed_is_over_and_does_not_count_for_the_speed() -> None:
    clock, todo = Clock(), trials(serp=3)
    remaining = RemainingTime(todo, STEPS, 1, clock)
    for trial, seconds, complete in ((todo[0], 10.0, True), (todo[1], 0.01, False)):
        remaining.notice(trial, 0)
        clock.now += seconds
        remaining.end(trial, complete=complete)
    assert remaining.seconds_left() == pytest.approx(10.0)
    assert remaining.share == pytest.approx(2 / 3)


@pytest.mark.parametrize("quiet", [False, True])
def test_a_line_a_trial_is_shown_where_there_is_no_terminal(
    quiet: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    todo = trials(serp=1, dqn=1)
    with Display(RemainingTime(todo, STEPS, 1), 2, quiet=quiet) as display:
        display.notice(todo[0], 10)
        display.end(todo[0], None)
        display.end(todo[1], "[bold]cable[/] cut")
        display.say("a line")
    captured = capsys.readouterr()
    if quiet:
        assert captured.out == captured.err == ""
        return
    lines = captured.err.splitlines()
    assert lines[0].startswith("[1/2] serp on walk, seed 0, about ")
    assert lines[1].startswith("[2/2] dqn on walk, seed 0: failed. [bold]cable[/] cut")
    assert lines[2] == "a line"
