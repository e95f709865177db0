"""A learner with an input, in the form that strategies use."""

from __future__ import annotations

from serp.control.protocols import Learner, Mask
from serp.learning.dqn import Proposal
from serp.model.transition_model import Vector


class LearnerProposer:
    """The proposals of a learner for one input `[F]`; see `serp.control.protocols.Proposer`."""

    def __init__(self, learner: Learner, x: Vector, *, explores: bool = True) -> None:
        self._learner = learner
        self._x = x
        self._explores = explores

    def propose(self, explorable: Mask | None) -> Proposal:
        """Propose an action, with exploration."""
        if not self._explores:
            return self.propose_greedily()
        return self._learner.propose(self._x, explorable)

    def propose_greedily(self) -> Proposal:
        """Propose the action with the largest value."""
        return self._learner.propose_greedily(self._x)
