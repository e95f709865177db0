from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.errors import RunError
from serp.model.transition_model import TransitionModel
from serp.sysid import monitor as module
from serp.sysid.monitor import ADAPTED, END, OBSERVED, REWARD, WRITTEN, Monitor, accumulate
from tests.generated.profile import examples
from tests.serp.sysid.rolls import from_text

LAMP = """(define (domain lamp)
  (:predicates (lit) (dark))
  (:functions (heat))
  (:action switch :parameters () :precondition (and)
    :effect (and (lit) (not (dark)) (increase (heat) 1.0)))
  (:action wait :parameters () :precondition (and)
    :effect (and (not (lit)) (dark) (decrease (heat) 0.5))))
"""
MODEL = from_text(LAMP).model
NUMERIC = [*(f.numeric for f in MODEL.fluents), True, False]

Array = np.ndarray[Any, Any]
Seen = tuple[Array, int, Array]  # state, action, [3, F + 2] written, adapted, observed


def states_of(rng: np.random.Generator, model: TransitionModel) -> Array:
    return np.array([rng.normal() if f.numeric else float(rng.integers(2)) for f in model.fluents])


def seen(count: int, seed: int = 0) -> list[Seen]:
    rng = np.random.default_rng(seed)
    steps: list[Seen] = []
    for _ in range(count):
        state = states_of(rng, MODEL)
        observed = np.r_[states_of(rng, MODEL), rng.normal(), rng.integers(2)]
        action = int(rng.integers(len(MODEL.actions)))
        written = np.r_[MODEL.step(state, action).state, rng.normal(), rng.integers(2)]
        adapted = written if rng.random() < 0.3 else (written + observed) / 2
        steps.append((state, action, np.stack([written, adapted, observed])))
    return steps


def observe(monitor: Monitor, *steps: Seen) -> Monitor:
    for state, action, step in steps:
        monitor.skipped += not accumulate(state, step, monitor.row_of(action), monitor.tables)
    return monitor


def told(monitor: Monitor) -> str:
    return repr(monitor.rows())


@given(count=st.integers(0, 60), seed=st.integers(0, 1000))
@examples(30)
def test_rows_are_what_numpy_finds(count: int, seed: int) -> None:
    steps = seen(count, seed)
    rows = {(row.action, row.fluent): row for row in observe(Monitor(MODEL), *steps).rows()}
    names = [*(f.name for f in MODEL.fluents), REWARD, END]
    done = {action for _, action, _ in steps}
    assert set(rows) == {(MODEL.actions[a].name, name) for a in done for name in names}
    values = np.array([v for s, _, step in steps for v in (np.r_[s, 0.0, 0.0], step[OBSERVED])])
    for action in done:
        before = np.array([np.r_[s, 0.0, 0.0] for s, a, _ in steps if a == action])
        all_steps = np.array([step for _, a, step in steps if a == action])
        for f, name in enumerate(names):
            row, observed = rows[MODEL.actions[action].name, name], all_steps[:, OBSERVED, f]
            assert (row.samples, row.numeric) == (len(observed), NUMERIC[f])
            assert row.scale == np.ptp(values[:, f])
            for side, k in ((row.written, WRITTEN), (row.adapted, ADAPTED)):
                predicted = all_steps[:, k, f]
                error = observed - predicted
                assert side.bias == pytest.approx(error.mean(), abs=1e-12)
                assert side.rmse == pytest.approx(np.sqrt((error**2).mean()), abs=1e-12)
                changes = np.abs(predicted - before[:, f]) > 0.5
                changed = observed != before[:, f]
                counts = changes.sum(), (changes & changed).sum(), (~changes & changed).sum()
                assert side[2:] == ((0, 0, 0) if NUMERIC[f] else counts)
            sizes = np.abs(observed - all_steps[:, WRITTEN, f])
            worst = int(sizes.argmax())
            assert (row.worst is None) == (sizes[worst] == 0.0)
            if row.worst is not None:
                assert row.worst[:4] == (sizes[worst], *all_steps[worst, :, f])
                np.testing.assert_array_equal(row.worst.state, before[worst, :-2])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e200])
@pytest.mark.parametrize("which", ["state", WRITTEN, ADAPTED, OBSERVED])
def test_what_is_no_number_is_skipped_and_poisons_nothing(bad: float, which: int | str) -> None:
    steps = seen(40)
    monitor = Monitor(MODEL)
    for k, (state, action, step) in enumerate(steps):
        spoiled, record = state.copy(), step.copy()
        if isinstance(which, str):
            spoiled[k % 3] = bad
        else:
            record[which, k % 5] = bad
        observe(monitor, (state, action, step), (spoiled, action, record))
    assert monitor.skipped == len(steps)
    assert told(monitor) == told(observe(Monitor(MODEL), *steps))


@pytest.mark.parametrize("before", [0, 1, 70])
@pytest.mark.parametrize("states", [True, False])
def test_resumed_equals_uninterrupted_bit_for_bit(
    before: int, states: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not states:
        monkeypatch.setattr(module, "_MAX_STATES", 0)
    steps = seen(150)
    whole, resumed = observe(Monitor(MODEL), *steps), Monitor(MODEL)
    resumed.load_state_dict(*observe(Monitor(MODEL), *steps[:before]).state_dict())
    observe(resumed, *steps[before:])
    assert told(resumed) == told(whole)
    assert {row.worst.state is not None for row in whole.rows() if row.worst} == {states}
    (arrays, meta), (again, meta_again) = whole.state_dict(), resumed.state_dict()
    assert meta_again == meta
    assert {k: a.tobytes() for k, a in again.items()} == {k: a.tobytes() for k, a in arrays.items()}


def test_a_saved_monitor_that_does_not_fit_is_refused_and_changes_nothing() -> None:
    monitor = observe(Monitor(MODEL), *seen(30))
    before = told(monitor)
    arrays, meta = observe(Monitor(MODEL), *seen(20, seed=1)).state_dict()
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
        assert told(monitor) == before
