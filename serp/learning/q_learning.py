"""Gradient updates: the network, its target network and the optimiser."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from serp.errors import LearningFailure
from serp.learning.kernels import aligned_zeros, compiled
from serp.learning.network import QNetwork, Workspace
from serp.learning.replay import Samples, type_F32
from serp.settings import LearnerSettings

_BETA1, _BETA2, _EPSILON = 0.9, 0.999, 1e-8
_ZERO, _ONE, _TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)


class Adam:
    """The Adam optimiser, in place, with the paper's β₁, β₂ and ε.

    The moments are stored without their factors (1 − β₁) and (1 − β₂), which are part of the step
    size instead: less arithmetic with the same result.

    Args:
        parameters: Contiguous float32 ``[members, P]``, changed by `step`.
        gradient: Likewise, read by `step`.
        learning_rate: The step size α > 0.
        largest_norm: Each member's gradient is scaled down to this Euclidean norm; None: never.
        average: Parameters that follow (Polyak averaging); ``[members, 0]`` for none.
        share: The fraction of the difference by which they follow in a step.

    Attributes:
        first, second: Σ β₁ᵗ⁻ⁱ gᵢ and Σ β₂ᵗ⁻ⁱ gᵢ², float32 ``[members, P]``.
        steps: Number of steps.
    """

    def __init__(
        self,
        parameters: type_F32,
        gradient: type_F32,
        learning_rate: float,
        largest_norm: float | None,
        average: type_F32,
        share: float,
    ) -> None:
        self._parameters, self._gradient = parameters, gradient
        self.first, self.second = (aligned_zeros(*parameters.shape) for _ in range(2))
        self._learning_rate = learning_rate
        self._largest_norm = np.float32(math.inf if largest_norm is None else largest_norm)
        self._average, self._share = average, np.float32(share)
        self.steps = 0

    def step(self) -> None:
        """Move the parameters against the gradient, and those that follow them."""
        self.steps += 1
        spread = math.sqrt((1.0 - _BETA2) / (1.0 - _BETA2**self.steps))
        rate = self._learning_rate * (1.0 - _BETA1) / (1.0 - _BETA1**self.steps) / spread
        _adam(
            self._parameters, self._gradient, self.first, self.second,
            np.float32(rate), np.float32(_EPSILON / spread), self._largest_norm,
            self._average, self._share,
        )  # fmt: skip


@compiled
def _adam(
    parameters: Any, gradient: Any, first: Any, second: Any,
    rate: Any, epsilon: Any, largest_norm: Any, average: Any, share: Any,
) -> None:  # fmt: skip
    """Do one step in place; all arrays are ``[E, P]``, `average` may be ``[E, 0]``."""
    members, count = parameters.shape
    decay1, decay2 = np.float32(_BETA1), np.float32(_BETA2)
    for e in range(members):
        p, g, m, v = parameters[e], gradient[e], first[e], second[e]
        square = _ZERO
        for i in range(count):
            square += g[i] * g[i]
        norm = np.sqrt(square)
        factor = largest_norm / norm if norm > largest_norm else np.float32(1.0)
        for i in range(count):
            slope = g[i] * factor
            m[i] = decay1 * m[i] + slope
            v[i] = decay2 * v[i] + slope * slope
            p[i] -= rate * m[i] / (np.sqrt(v[i]) + epsilon)
        slow = average[e]
        for i in range(len(slow)):
            slow[i] += share * (p[i] - slow[i])


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
def td_gradient(values: Any, batch: Any, bounds: Any, imitation: Any, q_gradient: Any) -> float:
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


class QLearning:
    """The network of a learner, its target network, and their gradient updates.

    Attributes:
        online: The network that learns.
        target: The target network; without one the same object as `online`.
        optimizer: The optimiser of `online`.
        updates: Number of gradient updates.
    """

    def __init__(
        self,
        input_size: int,
        action_count: int,
        settings: LearnerSettings,
        rng: np.random.Generator,
    ) -> None:
        self.updates = 0
        sizes = (input_size, *settings.hidden, action_count)
        norm, members = settings.layer_norm, settings.members
        self.online = QNetwork(sizes, layer_norm=norm, members=members, rng=rng)
        # Without a target network the network itself values the next state (paper, equation 3).
        self.target = self.online
        following = self.online.parameters[:, :0]
        self._work = Workspace(self.online, settings.batch_size)
        self._next_work = Workspace(self.online, settings.batch_size)
        self._choice_work = self._next_work
        if settings.target_polyak is not None:
            self.target = QNetwork(sizes, layer_norm=norm, members=members)
            following = self.target.parameters
            following[:] = self.online.parameters
            self._choice_work = Workspace(self.online, settings.batch_size)
        self.optimizer = Adam(
            self.online.parameters, self.online.gradient, settings.learning_rate,
            settings.gradient_clip, following, settings.target_polyak or 0.0,
        )  # fmt: skip

    def update(
        self, batch: Samples, bounds: tuple[float, float], imitation_weight: float, env_step: int
    ) -> float:
        """Do one gradient update on a batch ``[E, B]`` and return its loss.

        `bounds` are the smallest and the largest possible value of a state.

        Raises:
            LearningFailure: The loss is not finite; nothing has changed.
        """
        self.target.forward(batch.next_observation, self._next_work)
        if self.target is not self.online:
            self.online.forward(batch.next_observation, self._choice_work)
        self.online.forward(batch.observation, self._work)
        imitation = None
        if batch.imitated.size:
            unit = _spread(self._work.q)
            imitation = batch.imitated, np.float32(unit), np.float32(imitation_weight * unit)
        loss: float = td_gradient(
            (self._work.q, self._next_work.q, self._choice_work.q),
            (batch.action, batch.reward, batch.discount, batch.forbidden),
            (np.float32(bounds[0]), np.float32(bounds[1])), imitation, self._work.q_gradient,
        )  # fmt: skip
        self.online.backward(self._work)
        if not math.isfinite(loss):
            raise self.failure(f"the loss is {loss}", env_step, batch)
        self.optimizer.step()
        self.updates += 1
        return loss

    def arrays(self) -> dict[str, type_F32]:
        """Return all arrays that a gradient update changes: name → view."""
        arrays: dict[str, type_F32] = {
            "parameters": self.online.parameters,
            "adam_first": self.optimizer.first,
            "adam_second": self.optimizer.second,
        }
        if self.target is not self.online:
            arrays["target"] = self.target.parameters
        return arrays

    def not_finite(self) -> str | None:
        """Return where the first number is that is not finite; None if all are finite."""
        for name, array in self.arrays().items():
            if not np.isfinite(array).all():
                column = np.argwhere(~np.isfinite(array))[0, 1]
                layer = sum(layer.end <= column for layer in self.online.layers) + 1
                return f"in the {name} of layer {layer}"
        return None

    def failure(self, what: str, env_step: int, batch: Samples | None = None) -> LearningFailure:
        """Return the error that names what is not finite: parameters before the largest input."""
        first = self.not_finite()
        if first is None and batch is not None:
            names = ("observation", "next_observation", "reward")
            size, name = max((np.abs(getattr(batch, name)).max(), name) for name in names)
            first = f"a value of the network; the largest of its inputs is a {name}: {size:g}"
        return LearningFailure(
            f"learner: {what} in gradient update {self.updates + 1}, env step {env_step}. "
            f"The first number that is not finite is {first}. Smaller inputs or rewards, or a "
            "smaller learner.learning_rate or learner.gradient_clip, keep the numbers small"
        )
