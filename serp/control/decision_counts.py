"""Counts of decisions: vetoes, steps by actor, unsafe steps, and how far the planner saw."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any, Final, Protocol

from serp._util.saved_state import Saved
from serp.control.decision import Actor, Reason
from serp.planning.limits import Bound


class _Countable(Protocol):
    """The part of a step that is counted; a `Decision` and a row of `decisions.csv` have it."""

    @property
    def executed_by(self) -> str: ...
    @property
    def reason(self) -> str: ...
    @property
    def vetoed(self) -> bool: ...
    @property
    def proposal_unsafe(self) -> bool: ...
    @property
    def unsafe(self) -> bool: ...
    @property
    def depth(self) -> int: ...
    @property
    def bound(self) -> str: ...
    @property
    def indifferent(self) -> bool: ...


STEPS_BY: Final[Mapping[str, str]] = {actor.value: f"{actor.value}_steps" for actor in Actor}
"""Actor → name of the count of steps in which its action was executed."""

SAFETY: Final = ("vetoes", "unsafe_predicted", "unsafe_executed", "no_safe_action")
SIGHT: Final = ("saw_all", "by_cells", "cut_short", "indifferent")
_SUMS: Final = (*SAFETY[1:], "saw_all", "by_cells", "cut_short", "layers_seen", "indifferent")
_BUDGETS: Final = (Bound.NODES.name.lower(), Bound.TIME.name.lower())
_ALL: Final = Bound.EXHAUSTED.name.lower()
_CELLS: Final = (Bound.CELLS.name.lower(), Bound.UNKNOWN.name.lower())


class DecisionCounts:
    """Counts over steps.

    Attributes:
        executed: Actor → steps in which its action was executed. They add up to `steps`.
        refused: Reason → proposals refused for it. They add up to `vetoes`.
        unsafe_predicted: Proposals that the domain file flags unsafe, or that are too risky.
        unsafe_executed: Executed actions that the domain file flags unsafe.
        no_safe_action: Steps in which every action was flagged or too risky.
        saw_all: Steps in which the planner saw everything that can be reached.
        by_cells: Steps in which values of cells stood for what lies beyond the lookahead.
        cut_short: Steps in which a budget of nodes or time ended its sight.
        layers_seen: Layers of states that it saw, summed over the steps in which it did not see
            everything.
        indifferent: Steps in which it had no reason to prefer one action.
    """

    def __init__(self) -> None:
        self.executed: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()
        self.unsafe_predicted = 0
        self.unsafe_executed = 0
        self.no_safe_action = 0
        self.saw_all = 0
        self.by_cells = 0
        self.cut_short = 0
        self.layers_seen = 0
        self.indifferent = 0

    def count(self, step: _Countable) -> None:
        """Count a step."""
        self.executed[step.executed_by] += 1
        if step.vetoed:
            self.refused[step.reason] += 1
        self.unsafe_predicted += step.proposal_unsafe
        self.unsafe_executed += step.unsafe
        self.no_safe_action += step.reason in (Reason.NO_SAFE_ACTION, Reason.LEAST_RISK)
        everything = step.bound == _ALL
        self.saw_all += everything
        self.by_cells += step.bound in _CELLS
        self.cut_short += step.bound in _BUDGETS
        self.layers_seen += 0 if everything else step.depth
        self.indifferent += step.indifferent

    @property
    def steps(self) -> int:
        """Number of steps counted."""
        return self.executed.total()

    @property
    def vetoes(self) -> int:
        """Number of proposals refused."""
        return self.refused.total()

    def numbers(self) -> dict[str, int]:
        """Return every count by the name of its column in `metrics.csv`."""
        return {
            **{name: self.executed[actor] for actor, name in STEPS_BY.items()},
            "vetoes": self.vetoes,
            **{name: getattr(self, name) for name in _SUMS},
        }

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `from_saved` takes."""
        return {
            "executed": [self.executed[actor] for actor in Actor],
            "refused": [self.refused[reason] for reason in Reason],
            **{name: getattr(self, name) for name in _SUMS},
        }

    @classmethod
    def from_saved(cls, meta: Any) -> DecisionCounts:
        """Return the counts that `state_dict` wrote."""
        tally, saved = cls(), Saved("counts", {}, meta)
        executed = saved.wholes("executed", len(Actor))
        refused = saved.wholes("refused", len(Reason))
        tally.executed.update(dict(zip(Actor, executed, strict=True)))
        tally.refused.update(dict(zip(Reason, refused, strict=True)))
        for name in _SUMS:
            setattr(tally, name, saved.whole(name))
        return tally

    def vetoes_by_reason(self) -> dict[str, int]:
        """Return reason → proposals refused for it, the most frequent first, ties by name."""
        found = {str(reason): count for reason, count in self.refused.items() if count}
        return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))


NUMBERS: Final = tuple(DecisionCounts().numbers())
"""Names of all counts; they are columns of `metrics.csv`."""


def total(metrics: Mapping[str, Any]) -> dict[str, int]:
    """Return every count over all episodes, given the columns of `metrics.csv` as arrays."""
    return {name: int(metrics[name].sum()) for name in NUMBERS}


def sight_of(counts: Mapping[str, int], steps: int) -> dict[str, float | None]:
    """Return how far the planner saw.

    The shares of all steps in which it saw everything that can be reached, in which values of cells
    stood for what lies beyond the layers that it saw, in which a budget cut it short, and in which
    it had no reason to prefer one action; and the mean number of layers that it saw in the steps in
    which it did not see everything.
    """
    shares = {name: counts[name] / steps if steps else None for name in SIGHT}
    partial = steps - counts["saw_all"]
    return {**shares, "mean_depth": counts["layers_seen"] / partial if partial else None}
