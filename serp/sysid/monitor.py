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

CASES: Final = 5
"""Number of worst cases kept for each ground action and fluent."""

_LARGEST: Final = 1e150
"""Errors of at least this size have no finite square; such a step is skipped."""

_MAX_STATES: Final = 2_000_000
"""Most numbers in the states of the worst cases (16 MB); above it no states are kept."""

# Columns of the table [rows, F + 2, columns]. Counts are exact in float64 up to 2⁵³.
_ERROR, _SQUARE = 0, 2  # each as written, adapted
_PREDICTED, _HAPPENED, _UNPREDICTED = 4, 6, 8
_CASES = 10  # CASES times: size of the error; predicted as written and adapted; observed
_CASE_WIDTH = 4
_COLUMNS = _CASES + CASES * _CASE_WIDTH

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

    Args:
        state: `[F]` before the action.
        step: The comparison `[3, F + 2]`.
        row: The row.
        tables: Sums and worst cases `[rows, F + 2, columns]`; states of the worst cases
            `[rows, F + 2, CASES, F]`, or no rows where they are not kept; the quantities.
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
        least = _CASES
        for case in range(_CASES, _COLUMNS, _CASE_WIDTH):
            if table[row, f, case] < table[row, f, least]:
                least = case
        if size > table[row, f, least]:
            table[row, f, least] = size
            table[row, f, least + 1] = step[WRITTEN, f]
            table[row, f, least + 2] = step[ADAPTED, f]
            table[row, f, least + 3] = after
            if keep:
                for g in range(width):
                    states[row, f, (least - _CASES) // _CASE_WIDTH, g] = state[g]
    return True


class Side(NamedTuple):
    """The accuracy of one model for one fluent, the reward or the end after one action.

    Attributes:
        bias: Mean of observed − predicted.
        rmse: Root mean squared error.
        predicted: Steps with a predicted change of the predicate, or a predicted end of the task; 0
            for numbers, as the next two are.
        happened: Number of these in which the change or end was observed.
        unpredicted: Steps with a change or end that was not predicted.
    """

    bias: float
    rmse: float
    predicted: int
    happened: int
    unpredicted: int


class Case(NamedTuple):
    """One of the steps with the largest errors.

    Attributes:
        error: |observed − predicted| of the file as written.
        written: Predicted by the file as written.
        adapted: Predicted by the adapted model; the same where there is none.
        observed: Observed value.
        state: `[F]` before the action; None where the domain is too large to keep it.
    """

    error: float
    written: float
    adapted: float
    observed: float
    state: Vector | None


class MonitorRow(NamedTuple):
    """The accuracy for one fluent, the reward or the end after one action.

    Attributes:
        action: Name of the ground action.
        fluent: Name of the fluent; `reward`, or `terminal` for the end.
        numeric: False for a predicate and for the end.
        samples: Steps.
        scale: Largest − smallest value observed, after any action.
        written: The file as written.
        adapted: The adapted model; equals `written` where there is none.
        worst: Its worst cases, the worst first; only steps with an error.
    """

    action: str
    fluent: str
    numeric: bool
    samples: int
    scale: float
    written: Side
    adapted: Side
    worst: tuple[Case, ...]


class Monitor:
    """Compares predicted with observed fluents, rewards and ends, by executed ground action.

    A row is added when an action is first executed, so that a domain of thousands of ground actions
    needs memory only for those in use.

    Args:
        model: The model whose fluents and actions are compared.

    Attributes:
        skipped: Steps left out: NaN, infinity or a number without a finite square in the state,
            a prediction or the observation.
        unknown: Steps of actions that the model does not know.
    """

    def __init__(self, model: TransitionModel) -> None:
        self._actions = [action.name for action in model.actions]
        self._width = width = len(model.fluents)
        self._quantities = [*(fluent.name for fluent in model.fluents), REWARD, END]
        self._numeric = [*(fluent.numeric for fluent in model.fluents), True, False]
        self._rows: list[int] = [-1] * len(self._actions)
        self._executed: list[int] = []  # row → action, in the order in which they came
        self._counts: list[int] = []
        self.skipped = 0
        self.unknown = 0
        self._ranges: Vector = np.empty((3, width + 2))
        self._ranges[_LOW], self._ranges[_HIGH] = math.inf, -math.inf
        self._ranges[_PREDICATE] = [not numeric for numeric in self._numeric]
        # For all actions, so that it does not depend on their order.
        self._keeps_states = len(self._actions) * (width + 2) * CASES * width <= _MAX_STATES
        self._table: Vector = np.zeros((0, width + 2, _COLUMNS))
        self._states: Vector = np.zeros((0, width + 2, CASES, width))

    @property
    def steps(self) -> int:
        """Steps compared."""
        return sum(self._counts)

    def observe(self, state: Vector, action: int, step: Vector) -> None:
        """Compare one env step.

        Args:
            state: float64 `[F]` before the action.
            action: Position of the ground action; −1 where the model knows none.
            step: `[3, F + 2]`, see `OBSERVED`. Where the action is not applicable the prediction
                is the state itself, no reward and no end.
        """
        if action < 0:
            self.unknown += 1
            return
        row = self.row_of(action)
        self.note(row, accumulate(state, step, row, self.tables))

    def row_of(self, action: int) -> int:
        """Return the row of `tables` that the steps of a ground action are added to."""
        row = self._rows[action]
        return row if row >= 0 else self._add_row(action)

    @property
    def tables(self) -> Tables:
        """The arrays that `accumulate` changes."""
        return self._table, self._states, self._ranges

    def note(self, row: int, compared: bool) -> None:
        """Count a step that was added to a row, or was skipped."""
        if compared:
            self._counts[row] += 1
        else:
            self.skipped += 1

    def _add_row(self, action: int) -> int:
        row = len(self._executed)
        self._executed.append(action)
        self._counts.append(0)
        self._rows[action] = row
        if row >= len(self._table):
            more = min(len(self._actions), max(row + 1, 2 * row)) - len(self._table)
            padding = ((0, more), (0, 0), (0, 0))
            self._table = np.pad(self._table, padding)
            if self._keeps_states:
                self._states = np.pad(self._states, (*padding, (0, 0)))
        return row

    def rows(self) -> list[MonitorRow]:
        """Return a row for each ground action executed and quantity, in the order of the file.

        Quantities are the fluents, then the reward, then the end.
        """
        scale = self._ranges[_HIGH] - self._ranges[_LOW]
        found: list[MonitorRow] = []
        for action, row in enumerate(self._rows):
            count = self._counts[row] if row >= 0 else 0
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

    def _worst(self, row: int, fluent: int, cells: list[float]) -> tuple[Case, ...]:
        cases = []
        for case in range(CASES):
            error, written, adapted, observed = cells[_CASES + case * _CASE_WIDTH :][:_CASE_WIDTH]
            if error > 0.0:
                state = self._states[row, fluent, case].copy() if self._keeps_states else None
                cases.append(Case(error, written, adapted, observed, state))
        return tuple(sorted(cases, key=lambda case: -case.error))

    # State -------------------------------------------------------------------------------------

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays (only nonzero entries) and JSON values that restore it exactly."""
        rows = len(self._executed)
        arrays: dict[str, NDArray[Any]] = {
            **_packed("table", self._table[:rows]),
            **_packed("states", self._states[:rows]),
            "actions": np.array(self._executed, dtype=np.int64),
            "counts": np.array(self._counts, dtype=np.int64),
            "bounds": self._ranges[:_PREDICATE].copy(),
        }
        meta = {
            "actions": len(self._actions),
            "fluents": self._width,
            "skipped": self.skipped,
            "unknown": self.unknown,
        }
        return arrays, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Continue from what `state_dict` returned.

        Raises:
            RunError: It belongs to another domain, or is incomplete; this monitor is unchanged.
        """
        saved, width = Saved("monitor", arrays, meta), self._width
        saved.equal("actions", len(self._actions), "continue with the task it was saved with")
        saved.equal("fluents", width, "continue with the task it was saved with")
        executed = saved.array("actions", np.int64, (-1,), 0, len(self._actions) - 1).tolist()
        rows = len(executed)
        if len(set(executed)) != rows:
            raise saved.wrong("actions come twice")
        counts = saved.array("counts", np.int64, (rows,), 0, MOST).tolist()
        bounds = saved.array("bounds", np.float64, (2, width + 2), -math.inf, math.inf)
        table = _unpacked("table", saved, (rows, width + 2, _COLUMNS))
        if (table[:, :, _SQUARE:_PREDICTED] < 0).any():
            raise saved.wrong("table has squares below 0")
        counted = table[:, :, _PREDICTED:_CASES]
        if ((counted < 0) | (counted > MOST)).any():
            raise saved.wrong("table has counts below 0 or beyond all bounds")
        kept = rows if self._keeps_states else 0
        states = _unpacked("states", saved, (kept, width + 2, CASES, width))
        skipped, unknown = saved.whole("skipped"), saved.whole("unknown")
        self._executed, self._counts = executed, counts
        self._rows = [-1] * len(self._actions)
        for row, action in enumerate(executed):
            self._rows[action] = row
        self._table, self._states = table, states
        self._ranges[:_PREDICATE] = bounds
        self.skipped, self.unknown = skipped, unknown


def _side(cells: list[float], side: int, count: int) -> Side:
    return Side(
        bias=cells[_ERROR + side] / count,
        rmse=math.sqrt(cells[_SQUARE + side] / count),
        predicted=int(cells[_PREDICTED + side]),
        happened=int(cells[_HAPPENED + side]),
        unpredicted=int(cells[_UNPREDICTED + side]),
    )


def _packed(name: str, array: Vector) -> dict[str, NDArray[Any]]:
    """Return the nonzero entries of an array: most predicates are predicted without error."""
    flat = np.ascontiguousarray(array).reshape(-1)
    places = np.flatnonzero(flat.view(np.int64))  # −0 is not 0
    return {f"{name}.places": places.astype(np.int64), f"{name}.values": flat[places]}


def _unpacked(name: str, saved: Saved, shape: tuple[int, ...]) -> Vector:
    """Return the array that was packed."""
    flat = np.zeros(math.prod(shape))
    places = saved.array(f"{name}.places", np.int64, (-1,), 0, flat.size - 1)
    flat[places] = saved.array(f"{name}.values", np.float64, places.shape)
    return flat.reshape(shape)
