"""Whether values at its leaves make a lookahead act better: episodes that are played in the model.

The values are approximations, so it may act worse with them than without (rollouts: Bertsekas &
Castañón, Journal of Heuristics 5, 1999).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from serp.model.flags import TERMINAL
from serp.model.transition_model import UNKNOWN, Vector
from serp.planning.far_sight.cell_values import NO_CELLS, CellValues, in_range
from serp.planning.lookahead import Lookahead
from serp.planning.preference import hazard

_MOST: Final = 8
"""Most pairs of episodes."""
_FEWEST: Final = 4
_PERIODS: Final = 100
"""Most control periods of an episode."""
_SURE: Final = 2.0
"""Standard errors of the mean difference after which no further pair is played."""


class Played(NamedTuple):
    """What an episode in the model came to.

    Attributes:
        value: Discounted sum of rewards.
        risk: Discounted sum of risks that are not accepted.
    """

    value: float
    risk: float


def favour_cells(lookahead: Lookahead, cells: CellValues, states: Vector) -> bool:
    """Return whether a lookahead acts better with values of cells at its leaves than without.

    Pairs of episodes begin in the same states, from all over `states` `[N, F]`, those that were
    visited. A pair counts if both episodes stay within what the model knows; with fewer than four
    the answer is no. The mean of their differences decides: less risk, or with equal risk more
    reward. The leaves of the lookahead are set.
    """
    starts = np.linspace(0, len(states) - 1, _MOST + 2).astype(np.intp)[1:-1]
    gains, risks = [], []
    for start in states[starts]:
        without = _play(lookahead, start, NO_CELLS, cells)
        found = without and _play(lookahead, start, cells, cells)
        if not (without and found):
            continue
        gains.append(found.value - without.value)
        risks.append(found.risk - without.risk)
        mean = float(np.mean(gains))
        if len(gains) >= _FEWEST:
            error = float(np.std(gains, ddof=1)) / math.sqrt(len(gains))
            if abs(mean) >= _SURE * error:
                break
    if len(gains) < _FEWEST:
        return False
    risk = float(np.mean(risks))
    return risk < 0.0 or (risk == 0.0 and float(np.mean(gains)) > 0.0)


def _play(
    lookahead: Lookahead, state: Vector, leaves: CellValues, cells: CellValues
) -> Played | None:
    """Play an episode; return None if it left what the model knows, or the range of `cells`."""
    model = lookahead.model
    discount, accepted = lookahead.settings.discount, lookahead.settings.accepted_risk
    lookahead.leaves = leaves
    value = risk = 0.0
    weight = 1.0
    for _ in range(_PERIODS):
        choice = lookahead.forecast(state).choice
        if choice < 0 or model.uncertainty(state)[choice] >= UNKNOWN:
            return None
        row, flags = model.transition(state.tolist(), choice)
        value += weight * row.pop()
        risk += weight * hazard(flags, accepted)
        if flags & TERMINAL:
            break
        weight *= discount
        state = np.array(row)
        if not in_range(cells, state, len(state)):
            return None
    return Played(value, risk)
