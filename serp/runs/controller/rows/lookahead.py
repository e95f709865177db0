"""The best path of every first action, a layer of the planning graph at a time.

It gives the same bits as `controller.lookahead.PathSearch.forecast`, and takes less time where
layers are large. Edges are arrays `[A, N]` of A actions and the N nodes of a layer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..forecast import SAFE, Prospects
from ..lookahead import LeafValues, SearchLimits
from ..step import APPLICABLE, RISK_SHIFT, RISK_UNIT, RISKY, TERMINAL, UNDEFINED, UNSAFE

Rows = NDArray[np.float64]
Flags = NDArray[np.int64]
StepRows = Callable[[Rows, Sequence[int]], tuple[Rows, Flags]]
"""See `rows.step`."""


class EdgeRows(NamedTuple):
    """The edges of a layer; see `controller.lookahead.FollowedEdge`. Targets are `[F, A, N]`."""

    target: Rows
    reward: Rows
    flags: Flags
    risk: Rows
    leaf: Rows

    @property
    def goes_on(self) -> NDArray[np.bool_]:
        """Whether an edge leads to a state in which the task goes on."""
        found: NDArray[np.bool_] = (self.flags & (APPLICABLE | TERMINAL)) == APPLICABLE
        return found


ExpandedRows = tuple[list[float], list[EdgeRows], list[Flags], bool]


class LayerSearch:
    """The lookahead over arrays."""

    def __init__(self, limits: SearchLimits, step: StepRows) -> None:
        self._limits, self._step = limits, step
        self._kept: ExpandedRows | None = None

    def forecast(self, state: list[float], leaves: LeafValues | None = None) -> Prospects:
        """Return the predictions for every ground action; `leaves` values the last layer."""
        with np.errstate(all="ignore"):
            if self._kept is None or self._kept[0] != state:
                self._kept = self._expanded(state)
            _, layers, children, complete = self._kept
            if leaves is not None and len(layers) == self._limits.depth:
                layers = [*layers[:-1], _with_values(layers[-1], leaves)]
            return _best(layers, children, complete, self._limits)

    def _expanded(self, state: list[float]) -> ExpandedRows:
        limits = self._limits
        layers: list[EdgeRows] = []
        children: list[Flags] = []
        layer = np.array(state)[:, None]
        nodes, applied, complete = 0, 0, True
        while len(layers) < limits.depth and layer.shape[1]:
            nodes += layer.shape[1]
            if nodes > limits.max_nodes:
                complete = False
                break
            edges = self._followed(layer)
            applied += int((edges.flags & APPLICABLE).sum())
            if applied > limits.max_edges and layers:
                complete = False
                break
            known = np.full(edges.flags.shape, -1)
            if len(layers) + 1 < limits.depth:
                layer = _distinct(edges, known)
            layers.append(edges)
            children.append(known)
        return state, layers, children, complete

    def _followed(self, layer: Rows) -> EdgeRows:
        """Follow all actions from all states of a layer."""
        count, actions = layer.shape[1], self._limits.actions
        bounds = np.arange(actions + 1) * count
        out, flags = self._step(np.tile(layer, (1, actions)), bounds.tolist())
        risk = self._step_risk(flags)

        def by_action(row: NDArray[Any]) -> NDArray[Any]:
            return row.reshape(actions, count)

        rows = map(by_action, (out[-1], _marked(flags, risk), risk, np.zeros(len(flags))))
        return EdgeRows(out[:-1].reshape(len(layer), actions, count), *rows)

    def _step_risk(self, flags: Flags) -> Rows:
        risk = (flags >> RISK_SHIFT) * RISK_UNIT
        risk = np.where(risk > self._limits.accepted_risk, risk, 0.0)
        return np.where(flags & UNSAFE, 1.0, risk)


def _marked(flags: Flags, risk: Rows) -> Flags:
    return np.where((risk > 0.0) & (flags & UNSAFE == 0), flags | RISKY, flags)


def _distinct(edges: EdgeRows, known: Flags) -> Rows:
    """Return the states `[F, M]` that edges lead to, equal ones once; write which to `known`."""
    goes_on = edges.goes_on
    action, node = np.nonzero(goes_on)
    rows = np.ascontiguousarray(edges.target[:, action, node].T) + 0.0  # -0.0 equals 0.0
    if not len(rows):
        return rows.T
    keys = rows.view(np.dtype((np.void, rows.itemsize * rows.shape[1]))).ravel()
    _, first, which = np.unique(keys, return_index=True, return_inverse=True)
    known[goes_on] = which.ravel()
    return np.ascontiguousarray(rows[first].T)


def _with_values(edges: EdgeRows, leaves: LeafValues) -> EdgeRows:
    """Return edges with the values of the states that they lead to."""
    goes_on = edges.goes_on
    action, node = np.nonzero(goes_on)
    leaf = np.zeros_like(edges.reward)
    leaf[goes_on] = leaves(edges.target[:, action, node].T.tolist())
    return edges._replace(leaf=leaf)


def _best(
    layers: list[EdgeRows], children: list[Flags], complete: bool, limits: SearchLimits
) -> Prospects:
    """Find the best path of every first action, from the last layer to the first."""
    discount, accepted = limits.discount, limits.accepted_risk
    value = risk = np.zeros(1)
    steps = np.full(1, SAFE)
    below = 0
    for edges, targets in zip(reversed(layers), reversed(children), strict=True):
        applicable = edges.flags & APPLICABLE != 0
        total = edges.reward + discount * edges.leaf
        danger, safe = edges.risk, np.full(edges.flags.shape, SAFE)
        rank = np.where(edges.flags & UNSAFE, 2, np.where(edges.flags & RISKY, 1, 0))
        if below:
            follows = (targets >= 0) & (targets < below)
            child = np.where(follows, targets, 0)
            total = np.where(follows, total + discount * value[child], total)
            danger = np.where(follows, danger + (1.0 - danger) * risk[child], danger)
            later = np.where(steps[child] == SAFE, SAFE, steps[child] + 1)
            safe = np.where(follows, later, safe)
        safe = np.where(edges.risk > 0.0, 0, safe)
        count = edges.flags.shape[1]
        chosen = np.full(count, -1)
        best = [np.zeros(count) for _ in range(4)]
        for action in range(len(edges.flags)):
            score = -rank[action], -danger[action], safe[action], total[action]
            better, equal = np.zeros(count, np.bool_), np.ones(count, np.bool_)
            for one, other in zip(score, best, strict=True):
                better |= equal & (one > other)
                equal &= one == other
            better = applicable[action] & (better | (chosen < 0))
            chosen = np.where(better, action, chosen)
            best = [np.where(better, one, other) for one, other in zip(score, best, strict=True)]
        if accepted > 0.0:
            counts = applicable & (-rank == best[0]) & (danger < 1.0)
            counts &= danger <= -best[1] + accepted
            danger, safe = np.where(counts, -best[1], danger), np.where(counts, best[2], safe)
            worth = np.where(counts, total, -np.inf)
            most = np.maximum(worth.max(axis=0), best[3])
            most_valued = counts & (worth == most)
            chosen = np.where(most_valued.any(axis=0), most_valued.argmax(axis=0), chosen)
            best[3] = most
        undefined = (chosen < 0) & (~applicable & (edges.flags & UNDEFINED != 0)).any(axis=0)
        some = chosen >= 0
        value = np.where(some, best[3], 0.0)
        risk = np.where(undefined, 1.0, np.where(some, -best[1], 0.0))
        steps = np.where(undefined, 0, np.where(some, best[2], SAFE)).astype(np.int64)
        below = count
    known = applicable[:, 0]
    return Prospects(
        int(chosen[0]),
        np.where(known, total[:, 0], -np.inf).tolist(),
        np.where(known, danger[:, 0], 1.0).tolist(),
        np.where(known, safe[:, 0], -1).tolist(),
        np.where(known, edges.reward[:, 0], 0.0).tolist(),
        edges.flags[:, 0].tolist(),
        complete,
    )
