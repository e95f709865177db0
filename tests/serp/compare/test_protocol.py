"""The equal terms: whole numbers, and when an evaluation is due."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from serp.compare.protocol import ComparisonProtocol
from serp.errors import SettingsError


def test_evaluations_are_due_at_equal_distances_and_at_the_end() -> None:
    conditions = ComparisonProtocol(env_steps=100, evaluate_every=30)
    assert [k for k in range(1, 101) if conditions.due(k)] == [30, 60, 90, 100]
    even = ComparisonProtocol(env_steps=90, evaluate_every=30)
    assert [k for k in range(1, 91) if even.due(k)] == [30, 60, 90]
    once = ComparisonProtocol(env_steps=7, evaluate_every=1_000)
    assert [k for k in range(1, 8) if once.due(k)] == [7]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("env_steps", 0),
        ("env_steps", 1.5),
        ("env_steps", None),
        ("evaluate_every", 0),
        ("evaluation_episodes", -1),
        ("final_episodes", "many"),
        ("final_episodes", True),
        ("evaluation_seed", -1),
    ],
)
def test_what_is_no_whole_number_in_its_range_is_refused(name: str, value: Any) -> None:
    given: Any = {"env_steps": 10, "evaluate_every": 5, name: value}
    with pytest.raises(SettingsError, match=f"{name} must be a whole number >= "):
        ComparisonProtocol(**given)


def test_they_survive_json_numpys_numbers_too() -> None:
    conditions = ComparisonProtocol(env_steps=np.int64(10), evaluate_every=5)  # type: ignore[arg-type]
    again = ComparisonProtocol.from_dict(json.loads(json.dumps(conditions.as_dict())))
    assert again == conditions
