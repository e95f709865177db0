"""Counts of the outcomes of an action, for predicates and whole numbers.

An outcome is what the file predicts for the action or for another action with the same arguments,
or a change of the state, see `prediction_kernels`. Outcomes are counted by action schema
over all states and in contexts: states with the same predicates, with the same whole numbers, and
with both, see `table_kernels`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import LARGEST, MOST, Saved
from serp.adaptation.adoption import BETTER, TrackRecord
from serp.adaptation.feature_groups import FeatureGroup
from serp.adaptation.file_step import ObservedStep
from serp.adaptation.moving_average import rate_of
from serp.adaptation.outcomes import table_kernels as c
from serp.adaptation.outcomes.counting_kernels import count
from serp.adaptation.outcomes.prediction_kernels import CHANGE
from serp.model.transition_model import Vector

_MEMORY: Final = 0.995  # weight of the past in the scores, per step
_MIN_SAMPLES: Final = 5
"""Counts are used after so many samples where their Brier score (Monthly Weather Review 78, 1950)
is smaller than `BETTER` times the file's."""
_MAX_STRAY, _STRAY_FROM = 0.2, 50
"""Fraction of outcomes that are not distinguished at which counting ends, and the samples needed to
determine it."""

Place = tuple[Vector, int, float]
"""Buffer of the model, position of the group among those of the action, and control period."""


class OutcomeCounts:
    """Counts the outcomes of the ground actions that share the key of a feature group.

    Args:
        group: Any feature group of the key.
        schemas: Number of action schemas.

    Attributes:
        table: The counts, see `serp.adaptation.outcomes.table_kernels`; None before the first
            error.
        places: Positions of the counted fluents within the inputs.
        samples: Number of samples since counting began.
    """

    def __init__(self, group: FeatureGroup, schemas: int) -> None:
        self._schemas = schemas
        self._depth = len(group.inputs)
        where = {column: place for place, column in enumerate(group.inputs)}
        self._predicates = np.array([where[column] for column in group.predicates], dtype=np.int64)
        self._numbers = np.array([where[column] for column in group.targets], dtype=np.int64)
        self._context = np.array(group.predicate_inputs, dtype=np.int64)
        self.table: Vector | None = None
        self.places = self._others = np.zeros(0, dtype=np.int64)
        self._scores = np.zeros(2)
        self.samples = self._strays = 0
        self._given_up = False

    @property
    def used(self) -> bool:
        """Whether counts have predicted new samples better than the file."""
        return (
            self.table is not None
            and not self._given_up
            and self.samples >= _MIN_SAMPLES
            and bool(self._scores[1] < BETTER * self._scores[0])
        )

    def track_record(self, schema: str) -> TrackRecord:
        """Return what is known of the counts, after actions of a schema."""
        written, learned = self._scores.tolist()
        hindrance = "too many different outcomes to count" if self._given_up else ""
        return TrackRecord(schema, self.used, self.samples, written, learned, hindrance)

    def count_again(self) -> None:
        """Forget all counts; keep the outcomes, with "nothing changes" among them."""
        if self.table is None:
            return
        old, kinds = _parts(self.table), int(self.table[c.T_KINDS])
        self._begin(self.places)
        self.table = new_table(self.places, self._context, self._others)
        nothing = (old["schemas"] == CHANGE) & (old["changes"] == 0.0).all(axis=1)
        self.table[c.T_KINDS] = min(c.KINDS, kinds + (not nothing[1:].any()))
        new = _parts(self.table)
        new["ranges"][:] = old["ranges"]
        for name in ("schemas", "changes"):
            new[name][:kinds] = old[name]

    def explanations(self) -> tuple[NDArray[np.bool_], Vector]:
        """Return sets of outcomes `[S, K]`, and how often each explained an observation `[S]`."""
        assert self.table is not None
        members, number = _parts(self.table)["sets"].T
        kinds = range(int(self.table[c.T_KINDS]))
        return np.stack([members.astype(np.int64) >> k & 1 for k in kinds], axis=1) == 1, number

    def outcomes(self) -> tuple[Vector, NDArray[np.int64], Vector]:
        """Return the K outcomes: probabilities over all contexts, schemas and changes.

        The probabilities are `[K]`; `[K]` are positions of action schemas, -1 for the file's
        prediction (the first) and for a change; changes are `[K, places]`.
        """
        assert self.table is not None
        parts = _parts(self.table)
        counts = parts["counts"][0, : len(parts["schemas"])]
        shares = counts / max(1.0, parts["totals"][0])
        return shares, parts["schemas"].astype(np.int64), parts["changes"]

    def learn(
        self,
        place: Place,
        inputs: NDArray[np.int64],
        step: ObservedStep,
        whole: NDArray[np.bool_],
    ) -> bool:
        """Count a sample; return False where there are too many different outcomes to count.

        `inputs` `[d]` are columns of the feature group in states `[F]`. `whole` `[F]`: whether a
        fluent has always been whole. The end of an episode is counted as one of the outcomes that
        end it, if there are any.
        """
        if step.over:
            if self.table is not None:
                self.samples += 1
                self._count(place, step)
            return True
        if self._given_up:
            return False
        numbers = self._numbers[whole[inputs[self._numbers]]]
        if len(numbers) + len(self._predicates) != len(self.places):
            self._begin(np.sort(np.concatenate((self._predicates, numbers))))
        if not len(self.places):
            return True
        columns = inputs[self.places]
        self.samples += 1
        if self.table is None:
            # While the file is right there is nothing to count.
            if (step.next_state[columns] == step.settled[columns]).all():
                return True
            self._others = np.setdiff1d(np.flatnonzero(whole[inputs]), self._context)
            self.table = new_table(self.places, self._context, self._others)
            _parts(self.table)["ranges"][:] = step.state[columns, None]
            # All samples so far were as in the file.
            sets, totals = int(self.table[c.T_ALTERNATIVES]), int(self.table[c.T_TOTALS])
            self.table[c.T_SETS], self.table[sets : sets + 2] = 1, (1, self.samples - 1)
            self.table[int(self.table[c.T_COUNTS])] = self.table[totals] = self.samples - 1
        if not self._count(place, step):
            self._strays += 1
            if self.samples >= _STRAY_FROM and self._strays > _MAX_STRAY * self.samples:
                # Without the numbers, the predicates may have few outcomes.
                self._given_up = not len(numbers)
                self._begin(self._predicates)
                return False
        return True

    def _count(self, place: Place, step: ObservedStep) -> bool:
        buffer, position, dt = place
        assert self.table is not None
        rate = rate_of(self.samples - 1, _MEMORY)
        flow = step.flowed, step.flags
        return bool(count(buffer, position, self.table, step[:4], flow, dt, self._scores, rate))

    def _begin(self, places: NDArray[np.int64]) -> None:
        self.places = places
        self.table = None
        self._scores[:] = 0.0
        self.samples = self._strays = 0

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays: dict[str, NDArray[Any]] = {
            "places": self.places.copy(),
            "others": self._others.copy(),
            "scores": self._scores.copy(),
        }
        if self.table is not None:
            arrays |= {name: part.copy() for name, part in _parts(self.table).items()}
        return arrays, {
            "samples": self.samples,
            "strays": self._strays,
            "given_up": self._given_up,
        }

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned; a `RunError` refuses what does not fit."""
        saved = Saved("outcome counts", arrays, meta)
        places, others = (self._positions(saved, name) for name in ("places", "others"))
        scores = saved.array("scores", np.float64, self._scores.shape)
        samples, given_up = saved.whole("samples"), saved.truth("given_up")
        strays = saved.whole("strays", 0, samples)
        table = self._table_of(saved, places, others) if saved.has("codes") else None
        self.places, self._others = places, others
        self._scores[:] = scores
        self.table = table
        self.samples, self._strays, self._given_up = samples, strays, given_up

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
        rows = len(codes)
        if not 1 <= rows <= c.ROWS or len(np.unique(codes[1:])) < rows - 1 or (codes % 1.0).any():
            raise saved.wrong("codes are not distinct whole numbers, or too many")
        schemas = saved.array("schemas", np.float64, (-1,), CHANGE, self._schemas - 1)
        if not 1 <= len(schemas) <= c.KINDS or (schemas % 1.0).any():
            raise saved.wrong(f"schemas are of {len(schemas)} outcomes, or no whole numbers")
        sets = saved.array("sets", np.float64, (-1, 2), 0, MOST)
        members = sets[:, 0]
        if not 1 <= len(sets) <= c.SETS or not np.isin(members, range(1, 2 ** len(schemas))).all():
            raise saved.wrong("sets are too many, or of unknown outcomes")
        table[c.T_KINDS], table[c.T_ROWS], table[c.T_SETS] = len(schemas), rows, len(sets)
        for row in range(1, rows):
            c.enter(table, codes[row], row)
        for name, part in _parts(table).items():
            # Probabilities are counts divided by totals, and shares of evidence and trust.
            low = {"changes": -LARGEST, "ranges": -LARGEST, "schemas": CHANGE}.get(name, 0.0)
            low = c.LEAST if name in ("evidence", "trust", "paths") else low
            high = MOST if name in ("counts", "totals", "codes", "trust") else LARGEST
            part[:] = saved.array(name, np.float64, part.shape, low, high)
        if not table[int(table[c.T_TOTALS])] > 0.0:
            raise saved.wrong("totals are of no sample")
        return table


def _parts(table: Vector) -> dict[str, Vector]:
    """Return views of what is saved of R rows: the layout and the hash table follow from it."""
    kinds, rows, columns = (int(table[k]) for k in (c.T_KINDS, c.T_ROWS, c.T_COLUMNS))
    shapes = {
        "schemas": (c.T_SCHEMAS, (kinds,)),
        "changes": (c.T_CHANGES, (kinds, columns)),
        "ranges": (c.T_RANGES, (columns, 2)),
        "trust": (c.T_TRUST, (c.LEVELS, c.EXPERTS)),
        "paths": (c.T_PATHS, (2,)),
        "sets": (c.T_ALTERNATIVES, (int(table[c.T_SETS]), 2)),
        "codes": (c.T_CODES, (rows,)),
        "counts": (c.T_COUNTS, (rows, c.KINDS)),
        "totals": (c.T_TOTALS, (rows,)),
        "evidence": (c.T_EVIDENCE, (rows, c.EXPERTS)),
    }
    return {
        name: table[int(table[start]) :][: int(np.prod(shape))].reshape(shape)
        for name, (start, shape) in shapes.items()
    }


def new_table(
    places: NDArray[np.int64], predicates: NDArray[np.int64], others: NDArray[np.int64]
) -> Vector:
    """Return an empty table for the counted fluents at some positions within the inputs.

    `predicates` are the positions of a context, `others` those of the whole numbers of a narrower
    one.
    """
    parts = {
        c.T_PLACES: len(places),
        c.T_CONTEXT: len(predicates) + len(others),
        c.T_SCHEMAS: c.KINDS,
        c.T_CHANGES: c.KINDS * len(places),
        c.T_RANGES: 2 * len(places),
        c.T_TRUST: c.LEVELS * c.EXPERTS,
        c.T_PATHS: 2,
        c.T_ALTERNATIVES: 2 * c.SETS,
        c.T_CODES: c.ROWS,
        c.T_SLOTS: c.SLOTS,
        c.T_COUNTS: c.ROWS * c.KINDS,
        c.T_TOTALS: c.ROWS,
        c.T_EVIDENCE: c.ROWS * c.EXPERTS,
    }
    table = np.zeros(c.TABLE + sum(parts.values()))
    at = c.TABLE
    for name, size in parts.items():
        table[name] = at
        at += size
    table[c.T_COLUMNS], table[c.T_KINDS], table[c.T_ROWS] = len(places), 1, 1
    table[c.T_PREDICATES], table[c.T_COUNT] = len(predicates), len(predicates) + len(others)
    for start, positions in ((c.T_PLACES, places), (c.T_CONTEXT, [*predicates, *others])):
        table[int(table[start]) :][: len(positions)] = positions
    for start, size in (
        (c.T_TRUST, c.LEVELS * c.EXPERTS),
        (c.T_PATHS, 2),
        (c.T_EVIDENCE, c.EXPERTS),
    ):
        table[int(table[start]) :][:size] = 1.0
    table[int(table[c.T_SCHEMAS]) :][: c.KINDS] = CHANGE
    return table
