"""Counts of the outcomes of an action, for predicates and whole numbers.

An outcome is a change of the state, or "as the file predicts". Outcomes are counted by action
schema and at three levels of context: in all states, in those with the same predicates, and in
those with the same whole numbers too. While a context has few samples, the broader one dominates
(hierarchical Dirichlet smoothing: MacKay & Peto, Natural Language Engineering 1, 1995).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import MOST, Saved
from serp.adaptation import outcome_kernels as c
from serp.adaptation.feature_groups import FeatureGroup
from serp.adaptation.moving_average import rate_of
from serp.model.transition_model import Vector

_MEMORY: Final = 0.995
"""Weight of the past in the scores, per step."""
_MIN_SAMPLES: Final = 5
_BETTER: Final = 0.95
"""Counts are used after so many samples where their Brier score (Monthly Weather Review 78, 1950)
is smaller than the file's by this factor."""
_MAX_COUNT: Final = 2_000.0
"""Counts of a context are halved beyond this."""
_MAX_STRAY, _STRAY_FROM = 0.2, 50
"""Fraction of outcomes that are not distinguished at which counting ends, and the samples needed to
determine it."""


class OutcomeCounts:
    """Counts the outcomes of the ground actions that share the key of a feature group.

    Args:
        group: Any feature group of the key.

    Attributes:
        table: The counts, see `serp.adaptation.outcome_kernels`; None before the first error.
    """

    def __init__(self, group: FeatureGroup) -> None:
        self._depth = len(group.inputs)
        where = {column: place for place, column in enumerate(group.inputs)}
        self._predicates = np.array([where[column] for column in group.predicates], dtype=np.int64)
        self._numbers = np.array([where[column] for column in group.targets], dtype=np.int64)
        self._context = np.array(group.predicate_inputs, dtype=np.int64)
        self.table: Vector | None = None
        self._places = self._others = np.zeros(0, dtype=np.int64)
        self._scores = np.zeros(2)
        self._samples = self._strays = 0
        self._given_up = False

    @property
    def used(self) -> bool:
        """Whether counts have predicted new samples better than the file."""
        return (
            self.table is not None
            and not self._given_up
            and self._samples >= _MIN_SAMPLES
            and bool(self._scores[1] < _BETTER * self._scores[0])
        )

    def learn(
        self,
        inputs: NDArray[np.int64],
        state: Vector,
        written: Vector,
        observed: Vector,
        whole: NDArray[np.bool_],
    ) -> bool:
        """Count a sample.

        Args:
            inputs: `[d]` columns of the feature group.
            state: `[F]`.
            written: `[F]` predicted by the file.
            observed: `[F]`.
            whole: `[F]` bool: whether a fluent has always been a whole number.

        Returns:
            False where there are too many different outcomes to count.
        """
        if self._given_up:
            return False
        numbers = self._numbers[whole[inputs[self._numbers]]]
        if len(numbers) + len(self._predicates) != len(self._places):
            self._begin(np.sort(np.concatenate((self._predicates, numbers))))
        if not len(self._places):
            return True
        columns = inputs[self._places]
        self._samples += 1
        if self.table is None:
            # While the file is right there is nothing to count.
            if (observed[columns] == written[columns]).all():
                return True
            self._others = np.setdiff1d(np.flatnonzero(whole[inputs]), self._context)
            self.table = new_table(self._places, self._context, self._others)
            totals = int(self.table[c.T_TOTALS])
            self.table[int(self.table[c.T_COUNTS])] = self.table[totals] = self._samples - 1
        rate = rate_of(self._samples - 1, _MEMORY)
        if not c.count(
            self.table, inputs, state, written, observed, self._scores, rate, _MAX_COUNT
        ):  # fmt: skip
            self._strays += 1
            if self._samples >= _STRAY_FROM and self._strays > _MAX_STRAY * self._samples:
                # Without the numbers, the predicates may have few outcomes.
                self._given_up = not len(numbers)
                self._begin(self._predicates)
                return False
        return True

    def _begin(self, places: NDArray[np.int64]) -> None:
        self._places = places
        self.table = None
        self._scores[:] = 0.0
        self._samples = self._strays = 0

    # State -------------------------------------------------------------------------------------

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly.

        Only the counts are saved; the layout and the hash table follow from them.
        """
        arrays: dict[str, NDArray[Any]] = {
            "places": self._places.copy(),
            "others": self._others.copy(),
            "scores": self._scores.copy(),
        }
        if self.table is not None:
            arrays |= {name: part.copy() for name, part in _parts(self.table).items()}
            arrays["codes"] = _codes(self.table)
        return arrays, {
            "samples": self._samples,
            "strays": self._strays,
            "given_up": self._given_up,
        }

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It belongs to another feature group, or is damaged.
        """
        saved = Saved("outcome counts", arrays, meta)
        places, others = (self._positions(saved, name) for name in ("places", "others"))
        scores = saved.array("scores", np.float64, self._scores.shape)
        samples, given_up = saved.whole("samples"), saved.truth("given_up")
        strays = saved.whole("strays", 0, samples)
        table = self._table_of(saved, places, others) if saved.has("codes") else None
        self._places, self._others = places, others
        self._scores[:] = scores
        self.table = table
        self._samples, self._strays, self._given_up = samples, strays, given_up

    def _positions(self, saved: Saved, name: str) -> NDArray[np.int64]:
        positions = saved.array(name, np.int64, (-1,), 0, self._depth - 1)
        if (np.diff(positions) <= 0).any():
            raise saved.wrong(f"{name} are not in order")
        return positions.copy()

    def _table_of(
        self, saved: Saved, places: NDArray[np.int64], others: NDArray[np.int64]
    ) -> Vector:
        """Return a new table with the saved counts."""
        table = new_table(places, self._context, others)
        codes = saved.array("codes", np.float64, (-1,), 0, MOST - 1)
        rows = 1 + len(codes)
        if rows > c.ROWS or len(np.unique(codes)) != len(codes) or (codes % 1.0).any():
            raise saved.wrong("codes are not distinct whole numbers, or too many")
        kinds = len(saved.array("changes", np.float64, (-1, len(places)), low=None))
        if not 1 <= kinds <= c.KINDS:
            raise saved.wrong(f"changes are of {kinds} outcomes")
        table[c.T_KINDS], table[c.T_ROWS] = kinds, rows
        shapes = {name: part.shape for name, part in _parts(table).items()}
        for name, part in _parts(table).items():
            low = None if name == "changes" else 0.0
            part[:] = saved.array(name, np.float64, shapes[name], low)
        totals = _parts(table)["totals"]
        if not totals[0] > 0.0:  # probabilities are counts divided by it
            raise saved.wrong("totals are of no sample")
        for row, code in enumerate(codes, start=1):
            c.enter(table, code, row)
        return table


def _parts(table: Vector) -> dict[str, Vector]:
    """Return views of changes `[K, D]`, counts `[R, KINDS]` and totals `[R]`."""
    kinds, rows, columns = (int(table[k]) for k in (c.T_KINDS, c.T_ROWS, c.T_COLUMNS))
    changes, counts, totals = (int(table[k]) for k in (c.T_CHANGES, c.T_COUNTS, c.T_TOTALS))
    return {
        "changes": table[changes : changes + kinds * columns].reshape(kinds, columns),
        "counts": table[counts : counts + rows * c.KINDS].reshape(rows, c.KINDS),
        "totals": table[totals : totals + rows],
    }


def _codes(table: Vector) -> Vector:
    """Return the codes of the contexts, `[R - 1]`, in the order of their rows."""
    codes, slots = int(table[c.T_CODES]), int(table[c.T_SLOTS])
    rows = table[slots : slots + c.SLOTS].astype(np.int64)
    found = np.zeros(int(table[c.T_ROWS]))
    found[rows] = table[codes : codes + c.SLOTS]
    return found[1:]


def new_table(
    places: NDArray[np.int64], predicates: NDArray[np.int64], others: NDArray[np.int64]
) -> Vector:
    """Return an empty table.

    Args:
        places: `[D]` positions of the counted fluents within the group's inputs.
        predicates: Positions of the predicates of a context.
        others: Positions of the whole numbers of a narrower context.
    """
    parts = {
        c.T_PLACES: len(places),
        c.T_CONTEXT: len(predicates) + len(others),
        c.T_CHANGES: c.KINDS * len(places),
        c.T_CODES: c.SLOTS,
        c.T_SLOTS: c.SLOTS,
        c.T_COUNTS: c.ROWS * c.KINDS,
        c.T_TOTALS: c.ROWS,
    }
    table = np.zeros(c.TABLE + sum(parts.values()))
    at = c.TABLE
    for name, size in parts.items():
        table[name] = at
        at += size
    table[c.T_COLUMNS], table[c.T_KINDS], table[c.T_ROWS] = len(places), 1, 1
    table[c.T_PREDICATES], table[c.T_COUNT] = len(predicates), len(predicates) + len(others)
    start = int(table[c.T_PLACES])
    table[start : start + len(places)] = places
    start = int(table[c.T_CONTEXT])
    table[start : start + len(predicates)] = predicates
    table[start + len(predicates) : start + len(predicates) + len(others)] = others
    return table
