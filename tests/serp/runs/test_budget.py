"""When a training ends."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from serp.errors import SettingsError
from serp.runs.trainer import Budget


def at(episode: int, env_steps: int, units: int) -> Any:
    return SimpleNamespace(episode=episode, env_steps=env_steps, units=units)


def test_the_first_end_that_is_reached_counts() -> None:
    assert not Budget().spent_by(at(10**9, 10**9, 10**9))
    budget = Budget(episodes=10, env_steps=100, units=3)
    assert not budget.spent_by(at(9, 99, 2))
    for reached in (at(10, 0, 0), at(0, 100, 0), at(0, 101, 0), at(0, 0, 3)):
        assert budget.spent_by(reached)


@pytest.mark.parametrize("name", ["episodes", "env_steps", "units"])
def test_what_is_no_number_of_something_is_refused(name: str) -> None:
    with pytest.raises(SettingsError, match=rf"budget\.{name} must be .*, not "):
        Budget(**{name: 0})
