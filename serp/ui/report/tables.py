"""What is behind the steps of a report: causes, errors of the model, what was prevented."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from serp.agent.causes import Cause
from serp.agent.decision import Reason
from serp.agent.explanation import step_causes
from serp.model.flags import APPLICABLE
from serp.model.transition_model import TransitionModel, Vector
from serp.runs.recording import REASONS
from serp.runs.step_account import error_units, in_units, predicted_states
from serp.ui.report.recorded_steps import RecordedSteps

_DECIDES: Final = {
    Reason.UNSAFE: ("unsafe",),
    Reason.NO_SAFE_ACTION: ("unsafe", "risk"),
    Reason.TOO_RISKY: ("risk",),
    Reason.LEAST_RISK: ("risk", "unsafe"),
    Reason.NOT_APPLICABLE: ("failed",),
    Reason.LOW_REWARD: ("reward",),
}
"""Reason → kinds of causes that it is about."""


class CauseTable:
    """What of the file is behind the executed and the refused action of each step.

    Attributes:
        causes: Every distinct cause, without amount and values.
        at: `[N + 1]` where the entries of each step begin.
        action, cause, amount: Of each entry the action of the environment, the position of its
            cause in `causes`, and the amount (0 where a cause has none).
    """

    def __init__(
        self,
        model: TransitionModel,
        steps: RecordedSteps,
        on_step: Callable[[], None],
    ) -> None:
        numbers: dict[Any, int] = {}
        ends, actions, positions, amounts = [0], [], [], []
        self.causes: list[Cause] = []
        executed, proposed = steps["action"].tolist(), steps["proposed"].tolist()
        for step, refused in enumerate(steps.vetoed.tolist()):
            shown = {executed[step], proposed[step] if refused else executed[step]}
            for action in sorted(shown - {-1}):
                ground = int(steps["ground"][step, action])
                flags = int(steps["flags"][step, action])
                if ground < 0:
                    continue
                reward = float(steps["reward"][step, action]) if flags & APPLICABLE else None
                for cause in step_causes(model, steps["state"][step], ground, flags, reward):
                    key = (cause.what, cause.origin, cause.name, cause.text, cause.place)
                    if key not in numbers:
                        numbers[key] = len(numbers)
                        self.causes.append(replace(cause, amount=None, reads={}))
                    actions.append(action)
                    positions.append(numbers[key])
                    amounts.append(cause.amount or 0.0)
            ends.append(len(positions))
            on_step()
        self.at = np.array(ends, np.uint32)
        self.action = np.array(actions, np.uint16)
        self.cause = np.array(positions, np.uint32)
        self.amount = np.array(amounts, np.float64)

    def decisive(self, step: int, action: int, reason: str) -> int:
        """Return the cause that a veto is about; -1 if it is not known."""
        kinds = _DECIDES.get(Reason(reason), ())
        own = slice(self.at[step], self.at[step + 1])
        entries = zip(self.action[own], self.cause[own], self.amount[own], strict=True)
        deciding = [
            (float(amount), int(cause))
            for other, cause, amount in entries
            if other == action and self.causes[cause].what in kinds
        ]
        return min(deciding)[1] if deciding else -1


@dataclass(frozen=True)
class ModelErrors:
    """Predictions of the model as written, one step ahead.

    Attributes:
        predicted: Next states `[N, F]`; NaN where there is no prediction.
        errors: `[N, F]` absolute errors in units of what a fluent usually changes by in a step
            (root mean square); of predicates 0 or 1; NaN without a prediction.
        largest: `[N]` the largest error of a step; 0 without a prediction.
        limit: Errors from here on are called large: those of a twentieth of the steps, at least 1.
    """

    predicted: Vector
    errors: Vector
    largest: Vector
    limit: float

    @property
    def mean(self) -> float | None:
        """Root mean square of all errors; None without any."""
        known = np.isfinite(self.errors)
        return float(np.sqrt(np.mean(self.errors[known] ** 2))) if known.any() else None


def model_errors(model: TransitionModel, steps: RecordedSteps, usual: Vector) -> ModelErrors:
    """Compare what the model as written predicts with what was observed.

    `usual` `[F]` is what a fluent usually changes by; one that never changes is measured by what it
    is predicted to change by.
    """
    model, states = model.written, steps["state"]
    predicted = predicted_states(model, states, steps.ground)
    changes = np.nan_to_num(predicted - states)
    own = np.sqrt(np.square(changes).sum(axis=0) / max(1, len(changes)))
    units = error_units(model, usual, own)
    errors = in_units(predicted - steps["next_state"], units)
    largest = np.nan_to_num(errors).max(axis=1, initial=0.0)
    limit = float(np.quantile(largest, 0.95)) if len(largest) else 0.0
    return ModelErrors(predicted, errors, largest, max(1.0, limit))


def prevented(steps: RecordedSteps, causes: CauseTable, actions: list[str]) -> list[dict[str, Any]]:
    """Return each distinct thing that vetoes prevented, the most frequent first, for the page.

    A veto is counted for what decided it: the effect that makes the step unsafe or risky, the
    condition that does not hold, of a low reward the largest loss; else for its reason. `steps` of
    a card are its vetoes.
    """
    groups: dict[tuple[int, str, int], list[int]] = {}
    for step in np.flatnonzero(steps.vetoed).tolist():
        reason, action = REASONS[steps["reason"][step]], int(steps["proposed"][step])
        cause = causes.decisive(step, action, reason) if action >= 0 else -1
        key = (cause, "", -1) if cause >= 0 else (-1, str(reason), action)
        groups.setdefault(key, []).append(step)
    cards: list[dict[str, Any]] = []
    for (cause, reason, _), where in sorted(groups.items(), key=lambda item: -len(item[1])):
        proposed = Counter(actions[steps["proposed"][step]] for step in where)
        names = ", ".join(name for name, _ in proposed.most_common(4))
        names += f" and {len(proposed) - 4} more" if len(proposed) > 4 else ""
        first, last = where[0], where[-1]
        cards.append(
            {
                "count": f"{len(where):,} ×",
                "cause": cause,
                "what": names if cause >= 0 else f"{names}: {reason.removeprefix('proposal ')}",
                "examples": [
                    {"step": step, "says": steps.place_of(step)} for step in sorted({first, last})
                ],
                "steps": where,
            }
        )
    return cards
