"""Learning from a guide (the planner): its advice on each env step, and how it is used.

* Imitation: the Q-value of the guide's action should exceed all others by a margin (DQfD, Hester et
  al. 2018, arXiv 1704.03732), unless the learner estimates another action to be better (the
  Q-filter of Nair et al. 2018, arXiv 1709.10089).
* The guide's action as a candidate in the target (IBRL, Hu et al. 2024, arXiv 2311.02198).
* The network learns the difference to the guide's values (residual learning, Silver et al. 2018,
  arXiv 1812.06298; Johannink et al. 2019, arXiv 1812.03201).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt


class Guidance(NamedTuple):
    """The guide's advice on one env step.

    Attributes:
        action: The guide's action in the current state, to be imitated; -1: no imitation here.
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
"""In place of guidance for a learner that uses none."""


def checked(guidance: Guidance | None, actions: int) -> Guidance:
    """Return guidance; raise ValueError if it is absent, of another shape or not finite."""
    if guidance is None:
        raise ValueError("a learner with a guide needs guidance for every step")
    values, chosen = guidance.next_values, (guidance.action, guidance.next_action)
    if values.shape != (actions,) or not all(-1 <= action < actions for action in chosen):
        raise ValueError(f"guidance of {actions} actions cannot be {guidance}")
    if not (math.isfinite(guidance.value) and np.isfinite(values).all()):
        raise ValueError(f"a guide's values must be finite, not {guidance.value} and {values}")
    return guidance


@dataclass(frozen=True, kw_only=True)
class GuidedLearning:
    """How a `serp.learning.dqn.DQN` learns from its guide. By default it does not.

    Attributes:
        margin: Margin by which Q of the guide's action should exceed all others, in units of Q,
            ≥ 0: the m of the loss max over a of (Q(s, a) + m·[a ≠ guide's]) − Q(s, guide's).
        margin_weight: Weight of that loss beside the TD loss, ≥ 0; 0: no imitation.
            `DQN.margin_weight` starts here.
        relative: Margin and weight are multiplied by the standard deviation of Q in the batch, so
            that imitation does not depend on the unit of the rewards.
        q_filter: Imitate only where the target network (without one: the network) values the
            guide's action at least as high as the learner's greedy choice.
        bootstrap_guide: Value the next state by the better, according to the target network, of the
            learner's greedy action and the guide's action, unless that is forbidden. It has an
            effect only with double DQN.
        residual: Q(s, a) is the guide's value plus the network's output, which is initially zero,
            in the TD error, in every choice and within the bounds of `clip_targets`.

    Raises:
        ValueError: Imitation and residual learning are combined: that would need the guide's values
            of every action in the current state.
    """

    margin: float = 0.8
    margin_weight: float = 0.0
    relative: bool = False
    q_filter: bool = True
    bootstrap_guide: bool = False
    residual: bool = False

    def __post_init__(self) -> None:
        if self.residual and self.margin_weight > 0:
            raise ValueError("margin_weight must be 0 for a learner that learns a residual")

    @property
    def in_use(self) -> bool:
        """Whether the learner uses the guide, so that guidance has to be stored."""
        return self.margin_weight > 0 or self.bootstrap_guide or self.residual
