"""Counted outcomes for many states at once; see `controller.outcomes`, and `rows.step` for arrays.

Counted fluents have few values, so that few predictions serve all states.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..outcomes import APPLICABLE, RARE, UNDEFINED, UNSAFE, CountTable, Prediction

if TYPE_CHECKING:
    from ..adaptation import Adaptation, LearnedGroup
    from .step import FileRows

Rows = NDArray[np.float64]
Flags = NDArray[np.int64]


class PredictedRows(NamedTuple):
    """Predictions of one table for M of the states.

    Attributes:
        at: `[M]` places of the states.
        columns: `[C, M]` columns of their counted fluents.
        which: `[M]` the prediction of each.
        probabilities: `[U, K]`, and `values` `[U, K, C]`, of each prediction.
        best: `[U]` likeliest outcome.
    """

    at: Flags
    columns: Flags
    which: Flags
    probabilities: Rows
    values: Rows
    best: Flags

    def put(self, some: Flags, kinds: Flags | int, out: Rows) -> None:
        """Set the counted fluents of some of the M states, which are all columns of `out`."""
        values = self.values[self.which[some], kinds]
        out[self.columns[:, some], np.arange(len(some))] = values.T


class OutcomeRows:
    """The counted outcomes of every action."""

    def __init__(self, learned: Adaptation, file: FileRows) -> None:
        self._file, self._others, actions = file, learned.others, len(learned.groups)
        self._actions = actions
        counted = [[g for g in groups if g.table is not None] for groups in learned.groups]
        self._rounds: list[list[tuple[CountTable, list[tuple[int, LearnedGroup]]]]] = []
        for place in range(max(map(len, counted), default=0)):
            shared: dict[int, tuple[CountTable, list[tuple[int, LearnedGroup]]]] = {}
            for action, groups in enumerate(counted):
                table = groups[place].table if place < len(groups) else None
                if table is not None:
                    known = shared.setdefault(id(table), (table, []))
                    known[1].append((action, groups[place]))
            self._rounds.append(list(shared.values()))

    def settle(
        self, states: Rows, bounds: Sequence[int], flow_flags: Flags, out: Rows
    ) -> tuple[Flags, Rows]:
        """Apply the likeliest outcomes and then events; rewards are expected over all outcomes.

        Returns:
            Flags of the likeliest outcome, and the probability that events flag the step unsafe.
        """
        flowed = out.copy()
        rounds = [
            [
                self._predict(table, parts, states, flowed)
                for table, groups in each
                if (parts := _parts(groups, bounds))
            ]
            for each in self._rounds
        ]
        for predicted in (one for each in rounds for one in each):
            usual = out[:, predicted.at]
            everyone = np.arange(len(predicted.at))
            predicted.put(everyone, predicted.best[predicted.which], usual)
            out[:, predicted.at] = usual
        usual = out.copy()
        flags = self._file.settle(states, flow_flags, out)
        unsafe, reward = flags & UNSAFE != 0, out[-1].copy()
        expected, alike = reward.copy(), np.ones(len(reward))
        ways = self._alternatives(rounds, usual, flags)
        if ways:
            at = np.concatenate([at for _, at, _, _ in ways])
            others = np.concatenate([changed for _, _, _, changed in ways], axis=1)
            changed = self._file.settle(states[:, at], flow_flags[at], others)
            last = 0
            for place in range(len(rounds)):
                different = np.zeros(len(reward))
                for of_round, at, p, _ in ways:
                    if of_round != place:
                        continue
                    part = slice(last, last + len(at))
                    last += len(at)
                    undefined = changed[part] & UNDEFINED != 0
                    flagged = changed[part] & UNSAFE != 0
                    counts = (flagged != unsafe[at]) & (flagged | ~undefined)
                    different[at[counts]] += p[counts]
                    gained = others[-1, part]
                    counts = ~undefined & np.isfinite(gained)
                    at, more = at[counts], p[counts] * (gained[counts] - reward[at[counts]])
                    expected[at] += more
                alike = alike * np.maximum(0.0, 1.0 - different)
        applicable = flags & APPLICABLE != 0
        out[-1] = np.where(applicable & np.isfinite(expected), expected, out[-1])
        risk = np.where(unsafe, alike, 1.0 - alike)
        return flags, np.where(applicable, risk, np.where(unsafe, 1.0, 0.0))

    def _alternatives(
        self, rounds: list[list[PredictedRows]], usual: Rows, flags: Flags
    ) -> list[tuple[int, Flags, Rows, Rows]]:
        """Return the round, states, probabilities and results of all less likely outcomes."""
        found = []
        for place, each in enumerate(rounds):
            for predicted in each:
                applicable = flags[predicted.at] & APPLICABLE != 0
                for kind in range(predicted.probabilities.shape[1]):
                    possible = predicted.probabilities[:, kind] > 0.0
                    possible &= predicted.best != kind
                    some = np.flatnonzero(possible[predicted.which] & applicable)
                    if len(some):
                        at = predicted.at[some]
                        other = usual[:, at]
                        predicted.put(some, kind, other)
                        p = predicted.probabilities[predicted.which[some], kind]
                        found.append((place, at, p, other))
        return found

    def _predict(
        self, table: CountTable, parts: list[tuple[int, LearnedGroup, slice]],
        states: Rows, flowed: Rows,
    ) -> PredictedRows:  # fmt: skip
        reads = [[group.inputs[place] for place in table.read] for _, group, _ in parts]
        pairs = list(zip(reads, parts, strict=True))
        known = np.concatenate([states[read, part] for read, (_, _, part) in pairs], axis=1)
        after = np.concatenate([flowed[g.columns, part] for _, g, part in parts], axis=1)
        wide, elsewhere = len(known), self._elsewhere(table, parts, states, known)
        first, which = _distinct(np.concatenate([known, after, *elsewhere]))
        size = len(table.places)
        predictions: list[Prediction] = []
        for k in first.tolist():
            others = tuple(
                tuple(each[1:, k].tolist()) if each[0, k] else None for each in elsewhere
            )
            inputs = tuple(known[:wide, k].tolist()), tuple(after[:, k].tolist())
            predictions.append(table.predict(*inputs, others))
        sizes = [part.stop - part.start for _, _, part in parts]
        return PredictedRows(
            np.concatenate([np.arange(part.start, part.stop) for _, _, part in parts]),
            np.repeat(np.array([g.columns for _, g, _ in parts], np.int64).T, sizes, axis=1),
            which,
            np.array([each.probabilities for each in predictions]),
            np.array([each.values for each in predictions]).reshape(len(predictions), -1, size),
            np.array([each.best for each in predictions]),
        )

    def _elsewhere(
        self, table: CountTable, parts: list[tuple[int, LearnedGroup, slice]],
        states: Rows, known: Rows,
    ) -> list[Rows]:  # fmt: skip
        """Return, for each outcome with the effects of another action, `[1 + C, M]`.

        The first row tells where it is likely enough and possible, the others its values.
        """
        if not table.alike:
            return []
        first, which = _distinct(known)
        each = [table.probabilities(tuple(known[:, k].tolist())) for k in first.tolist()]
        likely = (np.array(each) >= RARE)[which]
        found = []
        for kind, schema in table.alike:
            values = np.zeros((1 + len(table.places), known.shape[1]))
            last = 0
            for action, group, part in parts:
                here = slice(last, last + part.stop - part.start)
                last = here.stop
                other, some = self._others[action][schema], likely[here, kind]
                if other < 0 or not some.any():
                    continue
                bounds = [0 if a <= other else last - here.start for a in range(self._actions + 1)]
                step, flags = self._file.flow(states[:, part], bounds)
                some = some & (flags & APPLICABLE != 0)
                values[0, here] = some
                values[1:, here] = np.where(some, step[group.columns], 0.0)
            found.append(values)
        return found


def _parts(
    groups: list[tuple[int, LearnedGroup]], bounds: Sequence[int]
) -> list[tuple[int, LearnedGroup, slice]]:
    """Return the groups whose action follows any state, and where these are."""
    return [
        (action, group, slice(bounds[action], bounds[action + 1]))
        for action, group in groups
        if bounds[action] < bounds[action + 1]
    ]


def _distinct(columns: Rows) -> tuple[Flags, Flags]:
    """Return the place of the first of each different column, and which each of them is."""
    codes = np.zeros(columns.shape[1], np.int64)
    for row in columns:
        ones = row != 0.0
        if not np.count_nonzero(ones & (row != 1.0)):
            codes = 2 * codes + ones
        else:
            values, place = np.unique(row, return_inverse=True)
            codes = len(values) * codes + place
        if len(codes) and codes.max() > 1 << 40:
            codes = np.unique(codes, return_inverse=True)[1]
    _, first, which = np.unique(codes, return_index=True, return_inverse=True)
    return first, which
