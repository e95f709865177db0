"""A refusal is counted for what it prevented."""

from __future__ import annotations

import pytest

from serp.agent.causes import Cause, What
from serp.agent.decision import Reason
from serp.ui.report.tables import CauseTable, _decisive


class _Table(CauseTable):
    """The causes of one action in one step."""

    def __init__(self, *kinds: What) -> None:
        self.causes = [Cause(kind, None, "event", "fall", "(unsafe)") for kind in kinds]

    def of(self, step: int, action: int) -> list[tuple[int, float]]:
        return [(k, 0.1 * k) for k in range(len(self.causes))]


@pytest.mark.parametrize("reason", [Reason.LEAST_RISK, Reason.NO_SAFE_ACTION])
@pytest.mark.parametrize("what", ["risk", "unsafe"])
def test_where_nothing_is_acceptable_the_harm_of_the_proposal_counts(
    reason: Reason, what: What
) -> None:
    assert _decisive(_Table("reward", what, "end"), 0, 0, reason) == 1
    assert _decisive(_Table("reward", "end"), 0, 0, reason) == -1
