"""The loops of `serp.learning.kernels` that only a learner with a guide needs.

Apart from them, so that nobody else compiles or runs them. Arrays are as described there.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from serp.learning.kernels import compiled, within

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_HALF = np.float32(0.5)
_TWO = np.float32(2.0)


@compiled
def take_guide_images(
    rows: Any,
    elements: Any,
    images: Any,
    action: Any,
    next_action: Any,
    next_values: Any,
    to_action: Any,
    to_next_action: Any,
    to_next_values: Any,
) -> None:
    """Copies what a guide said, each sample as its image under an element of a symmetry group.

    Args:
        rows: int64 ``[N]``, which samples.
        elements: int64 ``[N]``, under which element each.
        images: int64 ``[G, A]``, the image of every action.
        action: the memory, see `GuideSamples`.
        next_action: likewise.
        next_values: likewise.
        to_action: written, N samples.
        to_next_action: likewise.
        to_next_values: likewise.
    """
    count = images.shape[1]
    for i in range(len(rows)):
        row, g = rows[i], elements[i]
        said, then = action[row], next_action[row]
        to_action[i] = images[g, said] if said >= 0 else said
        to_next_action[i] = images[g, then] if then >= 0 else then
        for k in range(count):
            to_next_values[i, images[g, k]] = next_values[row, k]


@compiled
def guided_td_gradient(
    q: Any,
    next_q: Any,
    choice_q: Any,
    filter_q: Any,
    action: Any,
    reward: Any,
    discount: Any,
    forbidden: Any,
    guide_action: Any,
    guide_value: Any,
    guide_next_action: Any,
    guide_next_values: Any,
    lower: Any,
    upper: Any,
    huber: bool,
    bootstrap: bool,
    residual: bool,
    margin: Any,
    margin_weight: Any,
    filtered: bool,
    q_gradient: Any,
) -> float:
    """The loss of `serp.learning.kernels.td_gradient` with a guide, and its gradient.

    The loss of a sample is the TD loss + margin_weight × (max over a of (q[a] + margin·[a ≠ g])
    − q[g]) with g the guide's action, the second part only where there is one and the filter lets
    it pass. Where all three are off, every number is as without a guide.

    Args:
        q: as there.
        next_q: as there.
        choice_q: as there.
        filter_q: ``[E, B, A]`` of the states acted in, which judges the guide's action; the same
            array as `q` where nothing else does.
        action: as there.
        reward: as there.
        discount: as there.
        forbidden: as there.
        guide_action: int64 ``[E, B]``, -1 for none.
        guide_value: ``[E, B]``.
        guide_next_action: int64 ``[E, B]``, -1 for none.
        guide_next_values: ``[E, B, A]``.
        lower: as there.
        upper: as there.
        huber: as there.
        bootstrap: the next state may be valued by the guide's action, where next_q prefers it.
        residual: the guide's values are added to `q`, `next_q` and `choice_q`.
        margin: ≥ 0.
        margin_weight: ≥ 0; 0: no imitation.
        filtered: imitate only where filter_q of the guide's action is no smaller than that of the
            action with the largest q.
        q_gradient: as there, written.

    Returns:
        The mean loss over members and batch.
    """
    members, batch, actions = q.shape
    share = _ONE / np.float32(batch)
    loss = 0.0
    for e in range(members):
        for i in range(batch):
            best = -1
            largest = _ZERO
            for k in range(actions):
                if not forbidden[e, i, k]:
                    choice = choice_q[e, i, k]
                    if residual:
                        choice += guide_next_values[e, i, k]
                    if best < 0 or choice > largest:
                        best, largest = k, choice
            value = next_q[e, i, best]
            if residual:
                value += guide_next_values[e, i, best]
            then = guide_next_action[e, i]
            if bootstrap and then >= 0 and not forbidden[e, i, then]:
                other = next_q[e, i, then]
                if residual:
                    other += guide_next_values[e, i, then]
                if other > value:
                    value = other
            value = within(value, lower, upper)
            chosen = action[e, i]
            error = q[e, i, chosen] - (reward[e, i] + discount[e, i] * value)
            if residual:
                error += guide_value[e, i]
            q_gradient[e, i, :] = _ZERO
            if huber:
                clipped = min(max(error, -_ONE), _ONE)
                loss += clipped * (error - _HALF * clipped)
                q_gradient[e, i, chosen] = clipped * share
            else:
                loss += error * error
                q_gradient[e, i, chosen] = _TWO * error * share

            said = guide_action[e, i]
            if margin_weight <= _ZERO or said < 0:
                continue
            # The guide's action first among equals: at the corner of the loss its gradient is 0.
            rival, above, greedy = said, q[e, i, said], 0
            for k in range(actions):
                if q[e, i, k] > q[e, i, greedy]:
                    greedy = k
                if k != said and q[e, i, k] + margin > above:
                    rival, above = k, q[e, i, k] + margin
            if rival != said and not (filtered and filter_q[e, i, said] < filter_q[e, i, greedy]):
                loss += margin_weight * (above - q[e, i, said])
                q_gradient[e, i, rival] += margin_weight * share
                q_gradient[e, i, said] -= margin_weight * share
    mean: float = loss / (members * batch)
    return mean
