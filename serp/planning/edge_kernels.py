"""The compiled loops that follow edges of the planning graph."""

from __future__ import annotations

from serp._util.compilation import cached_njit
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.native import call_step, pointer_to
from serp.planning.kernel_records import Rules
from serp.planning.preference import compiled_joined, compiled_rank_of, hazard, marked

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"


@cached_njit(nogil=True, forceinline=True)
def edge(model, rules, state, action, target, scratch, width):
    """Follow one edge: `action`, `repeat` times or until it ends.

    States are pointers to rows of `width` numbers; `target` has one more, for the reward.

    Returns:
        What `serp.planning.graph.Edge` has from `reward` on; reward and flags of the first period.
    """
    address, data, dt = model
    theta, accepted = pointer_to(data, 0), rules.accepted_risk
    for i in range(width):
        target[i] = state[i]
    flags = call_step(address, state, action, theta, dt, target)
    reward = target[width]
    first_reward = reward
    risk = hazard(flags, accepted)
    flags = marked(flags, risk)
    first_flags = flags
    rank = compiled_rank_of(flags)
    weight = rules.discount
    periods = 0 if risk > 0.0 else 1
    for _ in range(rules.repeat - 1):
        if not flags & APPLICABLE or flags & TERMINAL:
            break
        for i in range(width):
            scratch[i] = target[i]
        again = call_step(address, scratch, action, theta, dt, target)
        if not again & APPLICABLE:
            for i in range(width):
                target[i] = scratch[i]
            break
        further = hazard(again, accepted)
        flags = compiled_joined(flags, marked(again, further))
        risk += (1.0 - risk) * further
        if risk == 0.0:
            periods += 1
        reward += weight * target[width]
        weight *= rules.discount
    return reward, weight, flags, rank, periods, risk, first_reward, first_flags


@cached_njit(nogil=True)
def expand(model, rules, nodes, states, out, found):
    """Follow every edge of the `nodes` rows of `states`; rows are flat, of F + 1 numbers.

    `out` receives the states reached, a row an edge and one to work in; `found`, six arrays, what
    `edge` returns first.
    """
    reward, weight, flags, rank, periods, risk = found
    limits = Rules(*rules)
    actions, row = limits.actions, states.shape[0] // nodes
    scratch = pointer_to(out, nodes * actions * row)
    for node in range(nodes):
        state = pointer_to(states, node * row)
        for action in range(actions):
            e = node * actions + action
            reward[e], weight[e], flags[e], rank[e], periods[e], risk[e], _, _ = edge(
                model, limits, state, action, pointer_to(out, e * row), scratch, row - 1
            )
