"""The compiled loops that follow edges of the planning graph; arguments as in `kernels`."""

from __future__ import annotations

from serp.compilation import cached_njit
from serp.domain.flags import APPLICABLE, TERMINAL, UNSAFE
from serp.domain.native import call_step, pointer_to

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"


@cached_njit(nogil=True, forceinline=True)
def edge(address, state, action, repeat, gamma, theta, dt, target, scratch, width):
    """Follow one edge: `action`, `repeat` times or until it ends.

    `state`, `theta`, `target` and `scratch` are pointers: to the state that the edge leaves, the
    literals, the row that receives the state reached, and a row to work in.

    Returns:
        Discounted reward, weight of what follows (γ to the number of periods), flags of the whole
        edge, its periods (those before the first unsafe one, where one is), reward and flags of
        its first period.
    """
    for i in range(width):
        target[i] = state[i]
    flags = call_step(address, state, action, theta, dt, target)
    reward = target[width]
    first_reward = reward
    first_flags = flags
    weight = gamma
    periods = 0 if flags & UNSAFE else 1
    for _ in range(repeat - 1):
        if not flags & APPLICABLE or flags & TERMINAL:
            break
        for i in range(width):
            scratch[i] = target[i]
        again = call_step(address, scratch, action, theta, dt, target)
        if not again & APPLICABLE:
            for i in range(width):
                target[i] = scratch[i]
            break
        flags |= again
        if not flags & UNSAFE:
            periods += 1
        reward += weight * target[width]
        weight *= gamma
    return reward, weight, flags, periods, first_reward, first_flags


@cached_njit(nogil=True)
def expand(address, states, nodes, actions, repeat, gamma, theta, dt, out, reward, weight, flags,
           periods, first_reward, first_flags):  # fmt: skip
    """Follow every edge of `nodes` states.

    `states` is flat `[nodes * (F + 1)]`; the flat `out`, `[(nodes * A + 1) * (F + 1)]`, receives
    the states reached; the other six, `[nodes * A]`, what `edge` returns.
    """
    row = states.shape[0] // nodes
    literals = pointer_to(theta, 0)
    scratch = pointer_to(out, nodes * actions * row)
    for node in range(nodes):
        state = pointer_to(states, node * row)
        for action in range(actions):
            e = node * actions + action
            reward[e], weight[e], flags[e], periods[e], first_reward[e], first_flags[e] = edge(
                address, state, action, repeat, gamma, literals, dt,
                pointer_to(out, e * row), scratch, row - 1,
            )  # fmt: skip
