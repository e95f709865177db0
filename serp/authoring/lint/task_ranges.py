"""What a domain file says of numbers that its task's observations never give."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from serp._util.text import readable
from serp.authoring.lint.conditions import threshold
from serp.errors import SerpError
from serp.model import ground as g
from serp.pddl.source import DomainWarning, Place
from serp.pddl.syntax import Change
from serp.tasks.grounding import FAR
from serp.tasks.task import BoundTask

_SAMPLES = 256
_OPEN = FAR / 1e3
"""A range as wide as this comes of a bound that the observation space leaves open."""


def out_of_range(bound: BoundTask) -> Iterator[DomainWarning]:
    """Yield numbers of the file that lie far outside of what the grounding can give.

    The range of a fluent is taken from observations that the space allows. Only what is farther
    away than the range is wide is told of: degrees for radians, millimetres for metres.
    """
    ranges = _ranges(bound)
    fluents = bound.model.fluents
    told: set[Place] = set()
    for index, step, place in _steps_of(bound.model.ground, bound.model.theta.tolist()):
        low, high = ranges[index]
        if place not in told and 0 < high - low < _OPEN and abs(step) > high - low:
            told.add(place)
            yield DomainWarning(
                f"`{place.text}`: the observations of the task give `{fluents[index].name}` values "
                f"from {readable(low)} to {readable(high)}, less than one such step apart",
                place,
                "out-of-range",
            )
    for index, value, place in _numbers_of(bound.model.ground, bound.model.theta.tolist()):
        low, high = ranges[index]
        span = high - low
        if place in told or not 0 < span < _OPEN or low - span <= value <= high + span:
            continue
        told.add(place)
        yield DomainWarning(
            f"`{place.text}`: the observations of the task give `{fluents[index].name}` values "
            f"from {readable(low)} to {readable(high)}; is {readable(value)} in the same unit?",
            place,
            "out-of-range",
        )


def _ranges(bound: BoundTask) -> NDArray[np.float64]:
    """Return the least and greatest value of every fluent, `[F, 2]`; infinities for none known."""
    rows = []
    for given in bound.grounding.on_samples(bound.env.observation_space, _SAMPLES):
        state = _state(bound, given)
        if state is not None:
            rows.append(state)
    if not rows:
        return np.tile([-np.inf, np.inf], (len(bound.model.fluents), 1))
    table = np.array(rows)
    return np.stack([table.min(axis=0), table.max(axis=0)], axis=1)


def _state(bound: BoundTask, given: Any) -> NDArray[np.float64] | None:
    try:
        return (
            bound.model.state(given)
            if isinstance(given, Mapping)
            else bound.model.check_state(given)
        )
    except SerpError:  # an observation that never comes
        return None


def _steps_of(ground: g.GroundModel, theta: list[float]) -> Iterator[tuple[int, float, Place]]:
    """Yield fluent, number and place of increases and decreases by a number that happen at once."""
    for schema in (*ground.actions, *ground.events):
        for effect in schema.effects:
            if (
                isinstance(effect, g.SetNumber)
                and effect.change.group == "add"
                and effect.target >= 0
                and isinstance(effect.value, g.ParameterRef)
            ):
                yield effect.target, theta[effect.value.parameter], effect.place


def _numbers_of(ground: g.GroundModel, theta: list[float]) -> Iterator[tuple[int, float, Place]]:
    """Yield fluent, number and place of comparisons with a number, and of assignments of one."""
    for schema in ground.schemas:
        for test in (*schema.preconditions, *(effect.condition for effect in schema.effects)):
            for comparison in g.comparisons_of(test):
                if (limit := threshold(comparison, theta)) is not None:
                    fluent, _, number = limit
                    yield fluent, number, comparison.place
        for effect in schema.effects:
            if (
                isinstance(effect, g.SetNumber)
                and effect.change is Change.ASSIGN
                and effect.target >= 0
                and isinstance(effect.value, g.ParameterRef)
            ):
                yield effect.target, theta[effect.value.parameter], effect.place
