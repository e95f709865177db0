from __future__ import annotations

import numpy as np
import pytest

from serp.model.flags import APPLICABLE, TERMINAL, UNSAFE
from serp.planning.forecast import SAFE, Forecast
from serp.planning.limits import Bound


def forecast(
    values: list[float], steps: list[int], flags: list[int] | None = None, choice: int = 0
) -> Forecast:
    return Forecast(
        choice=choice,
        value=np.array(values),
        path_risk=np.array([float(s != SAFE) for s in steps]),
        safe_steps=np.array(steps, dtype=np.int64),
        reward=np.zeros(len(values)),
        flags=np.array(flags or [int(s >= 0) for s in steps], dtype=np.int64),
        depth=1,
        bound=Bound.DEPTH,
    )


def test_flags_are_told_apart() -> None:
    flags = [0, APPLICABLE, APPLICABLE | UNSAFE, APPLICABLE | TERMINAL, 7]
    found = forecast([0.0] * 5, [-1, SAFE, 0, SAFE, 0], flags)
    assert found.applicable.tolist() == [False, True, True, True, True]
    assert found.unsafe.tolist() == [False, False, True, False, True]
    assert found.terminal.tolist() == [False, False, False, True, True]
    assert found.applicable.dtype == np.bool_


@pytest.mark.parametrize(
    ("values", "steps", "expected"),
    [
        ([1.0, 1.0, 1.0], [SAFE] * 3, True),
        ([1.0, 1.0, 1.5], [SAFE] * 3, False),
        ([1.0, 1.0], [SAFE, 2], False),
        ([1.0, 1.0], [2, 2], True),
        ([1.0, -np.inf, 1.0], [SAFE, -1, SAFE], True),
        ([1.0, -np.inf], [SAFE, -1], False),  # a single action is no tie
        ([-np.inf, -np.inf], [-1, -1], False),
        ([], [], False),
    ],
)
def test_indifferent_is_when_all_that_is_safe_promises_the_same(
    values: list[float], steps: list[int], expected: bool
) -> None:
    assert forecast(values, steps).indifferent is expected


def test_an_unsafe_action_is_no_choice_while_there_is_another() -> None:
    flags = [APPLICABLE, APPLICABLE | UNSAFE, APPLICABLE]
    assert forecast([1.0, 5.0, 1.0], [SAFE, 0, SAFE], flags).indifferent
    assert not forecast([1.0, 5.0, 2.0], [SAFE, 0, SAFE], flags).indifferent
    assert not forecast([1.0, 5.0], [SAFE, 0], flags[:2]).indifferent
    assert forecast([1.0, 1.0], [0, 0], [APPLICABLE | UNSAFE] * 2).indifferent


def test_safe_is_about_the_whole_chosen_path() -> None:
    assert forecast([1.0, 2.0], [SAFE, 3], choice=0).safe
    assert not forecast([1.0, 2.0], [SAFE, 3], choice=1).safe
    assert not forecast([-np.inf], [-1], choice=-1).safe
