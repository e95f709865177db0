"""The protocol: whole numbers, and when an evaluation is due."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.comparison.protocol import ComparisonProtocol
from serp.errors import SettingsError


@given(st.integers(1, 200), st.integers(1, 300))
def test_evaluations_are_due_at_equal_distances_and_at_the_end(budget: int, every: int) -> None:
    protocol = ComparisonProtocol(env_steps=budget, evaluate_every=every)
    due = [k for k in range(1, budget + 1) if protocol.due(k)]
    assert due == sorted({*range(every, budget + 1, every), budget})


@pytest.mark.parametrize(
    ("name", "value"),
    [("env_steps", 0), ("env_steps", 1.5), ("env_steps", None), ("evaluate_every", 0),
     ("evaluation_episodes", -1), ("final_episodes", "many"), ("final_episodes", True),
     ("evaluation_seed", -1)],
)  # fmt: skip
def test_what_is_no_whole_number_in_its_range_is_refused(name: str, value: Any) -> None:
    given: Any = {"env_steps": 10, "evaluate_every": 5, name: value}
    with pytest.raises(SettingsError, match=f"{name} must be a whole number >= "):
        ComparisonProtocol(**given)


def test_numbers_of_numpy_survive_json() -> None:
    protocol = ComparisonProtocol(env_steps=np.int64(10), evaluate_every=5)  # type: ignore[arg-type]
    assert ComparisonProtocol(**json.loads(json.dumps(asdict(protocol)))) == protocol
