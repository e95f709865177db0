"""The loops of the learner that are not matrix products, compiled by numba.

What stands between two matrix products of a small network (bias, LayerNorm, ReLU and their
gradients), the TD error and Adam are each one pass over a few kilobytes. As single array operations
they cost more in calls than in arithmetic; compiled and fused they take 1 to 6 µs each. They are
compiled on first use, in about two seconds, and cached on disk.

All arrays are C-contiguous float32 unless said otherwise. E is members, B batch, H a layer's
outputs, A actions, P parameters of a member. A layer's vectors lie in the flat parameters
``[E, P]`` (and in the gradient likewise) one after the other from column `at` on: bias ``[H]`` and,
under LayerNorm, gain ``[H]`` and shift ``[H]``.

Sums may be reordered for vector instructions, the same way in every run on one kind of machine;
NaN and infinities keep their meaning.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from serp._util.compilation import cached_njit

_F = TypeVar("_F", bound=Callable[..., Any])

NORM_EPSILON = 1e-5  # torch.nn.LayerNorm's

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_HALF = np.float32(0.5)
_TWO = np.float32(2.0)
_NORM_EPSILON = np.float32(NORM_EPSILON)


def compiled(function: _F) -> _F:
    """Compiles a loop with the arithmetic said above."""
    flags = {"reassoc", "contract", "nsz"}
    loop: _F = cached_njit(error_model="numpy", fastmath=flags)(function)
    return loop


@compiled
def add_bias(z: Any, parameters: Any, at: int, floor: Any) -> None:
    """In place, z ``[E, B, H]`` = max(z + bias, floor): ReLU with floor 0, none with −inf."""
    members, batch, outputs = z.shape
    for e in range(members):
        bias = parameters[e, at : at + outputs]
        for i in range(batch):
            row = z[e, i]
            for j in range(outputs):
                value = row[j] + bias[j]
                row[j] = floor if value <= floor else value  # NaN stays NaN


@compiled
def normalize(z: Any, h: Any, inverse: Any, parameters: Any, at: int) -> None:
    """Sets h to ReLU(LayerNorm(z + bias)).

    Args:
        z: ``[E, B, H]``; becomes the normalised value before gain and shift.
        h: ``[E, B, H]``, written.
        inverse: ``[E, B]``, written: 1 / standard deviation of each row.
        parameters: ``[E, P]``.
        at: column of the layer's bias.
    """
    members, batch, outputs = z.shape
    share = _ONE / np.float32(outputs)
    for e in range(members):
        bias = parameters[e, at : at + outputs]
        gain = parameters[e, at + outputs : at + 2 * outputs]
        shift = parameters[e, at + 2 * outputs : at + 3 * outputs]
        for i in range(batch):
            row, out = z[e, i], h[e, i]
            mean = _ZERO
            for j in range(outputs):
                row[j] += bias[j]
                mean += row[j]
            mean *= share
            variance = _ZERO
            for j in range(outputs):
                centred = row[j] - mean
                row[j] = centred
                variance += centred * centred
            factor = _ONE / np.sqrt(variance * share + _NORM_EPSILON)
            inverse[e, i] = factor
            for j in range(outputs):
                normal = row[j] * factor
                row[j] = normal
                value = normal * gain[j] + shift[j]
                out[j] = _ZERO if value <= _ZERO else value  # NaN stays NaN


@compiled
def add_bias_backward(d: Any, gradient: Any, at: int) -> None:
    """Gradient of a bias with nothing after it: the sum of d ``[E, B, H]`` over the batch."""
    members, batch, outputs = d.shape
    for e in range(members):
        bias = gradient[e, at : at + outputs]
        bias[:] = _ZERO
        for i in range(batch):
            row = d[e, i]
            for j in range(outputs):
                bias[j] += row[j]


@compiled
def relu_backward(d: Any, h: Any, gradient: Any, at: int) -> None:
    """From dloss/dh to dloss/dz, in place in d ``[E, B, H]``; writes the gradient of the bias."""
    members, batch, outputs = d.shape
    for e in range(members):
        bias = gradient[e, at : at + outputs]
        bias[:] = _ZERO
        for i in range(batch):
            row, out = d[e, i], h[e, i]
            for j in range(outputs):
                value = row[j] if out[j] > _ZERO else _ZERO
                row[j] = value
                bias[j] += value


@compiled
def normalize_backward(
    d: Any, h: Any, z: Any, inverse: Any, parameters: Any, gradient: Any, at: int
) -> None:
    """From dloss/dh to dloss/dz, in place in d; the other arrays as `normalize` left them.

    Writes the gradients of bias, gain and shift. With x the normalised row and g = d × gain,
    dz = (g − mean(g) − x · mean(g · x)) / standard deviation (arXiv 1607.06450).
    """
    members, batch, outputs = d.shape
    share = _ONE / np.float32(outputs)
    for e in range(members):
        gain = parameters[e, at + outputs : at + 2 * outputs]
        bias_gradient = gradient[e, at : at + outputs]
        gain_gradient = gradient[e, at + outputs : at + 2 * outputs]
        shift_gradient = gradient[e, at + 2 * outputs : at + 3 * outputs]
        bias_gradient[:] = _ZERO
        gain_gradient[:] = _ZERO
        shift_gradient[:] = _ZERO
        for i in range(batch):
            row, out, normal = d[e, i], h[e, i], z[e, i]
            # Loops that touch few arrays: the compiler takes only those apart into vectors, for it
            # has to see that no array overlaps another.
            for j in range(outputs):
                value = row[j] if out[j] > _ZERO else _ZERO
                row[j] = value
                shift_gradient[j] += value
            for j in range(outputs):
                gain_gradient[j] += row[j] * normal[j]
            mean, along = _ZERO, _ZERO
            for j in range(outputs):
                value = row[j] * gain[j]
                row[j] = value
                mean += value
                along += value * normal[j]
            mean *= share
            along *= share
            factor = inverse[e, i]
            for j in range(outputs):
                value = factor * (row[j] - mean - normal[j] * along)
                row[j] = value
                bias_gradient[j] += value


@compiled
def choose_rows(uniform: Any, starts: Any, counts: Any, rows: Any) -> None:
    """From uniform random numbers to rows of the replay memory.

    Args:
        uniform: float64 ``[E, B]``, in [0, 1).
        starts: int64 ``[B]``, the first row that a column of a batch is drawn from.
        counts: float64 ``[B]``, how many rows.
        rows: int64 ``[E · B]``, written.
    """
    members, batch = uniform.shape
    for e in range(members):
        for i in range(batch):
            rows[e * batch + i] = starts[i] + np.int64(uniform[e, i] * counts[i])


@compiled
def take_samples(
    rows: Any,
    observation: Any,
    action: Any,
    reward: Any,
    next_observation: Any,
    discount: Any,
    forbidden: Any,
    to_observation: Any,
    to_action: Any,
    to_reward: Any,
    to_next_observation: Any,
    to_discount: Any,
    to_forbidden: Any,
) -> None:
    """Copies samples.

    Args:
        rows: int64 ``[N]``, which samples.
        observation: the memory, see `Samples`.
        action: likewise.
        reward: likewise.
        next_observation: likewise.
        discount: likewise.
        forbidden: likewise.
        to_observation: written, N samples.
        to_action: likewise.
        to_reward: likewise.
        to_next_observation: likewise.
        to_discount: likewise.
        to_forbidden: likewise.
    """
    width, count = observation.shape[1], forbidden.shape[1]
    for i in range(len(rows)):
        row = rows[i]
        for j in range(width):
            to_observation[i, j] = observation[row, j]
            to_next_observation[i, j] = next_observation[row, j]
        to_action[i] = action[row]
        to_reward[i] = reward[row]
        to_discount[i] = discount[row]
        for k in range(count):
            to_forbidden[i, k] = forbidden[row, k]


@compiled
def take_images(
    rows: Any,
    elements: Any,
    columns: Any,
    signs: Any,
    images: Any,
    observation: Any,
    action: Any,
    reward: Any,
    next_observation: Any,
    discount: Any,
    forbidden: Any,
    to_observation: Any,
    to_action: Any,
    to_reward: Any,
    to_next_observation: Any,
    to_discount: Any,
    to_forbidden: Any,
) -> None:
    """As `take_samples`, each as its image under an element of a symmetry group.

    Args:
        rows: as there.
        elements: int64 ``[N]``, under which element each.
        columns: int64 ``[G, F]``; image[i] = signs[g, i] × input[columns[g, i]].
        signs: ``[G, F]``.
        images: int64 ``[G, A]``, the image of every action.
        observation: as there.
        action: as there.
        reward: as there.
        next_observation: as there.
        discount: as there.
        forbidden: as there.
        to_observation: as there.
        to_action: as there.
        to_reward: as there.
        to_next_observation: as there.
        to_discount: as there.
        to_forbidden: as there.
    """
    width, count = columns.shape[1], images.shape[1]
    for i in range(len(rows)):
        row, g = rows[i], elements[i]
        for j in range(width):
            sign, column = signs[g, j], columns[g, j]
            to_observation[i, j] = sign * observation[row, column]
            to_next_observation[i, j] = sign * next_observation[row, column]
        to_action[i] = images[g, action[row]]
        to_reward[i] = reward[row]
        to_discount[i] = discount[row]
        for k in range(count):
            to_forbidden[i, images[g, k]] = forbidden[row, k]


@compiled
def all_images(x: Any, columns: Any, signs: Any, out: Any) -> None:
    """The images of inputs under K elements of a symmetry group, those of an element together.

    Args:
        x: ``[B, F]``.
        columns: int64 ``[G, F]``; image[i] = signs[g, i] × input[columns[g, i]].
        signs: ``[G, F]``.
        out: ``[K · B, F]``, K ≤ G, written.
    """
    batch, width = x.shape
    for r in range(len(out)):
        g, i = r // batch, r % batch
        for j in range(width):
            out[r, j] = signs[g, j] * x[i, columns[g, j]]


@compiled
def mean_over_images(q: Any, images: Any, out: Any) -> None:
    """The mean of Q over members and a symmetry group.

    Args:
        q: ``[E, K · B, A]`` of what `all_images` wrote.
        images: int64 ``[G, A]``, the image of every action.
        out: ``[B, A]``, written.
    """
    members, rows, actions = q.shape
    batch = len(out)
    share = _ONE / np.float32(members * (rows // batch))
    out[:, :] = _ZERO
    for e in range(members):
        for r in range(rows):
            g, i = r // batch, r % batch
            for k in range(actions):
                out[i, k] += q[e, r, images[g, k]]
    for i in range(batch):
        for k in range(actions):
            out[i, k] *= share


@compiled
def within(value: Any, lower: Any, upper: Any) -> Any:
    """A value, or the bound that it exceeds; NaN stays NaN."""
    if value < lower:
        return lower
    return upper if value > upper else value


@compiled
def td_gradient(
    q: Any,
    next_q: Any,
    choice_q: Any,
    action: Any,
    reward: Any,
    discount: Any,
    forbidden: Any,
    lower: Any,
    upper: Any,
    huber: bool,
    q_gradient: Any,
) -> float:
    """The TD loss (paper, equations 2 and 3) and its gradient.

    The target of a sample is reward + discount × next_q[best], with best the action of largest
    choice_q among those not forbidden (the lowest index among equals), and next_q[best] kept
    between lower and upper.

    Args:
        q: ``[E, B, A]`` of the states acted in.
        next_q: ``[E, B, A]`` of the next states, which values them.
        choice_q: ``[E, B, A]`` of the next states, which chooses; the same array as `next_q`
            unless double DQN.
        action: int64 ``[E, B]``.
        reward: ``[E, B]``.
        discount: ``[E, B]``; 0 after a terminal step.
        forbidden: bool ``[E, B, A]``, never all of a row.
        lower: smallest possible value.
        upper: largest possible value.
        huber: Huber's loss with its corner at 1 instead of the squared error.
        q_gradient: ``[E, B, A]``, written: gradient of each member's mean loss.

    Returns:
        The mean loss over members and batch.
    """
    members, batch, actions = q.shape
    share = _ONE / np.float32(batch)
    loss = 0.0
    for e in range(members):
        for i in range(batch):
            best = -1
            for k in range(actions):
                if not forbidden[e, i, k] and (
                    best < 0 or choice_q[e, i, k] > choice_q[e, i, best]
                ):
                    best = k
            value = within(next_q[e, i, best], lower, upper)
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
    mean: float = loss / (members * batch)
    return mean


@compiled
def adam(
    parameters: Any,
    gradient: Any,
    first: Any,
    second: Any,
    beta1: Any,
    beta2: Any,
    rate: Any,
    epsilon: Any,
    largest_norm: Any,
) -> None:
    """One step of Adam in place; see `serp.learning.optimizer`.

    All arrays are ``[E, P]``. The gradient of each member is first scaled down to a Euclidean norm
    of at most `largest_norm`.
    """
    members, count = parameters.shape
    for e in range(members):
        p, g, m, v = parameters[e], gradient[e], first[e], second[e]
        square = _ZERO
        for i in range(count):
            square += g[i] * g[i]
        norm = np.sqrt(square)
        factor = largest_norm / norm if norm > largest_norm else _ONE
        for i in range(count):
            slope = g[i] * factor
            m[i] = beta1 * m[i] + slope
            v[i] = beta2 * v[i] + slope * slope
            p[i] -= rate * m[i] / (np.sqrt(v[i]) + epsilon)
