"""From a batch of samples to the gradient of the loss (paper, equations 2 and 3).

Where a sample names an action of the planner, the loss of imitation is added: the value of that
action should exceed all others by a margin (DQfD, Hester et al. 2018, arXiv 1704.03732). The margin
is the standard deviation of the values in the batch, so that it is independent of the unit of
rewards.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from serp.learning.kernels import compiled
from serp.learning.network import QNetwork, Workspace
from serp.learning.samples import Samples
from serp.settings import LearnerSettings

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_HALF = np.float32(0.5)
_TWO = np.float32(2.0)


class TDGradient:
    """Forward and backward passes of one gradient update of `online`.

    `target` is the same network if there is no target network.
    """

    def __init__(
        self,
        online: QNetwork,
        target: QNetwork,
        settings: LearnerSettings,
    ) -> None:
        self._online = online
        self._target = target
        self._huber = settings.loss == "huber"
        apart = target is not online
        self._chooses = settings.double and apart
        self._work = Workspace(online, settings.batch_size)
        self._next_work = Workspace(online, settings.batch_size)
        self._choice_work = Workspace(online, settings.batch_size if self._chooses else 0)
        next_q = self._next_work.q
        self._values = (self._work.q, next_q, self._choice_work.q if self._chooses else next_q)

    def gradient(
        self, batch: Samples, bounds: tuple[float, float], imitation_weight: float
    ) -> float:
        """Write the gradient of the loss on a batch ``[E, B]`` into the network's; return the loss.

        `bounds` are the smallest and the largest possible value of a state.
        """
        self._target.forward(batch.next_observation, self._next_work)
        if self._chooses:
            self._online.forward(batch.next_observation, self._choice_work)
        self._online.forward(batch.observation, self._work)
        imitation = None
        if batch.imitated.size:
            unit = _spread(self._work.q)
            imitation = batch.imitated, np.float32(unit), np.float32(imitation_weight * unit)
        loss: float = td_gradient(
            self._values, (batch.action, batch.reward, batch.discount, batch.forbidden),
            (np.float32(bounds[0]), np.float32(bounds[1])), self._huber, imitation,
            self._work.q_gradient,
        )  # fmt: skip
        self._online.backward(self._work)
        return loss


@compiled
def _spread(q: Any) -> float:
    """Return the standard deviation of q ``[E, B, A]``."""
    members, batch, actions = q.shape
    mean = squares = 0.0
    for e in range(members):
        for i in range(batch):
            for k in range(actions):
                mean += q[e, i, k]
    mean /= members * batch * actions
    for e in range(members):
        for i in range(batch):
            for k in range(actions):
                squares += (q[e, i, k] - mean) ** 2
    spread: float = np.sqrt(squares / (members * batch * actions))
    return spread


@compiled
def _within(value: Any, lower: Any, upper: Any) -> Any:
    """Clip a value to bounds; NaN stays NaN."""
    if value < lower:
        return lower
    return upper if value > upper else value


@compiled
def td_gradient(
    values: Any, batch: Any, bounds: Any, huber: bool, imitation: Any, q_gradient: Any
) -> float:
    """Write the gradient of each member's mean loss; return the mean loss over members and batch.

    The target of a sample is reward + discount × next_q[best], with best the action of largest
    choice_q among those not forbidden (the lowest index in a tie), and next_q[best] clipped to
    the bounds. With an action g to be imitated, weight × (max over a of (q[a] + margin·[a ≠ g]) −
    q[g]) is added to the loss of the sample.

    Args:
        values: ``[E, B, A]`` each: q of the current states; next_q, the values of the next states;
            choice_q, which selects the next action.
        batch: Action, reward, discount and forbidden of `Samples`.
        bounds: Smallest and largest possible value of a state.
        huber: The Huber loss with threshold 1 instead of the squared error.
        imitation: Imitated of `Samples`, margin and weight; None: the loop is compiled without it.
        q_gradient: ``[E, B, A]``, written.
    """
    q, next_q, choice_q = values
    action, reward, discount, forbidden = batch
    lower, upper = bounds
    if imitation is not None:
        imitated, margin, weight = imitation
    members, batch_size, actions = q.shape
    share = _ONE / np.float32(batch_size)
    loss = 0.0
    for e in range(members):
        for i in range(batch_size):
            best = -1
            largest = _ZERO
            for k in range(actions):
                if not forbidden[e, i, k]:
                    choice = choice_q[e, i, k]
                    if best < 0 or choice > largest:
                        best, largest = k, choice
            value = _within(next_q[e, i, best], lower, upper)
            chosen = action[e, i]
            error = q[e, i, chosen] - (reward[e, i] + discount[e, i] * value)
            q_gradient[e, i, :] = _ZERO
            if huber:
                clipped = min(max(error, -_ONE), _ONE)
                loss += clipped * (error - _HALF * clipped)
                q_gradient[e, i, chosen] = clipped * share
            else:
                loss += error * error
                q_gradient[e, i, chosen] = _TWO * error * share
            if imitation is not None:
                said = imitated[e, i]
                if weight <= _ZERO or said < 0:
                    continue
                # In a tie that action is first: there the gradient of the loss is 0.
                rival, above = said, q[e, i, said]
                for k in range(actions):
                    if k != said and q[e, i, k] + margin > above:
                        rival, above = k, q[e, i, k] + margin
                if rival != said:
                    loss += weight * (above - q[e, i, said])
                    q_gradient[e, i, rival] += weight * share
                    q_gradient[e, i, said] -= weight * share
    mean: float = loss / (members * batch_size)
    return mean
