"""Seeds that take turns in one process find what each finds alone, and share the process fairly."""

from __future__ import annotations

import dataclasses
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.comparison.algorithms import find_algorithm
from serp.comparison.conditions import Conditions
from serp.comparison.groups import MOST, faster_together, grouped, time_of
from serp.comparison.progress import Outlook
from serp.comparison.records import Trial
from serp.comparison.together import Turns, run_together
from serp.comparison.trial import Measured
from serp.comparison.workers import Job, run_here, run_in_processes
from serp.errors import EnvironmentFailure, SerpError
from serp.learning.settings import DQNSettings
from serp.learning.side_by_side import SideBySide
from serp.task import Task
from serp.training import Trainer
from tests.serp.comparison.contest import (
    CONDITIONS,
    OWN,
    Pothole,
    Walk,
    episodes_of,
    everything,
    measured,
    small,
    walk,
)

SEEDS = (0, 1, 2)
SWIFT = {
    "guide": {"jump_stages": 2, "jump_tolerance": 5.0, "imitation_steps": 40},
    "learner": {"updates_per_step": 0.7},
    "training": {"random_steps": 20},
}
"""Random phases of unequal lengths, so that the seeds learn out of step."""
Changes = Mapping[str, Mapping[str, Any]]


def trials(name: str, seeds: Sequence[int] = SEEDS, variant: str = "walk") -> list[Trial]:
    return [Trial(name, variant, seed) for seed in seeds]


def beginning(
    task: Task, name: str, changes: Changes | None = None, steps: dict[int, int] | None = None
) -> Iterator[tuple[Trial, Measured | SerpError]]:
    def tell(trial: Trial, env_steps: int) -> None:
        if steps is not None:
            steps[trial.seed] = env_steps

    algorithm = find_algorithm(name)
    return run_together(trials(name), algorithm, task, CONDITIONS, changes or {}, tell)


def together(*given: Any) -> dict[int, Measured | SerpError]:
    return {trial.seed: found for trial, found in beginning(*given)}


def found(one: Measured | SerpError) -> Any:
    """What was found, but for the time it took."""
    assert isinstance(one, Measured), one
    return episodes_of(one), one.evaluations, one.terms


def compare_with_alone(folder: Path, name: str, changes: Changes) -> None:
    task = walk(folder)
    results = together(task, name, changes)
    assert set(results) == set(SEEDS)
    for seed in SEEDS:
        alone = measured(folder, name, task=task, seed=seed, changes=changes)
        assert found(results[seed]) == found(alone)


@pytest.mark.parametrize("name", [name for name in OWN if name != "mrp"])
def test_records_are_those_of_seeds_alone(tmp_path: Path, name: str) -> None:
    compare_with_alone(tmp_path, name, {})


@pytest.mark.parametrize("name", ["serp", "dqn", "serp-paper", "dqfd"])
def test_records_are_those_of_seeds_alone_out_of_step_too(tmp_path: Path, name: str) -> None:
    compare_with_alone(tmp_path, name, SWIFT)


def test_learning_decides_what_is_found(tmp_path: Path) -> None:
    """Else equal records would say little."""
    idle: Changes = {"learner": {"updates_per_step": 0.0}}
    for name in ("serp", "dqn"):
        learned, not_learned = together(walk(tmp_path), name), together(walk(tmp_path), name, idle)
        assert all(found(learned[seed]) != found(not_learned[seed]) for seed in SEEDS)


def test_they_learn_in_common_passes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    passes: Counter[int] = Counter()
    learn = SideBySide.learn

    def counted(self: SideBySide, numbers: Sequence[int] | None = None) -> Any:
        assert numbers is not None
        passes[len(numbers)] += 1
        return learn(self, numbers)

    monkeypatch.setattr(SideBySide, "learn", counted)
    together(walk(tmp_path), "dqn")
    assert passes == {len(SEEDS): CONDITIONS.env_steps}


def test_a_comparison_and_other_processes_write_what_trials_alone_write(tmp_path: Path) -> None:
    task = walk(tmp_path)
    names = ("serp", "dqn", "serp-paper", "dqfd")
    small(task, tmp_path / "compared", algorithms=names, seeds=len(SEEDS))
    (variant,) = {place.name for place in (tmp_path / "compared" / "trials").glob("*/*")}
    asked = {name: trials(name, variant=variant) for name in names}
    alone = [job(tmp_path / "alone", task, trial) for name in names for trial in asked[name]]
    assert all(end.error is None for end in run_here(alone, lambda trial, steps: None))
    assert len(everything(tmp_path / "alone")) == len(alone)
    groups = [job(tmp_path / "there", task, *asked[name]) for name in names]
    there = run_in_processes(groups, 1, lambda trial, steps: None, lambda: False)
    assert sorted(end.trial for end in there if end.error is None) == sorted(
        trial for one in alone for trial in one.trials
    )
    assert everything(tmp_path / "compared") == everything(tmp_path / "alone")
    assert everything(tmp_path / "there") == everything(tmp_path / "alone")


def job(folder: Path, task: Task, *group: Trial) -> Job:
    """A job on the terms of `small`."""
    terms = Conditions(env_steps=60, evaluate_every=30, evaluation_episodes=2, final_episodes=2)
    return Job(folder, group, find_algorithm(group[0].algorithm), task, terms, {}, {})


# What goes wrong ----------------------------------------------------------------------------------


def test_one_that_fails_ends_with_its_error_and_the_others_go_on(tmp_path: Path) -> None:
    good = together(walk(tmp_path), "serp")
    results = together(walk(tmp_path, Pothole), "serp")
    assert isinstance(results[1], EnvironmentFailure)
    assert "cable cut" in str(results[1])
    for seed in (0, 2):
        assert found(results[seed]) == found(good[seed])


@pytest.mark.parametrize("when", ["made", "reset"])
def test_one_that_cannot_begin_loses_no_other(tmp_path: Path, when: str) -> None:
    begun: list[Any] = []

    class Unlucky(Walk):
        """The second seed is without an environment, or with a broken one."""

        def __init__(self) -> None:
            super().__init__()
            begun.append(self)
            if when == "made" and self.of_second_seed:
                raise ConnectionError("no port is free")

        @property
        def of_second_seed(self) -> bool:
            # Each seed has one to train in and four to be evaluated in.
            return begun.index(self) == 5

        def reset(self, **options: Any) -> Any:
            if when == "reset" and self.of_second_seed:
                raise ConnectionError("no port is free")
            return super().reset(**options)

    results = together(walk(tmp_path, Unlucky), "dqn")
    assert "no port is free" in str(results[1])
    for seed in (0, 2):
        assert found(results[seed]) == found(measured(tmp_path, "dqn", seed=seed))


def test_all_that_fail_end_with_their_errors(tmp_path: Path) -> None:
    class Broken(Walk):
        def reset(self, **options: Any) -> Any:
            raise ConnectionError("no port is free")

    results = together(walk(tmp_path, Broken), "serp")
    assert {seed: str(error).partition(" (")[0] for seed, error in results.items()} == {
        seed: "task walk: reset failed: ConnectionError: no port is free" for seed in SEEDS
    }


def test_a_bug_is_raised_when_the_others_have_come_to_their_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    end_unit = Trainer._end_unit

    def faulty(self: Trainer, unit: str) -> None:
        if self.seed == 0 and self.env_steps == 40:
            raise ZeroDivisionError("a bug")
        end_unit(self, unit)

    monkeypatch.setattr(Trainer, "_end_unit", faulty)
    ended = []
    with pytest.raises(ZeroDivisionError, match="a bug"):
        for trial, one in beginning(walk(tmp_path), "dqn"):
            ended.append((trial.seed, found(one)))
    assert [seed for seed, _ in ended] == [1, 2]


def test_environments_are_closed_however_it_ends(tmp_path: Path) -> None:
    opened: list[Any] = []
    closed: list[Any] = []

    class Closing(Pothole):
        def __init__(self) -> None:
            super().__init__()
            opened.append(self)

        def close(self) -> None:
            closed.append(self)

    for name in ("serp", "dqn"):
        together(walk(tmp_path, Closing), name)
    begun = beginning(walk(tmp_path, Closing), "dqn")
    with closing(begun):  # type: ignore[type-var]
        next(begun)
    assert len(opened) == 3 * len(SEEDS) * 5
    assert sorted(map(id, opened)) == sorted(map(id, closed))


def test_a_trial_is_handed_over_as_soon_as_it_is_complete(tmp_path: Path) -> None:
    """The first to end has failed, after a few steps; the others have most before them."""
    steps: dict[int, int] = {}
    begun = beginning(walk(tmp_path, Pothole), "dqn", {}, steps)
    assert next(begun)[0].seed == 1
    assert max(steps.values()) < CONDITIONS.env_steps
    assert [trial.seed for trial, _ in begun] == [0, 2]


def test_when_the_user_stops_a_group_that_runs_comes_to_its_end(tmp_path: Path) -> None:
    task = walk(tmp_path)
    todo = [job(tmp_path / "c", task, *trials(name)) for name in ("dqn", "serp")]
    pressed: list[int] = []
    ended = run_here(todo, lambda trial, steps: pressed.append(steps), lambda: bool(pressed))
    assert [end.trial for end in ended] == trials("dqn")


# Time ---------------------------------------------------------------------------------------------


def test_a_clock_of_turns_counts_turns_and_shares() -> None:
    now = 100.0
    turns = Turns(lambda: now)
    assert turns() == 0.0
    for before, inside in ((5.0, 2.0), (1.0, 4.0)):
        now += before
        turns.begin()
        now += inside / 2
        begun = turns()
        now += inside / 2
        assert turns() == begun + inside / 2
        turns.end()
    assert turns() == 6.0
    turns.share(0.5)
    now += 9.0
    assert turns() == 6.5


def test_the_time_of_all_is_the_time_that_passed(tmp_path: Path) -> None:
    together(walk(tmp_path), "dqn")  # compiles
    begin = time.perf_counter()
    results = together(walk(tmp_path), "dqn")
    passed = time.perf_counter() - begin
    spent = [sum(one.seconds.values()) for one in results.values() if isinstance(one, Measured)]
    assert len(spent) == len(SEEDS)
    assert 0.3 * passed < sum(spent) <= passed
    for one in results.values():
        assert isinstance(one, Measured)
        seconds = [row.seconds for row, _ in one.log.rows]
        assert seconds == sorted(seconds)
        assert 0.0 < seconds[-1] <= one.seconds["training"]


# Who shares a process -----------------------------------------------------------------------------


def test_only_what_is_faster_together_is_together() -> None:
    for name in OWN:
        settings = DQNSettings(members=2)
        assert faster_together(find_algorithm(name), settings, 8, 2), name
    idle = DQNSettings(updates_per_step=0.0)  # as the planner alone has it
    assert not faster_together(find_algorithm("mrp"), idle, 4, 2)
    guest = dataclasses.replace(find_algorithm("dqn"), kind="guest")
    assert not faster_together(guest, DQNSettings(), 4, 2)
    for large in (
        DQNSettings(hidden=(512, 512)),
        DQNSettings(members=3),
        DQNSettings(batch_size=4096),
    ):
        assert not faster_together(find_algorithm("serp"), large, 4, 2)
    assert not faster_together(find_algorithm("serp"), DQNSettings(), 5_000, 2)


_COUNTS = st.dictionaries(st.sampled_from("abcd"), st.integers(1, 13), min_size=1)


@given(_COUNTS, st.sets(st.sampled_from("abcd")), st.integers(1, 16))
def test_groups_hold_every_trial_once_and_the_largest_come_first(
    counts: dict[str, int], alone: set[str], processes: int
) -> None:
    todo = [Trial(name, "walk", seed) for name, count in counts.items() for seed in range(count)]
    groups = grouped(todo, lambda trial: trial.algorithm not in alone, processes)
    assert sorted(trial for group in groups for trial in group) == sorted(todo)
    sizes = [len(group) for group in groups]
    assert sizes == sorted(sizes, reverse=True)
    for group in groups:
        assert 1 <= len(group) <= MOST
        assert len({(trial.algorithm, trial.variant) for trial in group}) == 1
        assert list(group) == sorted(group)
        assert len(group) == 1 or group[0].algorithm not in alone
    for name in counts.keys() - alone:
        of_name = [len(group) for group in groups if group[0].algorithm == name]
        assert max(of_name) - min(of_name) <= 1
    # Being together never costs more, in processes that are idle, than it saves.
    singles = [(trial,) for trial in todo]
    assert time_of(groups, processes) <= time_of(singles, processes) + 1e-9


@pytest.mark.parametrize(
    ("seeds", "processes", "sizes"),
    [
        (5, 1, [5]),
        (5, 2, [3, 2]),
        (10, 2, [5, 5]),
        (10, 4, [3, 3, 2, 2]),
        (5, 8, [1, 1, 1, 1, 1]),
        (12, 1, [4, 4, 4]),
        (1, 2, [1]),
    ],
)
def test_how_seeds_are_spread(seeds: int, processes: int, sizes: list[int]) -> None:
    groups = grouped(trials("serp", range(seeds)), lambda trial: True, processes)
    assert [len(group) for group in groups] == sizes


def test_variants_and_algorithms_are_apart_and_each_is_spread_over_the_processes() -> None:
    todo = [
        Trial(name, variant, seed)
        for seed in range(5)
        for name in ("serp", "dqn", "mrp")
        for variant in ("walk", "wrong")
    ]
    groups = grouped(todo, lambda trial: trial.algorithm != "mrp", 2)
    assert [len(group) for group in groups] == [3] * 4 + [2] * 4 + [1] * 10


@pytest.mark.parametrize("rate", [0.001, 0.02])
def test_time_left_is_exact_where_trials_take_turns_at_constant_speed(rate: float) -> None:
    now, budget = 7.0, 1_000
    groups = [trials("serp", (0, 1, 2)), trials("serp", (3, 4))]
    todo = [trial for group in groups for trial in group]
    outlook = Outlook(todo, budget, 1, lambda: now, groups)
    left = rate * budget * len(todo)
    for group in groups:
        for steps in (0, 10, 300, 900):
            for trial in group:
                outlook.notice(trial, steps)
            if steps:
                expected = left - rate * steps * len(group)
                assert outlook.seconds_left() == pytest.approx(expected)
            following = {0: 10, 10: 300, 300: 900, 900: budget}[steps]
            now += rate * (following - steps) * len(group)
        for trial in group:
            outlook.end(trial, complete=True)
        left -= rate * budget * len(group)
    assert outlook.seconds_left() == 0.0


def test_a_group_is_not_spread_over_processes_in_the_time_left() -> None:
    now = 0.0
    groups = [trials("serp", range(4)), trials("dqn", range(1))]
    outlook = Outlook([*groups[0], *groups[1]], 100, 2, lambda: now, groups)
    for trial in groups[0]:
        outlook.notice(trial, 0)
    now += 40.0
    for trial in groups[0]:
        outlook.notice(trial, 10)  # a second a step of one
    assert outlook.seconds_left() == pytest.approx(4 * 90.0)
