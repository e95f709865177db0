"""Predicted and observed rewards and ends, by the line of the file that defines them.

A step whose reward or end differs from the prediction is attributed to the lines that apply to only
one of the predicted and the observed next state: the file predicted the fluents wrongly. If the
same lines apply to both, it is attributed to these lines; if none applies, to no line.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from serp.diagnosis.accuracy import END, REWARD, Steps
from serp.diagnosis.findings import RuleFinding
from serp.model import ground as g
from serp.model.emit import Site
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.pddl.source import Place

_EQUAL = 0.1
"""A reward is as predicted if it differs by at most this fraction of the usual reward."""


class _Line(NamedTuple):
    schema: str
    place: Place | None


_NO_LINE = _Line("", None)


@dataclass
class _Count:
    """The steps of a line: those in which it was predicted, with sums of what was said and came."""

    predicted: int = 0
    came: int = 0
    unpredicted: int = 0
    expected: float = 0.0
    observed: float = 0.0
    unpredicted_sum: float = 0.0
    squares: float = 0.0

    @property
    def mean_observed(self) -> float:
        if self.predicted:
            return self.observed / self.predicted
        return self.unpredicted_sum / max(1, self.unpredicted)


def find_rules(model: TransitionModel, steps: Steps) -> tuple[RuleFinding, ...]:
    """Return the lines whose rewards or ends differ from the observed ones, the worst first."""
    sample, predicted, units = steps.sample, steps.predicted, steps.units
    width = len(model.fluents)
    rules = _Rules(model)
    counts: dict[str, dict[_Line, _Count]] = {REWARD: {}, END: {}}
    pairs = np.stack((predicted[:, width:], steps.after[:, width:]), axis=1)
    for row in np.flatnonzero((pairs != 0.0).any(axis=(1, 2)) & np.isfinite(pairs).all((1, 2))):
        state, action, after = sample.states[row], int(sample.actions[row]), sample.next_states[row]
        said = rules.predicted(state, action, pairs[row, 0])
        seen = rules.judged(state, action, after)
        for k, (fluent, own) in enumerate(counts.items()):
            expected, came = pairs[row, :, k].tolist()
            equal = _EQUAL * float(units[width + k])
            _count(own, said[fluent], seen[fluent], expected, came, equal)
    found = [
        RuleFinding(
            schema=line.schema,
            place=line.place,
            fluent=fluent,
            predicted=count.predicted,
            came=count.came,
            unpredicted=count.unpredicted,
            expected=count.expected / max(1, count.predicted),
            observed=count.mean_observed,
            samples=len(sample),
            cost=count.squares / float(units[width + k]) ** 2 / len(sample),
        )
        for k, (fluent, own) in enumerate(counts.items())
        for line, count in own.items()
        if count.squares > 0.0
    ]
    return tuple(
        sorted(found, key=lambda f: (-f.cost, f.fluent, -1 if f.place is None else f.place.start))
    )


def _count(
    lines: dict[_Line, _Count],
    said: set[_Line],
    seen: set[_Line],
    expected: float,
    came: float,
    equal: float,
) -> None:
    """Count a step by the lines said to apply, and those seen to; `equal` is no difference."""
    right, off = abs(came - expected) <= equal, (came - expected) ** 2
    for line in said:
        count = lines.setdefault(line, _Count())
        count.predicted += 1
        count.came += right
        count.expected += expected
        count.observed += came
    if not off:
        return
    if came == 0.0:  # a line that applies to the observed state cannot be the cause
        seen = seen & said
    blamed = said ^ seen or said or {_NO_LINE}
    for line in blamed:
        count = lines.setdefault(line, _Count())
        count.squares += off / len(blamed)
        if line not in said and not right:
            count.unpredicted += 1
            count.unpredicted_sum += came


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
        reward = end = 0.0
        if self._goal or self._metric:
            with contextlib.suppress(StateError):
                judged = self._model.judge(state, action, next_state)
                reward, end = judged.reward, float(judged.terminal)
        passed = self._model.judged_passages(state, action, next_state)
        return self._applied([passage.site for passage in passed], reward, end)

    def _applied(self, sites: Iterable[Site], reward: float, end: float) -> dict[str, set[_Line]]:
        """Return the lines among the sites; goal or metric where there are none."""
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
