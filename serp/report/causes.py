"""What of the file is behind each alternative of each step, every distinct cause once."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from serp.explanation.causes import Cause
from serp.explanation.decision import step_causes
from serp.model.flags import APPLICABLE
from serp.model.transition_model import TransitionModel
from serp.report.recorded_steps import RecordedSteps


class CauseTable:
    """The causes of steps, one control period ahead.

    Attributes:
        causes: Every distinct cause, without amount and values.
        at: `[N + 1]` where the entries of each step begin.
        action, cause, amount: Of each entry the action of the environment, the position of its
            cause in `causes`, and the amount (0 where a cause has none).
    """

    def __init__(self, model: TransitionModel, steps: RecordedSteps) -> None:
        numbers: dict[Any, int] = {}
        ends, actions, causes, amounts = [0], [], [], []
        self.causes: list[Cause] = []
        rows = zip(
            steps["state"], steps["ground"].tolist(), steps["flags"].tolist(),
            steps["reward"].tolist(), strict=True,
        )  # fmt: skip
        for state, ground, flags, reward in rows:
            for action, each in enumerate(ground):
                if each < 0:
                    continue
                applicable = flags[action] & APPLICABLE
                gained = reward[action] if applicable else None
                found = step_causes(model, state, each, flags[action], gained)
                for cause in found:
                    key = (cause.what, cause.origin, cause.name, cause.text, cause.place)
                    if key not in numbers:
                        numbers[key] = len(numbers)
                        self.causes.append(replace(cause, amount=None, reads={}))
                    actions.append(action)
                    causes.append(numbers[key])
                    amounts.append(cause.amount or 0.0)
            ends.append(len(causes))
        self.at = np.array(ends, np.uint32)
        self.action = np.array(actions, np.uint16)
        self.cause = np.array(causes, np.uint32)
        self.amount = np.array(amounts, np.float64)

    def of(self, step: int, action: int) -> list[tuple[int, float]]:
        """Return the causes of an action in a step: position and amount."""
        own = slice(self.at[step], self.at[step + 1])
        found = zip(self.action[own], self.cause[own], self.amount[own], strict=True)
        return [(int(cause), float(amount)) for other, cause, amount in found if other == action]
