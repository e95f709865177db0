"""The monitor: one-step predictions of the model compared with what was observed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp._util.saved_state import MOST, Saved
from serp.model.transition_model import TransitionModel, Vector

_LARGEST: Final = 1e150
"""Errors of at least this size have no finite square; such a step is skipped."""

_MAX_STATES: Final = 400_000
"""Most numbers in the states of the worst cases (3 MB); above it no states are kept."""

# Columns of the table [rows, F + 2, columns]. Counts are exact in float64 up to 2⁵³.
_ERROR, _SQUARE = 0, 2  # each as written, adapted
_PREDICTED, _HAPPENED, _UNPREDICTED = 4, 6, 8
_SAMPLES = 10
_WORST, _COLUMNS = 11, 15  # size of the largest error; predicted as written, adapted; observed

_LOW, _HIGH, _PREDICATE = 0, 1, 2  # rows of the array `quantities` [3, F + 2]

WRITTEN, ADAPTED, OBSERVED = 0, 1, 2
"""Rows of a comparison `[3, F + 2]`: the prediction of the file, that of the model in use, and the
observation. Reward and end (0 or 1) follow the fluents; both are 0 before the step."""

REWARD: Final = "reward"
END: Final = "terminal"

Tables = tuple[Vector, Vector, Vector]


@cached_njit(error_model="numpy")
def accumulate(state: Any, step: Any, row: int, tables: Any) -> bool:
    """Add a step to a row of the tables; return False if it is skipped for its values.

    `state` `[F]` is that before the action, `step` the comparison `[3, F + 2]`; where the action is
    not applicable its prediction is the state itself, no reward and no end. `tables` are sums and
    worst cases `[rows, F + 2, columns]`; states of the worst cases `[rows, F + 2, F]`, or no rows
    where they are not kept; the quantities.
    """
    table, states, quantities = tables
    width, count = state.shape[0], step.shape[1]
    for f in range(count):
        before, after = state[f] if f < width else 0.0, step[OBSERVED, f]
        # One comparison finds NaN, infinity and what would overflow when squared.
        if not (
            abs(before) < _LARGEST
            and abs(after) < _LARGEST
            and abs(after - step[WRITTEN, f]) < _LARGEST
            and abs(after - step[ADAPTED, f]) < _LARGEST
        ):
            return False
    keep = states.shape[0] > 0
    for f in range(count):
        before, after = state[f] if f < width else 0.0, step[OBSERVED, f]
        quantities[_LOW, f] = min(quantities[_LOW, f], before, after)
        quantities[_HIGH, f] = max(quantities[_HIGH, f], before, after)
        predicate = quantities[_PREDICATE, f] != 0.0
        table[row, f, _SAMPLES] += 1.0
        for side in range(2):
            predicted = step[side, f]
            error = after - predicted
            table[row, f, _ERROR + side] += error
            table[row, f, _SQUARE + side] += error * error
            if predicate:  # the adapted model may predict a probability
                changes = abs(predicted - before) > 0.5
                if changes:
                    table[row, f, _PREDICTED + side] += 1.0
                if before != after:
                    table[row, f, (_HAPPENED if changes else _UNPREDICTED) + side] += 1.0
        size = abs(after - step[WRITTEN, f])
        if size > table[row, f, _WORST]:
            table[row, f, _WORST] = size
            table[row, f, _WORST + 1] = step[WRITTEN, f]
            table[row, f, _WORST + 2] = step[ADAPTED, f]
            table[row, f, _WORST + 3] = after
            if keep:
                for g in range(width):
                    states[row, f, g] = state[g]
    return True


class Side(NamedTuple):
    """The accuracy of one model for one fluent, the reward or the end after one action.

    `bias` is the mean of observed − predicted. Of predicates and the end, `predicted` counts steps
    with a predicted change, `happened` those of these in which it was observed, and `unpredicted`
    steps with a change that was not predicted.
    """

    bias: float
    rmse: float
    predicted: int
    happened: int
    unpredicted: int


class Case(NamedTuple):
    """The step with the largest error of the file as written.

    `state` `[F]` is that before the action; None where the domain is too large to keep it.
    """

    error: float
    written: float
    adapted: float
    observed: float
    state: Vector | None


class MonitorRow(NamedTuple):
    """The accuracy for one fluent, `reward` or `terminal` after one ground action.

    `numeric` is False for a predicate and for the end. `scale` is the largest − smallest value
    observed after any action. `adapted` equals `written` without an adapted model; `worst` is None
    where no step has an error.
    """

    action: str
    fluent: str
    numeric: bool
    samples: int
    scale: float
    written: Side
    adapted: Side
    worst: Case | None


class Monitor:
    """Compares predicted with observed fluents, rewards and ends, by executed ground action.

    A row is added when an action is first executed, so that a domain of thousands of ground actions
    needs memory only for those in use.

    Attributes:
        skipped: Steps left out: NaN, infinity or a number without a finite square in the state,
            a prediction or the observation.
    """

    def __init__(self, model: TransitionModel) -> None:
        self._actions = [action.name for action in model.actions]
        self._width = width = len(model.fluents)
        self._quantities = [*(fluent.name for fluent in model.fluents), REWARD, END]
        self._numeric = [*(fluent.numeric for fluent in model.fluents), True, False]
        self._rows: dict[int, int] = {}  # action → row, in the order in which they came
        self.skipped = 0
        self._ranges: Vector = np.empty((3, width + 2))
        self._ranges[_LOW], self._ranges[_HIGH] = math.inf, -math.inf
        self._ranges[_PREDICATE] = [not numeric for numeric in self._numeric]
        # For all actions, so that it does not depend on their order.
        self._keeps_states = len(self._actions) * (width + 2) * width <= _MAX_STATES
        self._table: Vector = np.zeros((0, width + 2, _COLUMNS))
        self._states: Vector = np.zeros((0, width + 2, width))

    def row_of(self, action: int) -> int:
        """Return the row of `tables` that the steps of a ground action are added to."""
        row = self._rows.setdefault(action, len(self._rows))
        if row == len(self._table):
            more = min(len(self._actions), max(row + 1, 2 * row)) - row
            padding = ((0, more), (0, 0), (0, 0))
            self._table = np.pad(self._table, padding)
            if self._keeps_states:
                self._states = np.pad(self._states, padding)
        return row

    @property
    def tables(self) -> Tables:
        """The arrays that `accumulate` changes."""
        return self._table, self._states, self._ranges

    def rows(self) -> list[MonitorRow]:
        """Return a row for each ground action executed and quantity, in the order of the file.

        Quantities are the fluents, then the reward, then the end.
        """
        scale = self._ranges[_HIGH] - self._ranges[_LOW]
        found: list[MonitorRow] = []
        for action, row in sorted(self._rows.items()):
            count = int(self._table[row, 0, _SAMPLES])
            if not count:
                continue
            for f, fluent in enumerate(self._quantities):
                cells = self._table[row, f].tolist()
                written, adapted = (_side(cells, side, count) for side in range(2))
                found.append(
                    MonitorRow(
                        self._actions[action], fluent, self._numeric[f], count, float(scale[f]),
                        written, adapted, self._worst(row, f, cells),
                    )
                )  # fmt: skip
        return found

    def _worst(self, row: int, fluent: int, cells: list[float]) -> Case | None:
        error, written, adapted, observed = cells[_WORST:]
        state = self._states[row, fluent].copy() if self._keeps_states else None
        return Case(error, written, adapted, observed, state) if error > 0.0 else None

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and JSON values that restore it exactly."""
        rows = len(self._rows)
        arrays: dict[str, NDArray[Any]] = {
            "table": self._table[:rows].copy(),
            "states": self._states[:rows].copy(),
            "actions": np.array(list(self._rows), dtype=np.int64),
            "bounds": self._ranges[:_PREDICATE].copy(),
        }
        meta = {
            "actions": len(self._actions),
            "fluents": self._width,
            "skipped": self.skipped,
        }
        return arrays, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned; a `RunError` refuses what does not fit."""
        saved, width = Saved("monitor", arrays, meta), self._width
        saved.equal("actions", len(self._actions), "continue with the task it was saved with")
        saved.equal("fluents", width, "continue with the task it was saved with")
        executed = saved.array("actions", np.int64, (-1,), 0, len(self._actions) - 1).tolist()
        rows = len(executed)
        if len(set(executed)) != rows:
            raise saved.wrong("actions come twice")
        bounds = saved.array("bounds", np.float64, (2, width + 2), -math.inf, math.inf)
        table = saved.array("table", np.float64, (rows, width + 2, _COLUMNS))
        if (table[:, :, _SQUARE:_PREDICTED] < 0).any():
            raise saved.wrong("table has squares below 0")
        counted = table[:, :, _PREDICTED:_WORST]
        if ((counted < 0) | (counted > MOST)).any():
            raise saved.wrong("table has counts below 0 or beyond all bounds")
        kept = rows if self._keeps_states else 0
        states = saved.array("states", np.float64, (kept, width + 2, width))
        self.skipped = saved.whole("skipped")
        self._rows = {action: row for row, action in enumerate(executed)}
        self._table, self._states = table.copy(), states.copy()
        self._ranges[:_PREDICATE] = bounds


def _side(cells: list[float], side: int, count: int) -> Side:
    return Side(
        bias=cells[_ERROR + side] / count,
        rmse=math.sqrt(cells[_SQUARE + side] / count),
        predicted=int(cells[_PREDICTED + side]),
        happened=int(cells[_HAPPENED + side]),
        unpredicted=int(cells[_UNPREDICTED + side]),
    )
