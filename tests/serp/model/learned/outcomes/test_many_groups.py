"""Several fluents with counted outcomes at once."""

import numpy as np
import pytest

from serp import _core
from tests.serp.model.learned.worlds import from_text

WORLD = """
(define (domain drift) (:functions {functions})
  (:action wait :parameters () :effect (and {effects})))
"""


@pytest.mark.parametrize("fluents", range(1, 6))
def test_probabilities_of_outcomes_add_up_however_many_fluents_vary(fluents):
    """Each of the numbers becomes 1 or 2, with equal chance, and never what the file says."""
    names = [f"(x{k})" for k in range(fluents)]
    effects = " ".join(f"(increase {name} 0)" for name in names)
    model = from_text(WORLD.format(functions=" ".join(names), effects=effects)).model
    shared = [_core.GroupParameters(None, 0) for _ in names]
    groups = [([k], [k], part) for k, part in enumerate(shared)]
    core = _core.AdaptedModel(model.written_core(), np.full((1, 1), -1), False, [groups])
    for part in shared:
        table = _core.OutcomeTable(np.zeros(1, np.int64), np.zeros(0, np.int64))
        table.schemas[:3], table.changes[:3, 0] = -1, (0.0, 1.0, 2.0)
        table.members[:2], table.numbers[:2] = (2, 4), 50.0
        table.counts[0, :3], table.totals[0] = (0.0, 50.0, 50.0), 100.0
        table.restore(3, 2, 1)
        part.outcomes = table
    rows = core.outcomes(np.zeros(fluents), 0)
    assert rows[:, -1].sum() == pytest.approx(1.0)
    assert np.isin(rows[:, :fluents], (1.0, 2.0)).all()
    assert len(rows) == min(2**fluents, 8)
