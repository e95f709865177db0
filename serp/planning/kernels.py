"""The compiled loops of planning, the same for every domain.

Each takes the address of a compiled transition function (see `serp.model.native`). The graph is
expanded layer by layer; equal states of a layer merge; the last layer is never stored. A backward
pass over the stored layers finds the best path of every first action.

Common arguments: `address` of the transition function; `width` F, `actions` A, `theta` and `dt` of
the model; `depth`, `repeat`, `gamma`, `accepted` (risk) and the budgets `max_nodes` and
`max_edges` of the planner's settings. Rows of states have F + 1 entries, the last for the reward.
"""

from __future__ import annotations

import numpy as np
from numba import get_num_threads, get_thread_id, prange  # type: ignore[attr-defined]

from serp._util.compilation import cached_njit
from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED
from serp.model.native import pointer_to
from serp.planning.edges import edge
from serp.planning.forecast import SAFE
from serp.planning.leaf_value import value_at
from serp.planning.limits import Bound
from serp.planning.preference import promise, rank_of

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

_DEPTH = int(Bound.DEPTH)
_NODES = int(Bound.NODES)
_EXHAUSTED = int(Bound.EXHAUSTED)
_LEFT_OUT, _WANTED = -2, -1
"""Stand for the steps of a node that is not, or not yet, looked at from the back."""
_BITS, _RANK = 0x1F, 6
"""Of the flags of an edge its bits are stored, and above them the rank of its first period."""

_promise = cached_njit(nogil=True, forceinline=True)(promise)
_rank_of = cached_njit(nogil=True, forceinline=True)(rank_of)


@cached_njit(nogil=True, forceinline=True)
def _same_slot(states, row, width, table, mask, candidate):
    """Return the table's slot of the state equal to row `candidate`, or the empty one for it."""
    digest = np.uint64(0xCBF29CE484222325)
    base = candidate * row
    for i in range(width):
        bits = np.float64(states[base + i] + 0.0).view(np.uint64)  # -0.0 equals 0.0
        digest = (digest ^ bits) * np.uint64(0x9E3779B97F4A7C15)
        digest ^= digest >> np.uint64(29)
    digest ^= digest >> np.uint64(32)
    digest *= np.uint64(0x9E3779B97F4A7C15)
    digest ^= digest >> np.uint64(29)
    slot = np.int64(digest & np.uint64(mask))
    while table[slot] >= 0:
        other = table[slot] * row
        equal = True
        for i in range(width):
            if states[other + i] != states[base + i]:
                equal = False
                break
        if equal:
            break
        slot = (slot + 1) & mask
    return slot


@cached_njit(nogil=True, forceinline=True)
def _want_children(edges, actions, flags, periods, risk, child, best_steps):
    """Note which children of a node matter: not those behind an edge that is never its best.

    That is an edge of a worse rank than another, and one that ends in damage for certain, where
    another one is without a risk for longer, whatever follows on either.
    """
    first, safest = np.int64(3), 0
    for e in range(edges, edges + actions):
        if flags[e] & APPLICABLE:
            rank = np.int64(flags[e] >> _RANK)
            if rank < first:
                first, safest = rank, 0
            if rank == first:
                safest = max(safest, int(periods[e]))
    for e in range(edges, edges + actions):
        lasting = risk[e] < 1.0 or periods[e] >= safest
        if child[e] >= 0 and lasting and np.int64(flags[e] >> _RANK) == first:
            best_steps[child[e]] = _WANTED


@cached_njit(nogil=True)
def search(address, state, width, actions, depth, repeat, gamma, accepted, max_nodes, max_edges,
           theta, dt, leaves, always, states, reward, weight, flags, periods, risk, child,
           best_value, best_risk, best_steps, table, value, path_risk, steps, first_reward,
           first_flags):  # fmt: skip
    """Expand the planning graph of one state `[F]` and find the best path of every first action.

    `leaves` says what the states are worth that the last layer leads to (see
    `serp.planning.leaf_value`), `always` or where all actions promise the same without it; empty:
    nothing. The other arguments and the results are those of `_search`.
    """
    found = _search_all(
        address, state, width, actions, depth, repeat, gamma, accepted, max_nodes, max_edges, theta,
        dt, leaves if always else leaves[:0], states, reward, weight, flags, periods, risk, child,
        best_value, best_risk, best_steps, table, value, path_risk, steps, first_reward,
        first_flags,
    )  # fmt: skip
    if not always and leaves.shape[0] > 0 and _alike(value, path_risk, steps, first_flags):
        found = _search_all(
            address, state, width, actions, depth, repeat, gamma, accepted, max_nodes, max_edges,
            theta, dt, leaves, states, reward, weight, flags, periods, risk, child, best_value,
            best_risk, best_steps, table, value, path_risk, steps, first_reward, first_flags,
        )  # fmt: skip
    return found


@cached_njit(nogil=True)
def _alike(value, path_risk, steps, flags):
    """As `serp.planning.forecast.all_alike`."""
    lowest = 3
    for action in range(value.shape[0]):
        if flags[action] & APPLICABLE:
            lowest = min(lowest, _rank_of(flags[action]))
    first, count = -1, 0
    for action in range(value.shape[0]):
        if not flags[action] & APPLICABLE or _rank_of(flags[action]) != lowest:
            continue
        count += 1
        if first < 0:
            first = action
        elif (
            value[action] != value[first]
            or path_risk[action] != path_risk[first]
            or steps[action] != steps[first]
        ):
            return False
    return count > 1


@cached_njit(nogil=True)
def _search_all(address, state, width, actions, depth, repeat, gamma, accepted, max_nodes,
                max_edges, theta, dt, leaves, states, reward, weight, flags, periods, risk, child,
                best_value, best_risk, best_steps, table, value, path_risk, steps, first_reward,
                first_flags):  # fmt: skip
    """As `_search`, without the nodes that cannot matter where the budgets have room for all."""
    nodes, layer = 0, 1
    for _ in range(depth):
        nodes += layer
        layer *= actions
        if nodes > max_nodes or nodes * actions > max_edges:
            break
    roomy = nodes <= max_nodes and nodes * actions <= max_edges
    found = _search(
        address, state, width, actions, depth, repeat, gamma, accepted, max_nodes, max_edges, theta,
        dt, leaves, states, reward, weight, flags, periods, risk, child, best_value, best_risk,
        best_steps, table, value, path_risk, steps, first_reward, first_flags, roomy,
    )  # fmt: skip
    if roomy and found[2] == _EXHAUSTED:
        # How deep the graph is, only all of it tells.
        found = _search(
            address, state, width, actions, depth, repeat, gamma, accepted, max_nodes, max_edges,
            theta, dt, leaves, states, reward, weight, flags, periods, risk, child, best_value,
            best_risk, best_steps, table, value, path_risk, steps, first_reward, first_flags, False,
        )  # fmt: skip
    return found


@cached_njit(nogil=True)
def _search(address, state, width, actions, depth, repeat, gamma, accepted, max_nodes, max_edges,
            theta, dt, leaves, states, reward, weight, flags, periods, risk, child, best_value,
            best_risk, best_steps, table, value, path_risk, steps, first_reward, first_flags,
            choosy):  # fmt: skip
    """Expand and look back; `choosy`: leave out nodes that cannot matter.

    Where a budget ends the expansion, `leaves` are worth nothing.

    Scratch: flat `states`, `[(max_nodes + 2) * (F + 1)]`; `reward`, `weight`, `flags`, `periods`,
    `risk`, `child`, `[max_nodes * A]`; `best_value`, `best_risk`, `best_steps`, `[max_nodes]`;
    `table`, a power of two of at least twice max_nodes. Results, `[A]`: `value`, `path_risk`,
    `steps`, `first_reward`, `first_flags`; see `Forecast`.

    Returns:
        Chosen action, layers expanded, bound.
    """
    row = width + 1
    literals = pointer_to(theta, 0)
    scratch = pointer_to(states, (max_nodes + 1) * row)
    for i in range(width):
        states[i] = state[i]
    start = 0
    end = 1
    expanded = 0
    applied = 0
    bound = _DEPTH
    while expanded < depth:
        if start == end:
            bound = _EXHAUSTED
            break
        if end > max_nodes:
            bound = _NODES
            break
        stored = end
        keep = expanded + 1 < depth
        mask = 1
        if keep:
            wanted = min(max_nodes, (end - start) * actions)
            while mask < 2 * wanted:
                mask *= 2
            mask -= 1
            for i in range(mask + 1):
                table[i] = -1
        for node in range(start, end):
            if choosy and node > 0 and best_steps[node] == _LEFT_OUT:
                continue
            source = pointer_to(states, node * row)
            for action in range(actions):
                e = node * actions + action
                slot = min(stored, max_nodes)
                reward[e], weight[e], bits, rank, periods[e], risk[e], one_reward, one_flags = edge(
                    address, source, action, repeat, gamma, accepted, literals, dt,
                    pointer_to(states, slot * row), scratch, width,
                )  # fmt: skip
                flags[e] = bits & _BITS | rank << _RANK
                child[e] = -1
                applied += flags[e] & APPLICABLE
                if expanded == 0:
                    first_reward[action] = one_reward
                    first_flags[action] = one_flags
                if not flags[e] & APPLICABLE or flags[e] & TERMINAL:
                    continue
                if not keep:
                    if leaves.shape[0] > 0:
                        reward[e] += weight[e] * value_at(leaves, states, slot * row, width)
                    continue
                if stored > max_nodes:
                    continue  # the next layer is too large to be expanded: all its nodes are leaves
                place = _same_slot(states, row, width, table, mask, slot)
                if table[place] < 0:
                    if stored < max_nodes:
                        table[place] = stored
                        best_steps[stored] = _LEFT_OUT if choosy and node > 0 else _WANTED
                    stored += 1
                    if stored > max_nodes:
                        continue
                child[e] = table[place]
            if choosy and keep and node > 0:
                _want_children(node * actions, actions, flags, periods, risk, child, best_steps)
            if applied > max_edges and expanded > 0:
                break
        if applied > max_edges and expanded > 0:
            bound = _NODES
            break
        start = end
        end = stored
        expanded += 1
    for node in range(start - 1, -1, -1):
        if choosy and node > 0 and best_steps[node] == _LEFT_OUT:
            continue
        chosen = -1
        top_risk, top_steps, top_value = 0.0, SAFE, 0.0
        best = _promise(0, top_risk, top_steps, top_value)
        undefined = 0
        for action in range(actions):
            e = node * actions + action
            if not flags[e] & APPLICABLE:
                if node == 0:
                    value[action] = -np.inf
                    path_risk[action] = 1.0
                    steps[action] = -1
                    first_reward[action] = 0.0
                undefined |= flags[e] & UNDEFINED
                continue
            total, danger, safe = reward[e], risk[e], SAFE
            if 0 <= child[e] < start:
                total += weight[e] * best_value[child[e]]
                danger += (1.0 - danger) * best_risk[child[e]]
                safe = best_steps[child[e]]
                if safe != SAFE:
                    safe += periods[e]
            if risk[e] > 0.0:
                safe = int(periods[e])
            if node == 0:
                value[action] = total
                path_risk[action] = danger
                steps[action] = safe
            found = _promise(np.int64(flags[e] >> _RANK), danger, safe, total)
            if chosen < 0 or found > best:
                chosen, best = action, found
                top_risk, top_steps, top_value = danger, safe, total
        if chosen < 0 and undefined:
            # What happens there cannot be predicted, so nothing is known to be safe.
            top_risk, top_steps = 1.0, 0
        best_value[node] = top_value
        best_risk[node] = top_risk
        best_steps[node] = top_steps
        if node == 0:
            return chosen, expanded, bound
    return -1, expanded, bound


@cached_njit(nogil=True, parallel=True)
def search_batch(address, batch, actions, depth, repeat, gamma, accepted, max_nodes, max_edges,
                 theta, dt, leaves, always, states, reward, weight, flags, periods, risk, child,
                 best_value, best_risk, best_steps, table, choice, value, path_risk, steps,
                 first_reward, first_flags, expanded, bound):  # fmt: skip
    """Run `search` on every row of `batch` `[B, F]`, in parallel over the rows.

    Scratch arrays have one more leading axis, one entry a thread; results one, an entry a row.
    """
    rows, width = batch.shape
    for k in prange(rows):
        t = get_thread_id()
        choice[k], expanded[k], bound[k] = search(
            address, batch[k], width, actions, depth, repeat, gamma, accepted, max_nodes, max_edges,
            theta, dt, leaves, always, states[t], reward[t], weight[t], flags[t], periods[t],
            risk[t], child[t], best_value[t], best_risk[t], best_steps[t], table[t], value[k],
            path_risk[k], steps[k], first_reward[k], first_flags[k],
        )  # fmt: skip


def threads() -> int:
    """Return how many threads a batch is spread over."""
    return int(get_num_threads())
