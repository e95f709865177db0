"""The compiled search through the planning graph, the same for every domain.

The graph is expanded layer by layer; equal states of a layer merge; the last layer is never stored.
A backward pass over the stored layers finds the best path of every first action. Rows of states
have F + 1 entries, the last for the reward.
"""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit
from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED
from serp.model.native import pointer_to
from serp.planning.edge_kernels import edge
from serp.planning.far_sight.cell_values import CellValues, value_at
from serp.planning.forecast import SAFE
from serp.planning.hash_table import state_slot, table_size
from serp.planning.kernel_records import FirstActions, Rules, Scratch
from serp.planning.limits import Bound
from serp.planning.preference import compiled_path_score, compiled_within_slack

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

_DEPTH = int(Bound.DEPTH)
_NODES = int(Bound.NODES)
_EXHAUSTED = int(Bound.EXHAUSTED)
_BITS, _RANK = 0x1F, 6
"""Stored flags of an edge: their bits, and above these the rank of its first period."""


@cached_njit(nogil=True)
def search(model, rules, leaves, state, scratch, found):
    """Expand the planning graph of one state and find the best path of every first action.

    `model` is `TransitionModel.machine_code`. Rules, scratch and found (which is written) are
    records of `serp.planning.kernel_records` as plain tuples. So are `leaves`, a `CellValues`, the
    values of the states that the last layer leads to; without any they are 0.

    Returns:
        Chosen action, layers expanded, bound, edges followed.
    """
    room, first = Scratch(*scratch), FirstActions(*found)
    return _search(model, Rules(*rules), CellValues(*leaves), state, room, first)


@cached_njit(nogil=True)
def _search(model, rules, leaves, state, scratch, found):
    """Expand and evaluate the nodes; where a budget ends the expansion, leaves are worth 0."""
    (
        states, reward, weight, flags, periods, risk, child, best_value, best_risk, best_steps,
        table,
    ) = scratch  # fmt: skip
    value, path_risk, steps, first_reward, first_flags = found
    actions, depth = rules.actions, rules.depth
    max_nodes, max_edges = rules.max_nodes, rules.max_edges
    accepted = rules.accepted_risk
    width = state.shape[0]
    row = width + 1
    room = pointer_to(states, (max_nodes + 1) * row)
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
        mask = 0
        if keep:
            mask = table_size(min(max_nodes, (end - start) * actions)) - 1
            for i in range(mask + 1):
                table[i] = -1
        for node in range(start, end):
            source = pointer_to(states, node * row)
            for action in range(actions):
                e = node * actions + action
                slot = min(stored, max_nodes)
                reward[e], weight[e], bits, rank, periods[e], risk[e], one_reward, one_flags = edge(
                    model, rules, source, action, pointer_to(states, slot * row), room, width
                )
                flags[e] = bits & _BITS | rank << _RANK
                child[e] = -1
                applied += flags[e] & APPLICABLE
                if expanded == 0:
                    first_reward[action] = one_reward
                    first_flags[action] = one_flags
                if not flags[e] & APPLICABLE or flags[e] & TERMINAL:
                    continue
                if not keep:
                    if leaves.value.shape[0] > 0:
                        reward[e] += weight[e] * value_at(leaves, states, slot * row)
                    continue
                if stored > max_nodes:
                    continue  # the next layer is too large to be expanded: all its nodes are leaves
                place = state_slot(table, mask, states, row, pointer_to(states, slot * row), width)
                if table[place] < 0:
                    if stored < max_nodes:
                        table[place] = stored
                    stored += 1
                    if stored > max_nodes:
                        continue
                child[e] = table[place]
            if applied > max_edges and expanded > 0:
                break
        if applied > max_edges and expanded > 0:
            bound = _NODES
            break
        start = end
        end = stored
        expanded += 1
    for node in range(start - 1, -1, -1):
        chosen = -1
        chance = False
        top_risk, top_steps, top_value = 0.0, SAFE, 0.0
        best = compiled_path_score(0, top_risk, top_steps, top_value)
        undefined = 0
        for action in range(actions):
            e = node * actions + action
            if not flags[e] & APPLICABLE:
                value[action] = -np.inf
                path_risk[action] = 1.0
                steps[action] = -1
                if node == 0:
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
            value[action] = total  # those of node 0 come last, and remain
            path_risk[action] = danger
            steps[action] = safe
            score = compiled_path_score(np.int64(flags[e] >> _RANK), danger, safe, total)
            if chosen < 0 or score > best:
                chosen, best = action, score
                top_risk, top_steps, top_value = danger, safe, total
            chance = chance or 0.0 < danger < 1.0
        if chosen < 0 and undefined:
            # No result can be predicted there, so no action is known to be safe.
            top_risk, top_steps = 1.0, 0
        if chance and accepted > 0.0:
            rank = flags[node * actions + chosen] >> _RANK
            for action in range(actions):
                e = node * actions + action
                if not flags[e] & APPLICABLE or flags[e] >> _RANK != rank:
                    continue
                if not compiled_within_slack(path_risk[action], top_risk, accepted):
                    continue
                path_risk[action] = top_risk
                steps[action] = top_steps
                if value[action] > top_value or (value[action] == top_value and action < chosen):
                    chosen, top_value = action, value[action]
        best_value[node] = top_value
        best_risk[node] = top_risk
        best_steps[node] = top_steps
        if node == 0:
            return chosen, expanded, bound, applied
    return -1, expanded, bound, applied
