"""What a domain file says of numbers that its task's observations never give."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from serp._util.text import readable
from serp.authoring.lint.conditions import threshold
from serp.errors import SerpError
from serp.model import ground_model as g
from serp.pddl.source import DomainWarning, Place
from serp.pddl.syntax import Change, Kind
from serp.tasks.grounding import FAR
from serp.tasks.task import BoundTask

_OPEN = FAR / 1e3
"""A range as wide as this comes of a bound that the observation space leaves open."""


def out_of_range(bound: BoundTask) -> Iterator[DomainWarning]:
    """Yield numbers of the file that lie far outside of what the grounding can give.

    The range of a fluent is taken from observations that the space allows. Only what is farther
    away than the range is wide is reported: degrees for radians, millimetres for metres.
    """
    ranges = _ranges(bound)
    reported: set[Place] = set()
    for index, number, place, step in _numbers(bound.model.ground, bound.model.theta.tolist()):
        low, high = ranges[index]
        span = high - low
        far = abs(number) > span if step else not low - span <= number <= high + span
        if place in reported or not 0 < span < _OPEN or not far:
            continue
        reported.add(place)
        unit = f"; is {readable(number)} in the same unit?"
        yield DomainWarning(
            f"`{place.text}`: the observations of the task give "
            f"`{bound.model.fluents[index].name}` values from {readable(low)} to {readable(high)}"
            f"{', less than one such step apart' if step else unit}",
            place,
            "out-of-range",
        )


def _ranges(bound: BoundTask) -> NDArray[np.float64]:
    """Return the least and greatest value of every fluent, `[F, 2]`; infinities for none known."""
    model, rows = bound.model, []
    for sample in bound.grounding.on_samples(bound.env.observation_space, 256):
        with contextlib.suppress(SerpError):  # of an observation that never comes
            mapping = isinstance(sample, Mapping)
            rows.append(model.state(sample) if mapping else model.check_state(sample))
    if not rows:
        return np.tile([-np.inf, np.inf], (len(model.fluents), 1))
    table = np.array(rows)
    return np.stack([table.min(axis=0), table.max(axis=0)], axis=1)


def _numbers(ground: g.GroundModel, theta: list[float]) -> Iterator[tuple[int, float, Place, bool]]:
    """Yield fluent, number and place, and whether the number is a step that happens at once."""
    for schema in ground.schemas:
        for effect in schema.effects:
            if not isinstance(effect, g.SetNumber) or effect.target < 0:
                continue
            if not isinstance(effect.value, g.ParameterRef):
                continue
            number = theta[effect.value.parameter]
            if effect.change is Change.ASSIGN:
                yield effect.target, number, effect.place, False
            elif effect.change.group == "add" and schema.kind is not Kind.PROCESS:
                yield effect.target, number, effect.place, True
        for test in (*schema.preconditions, *(effect.condition for effect in schema.effects)):
            for comparison in g.comparisons_of(test):
                if (limit := threshold(comparison, theta)) is not None:
                    yield limit[0], limit[2], comparison.place, False
