"""The compiled loops that follow edges of the planning graph; arguments as in `kernels`."""

from __future__ import annotations

from serp._util.compilation import cached_njit
from serp.model.flags import APPLICABLE, TERMINAL, joined
from serp.model.native import call_step, pointer_to
from serp.planning.preference import hazard, marked, rank_of

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

_hazard = cached_njit(nogil=True, forceinline=True)(hazard)
_marked = cached_njit(nogil=True, forceinline=True)(marked)
_rank_of = cached_njit(nogil=True, forceinline=True)(rank_of)
_joined = cached_njit(nogil=True, forceinline=True)(joined)


@cached_njit(nogil=True, forceinline=True)
def edge(address, state, action, repeat, gamma, accepted, theta, dt, target, scratch, width):
    """Follow one edge: `action`, `repeat` times or until it ends.

    `state`, `theta`, `target` and `scratch` are pointers: to the state that the edge leaves, the
    literals, the row that receives the state reached, and a row to work in.

    Returns:
        Discounted reward, weight of what follows (γ to the number of periods), flags of the whole
        edge, `rank_of` its first period, its periods (those before the first with a risk, where one
        has), the risk of all of them that is not accepted, reward and flags of its first period.
    """
    for i in range(width):
        target[i] = state[i]
    flags = call_step(address, state, action, theta, dt, target)
    reward = target[width]
    first_reward = reward
    risk = _hazard(flags, accepted)
    flags = _marked(flags, risk)
    first_flags = flags
    rank = _rank_of(flags)
    weight = gamma
    periods = 0 if risk > 0.0 else 1
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
        further = _hazard(again, accepted)
        flags = _joined(flags, _marked(again, further))
        risk += (1.0 - risk) * further
        if risk == 0.0:
            periods += 1
        reward += weight * target[width]
        weight *= gamma
    return reward, weight, flags, rank, periods, risk, first_reward, first_flags


@cached_njit(nogil=True)
def expand(address, states, nodes, actions, repeat, gamma, accepted, theta, dt, out, reward, weight,
           flags, rank, periods, risk, first_reward, first_flags):  # fmt: skip
    """Follow every edge of `nodes` states.

    `states` is flat `[nodes * (F + 1)]`; the flat `out`, `[(nodes * A + 1) * (F + 1)]`, receives
    the states reached; the other eight, `[nodes * A]`, what `edge` returns.
    """
    row = states.shape[0] // nodes
    literals = pointer_to(theta, 0)
    scratch = pointer_to(out, nodes * actions * row)
    for node in range(nodes):
        state = pointer_to(states, node * row)
        for action in range(actions):
            e = node * actions + action
            (
                reward[e], weight[e], flags[e], rank[e], periods[e], risk[e], first_reward[e],
                first_flags[e],
            ) = edge(
                address, state, action, repeat, gamma, accepted, literals, dt,
                pointer_to(out, e * row), scratch, row - 1,
            )  # fmt: skip
