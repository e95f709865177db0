"""What was refused: a table by action and reason, and each event that was prevented."""

from __future__ import annotations

from collections import Counter
from typing import Any, Final

import numpy as np

from serp._util.text import plural
from serp.control.decision import Reason
from serp.explanation.causes import Cause
from serp.explanation.decision import causes_ahead
from serp.report.causes import CauseTable
from serp.report.recorded_steps import RecordedSteps
from serp.review.agreeing import agreeing_planner
from serp.review.run_model import RunModel
from serp.runs.recording import VETO_COLUMNS, Recording, vetoed
from serp.runs.recording_format import REASONS

_MOST: Final = 20
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
    for action, total in by_action.most_common(_MOST):
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
