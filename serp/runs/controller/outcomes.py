"""Counted outcomes: what an action does by chance, for predicates and whole numbers.

The arithmetic is that of serp's compiled loops, see `serp.adaptation.outcomes`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from .reading import Arrays, Entry

if TYPE_CHECKING:
    from .adaptation import Adaptation, LearnedGroup
    from .step import FileStep

APPLICABLE, UNSAFE, UNDEFINED = 1, 2, 8
CHANGE, RARE = -1, 1e-3
"""In place of an action schema: the outcome is a change. Less likely outcomes are left out."""
PRIORS = (0.1, 1.0, 10.0)
_BY_PREDICATES, _BY_NUMBERS, _BY_BOTH = range(3)
_BASIS, _PRIME, _MASK = 0xCBF29CE484222325, 0x100000001B3, (1 << 64) - 1
_MOST = 10_000
"""Predictions that are kept: counted fluents have few values."""

Values = tuple[float, ...]


class Prediction(NamedTuple):
    """Outcomes of a group in a state: probabilities, values of counted fluents, the likeliest.

    A probability is 0 where an outcome is not possible, or predicts what one before it does.
    """

    probabilities: list[float]
    values: list[Values]
    best: int


class CountTable:
    """The counts of one feature group.

    Args:
        data: Its shape.
        arrays: Its arrays; see `serp.adaptation.outcomes.table_kernels`.
        schemas: Number of action schemas.

    Attributes:
        inputs: Number of inputs of the group.
        places: Positions of the counted fluents within the inputs.
        read: Positions of all inputs that outcomes depend on.
        alike: Outcomes with the effects of another action, and its schema.
    """

    def __init__(self, data: Entry, arrays: Arrays, schemas: int) -> None:
        self.inputs = data["inputs"].whole(0)
        self.places = data["places"].positions(self.inputs)
        context = data["context"].positions(self.inputs)
        predicates = data["predicates"].whole(0, len(context))
        self.read = sorted({*context, *self.places})
        context = [self.read.index(place) for place in context]
        both = context if predicates not in (0, len(context)) else []
        self._contexts = context[:predicates], context[predicates:], both
        self._counted = [self.read.index(place) for place in self.places]
        found: list[int] = arrays.whole("schemas", CHANGE, schemas - 1, None).tolist()
        if not found:
            raise arrays.wrong("schemas", "is empty")
        self.alike = [(k, schema) for k, schema in enumerate(found) if k and schema != CHANGE]
        kinds, columns, experts = len(found), len(self.places), len(PRIORS) + 1
        self._changes: list[list[float]] = arrays.numbers("changes", kinds, columns).tolist()
        self._ranges: list[list[float]] = arrays.numbers("ranges", columns, 2).tolist()
        codes: list[int] = arrays.whole("codes", 0, None, None).tolist()
        if not codes:
            raise arrays.wrong("codes", "is empty")
        self._rows = {code: row for row, code in enumerate(codes) if row}
        self._trust: list[list[float]] = arrays.numbers("trust", 3, experts).tolist()
        counts: list[list[float]] = arrays.numbers("counts", len(codes), kinds).tolist()
        totals: list[float] = arrays.numbers("totals", len(codes)).tolist()
        evidence: list[list[float]] = arrays.numbers("evidence", len(codes), experts).tolist()
        self._each = list(zip(counts, totals, evidence, strict=True))
        self._broadest = [1.0] + [0.0] * (kinds - 1)
        if totals[0] > 0.0:
            self._broadest = [count / totals[0] for count in counts[0]]
        paths = arrays.numbers("paths", 2).tolist()
        if not paths[0] + paths[1] > 0.0:
            raise arrays.wrong("paths", "has no positive sum")
        self._share = paths[0] / (paths[0] + paths[1])
        self._probabilities: dict[Values, list[float]] = {}
        self._predictions: dict[object, Prediction] = {}

    def probabilities(self, known: Values) -> list[float]:
        """Return the probability of each outcome, by the values of the inputs `read`."""
        found = self._probabilities.get(known)
        if found is None:
            one = self._refined(_BY_PREDICATES, known, self._broadest)
            other = self._refined(_BY_NUMBERS, known, self._broadest)
            share = self._share
            mixed = [share * p + (1.0 - share) * q for p, q in zip(one, other, strict=True)]
            found = self._refined(_BY_BOTH, known, mixed)
            if len(self._probabilities) >= _MOST:
                self._probabilities.clear()
            self._probabilities[known] = found
        return found

    def _refined(self, level: int, known: Values, broader: list[float]) -> list[float]:
        """Return the probabilities in a context, from those of a broader one."""
        context = self._contexts[level]
        if not context:
            return broader
        code = _BASIS ^ level
        for place in context:
            code = ((code ^ (int(known[place]) & _MASK)) * _PRIME) & _MASK
            code ^= code >> 29
        row = self._rows.get(code >> 11, 0)
        if row == 0:
            return broader
        trust, (counts, total, evidence) = self._trust[level], self._each[row]
        weights = trust[-1] * evidence[-1]
        counted, kept = 0.0, weights
        for e, prior in enumerate(PRIORS):
            weight = trust[e] * evidence[e]
            weights += weight
            counted += weight / (total + prior)
            kept += weight * prior / (total + prior)
        return [(counted * counts[k] + kept * p) / weights for k, p in enumerate(broader)]

    def predict(
        self, known: Values, flowed: Values, elsewhere: tuple[Values | None, ...]
    ) -> Prediction:
        """Return the outcomes.

        Args:
            known: Values of the inputs `read`.
            flowed: Of the counted fluents after effects and processes.
            elsewhere: The same after each action in `alike`; None where it is not applicable or not
                likely.
        """
        key = known, flowed, elsewhere
        found = self._predictions.get(key)
        if found is None:
            if len(self._predictions) >= _MOST:
                self._predictions.clear()
            found = self._predictions[key] = self._predicted(known, flowed, elsewhere)
        return found

    def _predicted(
        self, known: Values, flowed: Values, elsewhere: tuple[Values | None, ...]
    ) -> Prediction:
        probabilities = self.probabilities(known)[:]
        by_kind = dict(zip((kind for kind, _ in self.alike), elsewhere, strict=True))
        values = [flowed]
        left = probabilities[0]
        for kind, p in enumerate(probabilities[1:], 1):
            found = by_kind[kind] if kind in by_kind else self._changed(kind, known)
            if found is None or p < RARE:
                probabilities[kind] = 0.0
            values.append(flowed if found is None else found)
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
        return Prediction(probabilities, values, probabilities.index(max(probabilities)))

    def _changed(self, kind: int, known: Values) -> Values | None:
        """Return the counted fluents after a change; None where it is not possible."""
        values = []
        ways = zip(self._counted, self._changes[kind], self._ranges, strict=True)
        for place, by, (low, high) in ways:
            value = known[place] + by
            if by != 0.0 and not low <= value <= high:
                return None
            values.append(value)
        return tuple(values)


class CountedOutcomes:
    """The counted outcomes of every action, in one state."""

    def __init__(self, learned: Adaptation, file: FileStep) -> None:
        self._file, self._others = file, learned.others
        self._groups = [
            [(group, group.table) for group in groups if group.table is not None]
            for groups in learned.groups
        ]

    def settle(
        self, state: list[float], action: int, flow_flags: int, out: list[float]
    ) -> tuple[list[float], int, float]:
        """Apply the likeliest outcomes and then events; the reward is expected over all outcomes.

        Returns:
            The state and reward, flags of the likeliest outcome, and the probability that events
            flag the step unsafe.
        """
        predictions = [
            (group.columns, self._predict(group, table, state, action, out))
            for group, table in self._groups[action]
        ]
        usual = out[:]
        for columns, each in predictions:
            if each.best > 0:
                _put(columns, each.values[each.best], usual)
        out, flags = self._file.settle(state, flow_flags, usual)
        unsafe = flags & UNSAFE != 0
        if not flags & APPLICABLE:
            return out, flags, 1.0 if unsafe else 0.0
        reward = out[-1]
        expected, alike = reward, 1.0
        for columns, each in predictions:
            different = 0.0
            for kind, p in enumerate(each.probabilities):
                if kind == each.best or p <= 0.0:
                    continue
                other = usual[:]
                _put(columns, each.values[kind], other)
                other, changed = self._file.settle(state, flow_flags, other)
                undefined, flagged = changed & UNDEFINED != 0, changed & UNSAFE != 0
                if flagged != unsafe and (flagged or not undefined):
                    different += p
                if not undefined and math.isfinite(other[-1]):
                    expected += p * (other[-1] - reward)
            alike *= max(0.0, 1.0 - different)
        if math.isfinite(expected):
            out[-1] = expected
        return out, flags, alike if unsafe else 1.0 - alike

    def _predict(
        self, group: LearnedGroup, table: CountTable,
        state: list[float], action: int, out: list[float],
    ) -> Prediction:  # fmt: skip
        inputs = group.inputs
        known = tuple([state[inputs[place]] for place in table.read])
        flowed = tuple([out[column] for column in group.columns])
        elsewhere: tuple[Values | None, ...] = ()
        if table.alike:
            p, columns = table.probabilities(known), group.columns
            elsewhere = tuple(
                self._after(state, self._others[action][schema], columns)
                if p[kind] >= RARE else None
                for kind, schema in table.alike
            )  # fmt: skip
        return table.predict(known, flowed, elsewhere)

    def _after(self, state: list[float], action: int, columns: list[int]) -> Values | None:
        """Return fluents after effects and processes of an action; None where it is refused."""
        if action < 0:
            return None
        out, flags = self._file.flow(state, action)
        return tuple([out[column] for column in columns]) if flags & APPLICABLE else None


def _put(columns: list[int], values: Values, out: list[float]) -> None:
    for column, value in zip(columns, values, strict=True):
        out[column] = value
