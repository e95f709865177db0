"""When a forecast is indifferent and when it is safe."""

from __future__ import annotations

import numpy as np
import pytest

from serp.model.flags import APPLICABLE, UNSAFE
from serp.planning.edges import Bound
from serp.planning.forecast import SAFE, Forecast

BAD = APPLICABLE | UNSAFE


@pytest.mark.parametrize(
    ("values", "steps", "flags", "indifferent"),
    [
        ([1.0, 1.0, 1.0], [SAFE] * 3, None, True),
        ([1.0, 1.0, 1.5], [SAFE] * 3, None, False),
        ([1.0, 1.0], [SAFE, 2], None, False),
        ([1.0, 1.0], [2, 2], None, True),
        ([1.0, -np.inf, 1.0], [SAFE, -1, SAFE], None, True),
        ([1.0, -np.inf], [SAFE, -1], None, False),  # a single action is no tie
        ([-np.inf, -np.inf], [-1, -1], None, False),
        ([], [], None, False),
        # An unsafe action is no choice while there is another.
        ([1.0, 5.0, 1.0], [SAFE, 0, SAFE], [APPLICABLE, BAD, APPLICABLE], True),
        ([1.0, 5.0], [SAFE, 0], [APPLICABLE, BAD], False),
        ([1.0, 1.0], [0, 0], [BAD, BAD], True),
    ],
)
def test_indifferent_is_when_all_that_is_safe_promises_the_same(
    values: list[float], steps: list[int], flags: list[int] | None, indifferent: bool
) -> None:
    for choice in range(-1, len(values)):
        forecast = Forecast(
            choice=choice,
            value=np.array(values),
            path_risk=np.array([float(s != SAFE) for s in steps]),
            safe_steps=np.array(steps, dtype=np.int64),
            reward=np.zeros(len(values)),
            flags=np.array(flags or [int(s >= 0) for s in steps], dtype=np.int64),
            depth=1,
            bound=Bound.DEPTH,
        )
        assert forecast.indifferent is indifferent
        assert forecast.safe == (choice >= 0 and steps[choice] == SAFE)  # on the whole path
