"""Rewards and ends that the file promises, beside those that came, by the line that says them.

A step that went otherwise is put down to the lines that apply to the predicted next state or to
the observed one, but not to both: there the file was wrong about the fluents. Where the same lines
apply to both, these are in doubt themselves; where none does, the file does not know what happened.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from serp.diagnosis.error_scales import Steps
from serp.diagnosis.findings import RuleFinding
from serp.model import ground as g
from serp.model.emit import Site
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.pddl.source import Place
from serp.sysid.monitor import END, REWARD
from serp.sysid.regression_data import RegressionData

_EQUAL = 0.1
"""A reward that differs by so little of the usual one is as predicted."""


class _Line(NamedTuple):
    schema: str
    place: Place | None


_NOTHING = _Line("", None)


@dataclass
class _Count:
    predicted: int = 0
    came: int = 0
    unpredicted: int = 0
    promised: float = 0.0
    observed: float = 0.0
    surprises: float = 0.0
    squares: float = 0.0


def find_rules(
    model: TransitionModel, sample: RegressionData, steps: Steps, predicted: Vector, units: Vector
) -> tuple[RuleFinding, ...]:
    """Return the lines on rewards and ends that went otherwise than predicted, the worst first.

    Args:
        model: The model as written.
        sample: The transitions.
        steps: What was observed in them.
        predicted: `[N, F + 2]` what the model predicts of them.
        units: `[F + 2]` see `serp.diagnosis.error_scales`.
    """
    width = len(model.fluents)
    rules = _Rules(model)
    counts = {REWARD: _Counts(), END: _Counts()}
    pairs = np.stack((predicted[:, width:], steps.after[:, width:]), axis=1)
    for row in np.flatnonzero((pairs != 0.0).any(axis=(1, 2)) & np.isfinite(pairs).all((1, 2))):
        state, action, after = sample.states[row], int(sample.actions[row]), sample.next_states[row]
        said = rules.predicted(state, action, pairs[row, 0])
        seen = rules.judged(state, action, after)
        for k, (fluent, own) in enumerate(counts.items()):
            promised, came = pairs[row, :, k].tolist()
            own.add(said[fluent], seen[fluent], promised, came, _EQUAL * float(units[width + k]))
    found = [
        RuleFinding(
            schema=line.schema,
            place=line.place,
            fluent=fluent,
            predicted=count.predicted,
            came=count.came,
            unpredicted=count.unpredicted,
            promised=count.promised / max(1, count.predicted),
            observed=count.observed / count.predicted
            if count.predicted
            else count.surprises / max(1, count.unpredicted),
            samples=len(sample),
            cost=count.squares / float(units[width + k]) ** 2 / len(sample),
        )
        for k, (fluent, own) in enumerate(counts.items())
        for line, count in own.lines.items()
        if count.squares > 0.0
    ]
    return tuple(sorted(found, key=_order))


def _order(finding: RuleFinding) -> tuple[float, str, int]:
    """Return what findings are sorted by: the most costly first, then as they stand in the file."""
    return -finding.cost, finding.fluent, -1 if finding.place is None else finding.place.start


@dataclass
class _Counts:
    """What came of the lines on rewards, or of those on ends."""

    lines: dict[_Line, _Count] = field(default_factory=dict)

    def add(
        self, said: set[_Line], seen: set[_Line], promised: float, came: float, equal: float
    ) -> None:
        """Count a step.

        Args:
            said: The lines that were predicted to apply.
            seen: Those that apply to what was observed.
            promised: What they say together.
            came: What was observed.
            equal: What is hardly a difference.
        """
        right, off = abs(came - promised) <= equal, (came - promised) ** 2
        for line in said:
            count = self.lines.setdefault(line, _Count())
            count.predicted += 1
            count.came += right
            count.promised += promised
            count.observed += came
        if not off:
            return
        if came == 0.0:  # a line that says something of it all the same is not to blame
            seen = seen & said
        blamed = said ^ seen or said or {_NOTHING}
        for line in blamed:
            count = self.lines.setdefault(line, _Count())
            count.squares += off / len(blamed)
            if line not in said and not right:
                count.unpredicted += 1
                count.surprises += came


class _Rules:
    """The lines of one model that give reward or end the task."""

    def __init__(self, model: TransitionModel) -> None:
        self._model = model
        ground = model.ground
        place = getattr(ground.goal, "place", None)
        self._goal = None if ground.goal is None else _Line("goal", place)
        self._metric = None if ground.metric is None else _Line("metric", None)

    def predicted(self, state: Vector, action: int, worth: Vector) -> dict[str, set[_Line]]:
        """Return the lines that are predicted to apply; `worth` is the predicted reward and end."""
        return self._applied(self._model.trace(state, action)[0], *worth.tolist())

    def judged(self, state: Vector, action: int, next_state: Vector) -> dict[str, set[_Line]]:
        """Return the lines that apply to an observed transition."""
        sites = self._model.trace_judged(state, action, next_state)
        if self._goal is None and self._metric is None:
            return self._applied(sites, 0.0, 0.0)
        try:
            judged = self._model.judge(state, action, next_state)
        except StateError:
            return self._applied(sites, 0.0, 0.0)
        return self._applied(sites, judged.reward, float(judged.terminal))

    def _applied(self, sites: Iterable[Site], reward: float, end: float) -> dict[str, set[_Line]]:
        """Return the lines among the places passed; goal or metric where there are none."""
        found: dict[str, set[_Line]] = {REWARD: set(), END: set()}
        for site in sites:
            effect = site.item
            if site.schema is None or site.what not in ("effect", "rate"):
                continue
            line = _Line(site.schema.schema, getattr(effect, "place", None))
            if isinstance(effect, g.SetNumber) and effect.target == g.REWARD_TARGET:
                found[REWARD].add(line)
            elif isinstance(effect, g.SetBoolean) and effect.target == g.TERMINAL_TARGET:
                found[END] |= {line} if effect.value else set()
        if end and not found[END] and self._goal is not None:
            found[END].add(self._goal)
        if reward and not found[REWARD] and (unwritten := self._metric or self._goal) is not None:
            found[REWARD].add(unwritten)
        return found
