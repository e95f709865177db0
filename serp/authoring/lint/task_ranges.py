"""What a domain file says of numbers that its task's observations never give."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping

import numpy as np

from serp._util.text import readable
from serp.authoring.lint.contradiction import limits_in
from serp.errors import SerpError
from serp.pddl.source import DomainWarning
from serp.tasks.environment import BoundTask
from serp.tasks.grounding import FAR


def out_of_range(bound: BoundTask) -> Iterator[DomainWarning]:
    """Yield conditions whose numbers lie far outside of what the grounding can give.

    The range of a fluent is taken from observations that the space allows. Only what is farther
    away than the range is wide is reported: degrees for radians, millimetres for metres; and what
    a whole number is never equal to. A bound that the space leaves open is no range.
    """
    model, states = bound.model, []
    for sample in bound.grounding.on_samples(bound.env.observation_space, 256):
        with contextlib.suppress(SerpError):  # of an observation that never comes
            mapping = isinstance(sample, Mapping)
            states.append(model.state(sample) if mapping else model.check_state(sample))
    if not states:
        return
    least, most = np.min(states, axis=0), np.max(states, axis=0)
    warnings = {}
    for index, number, place in limits_in(model.ground, model.theta.tolist()):
        low, high = least[index], most[index]
        span = high - low
        whole = place.text.startswith("(=") and all(state[index] % 1 == 0 for state in states)
        slack = 0 if whole else span
        if 0 < span < FAR / 1e3 and not low - slack <= number <= high + slack:
            warnings[place] = DomainWarning(
                f"`{place.text}`: the observations of the task give `{model.fluents[index].name}` "
                f"values from {readable(low)} to {readable(high)}; is {readable(number)} in the "
                "same unit?",
                place,
                "out-of-range",
            )
    yield from warnings.values()
