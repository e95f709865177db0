"""Counted outcomes: what an action does by chance, for predicates and whole numbers.

The arithmetic is that of serp's compiled loops, see `serp.adaptation.outcomes`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from .residual import Array, parts_of

if TYPE_CHECKING:
    from .step import FileStep

APPLICABLE, UNSAFE, UNDEFINED = 1, 2, 8
CHANGE, RARE = -1, 1e-3
"""In place of an action schema: the outcome is a change. Less likely outcomes are left out."""
PRIORS = (0.1, 1.0, 10.0)
BY_PREDICATES, BY_NUMBERS, BY_BOTH = range(3)
BASIS, PRIME, _MASK = 0xCBF29CE484222325, 0x100000001B3, (1 << 64) - 1


class CountTable:
    """The counts of one feature group.

    Attributes:
        places: Positions of the counted fluents within the inputs.
        schemas, changes: `[K]` action whose effects an outcome has, or `CHANGE` and the change.
        ranges: `[columns, 2]` values that were observed.
        broadest: `[K]` probabilities over all contexts.
        share: Weight of what predicates say, beside what numbers say.
        rows: Code of a context → its row.
        counts, totals, trust, evidence: As in `serp.adaptation.outcomes.table_kernels`.
    """

    def __init__(self, data: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
        self.places: list[int] = data["places"]
        context, predicates = list(data["context"]), int(data["predicates"])
        both = context if predicates not in (0, len(context)) else []
        self._contexts = context[:predicates], context[predicates:], both
        self.schemas = [int(schema) for schema in arrays["schemas"].tolist()]
        self.kinds = len(self.schemas)
        self.changes: list[list[float]] = arrays["changes"].tolist()
        self.ranges: list[list[float]] = arrays["ranges"].tolist()
        self.counts, self.totals = arrays["counts"][:, : self.kinds], arrays["totals"]
        self.trust: list[list[float]] = arrays["trust"].tolist()
        self.evidence = arrays["evidence"]
        total, counts = float(self.totals[0]), self.counts[0].tolist()
        self.broadest = [1.0] + [0.0] * (self.kinds - 1)
        if total > 0.0:
            self.broadest = [count / total for count in counts]
        paths = arrays["paths"].tolist()
        self.share = paths[0] / (paths[0] + paths[1])
        codes = arrays["codes"].tolist()
        self.rows = {int(code): row for row, code in enumerate(codes) if row}
        self._each = list(
            zip(self.counts.tolist(), self.totals.tolist(), self.evidence.tolist(), strict=True)
        )

    def context_of(self, level: int) -> list[int]:
        """Return the positions within the inputs that a context consists of; none: no context."""
        return self._contexts[level]

    def probabilities(self, inputs: Sequence[int], state: list[float]) -> list[float]:
        """Return the probability of each outcome in a state."""
        one = self._refined(BY_PREDICATES, inputs, state, self.broadest)
        other = self._refined(BY_NUMBERS, inputs, state, self.broadest)
        share = self.share
        mixed = [share * p + (1.0 - share) * q for p, q in zip(one, other, strict=True)]
        return self._refined(BY_BOTH, inputs, state, mixed)

    def _refined(
        self, level: int, inputs: Sequence[int], state: list[float], broader: list[float]
    ) -> list[float]:
        """Return the probabilities in a context, from those of a broader one."""
        context = self._contexts[level]
        if not context:
            return broader
        code = BASIS ^ level
        for place in context:
            code = ((code ^ (int(state[inputs[place]]) & _MASK)) * PRIME) & _MASK
            code ^= code >> 29
        row = self.rows.get(code >> 11, 0)
        if row == 0:
            return broader
        trust, (counts, total, evidence) = self.trust[level], self._each[row]
        weights = trust[-1] * evidence[-1]
        counted, kept = 0.0, weights
        for e, prior in enumerate(PRIORS):
            weight = trust[e] * evidence[e]
            weights += weight
            counted += weight / (total + prior)
            kept += weight * prior / (total + prior)
        return [(counted * counts[k] + kept * p) / weights for k, p in enumerate(broader)]


def made_tables(data: Mapping[str, Any], arrays: Mapping[str, Array]) -> list[CountTable]:
    """Return all tables of an adaptation."""
    return [
        CountTable(each, parts_of(arrays, f"table{k}.")) for k, each in enumerate(data["tables"])
    ]


class GroupCounts(NamedTuple):
    """A feature group with counts: its columns in the state."""

    inputs: list[int]
    table: CountTable


class Prediction(NamedTuple):
    """Outcomes of a group in a state: probabilities, values of counted fluents, the likeliest."""

    columns: list[int]
    probabilities: list[float]
    values: list[list[float]]
    best: int

    def put(self, kind: int, out: list[float]) -> None:
        """Set the counted fluents as an outcome predicts."""
        for column, value in zip(self.columns, self.values[kind], strict=True):
            out[column] = value


class CountedOutcomes:
    """The counted outcomes of every action.

    Attributes:
        counted: `[A]` whether an action has any.
    """

    def __init__(
        self, data: Mapping[str, Any], arrays: Mapping[str, Array], file: FileStep
    ) -> None:
        tables = made_tables(data, arrays)
        self._file = file
        self._others: list[list[int]] = arrays["others"].tolist()
        self._groups = [
            [GroupCounts(g["inputs"], tables[g["table"]]) for g in groups if g["table"] is not None]
            for groups in data["actions"]
        ]
        self.counted = [bool(groups) for groups in self._groups]

    def settle(
        self, state: list[float], action: int, flow_flags: int, out: list[float]
    ) -> tuple[int, float]:
        """Apply the likeliest outcomes and then events; the reward is expected over all outcomes.

        Returns:
            Flags of the likeliest outcome, and the probability that events flag the step unsafe.
        """
        flowed = out[:-1]
        predictions = [
            self._predict(group, state, action, flowed) for group in self._groups[action]
        ]
        for each in predictions:
            if each.best > 0:
                each.put(each.best, out)
        usual = out[:]
        flags = self._file.settle(state, flow_flags, out)
        unsafe = flags & UNSAFE != 0
        if not flags & APPLICABLE:
            return flags, 1.0 if unsafe else 0.0
        reward = out[-1]
        expected, alike = reward, 1.0
        for each in predictions:
            different = 0.0
            for kind, p in enumerate(each.probabilities):
                if kind == each.best or p <= 0.0:
                    continue
                other = usual[:]
                each.put(kind, other)
                changed = self._file.settle(state, flow_flags, other)
                undefined, flagged = changed & UNDEFINED != 0, changed & UNSAFE != 0
                if flagged != unsafe and (flagged or not undefined):
                    different += p
                if not undefined and math.isfinite(other[-1]):
                    expected += p * (other[-1] - reward)
            alike *= max(0.0, 1.0 - different)
        if math.isfinite(expected):
            out[-1] = expected
        return flags, alike if unsafe else 1.0 - alike

    def _predict(
        self, group: GroupCounts, state: list[float], action: int, flowed: list[float]
    ) -> Prediction:
        table, inputs = group.table, group.inputs
        columns = [inputs[place] for place in table.places]
        probabilities = table.probabilities(inputs, state)[:]
        values: list[list[float]] = [[] for _ in probabilities]
        left = 0.0
        for kind, p in enumerate(probabilities):
            if kind == 0:
                values[0] = [flowed[column] for column in columns]
            else:
                found = None
                if p >= RARE:
                    found = self._outcome(table, kind, columns, state, action)
                if found is None:
                    probabilities[kind] = 0.0
                else:
                    values[kind] = found
            left += probabilities[kind]
        if left <= RARE:
            probabilities[0] = left = 1.0
        for kind in range(1, len(values)):  # those that predict the same are one
            for other in range(kind):
                both = probabilities[kind] > 0.0 and probabilities[other] > 0.0
                if both and values[kind] == values[other]:
                    probabilities[other] += probabilities[kind]
                    probabilities[kind] = 0.0
        probabilities = [p / left for p in probabilities]
        return Prediction(columns, probabilities, values, probabilities.index(max(probabilities)))

    def _outcome(
        self, table: CountTable, kind: int, columns: list[int], state: list[float], action: int
    ) -> list[float] | None:
        """Return the counted fluents that an outcome predicts; None where it is not possible."""
        schema = table.schemas[kind]
        if schema == CHANGE:
            values = []
            for column, by, (low, high) in zip(
                columns, table.changes[kind], table.ranges, strict=True
            ):
                value = state[column] + by
                if by != 0.0 and not low <= value <= high:
                    return None
                values.append(value)
            return values
        other = self._others[action][schema]
        if other < 0:
            return None
        step, flags = self._file.flow(state, other)
        return [step[column] for column in columns] if flags & APPLICABLE else None
