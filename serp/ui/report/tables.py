"""What was refused: a table by action and reason, and each event that was prevented."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.text import percent, plural, readable
from serp.agent.causes import Cause
from serp.agent.decision import Reason
from serp.agent.explanation import causes_ahead, step_causes
from serp.model.flags import APPLICABLE
from serp.model.transition_model import TransitionModel, Vector
from serp.runs.agreeing import RunModel, agreeing_planner
from serp.runs.recording import VETO_COLUMNS, Recording, vetoed
from serp.runs.recording_format import REASONS
from serp.runs.step_account import error_units, in_units, predicted_states
from serp.ui.report.recorded_steps import RecordedSteps


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


_LARGE: Final = 0.05
"""Share of the steps whose largest errors are called large."""
_MOST: Final = 12
"""Fluents and actions in the table, and worst steps in the list."""
_HEAT: Final = (0.1, 0.5, 1.0, 2.0)
"""Errors, in units, from which a cell is coloured more."""


@dataclass(frozen=True)
class ModelErrors:
    """Predictions of the model as written, one step ahead.

    Attributes:
        predicted: Next states `[N, F]`; NaN where there is no prediction.
        units: `[F]` what a fluent usually changes by in a step (root mean square); of predicates 1.
        errors: `[N, F]` absolute errors in these units; NaN without a prediction.
        largest: `[N]` the largest error of a step; 0 without a prediction.
        limit: Errors from here on are called large: those of a twentieth of the steps, at least 1.
    """

    predicted: Vector
    units: Vector
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

    Args:
        model: The model.
        steps: The steps.
        usual: `[F]` what a fluent usually changes by; one that never changes is measured by what
            it is predicted to change by.
    """
    model, states = model.written, steps["state"]
    predicted = predicted_states(model, states, steps.ground)
    said = np.nan_to_num(predicted - states)
    units = error_units(model, usual, np.sqrt(np.square(said).sum(axis=0) / max(1, len(said))))
    errors = in_units(predicted - steps.next_states, units)
    largest = np.nan_to_num(errors).max(axis=1, initial=0.0)
    limit = float(np.quantile(largest, 1.0 - _LARGE)) if len(largest) else 0.0
    return ModelErrors(predicted, units, errors, largest, max(1.0, limit))


def error_table(
    found: ModelErrors, model: TransitionModel, actions: list[str], steps: RecordedSteps
) -> dict[str, Any]:
    """Return the table of errors by fluent and action, and the worst steps, for the page."""
    squares = np.nan_to_num(found.errors) ** 2
    known = np.isfinite(found.errors).all(axis=1)
    if not known.any():
        return {"rows": [], "says": "There are no predictions to compare."}
    executed = steps["action"]
    used = [a for a in range(len(actions)) if (executed[known] == a).any()]
    by_fluent = squares[known].mean(axis=0)
    wrong = [int(f) for f in np.argsort(-by_fluent, kind="stable") if by_fluent[f] > 0.0]
    if not wrong:
        says = f"Every prediction of the file came true, in {plural(int(known.sum()), 'step')}."
        return {"rows": [], "says": says}
    worst_first = sorted(used, key=lambda a: -float(squares[known & (executed == a)].mean()))
    shown = sorted(worst_first[:_MOST])
    rows = [
        {
            "fluent": model.fluents[f].name,
            "unit": readable(float(found.units[f])) if model.fluents[f].numeric else "–",
            "cells": [_cell(found, model, f, a, actions, known & (executed == a)) for a in shown],
        }
        for f in wrong[:_MOST]
    ]
    left = [text for text in (_left(len(wrong), "fluent"), _left(len(used), "action")) if text]
    return {
        "says": f"The file as it is written, without what the run learned, predicts the next step: "
        f"compared with what was observed in {plural(int(known.sum()), 'step')}.",
        "rows": rows,
        "actions": [actions[a] for a in shown],
        "left": " and ".join(left),
        "worst": _worst(found, model, steps, actions),
    }


def _left(count: int, what: str) -> str:
    return f"{plural(count - _MOST, what)} with smaller errors left out" if count > _MOST else ""


def _cell(
    found: ModelErrors,
    model: TransitionModel,
    fluent: int,
    action: int,
    actions: list[str],
    rows: NDArray[np.bool_],
) -> dict[str, Any]:
    errors = found.errors[rows, fluent]
    size = float(np.sqrt(np.mean(errors**2)))
    about = model.fluents[fluent]
    large = (errors >= (found.limit if about.numeric else 1.0)).any()
    off = f"off by {readable(found.limit)} or more" if about.numeric else "came out otherwise"
    shown = "0" if size == 0.0 else "< 0.01" if size < 0.01 else f"{size:.2f}"
    return {
        "shown": shown if about.numeric else percent(size**2),
        "heat": sum(size >= limit for limit in _HEAT),
        "test": {"executed": [action], "fluents": [fluent]} if large else None,
        "says": f"{actions[action]}: ({about.name}) {off}",
    }


def _worst(
    found: ModelErrors, model: TransitionModel, steps: RecordedSteps, actions: list[str]
) -> list[dict[str, Any]]:
    """Return the worst steps: of each fluent and action the worst one, and of these some."""
    errors = np.nan_to_num(found.errors)
    executed = steps["action"]
    cells = []
    for action in np.unique(executed).tolist():
        rows = np.flatnonzero(executed == action)
        for fluent, at in enumerate(errors[rows].argmax(axis=0).tolist()):
            cells.append((-float(errors[rows[at], fluent]), int(rows[at]), fluent))
    worst = []
    for error, step, fluent in sorted(cells)[:_MOST]:
        if -error < _HEAT[0]:
            break
        about = model.fluents[fluent]
        said, came = (
            readable(float(values[step, fluent])) if about.numeric
            else str(bool(values[step, fluent])).lower()
            for values in (found.predicted, steps.next_states)
        )  # fmt: skip
        worst.append(
            {
                "step": step,
                "where": steps.place_of(step),
                "says": f"after {actions[int(executed[step])]}: ({about.name}) predicted {said}, "
                f"observed {came}",
            }
        )
    return worst


_MOST_OF_REFUSALS: Final = 20
"""Actions in the table."""
_EXAMPLES: Final = 3
_TRIED: Final = 5
"""Vetoes for what lies ahead that are planned again, until one tells what that is."""
_SECONDS: Final = 4.0
"""Time for planning one of them again."""
_DECIDES: Final = {
    Reason.UNSAFE: ("unsafe",),
    Reason.NO_SAFE_ACTION: ("unsafe", "risk"),
    Reason.TOO_RISKY: ("risk",),
    Reason.LEAST_RISK: ("risk", "unsafe"),
    Reason.NOT_APPLICABLE: ("failed",),
    Reason.LOW_REWARD: ("reward",),
}
"""Reason → kinds of causes that it is about."""


def veto_table(recording: Recording, actions: list[str]) -> dict[str, Any]:
    """Return the refused proposals of a whole recording by action and reason, for the page."""
    columns = recording.columns("proposed", *VETO_COLUMNS)
    refused = vetoed(columns)
    counts: Counter[tuple[int, int]] = Counter(
        zip(columns["proposed"][refused].tolist(), columns["reason"][refused].tolist(), strict=True)
    )
    reasons = sorted({reason for _, reason in counts})
    by_action: Counter[int] = Counter()
    for (action, _), count in counts.items():
        by_action[action] += count
    most = max(counts.values(), default=1)
    rows = []
    for action, total in by_action.most_common(_MOST_OF_REFUSALS):
        name = actions[action]
        cells = [
            {
                "count": counts[action, reason],
                "shown": f"{counts[action, reason]:,}" if counts[action, reason] else "",
                "heat": min(4, 1 + int(4 * counts[action, reason] / most))
                if counts[action, reason] else 0,
                "test": {"vetoed": True, "proposed": action, "reason": reason},
                "says": f"{name}: {REASONS[reason]}",
            }
            for reason in reasons
        ]  # fmt: skip
        rows.append({"action": name, "cells": cells, "sum": f"{total:,}"})
    left = len(by_action) - len(rows)
    return {
        "rows": rows,
        "reasons": [REASONS[reason].removeprefix("proposal ") for reason in reasons],
        "left": f"{plural(left, 'action')} with fewer left out" if left else "",
    }


def prevented(steps: RecordedSteps, causes: CauseTable, actions: list[str]) -> list[dict[str, Any]]:
    """Return each distinct thing that vetoes prevented, the most frequent first, for the page.

    A veto is counted for what decided it: the effect that makes the step unsafe or risky, the
    condition that does not hold, of a low reward the largest loss. Vetoes of which the file says
    nothing one step ahead are counted by their reason. `steps` of a card are its vetoes.
    """
    found: dict[tuple[int, str, int], list[int]] = {}
    for step in np.flatnonzero(steps.vetoed).tolist():
        reason = REASONS[steps["reason"][step]]
        action = int(steps["proposed"][step])
        cause = _decisive(causes, step, action, reason) if action >= 0 else -1
        key = (cause, "", -1) if cause >= 0 else (-1, str(reason), action)
        found.setdefault(key, []).append(step)
    cards: list[dict[str, Any]] = []
    for (cause, reason, _), where in sorted(found.items(), key=lambda each: -len(each[1])):
        proposed = Counter(actions[steps["proposed"][step]] for step in where)
        names = ", ".join(name for name, _ in proposed.most_common(4))
        names += f" and {len(proposed) - 4} more" if len(proposed) > 4 else ""
        cards.append(
            {
                "count": f"{len(where):,} ×",
                "cause": cause,
                "ahead": _soonest(steps, where) if reason == Reason.UNSAFE_AHEAD else [],
                "what": names if cause >= 0 else f"{names}: {reason.removeprefix('proposal ')}",
                "examples": [
                    {"step": step, "says": steps.place_of(step)} for step in _spread(where)
                ],
                "test": {"card": len(cards) + 1},
                "steps": where,
            }
        )
    return cards


def _soonest(steps: RecordedSteps, where: list[int]) -> list[int]:
    """Return positions of some vetoes for what lies ahead, the one with the nearest risk first."""
    proposed = steps["proposed"][where]
    order = np.argsort(steps["safe_steps"][where, proposed], kind="stable")[:_TRIED]
    return [int(steps.positions[where[k]]) for k in order]


def unsafe_ahead_by(read: RunModel, recording: Recording, positions: list[int]) -> Cause | None:
    """Return what of the file is unsafe on the best path by a proposal, planned again.

    Args:
        read: The run's model.
        recording: The recording.
        positions: Steps in which the proposal was refused for what lies ahead; the first of them
            counts in which planning again finds something unsafe.
    """
    for position in positions:
        step = recording.step(position)
        planner, decision = agreeing_planner(read, step), step.decision
        ground = int(decision.forecast.ground[decision.proposed])
        if planner is None or ground < 0:
            continue
        path = planner.paths(step.state, _SECONDS)[ground]
        for cause in causes_ahead(planner.model, step.state, path):
            if cause.what == "unsafe":
                return cause
    return None


def _decisive(causes: CauseTable, step: int, action: int, reason: Reason) -> int:
    """Return the cause that a veto is about; -1 if it is not known."""
    kinds = _DECIDES.get(reason, ())
    found = [
        (amount, cause)
        for cause, amount in causes.of(step, action)
        if causes.causes[cause].what in kinds
    ]
    return min(found)[1] if found else -1


def _spread(where: list[int]) -> list[int]:
    """Return some steps: the first, the last, and in between."""
    positions = np.linspace(0, len(where) - 1, min(_EXAMPLES, len(where)))
    return [where[k] for k in np.unique(positions.astype(np.int64)).tolist()]
