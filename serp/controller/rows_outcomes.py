"""Counted outcomes for many states at once; see `outcomes` for one.

Probabilities are arrays `[K, N]`, what outcomes predict lists of K arrays `[columns, N]`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .outcomes import (
    APPLICABLE,
    BASIS,
    CHANGE,
    PRIME,
    PRIORS,
    RARE,
    UNDEFINED,
    UNSAFE,
    CountTable,
    made_tables,
)  # fmt: skip

if TYPE_CHECKING:
    from .rows_step import FileRows

Rows = NDArray[np.float64]
Flags = NDArray[np.int64]
_PRIME = np.uint64(PRIME)


class PredictedRows(NamedTuple):
    """Outcomes of a group: probabilities, values of counted fluents, the likeliest."""

    columns: list[int]
    probabilities: Rows
    values: list[Rows]
    best: NDArray[np.int64]

    def put(self, kind: int, out: Rows, where: NDArray[np.bool_]) -> None:
        """Set the counted fluents of some states as an outcome predicts."""
        for column, values in zip(self.columns, self.values[kind], strict=True):
            out[column, where] = values[where]


class OutcomeRows:
    """The counted outcomes of every action.

    Attributes:
        counted: `[A]` whether an action has any.
    """

    def __init__(
        self, data: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], file: FileRows
    ) -> None:
        tables = made_tables(data, arrays)
        self._file = file
        self._others: list[list[int]] = arrays["others"].tolist()
        self._groups: list[list[tuple[list[int], CountTable]]] = [
            [(g["inputs"], tables[g["table"]]) for g in groups if g["table"] is not None]
            for groups in data["actions"]
        ]
        self.counted = [bool(groups) for groups in self._groups]

    def settle(self, states: Rows, action: int, flow_flags: Flags, out: Rows) -> tuple[Flags, Rows]:
        """Apply the likeliest outcomes and then events; rewards are expected over all outcomes.

        Returns:
            Flags of the likeliest outcome, and the probability that events flag the step unsafe.
        """
        flowed = out[:-1].copy()
        predictions = [
            self._predict(inputs, table, states, action, flowed)
            for inputs, table in self._groups[action]
        ]
        for each in predictions:
            for kind in range(1, len(each.values)):
                each.put(kind, out, each.best == kind)
        usual = out.copy()
        flags = self._file.settle(states, flow_flags, out)
        unsafe = flags & UNSAFE != 0
        reward = out[-1].copy()
        expected, alike = reward.copy(), np.ones(len(reward))
        for each in predictions:
            different = np.zeros(len(reward))
            for kind, p in enumerate(each.probabilities):
                meant = (each.best != kind) & (p > 0.0)
                if not meant.any():
                    continue
                other = usual.copy()
                each.put(kind, other, meant)
                changed = self._file.settle(states, flow_flags, other)
                undefined, flagged = changed & UNDEFINED != 0, changed & UNSAFE != 0
                counts = meant & (flagged != unsafe) & (flagged | ~undefined)
                different = np.where(counts, different + p, different)
                counts = meant & ~undefined & np.isfinite(other[-1])
                expected = np.where(counts, expected + p * (other[-1] - reward), expected)
            alike = alike * np.maximum(0.0, 1.0 - different)
        applicable = flags & APPLICABLE != 0
        out[-1] = np.where(applicable & np.isfinite(expected), expected, out[-1])
        risk = np.where(unsafe, alike, 1.0 - alike)
        return flags, np.where(applicable, risk, np.where(unsafe, 1.0, 0.0))

    def _predict(
        self, inputs: list[int], table: CountTable, states: Rows, action: int, flowed: Rows
    ) -> PredictedRows:
        columns = [inputs[place] for place in table.places]
        p = probabilities_of(table, inputs, states)
        values = [flowed[columns]]
        left = p[0].copy()
        for kind in range(1, table.kinds):
            usual = p[kind] >= RARE
            found, possible = values[0], np.zeros(len(left), np.bool_)
            if usual.any():
                found, possible = self._outcome(table, kind, columns, states, action)
            p[kind] = np.where(usual & possible, p[kind], 0.0)
            values.append(found)
            left = left + p[kind]
        none = left <= RARE
        p[0, none] = left[none] = 1.0
        for kind in range(1, table.kinds):
            for other in range(kind):
                same = (p[kind] > 0.0) & (p[other] > 0.0)
                if same.any():
                    same &= (values[kind] == values[other]).all(axis=0)
                    p[other] = np.where(same, p[other] + p[kind], p[other])
                    p[kind] = np.where(same, 0.0, p[kind])
        p = p / left
        return PredictedRows(columns, p, values, p.argmax(axis=0))

    def _outcome(
        self, table: CountTable, kind: int, columns: list[int], states: Rows, action: int
    ) -> tuple[Rows, NDArray[np.bool_]]:
        """Return the counted fluents that an outcome predicts, and where it is possible."""
        schema = table.schemas[kind]
        if schema == CHANGE:
            values, possible = states[columns], np.ones(states.shape[1], np.bool_)
            ways = zip(table.changes[kind], table.ranges, strict=True)
            for k, (by, (low, high)) in enumerate(ways):
                values[k] += by
                if by != 0.0:
                    possible &= (low <= values[k]) & (values[k] <= high)
            return values, possible
        other = self._others[action][schema]
        if other < 0:
            return states[columns], np.zeros(states.shape[1], np.bool_)
        step, flags = self._file.flow(states, other)
        return step[columns], flags & APPLICABLE != 0


def probabilities_of(table: CountTable, inputs: list[int], states: Rows) -> Rows:
    """Return the probability of each outcome in states, as `CountTable.probabilities` does."""
    broadest = np.repeat(np.array(table.broadest)[:, None], states.shape[1], axis=1)
    one = _refined(table, 0, inputs, states, broadest)
    other = _refined(table, 1, inputs, states, broadest)
    mixed = table.share * one + (1.0 - table.share) * other
    return _refined(table, 2, inputs, states, mixed)


def _refined(table: CountTable, level: int, inputs: list[int], states: Rows, broader: Rows) -> Rows:
    context = table.context_of(level)
    if not context:
        return broader.copy()
    codes = np.full(states.shape[1], BASIS ^ level, np.uint64)
    for place in context:
        codes = (codes ^ states[inputs[place]].astype(np.int64).view(np.uint64)) * _PRIME
        codes ^= codes >> np.uint64(29)
    find = table.rows.get
    rows = np.array([find(code, 0) for code in (codes >> np.uint64(11)).tolist()], np.int64)
    trust, evidence, total = table.trust[level], table.evidence[rows], table.totals[rows]
    weights = trust[-1] * evidence[:, -1]
    counted, kept = np.zeros(len(rows)), weights
    for e, prior in enumerate(PRIORS):
        weight = trust[e] * evidence[:, e]
        weights = weights + weight
        counted = counted + weight / (total + prior)
        kept = kept + weight * prior / (total + prior)
    refined = (counted * table.counts[rows].T + kept * broader) / weights
    return np.where(rows == 0, broader, refined)
