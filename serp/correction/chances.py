"""Counts of what comes of an action, for predicates and whole numbers.

What an action does by chance, or otherwise than written, is counted as a change relative to the
state, or as "what the file says", by action schema and context: all there is, where the same
predicates hold, where the whole numbers nearby are the same too. While samples of a context are
few, the broader one decides (the hierarchical Dirichlet smoothing of MacKay & Peto, Natural
Language Engineering 1, 1995).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp.correction import chance_kernels as c
from serp.correction.forgetting import rate_of
from serp.correction.views import View
from serp.domain.model import Vector

Array = NDArray[np.float64]

_MEMORY: Final = 0.995
_LEAST: Final = 5
"""Before so many samples counts are not believed."""
_BETTER: Final = 0.95
"""Counts are used where their Brier score (1950) is smaller than the file's by this factor."""
_MOST: Final = 2_000.0
_STRAY: Final = 0.2
"""Where more outcomes than this share are none of those told apart, counting is of no use."""
_ENOUGH: Final = 50


class Chances:
    """Counts the outcomes of the ground actions that share a view's key.

    Args:
        view: Any view of the key.
    """

    def __init__(self, view: View) -> None:
        self._depth = len(view.inputs)
        where = {column: place for place, column in enumerate(view.inputs)}
        self._predicates = np.array([where[column] for column in view.predicates], dtype=np.int64)
        self._numbers = np.array([where[column] for column in view.targets], dtype=np.int64)
        self._truths = np.array(view.truths, dtype=np.int64)
        self.table: Array | None = None
        self._places = self._others = np.zeros(0, dtype=np.int64)
        self._scores = np.zeros(2)
        self._samples = self._strays = 0
        self._hopeless = False

    @property
    def used(self) -> bool:
        """Whether counts have predicted better than the file, on data that they had not seen."""
        return (
            self.table is not None
            and not self._hopeless
            and self._samples >= _LEAST
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
            inputs: `[d]` columns of the view.
            state: `[F]`.
            written: `[F]` what the file makes of it.
            observed: `[F]`.
            whole: `[F]` bool: whether a fluent has always been a whole number.

        Returns:
            Whether counting makes sense: False where too many different things happen.
        """
        if self._hopeless:
            return False
        numbers = self._numbers[whole[inputs[self._numbers]]]
        if len(numbers) + len(self._predicates) != len(self._places):
            self._begin(np.sort(np.concatenate((self._predicates, numbers))))  # one has dropped out
        if not len(self._places):
            return True
        columns = inputs[self._places]
        self._samples += 1
        if self.table is None:
            # Where the file is always right there is nothing to count.
            if (observed[columns] == written[columns]).all():
                return True
            self._others = np.setdiff1d(np.flatnonzero(whole[inputs]), self._truths)
            self.table = _new_table(self._places, self._truths, self._others)
            totals = int(self.table[c.T_TOTALS])
            self.table[int(self.table[c.T_COUNTS])] = self.table[totals] = self._samples - 1
        rate = rate_of(self._samples - 1, _MEMORY)
        if not c.count(
            self.table, inputs, state, written, observed, self._scores, rate, _MOST
        ):  # fmt: skip
            self._strays += 1
            if self._samples >= _ENOUGH and self._strays > _STRAY * self._samples:
                # Without the numbers there may be some sense in it.
                self._hopeless = not len(numbers)
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
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays: dict[str, NDArray[Any]] = {
            "places": self._places.copy(),
            "others": self._others.copy(),
            "scores": self._scores.copy(),
        }
        if self.table is not None:
            arrays["table"] = self.table.copy()
        return arrays, {
            "samples": self._samples,
            "strays": self._strays,
            "hopeless": self._hopeless,
        }

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            ValueError: It belongs to another view, or is damaged.
        """
        self._places, self._others = arrays["places"].copy(), arrays["others"].copy()
        self._scores[:] = arrays["scores"]
        self.table = self._checked(arrays["table"].copy()) if "table" in arrays else None
        self._samples, self._strays = int(meta["samples"]), int(meta["strays"])
        self._hopeless = bool(meta["hopeless"])

    def _checked(self, table: Array) -> Array:
        """Return a saved table; compiled code takes what it says for addresses."""
        for positions in (self._places, self._others):
            if len(positions) and not 0 <= positions.min() <= positions.max() < self._depth:
                raise ValueError("counted outcomes of another view")
        fresh = _new_table(self._places, self._truths, self._others)
        fixed = [k for k in range(c.TABLE) if k not in (c.T_KINDS, c.T_ROWS)]
        start, end = int(fresh[c.T_PLACES]), int(fresh[c.T_CHANGES])
        slots = int(fresh[c.T_SLOTS])
        if (
            table.shape != fresh.shape
            or (table[fixed] != fresh[fixed]).any()
            or (table[start:end] != fresh[start:end]).any()
            or not 1 <= table[c.T_KINDS] <= c.KINDS
            or not 1 <= table[c.T_ROWS] <= c.ROWS
            or not ((table[slots : slots + c.SLOTS] >= 0).all())
            or not (table[slots : slots + c.SLOTS] < table[c.T_ROWS]).all()
        ):
            raise ValueError("counted outcomes are damaged")
        return table


def _new_table(
    places: NDArray[np.int64], predicates: NDArray[np.int64], others: NDArray[np.int64]
) -> Array:
    """Return an empty table.

    Args:
        places: `[D]` positions of what is counted.
        predicates: Positions of the predicates of a context.
        others: Positions of the whole numbers that a narrower context has beside them.
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
