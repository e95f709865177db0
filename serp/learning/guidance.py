"""Learning from a guide: what it said about each env step, and what the learner makes of it.

A guide (the planner) can do more for the learner than act in its place. Three ways are known to
work, and may be combined except where said:

* imitation: where the guide would act is worth a margin more than anything else (DQfD, Hester et
  al. 2018, arXiv 1704.03732), unless the learner has reason to believe in something better (the
  Q-filter of Nair et al. 2018, arXiv 1709.10089);
* the guide's action as a candidate in the target (IBRL, Hu et al. 2024, arXiv 2311.02198);
* the network learns only what the guide's value lacks (residual learning, Silver et al. 2018,
  arXiv 1812.06298; Johannink et al. 2019, arXiv 1812.03201).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt


class Guidance(NamedTuple):
    """What the guide says about one env step.

    Attributes:
        action: The guide's action in the state acted in, to be imitated; -1: imitate nothing here.
        value: The guide's value of the *executed* action in that state, in units of Q (reward ×
            `reward_scale`), finite.
        next_action: The guide's action in the next state; -1: it has none.
        next_values: ``[A]``, the guide's values of all actions in the next state, in units of Q,
            finite. Not used after a terminal step.
    """

    action: int
    value: float
    next_action: int
    next_values: npt.NDArray[np.floating[Any]]


NO_GUIDANCE = Guidance(-1, 0.0, -1, np.zeros(0))
"""Stands for the guidance of a learner that does not learn from any."""


def checked(guidance: Guidance | None, actions: int) -> Guidance:
    """Return guidance that fits so many actions.

    Raises:
        ValueError: It is absent, of another shape or not finite.
    """
    if guidance is None:
        raise ValueError("a learner that learns from a guide needs its guidance for every step")
    for action in (guidance.action, guidance.next_action):
        if not -1 <= action < actions:
            raise ValueError(f"there are {actions} actions, a guide cannot choose {action}")
    values = guidance.next_values
    if values.shape != (actions,):
        raise ValueError(f"a guide's values must have shape ({actions},), not {values.shape}")
    if not (math.isfinite(guidance.value) and np.isfinite(values).all()):
        raise ValueError(f"a guide's values must be finite, not {guidance.value} and {values}")
    return guidance


@dataclass(frozen=True, kw_only=True)
class GuidedLearning:
    """How a `serp.learning.dqn.DQN` learns from its guide. By default it does not.

    Attributes:
        margin: By how much the guide's action should be worth more than any other, in units of Q,
            ≥ 0: the m of the loss max over a of (Q(s, a) + m·[a ≠ guide's]) − Q(s, guide's).
        margin_weight: Weight of that loss beside the TD loss, ≥ 0; 0: no imitation.
            `DQN.margin_weight` starts here.
        q_filter: Imitate only where the target network (without one: the network) values the
            guide's action no lower than the learner's own greedy choice.
        bootstrap_guide: Value the next state by the better, by the target network, of the
            learner's greedy action and the guide's action, unless that is forbidden. It changes
            double DQN only: without `double` the learner's action already is the best by that
            network.
        residual: Q(s, a) is the guide's value plus the network's output, in the TD error, in every
            choice and within the bounds of `clip_targets`. The network's last layer then starts at
            zero, so that Q starts as the guide's value. Excludes imitation, which would need the
            guide's values of every action in the state acted in.

    Raises:
        ValueError: Imitation and residual learning are combined.
    """

    margin: float = 0.8
    margin_weight: float = 0.0
    q_filter: bool = True
    bootstrap_guide: bool = False
    residual: bool = False

    def __post_init__(self) -> None:
        if self.residual and self.margin_weight > 0:
            raise ValueError("margin_weight must be 0 for a learner that learns a residual")

    @property
    def in_use(self) -> bool:
        """Whether anything is learned from the guide, so that its advice has to be remembered."""
        return self.margin_weight > 0 or self.bootstrap_guide or self.residual
