from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp import load_domain
from serp.errors import RunError
from serp.model.transition_model import TransitionModel
from serp.sysid import monitor as module
from serp.sysid.monitor import (
    ADAPTED,
    END,
    OBSERVED,
    REWARD,
    WRITTEN,
    Monitor,
    MonitorRow,
    accumulate,
)

DOMAIN = """(define (domain lamp)
  (:predicates (lit) (dark))
  (:functions (heat))
  (:action switch :parameters () :precondition (and)
    :effect (and (lit) (not (dark)) (increase (heat) 1.0)))
  (:action wait :parameters () :precondition (and)
    :effect (and (not (lit)) (dark) (decrease (heat) 0.5))))
"""


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> TransitionModel:
    file = Path(tmp_path_factory.mktemp("domain")) / "lamp.pddl"
    file.write_text(DOMAIN, encoding="utf-8")
    return load_domain(file).model


Array = np.ndarray[Any, Any]
Seen = tuple[Array, int, Array]  # state, action, [3, F + 2] written, adapted, observed


def states_of(rng: np.random.Generator, model: TransitionModel) -> Array:
    return np.array([rng.normal() if f.numeric else float(rng.integers(2)) for f in model.fluents])


def record(written: Array, adapted: Array, observed: Array) -> Array:
    """The record of a step, without reward or end where only fluents are given."""
    return np.stack([np.r_[side, np.zeros(5 - len(side))] for side in (written, adapted, observed)])


def seen_by(model: TransitionModel, count: int, seed: int = 0) -> list[Seen]:
    rng = np.random.default_rng(seed)
    steps: list[Seen] = []
    for _ in range(count):
        state = states_of(rng, model)
        observed = np.r_[states_of(rng, model), rng.normal(), rng.integers(2)]
        action = int(rng.integers(len(model.actions)))
        written = np.r_[model.step(state, action).state, rng.normal(), rng.integers(2)]
        adapted = written if rng.random() < 0.3 else (written + observed) / 2
        steps.append((state, action, record(written, adapted, observed)))
    return steps


def watched(model: TransitionModel, steps: list[Seen]) -> Monitor:
    monitor = Monitor(model)
    observe(monitor, *steps)
    return monitor


def observe(monitor: Monitor, *steps: Seen) -> None:
    for state, action, step in steps:
        monitor.skipped += not accumulate(state, step, monitor.row_of(action), monitor.tables)


def same(rows: list[MonitorRow], others: list[MonitorRow]) -> bool:
    return repr(rows) == repr(others)


@settings(max_examples=30, deadline=None)  # the first example compiles
@given(count=st.integers(0, 60), seed=st.integers(0, 1000))
def test_rows_are_what_numpy_finds(model: TransitionModel, count: int, seed: int) -> None:
    steps = seen_by(model, count, seed)
    rows = {(row.action, row.fluent): row for row in watched(model, steps).rows()}
    names = [*(f.name for f in model.fluents), REWARD, END]
    numeric = [*(f.numeric for f in model.fluents), True, False]
    done = {action for _, action, _ in steps}
    assert set(rows) == {(model.actions[a].name, name) for a in done for name in names}
    seen = np.array([v for s, _, step in steps for v in (np.r_[s, 0.0, 0.0], step[OBSERVED])])
    for action in done:
        mine = [step for step in steps if step[1] == action]
        state = np.array([np.r_[s, 0.0, 0.0] for s, _, _ in mine])
        observed = np.array([step[OBSERVED] for _, _, step in mine])
        for f, name in enumerate(names):
            row = rows[model.actions[action].name, name]
            assert row.samples == len(mine)
            assert row.scale == seen[:, f].max() - seen[:, f].min()
            assert row.numeric == numeric[f]
            for side, k in ((row.written, WRITTEN), (row.adapted, ADAPTED)):
                predicted = np.array([step[k] for _, _, step in mine])[:, f]
                error = observed[:, f] - predicted
                assert side.bias == pytest.approx(error.mean(), abs=1e-12)
                assert side.rmse == pytest.approx(np.sqrt((error**2).mean()), abs=1e-12)
                if not numeric[f]:
                    changes = np.abs(predicted - state[:, f]) > 0.5
                    changed = observed[:, f] != state[:, f]
                    assert side.predicted == changes.sum()
                    assert side.happened == (changes & changed).sum()
                    assert side.unpredicted == (~changes & changed).sum()
                else:
                    assert side.predicted == side.happened == side.unpredicted == 0
            worst = np.abs(observed - [step[WRITTEN] for _, _, step in mine])[:, f].max()
            assert (row.worst.error if row.worst else 0.0) == worst


def test_a_worst_case_is_told_as_it_was(model: TransitionModel) -> None:
    monitor = Monitor(model)
    heat = next(f.index for f in model.fluents if f.numeric)
    for size in (0.5, 3.0, 1.0):
        state = np.zeros(3)
        state[heat] = size
        written, adapted = model.step(state, 0).state, np.zeros(3)
        observe(monitor, (state, 0, record(written, adapted, np.full(3, size + 1.0 + size))))
    worst = next(row for row in monitor.rows() if row.numeric).worst
    assert worst is not None
    assert (worst.error, worst.written, worst.adapted, worst.observed) == (3.0, 4.0, 0.0, 7.0)
    assert worst.state is not None
    assert worst.state[heat] == 3.0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e200])
@pytest.mark.parametrize("which", ["state", WRITTEN, ADAPTED, OBSERVED])
def test_what_is_no_number_is_skipped_and_poisons_nothing(
    model: TransitionModel, bad: float, which: int | str
) -> None:
    steps = seen_by(model, 40)
    monitor, clean = Monitor(model), watched(model, steps)
    for k, (state, action, step) in enumerate(steps):
        spoiled, record = state.copy(), step.copy()
        if isinstance(which, str):
            spoiled[k % 3] = bad
        else:
            record[which, k % 5] = bad
        observe(monitor, (state, action, step), (spoiled, action, record))
    assert monitor.skipped == len(steps)
    assert same(monitor.rows(), clean.rows())


@pytest.mark.parametrize("before", [0, 1, 70])
@pytest.mark.parametrize("states", [True, False])
def test_resumed_equals_uninterrupted_bit_for_bit(
    model: TransitionModel, before: int, states: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not states:
        monkeypatch.setattr(module, "_MAX_STATES", 0)
    steps = seen_by(model, 150)
    whole, resumed = watched(model, steps), Monitor(model)
    resumed.load_state_dict(*watched(model, steps[:before]).state_dict())
    observe(resumed, *steps[before:])
    assert same(resumed.rows(), whole.rows())
    assert {row.worst.state is not None for row in whole.rows() if row.worst} == {states}
    (arrays, meta), (again, meta_again) = whole.state_dict(), resumed.state_dict()
    assert meta_again == meta
    assert {k: a.tobytes() for k, a in again.items()} == {k: a.tobytes() for k, a in arrays.items()}


def test_a_saved_monitor_that_does_not_fit_is_refused_and_changes_nothing(
    model: TransitionModel,
) -> None:
    monitor = watched(model, seen_by(model, 30))
    before = monitor.rows()
    arrays, meta = watched(model, seen_by(model, 20, seed=1)).state_dict()
    wrong: list[tuple[dict[str, Any], dict[str, Any]]] = [
        (arrays, {**meta, "fluents": 9}),
        (arrays, {**meta, "actions": 9}),
        ({k: a for k, a in arrays.items() if k != "table"}, meta),
        ({**arrays, "actions": arrays["actions"] + 5}, meta),
        ({**arrays, "actions": np.zeros_like(arrays["actions"])}, meta),
        ({**arrays, "table": -np.abs(arrays["table"])}, meta),
        ({**arrays, "states": arrays["states"][:-1]}, meta),
        ({**arrays, "bounds": arrays["bounds"][:, :-1]}, meta),
    ]
    for saved in wrong:
        with pytest.raises(RunError):
            monitor.load_state_dict(*saved)
        assert same(monitor.rows(), before)
