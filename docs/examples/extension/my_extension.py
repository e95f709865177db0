"""A strategy, a planner and a learner that serp finds by their entry points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import serp


class PlannerFirst(serp.Strategy):
    """The planner acts until the learner begins to learn.

    Args:
        settings: All settings.
        seed: Seed of its draws; it draws nothing.
    """

    def __init__(self, settings: serp.Settings, seed: Any) -> None:
        super().__init__(settings, seed)
        self._left = settings.learner.learning_starts

    def propose(self, situation: Any, learner: Any) -> Any:
        """Return the learner's proposal, or None where it is the planner's turn."""
        return None if self._left else learner.propose(situation.admissible)

    def end_unit(self, unit: str) -> None:
        """Count the env steps."""
        if unit == "step":
            self._left = max(0, self._left - 1)

    def state_dict(self) -> dict[str, Any]:
        """Return what a checkpoint keeps."""
        return {"left": self._left}

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned."""
        self._left = int(meta["left"])


def one_step(model: serp.TransitionModel, settings: serp.PlannerSettings) -> serp.Lookahead:
    """Return a planner that looks one action ahead, whatever the settings say."""
    return serp.Lookahead(model, settings.replace(depth=1, repeat=1))


def linear(
    input_size: int, action_count: int, settings: serp.LearnerSettings, *rest: Any, **options: Any
) -> serp.DQN:
    """Return a learner whose values are linear in its input."""
    return serp.DQN(input_size, action_count, settings.replace(hidden=()), *rest, **options)
