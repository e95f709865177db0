"""The compiled loops that solve a planning graph: value iteration, and the look-up of a forecast.

Records are passed as plain tuples, see `serp.planning.edges`.
"""

from __future__ import annotations

import numpy as np

from serp._util.compilation import cached_njit
from serp.planning.array_graph import Counters, GraphArrays
from serp.planning.edges import FirstActions
from serp.planning.forecast import SAFE
from serp.planning.preference import compiled_path_score, compiled_rank_of, compiled_within_slack

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

_TINY = 1e-9
_ONCE = -2
"""In place of the node of an edge that is taken once: no outcome leads there."""


# The sum over outcomes is written out twice: a column as an argument of a loop costs a reference
# count for every edge, and solving a graph takes ten times as long.
@cached_njit(nogil=True, forceinline=True)
def lasting_risk(graph, edge, node, discount):
    """Return the discounted risk of an edge that is taken again while it leads back to its node.

    The least risk is a fixed point of it, whether or not the edge is taken again (`_ONCE`).
    """
    danger, following, own = graph.step_risk[edge], 0.0, 0.0
    for k in range(graph.first_outcome[edge], graph.first_outcome[edge + 1]):
        target = graph.target[k]
        if target == node:
            own += graph.chance[k]
        elif target >= 0:
            following += graph.chance[k] * graph.risk[target]
    rest = (1.0 - danger) * discount
    return (danger + rest * following) / max(1.0 - rest * own, _TINY)


@cached_njit(nogil=True, forceinline=True)
def lasting_value(graph, edge, node, discount):
    """Return the value of an edge that is taken again while it leads back to its node.

    It is the value to choose by. Taken once (`_ONCE`), to wait for nothing at discount 1 would be
    worth what can be done afterwards, and might be done for ever.
    """
    following, own = 0.0, 0.0
    for k in range(graph.first_outcome[edge], graph.first_outcome[edge + 1]):
        target = graph.target[k]
        if target == node:
            own += graph.chance[k]
        elif target >= 0:
            following += graph.chance[k] * graph.value[target]
    total = graph.reward[edge] + discount * following
    if discount * own < 1.0 - _TINY:
        return total / (1.0 - discount * own)
    return total + graph.value[node] if total != 0.0 else 0.0


@cached_njit(nogil=True, forceinline=True)
def steps_through(graph, edge):
    """Return the control periods before the first risk on an edge and what follows it."""
    if graph.step_risk[edge] > 0.0:
        return np.int64(0)
    least = np.int64(SAFE)
    for k in range(graph.first_outcome[edge], graph.first_outcome[edge + 1]):
        target = graph.target[k]
        if target >= 0 and graph.steps[target] < least:
            least = graph.steps[target]
    return least if least == SAFE else least + 1


@cached_njit(nogil=True, forceinline=True)
def best_rank(graph, node):
    """Return the least rank of the edges of a node."""
    rank = np.int64(3)
    for edge in range(graph.first_edge[node], graph.first_edge[node + 1]):
        rank = min(rank, np.int64(compiled_rank_of(graph.flags[edge])))
    return rank


@cached_njit(nogil=True, forceinline=True)
def certain(graph, edge):
    """Return whether damage is certain after an edge."""
    if graph.step_risk[edge] >= 1.0:
        return True
    for k in range(graph.first_outcome[edge], graph.first_outcome[edge + 1]):
        target = graph.target[k]
        if target < 0 or not graph.dead_end[target]:
            return False
    return True


_EXACT = 1e-9
"""Precision of the values of states: value iteration ends where none changed by more than this
fraction of the largest."""
ALIKE = 1e-7
"""Values that differ by less than this fraction of the largest are equal."""
_SWEEPS = 3_000
"""Most sweeps of value iteration, and of each of its parts."""
_NODES, _EXPANDED, _EDGES, _ = Counters()


@cached_njit(nogil=True)
def mark_dead_ends(arrays):
    """Mark the nodes at which every action of the best rank is certain to do damage."""
    graph = GraphArrays(*arrays)
    expanded = graph.counters[_EXPANDED]
    for node in range(graph.counters[_NODES]):
        graph.dead_end[node] = 0
    changed = True
    while changed:
        changed = False
        for k in range(expanded):
            node = expanded - 1 - k
            if graph.dead_end[node]:
                continue
            start, end = graph.first_edge[node], graph.first_edge[node + 1]
            lost = start < end or graph.undefined[node] != 0
            lowest = best_rank(graph, node)
            for edge in range(start, end):
                if np.int64(compiled_rank_of(graph.flags[edge])) == lowest:
                    lost = lost and certain(graph, edge)
            if lost:
                graph.dead_end[node] = 1
                changed = True


@cached_njit(nogil=True, forceinline=True)
def _accepted(graph, edge, node, danger, accepted):
    """Return whether the risk of an edge of the best rank, `danger`, counts as the least."""
    within = compiled_within_slack(danger, graph.risk[node] + ALIKE, accepted)
    return within and not graph.dead_end[node] and not certain(graph, edge)


@cached_njit(nogil=True)
def solve(arrays, discount, accepted):
    """Find the best policy of every node, by value iteration.

    The order of preferences is that of `serp.planning.preference`; the risks of later steps are
    discounted, as rewards are (lexicographic value iteration: Wray, Zilberstein & Mouaddib, AAAI
    2015). A risk within the slack of the least, by what follows at the least risk, counts as the
    least. Nodes that are not expanded have value and risk 0.

    Args:
        arrays: Values of `GraphArrays`; values and risks are continued from.
        discount: Weight of a reward one control period later.
        accepted: The slack.
    """
    graph = GraphArrays(*arrays)
    nodes, expanded = graph.counters[_NODES], graph.counters[_EXPANDED]
    allowed = np.empty(graph.counters[_EDGES], dtype=np.uint8)
    for node in range(nodes):
        graph.best[node] = -1
        graph.risk[node] = 0.0
        graph.steps[node] = SAFE
        graph.inside[node] = 1 if node < expanded else 0
        if node >= expanded:
            graph.value[node] = 0.0
    for node in range(expanded):
        lowest = best_rank(graph, node)
        start, end = graph.first_edge[node], graph.first_edge[node + 1]
        for edge in range(start, end):
            allowed[edge] = np.int64(compiled_rank_of(graph.flags[edge])) == lowest
        if start == end:
            graph.value[node] = 0.0
            graph.risk[node] = 1.0 if graph.undefined[node] else 0.0
            graph.steps[node] = 0 if graph.undefined[node] else SAFE
    risky = _solve_risks(graph, expanded, discount, allowed)
    graph.dead_end[:nodes] = 0
    if risky and accepted > 0.0:
        mark_dead_ends(arrays)
        _allow_accepted(graph, expanded, discount, accepted, allowed)
    _solve_values(graph, expanded, discount, allowed)
    _mark_inside(graph, expanded)


@cached_njit(nogil=True)
def _solve_risks(graph, expanded, discount, allowed):
    """Find the least risks, and leave only the edges that have them; return if there are any."""
    risky = False
    for edge in range(graph.counters[_EDGES]):
        risky = risky or graph.step_risk[edge] > 0.0
    for node in range(expanded):
        risky = risky or graph.risk[node] > 0.0
    if not risky:
        return False
    for sweep in range(_SWEEPS):
        change = 0.0
        for k in range(expanded):
            node = k if sweep % 2 else expanded - 1 - k
            start, end = graph.first_edge[node], graph.first_edge[node + 1]
            if start == end:
                continue
            least = 2.0
            for edge in range(start, end):
                if allowed[edge]:
                    least = min(least, lasting_risk(graph, edge, node, discount))
            change = max(change, abs(least - graph.risk[node]))
            graph.risk[node] = least
        if change <= _EXACT:
            break
    for node in range(expanded):
        for edge in range(graph.first_edge[node], graph.first_edge[node + 1]):
            if allowed[edge]:
                danger = lasting_risk(graph, edge, node, discount)
                allowed[edge] = danger <= graph.risk[node] + ALIKE
        if graph.risk[node] <= ALIKE:
            graph.risk[node] = 0.0
    for sweep in range(_SWEEPS):
        changed = False
        for k in range(expanded):
            node = k if sweep % 2 else expanded - 1 - k
            start, end = graph.first_edge[node], graph.first_edge[node + 1]
            if start == end or graph.risk[node] == 0.0:
                continue
            longest = np.int64(-1)
            for edge in range(start, end):
                if allowed[edge]:
                    longest = max(longest, steps_through(graph, edge))
            if longest != graph.steps[node]:
                graph.steps[node] = longest
                changed = True
        if not changed:
            break
    return True


@cached_njit(nogil=True)
def _allow_accepted(graph, expanded, discount, accepted, allowed):
    """Allow the edges whose risk counts as the least."""
    for node in range(expanded):
        lowest = best_rank(graph, node)
        for edge in range(graph.first_edge[node], graph.first_edge[node + 1]):
            if np.int64(compiled_rank_of(graph.flags[edge])) == lowest and not allowed[edge]:
                danger = lasting_risk(graph, edge, node, discount)
                allowed[edge] = _accepted(graph, edge, node, danger, accepted)


@cached_njit(nogil=True)
def _solve_values(graph, expanded, discount, allowed):
    for sweep in range(_SWEEPS):
        change, largest = 0.0, 0.0
        for k in range(expanded):
            node = k if sweep % 2 else expanded - 1 - k
            start, end = graph.first_edge[node], graph.first_edge[node + 1]
            if start == end:
                continue
            most = -np.inf
            for edge in range(start, end):
                if allowed[edge]:
                    most = max(most, lasting_value(graph, edge, node, discount))
            change = max(change, abs(most - graph.value[node]))
            largest = max(largest, abs(most))
            graph.value[node] = most
        if change <= _EXACT * largest:
            break
    unit = ALIKE * largest
    for node in range(expanded):
        most, best = -np.inf, np.int64(-1)
        for edge in range(graph.first_edge[node], graph.first_edge[node + 1]):
            if allowed[edge]:
                value = lasting_value(graph, edge, node, discount)
                if best < 0 or value > most + unit:
                    most, best = value, np.int64(edge)
        graph.best[node] = best


@cached_njit(nogil=True)
def _mark_inside(graph, expanded):
    """Mark the nodes whose best policy never leads to a node that is not expanded."""
    changed = True
    while changed:
        changed = False
        for k in range(expanded):
            node = expanded - 1 - k
            edge = graph.best[node]
            if edge < 0 or not graph.inside[node]:
                continue
            for outcome in range(graph.first_outcome[edge], graph.first_outcome[edge + 1]):
                target = graph.target[outcome]
                if target >= 0 and not graph.inside[target]:
                    graph.inside[node] = 0
                    changed = True
                    break


@cached_njit(nogil=True, forceinline=True)
def _rounded(number, unit):
    return np.round(number / unit) * unit if unit > 0.0 else number


@cached_njit(nogil=True, forceinline=True)
def _score(graph, edge, node, discount, unit):
    """Return the score that an edge is chosen by, see `serp.planning.preference`."""
    danger = lasting_risk(graph, edge, node, discount)
    danger = 0.0 if danger <= ALIKE else _rounded(danger, ALIKE)
    steps = steps_through(graph, edge) if danger > 0.0 else np.int64(SAFE)
    value = _rounded(lasting_value(graph, edge, node, discount), unit)
    return compiled_path_score(np.int64(compiled_rank_of(graph.flags[edge])), danger, steps, value)


@cached_njit(nogil=True, forceinline=True)
def _shown_risk(graph, edge, discount, score):
    """Return the risk of an edge that is taken once; 0 only if it is 0 in the score."""
    return (
        0.0
        if score[1] == 0.0
        else max(ALIKE, _rounded(lasting_risk(graph, edge, _ONCE, discount), ALIKE))
    )


@cached_njit(nogil=True)
def look_up(arrays, node, rules, unit, found):
    """Write the forecast for one expanded node; return the chosen action.

    The choice is made as in `solve`. The forecast is of an action that is taken once, with the best
    policy from then on. Where rounding hides that another action is worse than the choice, it
    differs by the least number that there is, so that the forecast never contradicts the choice.

    Args:
        arrays: Values of `GraphArrays`, solved.
        node: The node.
        rules: Discount and accepted risk, as in `solve`.
        unit: Values are rounded to multiples of this.
        found: Values of `FirstActions`, written.
    """
    graph = GraphArrays(*arrays)
    first = FirstActions(*found)
    discount, accepted = rules
    first.value[:], first.path_risk[:], first.safe_steps[:] = -np.inf, 1.0, -1
    first.reward[:], first.flags[:] = 0.0, 0
    start, end = graph.first_edge[node], graph.first_edge[node + 1]
    if start == end:
        return np.int64(-1)
    scores = [_score(graph, start, node, discount, unit)]
    for edge in range(start + 1, end):
        scores.append(_score(graph, edge, node, discount, unit))
    safest = chosen = 0
    for k in range(1, len(scores)):
        if scores[k] > scores[safest]:
            safest = k
    rank, risk, steps, _ = scores[safest]
    least = _shown_risk(graph, start + safest, discount, scores[safest])
    if accepted > 0.0:  # an accepted risk counts as that of the safest
        for k in range(len(scores)):
            danger = lasting_risk(graph, start + k, node, discount)
            if scores[k][0] == rank and _accepted(graph, start + k, node, danger, accepted):
                scores[k] = rank, risk, steps, scores[k][3]
    for k in range(1, len(scores)):
        if scores[k] > scores[chosen]:
            chosen = k
    best = scores[chosen]
    most = _rounded(lasting_value(graph, start + chosen, _ONCE, discount), unit)
    for k in range(len(scores)):
        edge, score = start + k, scores[k]
        value = _rounded(lasting_value(graph, edge, _ONCE, discount), unit)
        danger = _shown_risk(graph, edge, discount, score)
        if score[:2] == best[:2]:
            danger = least
            if score[2] == best[2]:
                value = most if score[3] == best[3] else min(value, np.nextafter(most, -np.inf))
        elif score[0] == best[0]:
            danger = max(danger, np.nextafter(least, np.inf))
        action = graph.action[edge]
        first.value[action], first.path_risk[action] = value, danger
        first.safe_steps[action], first.flags[action] = score[2], graph.flags[edge]
        first.reward[action] = graph.reward[edge]
    return np.int64(graph.action[start + chosen])
