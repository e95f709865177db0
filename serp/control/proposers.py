"""A learner with an input, in the form that strategies use."""

from __future__ import annotations

from serp._util.numbers import best_of
from serp.control.protocols import Learner, Mask, Values
from serp.learning.dqn import Proposal
from serp.model.transition_model import Vector


class LearnerProposer:
    """The proposals of a learner for one input `[F]`; see `serp.control.protocols.Proposer`."""

    def __init__(self, learner: Learner, x: Vector, *, explores: bool = True) -> None:
        self._learner = learner
        self._x = x
        self._explores = explores

    def propose(
        self, explorable: Mask | None, *, among: Mask | None = None, base: Values | None = None
    ) -> Proposal:
        """Propose an action, with exploration."""
        if not self._explores:
            return self.propose_greedily(among=among, base=base)
        return _limited(self._learner.propose(self._x, explorable, base), among)

    def propose_greedily(
        self, *, among: Mask | None = None, base: Values | None = None
    ) -> Proposal:
        """Propose the action with the largest value."""
        return _limited(self._learner.propose_greedily(self._x, base), among)

    def target_q(self) -> Values:
        """Return `[E]` the values of the target network."""
        return self._learner.target_q(self._x)


def _limited(proposal: Proposal, among: Mask | None) -> Proposal:
    """Limit a greedy choice to the given actions."""
    if among is None or proposal.q is None or among[proposal.action] or not among.any():
        return proposal
    return proposal._replace(action=best_of(proposal.q, among))
