"""What is measured of a run while it is recorded, each step once."""

from __future__ import annotations

import threading
from collections import Counter
from typing import Final

import numpy as np
from numpy.typing import NDArray

from serp.model.transition_model import TransitionModel, Vector
from serp.runs.recording import NEXT_STATE_COLUMNS, VETO_COLUMNS, Recording, next_states, vetoed
from serp.runs.recording_format import REASONS, Columns
from serp.runs.step_account import error_units, in_units, predicted_states

_WINDOWS: Final = 40
"""Most windows; when they are full, each takes in its neighbour."""
_LEAST_STEPS: Final = 2 * _WINDOWS
_MOST_FLUENTS: Final = 6
_READ: Final = (*VETO_COLUMNS, *NEXT_STATE_COLUMNS, "action", "ground")


class MeasuredRun:
    """Vetoes, and the error of a model one step ahead, of the steps that were read so far.

    Actions that the model does not know, or takes for not applicable, have no error.

    Args:
        model: The file's model; None: no error is measured.
    """

    def __init__(self, model: TransitionModel | None) -> None:
        self._model = model
        self._reading = threading.Lock()
        self._vetoes: Counter[str] = Counter()
        self._steps = 0
        self._width = 1  # steps of a window
        fluents = 0 if model is None else len(model.fluents)
        self._squares, self._counts = np.zeros((_WINDOWS, fluents)), np.zeros(_WINDOWS)
        self._changes, self._changed = np.zeros(fluents), 0
        self._predicted = np.zeros(fluents)
        self._open: Columns | None = None

    def read(self, recording: Recording) -> None:
        """Take in the steps of a recording that have come since it was read last."""
        with self._reading:  # a page that has just taken over may ask at the same time
            if len(recording) > self._steps:
                columns = recording.columns(*_READ, since=self._steps)
                self.take(columns, recording.layout.fluents)

    def take(self, columns: Columns, fluents: tuple[str, ...]) -> None:
        """Take in the next steps of a recording of these fluents."""
        first, count = self._steps, len(columns["reason"])
        refused = columns["reason"][vetoed(columns)]
        self._vetoes.update(str(REASONS[k]) for k in refused.tolist())
        self._steps += count
        model = self._model
        if model is None or tuple(each.name for each in model.fluents) != fluents:
            return
        columns = {**columns, "step": np.arange(first, first + count)}
        if self._open is not None:
            columns = {k: np.concatenate([self._open[k], columns[k]]) for k in self._open}
        after = next_states(columns)
        come = np.isfinite(after).all(axis=1)
        final = columns.pop("final_state")
        self._take({name: values[come] for name, values in columns.items()}, after[come], model)
        self._open = {name: values[~come] for name, values in columns.items()}
        self._open["final_state"] = final[:0]

    def _take(self, columns: Columns, after: Vector, model: TransitionModel) -> None:
        """Take in steps and the states after them."""
        states, rows = columns["state"], np.arange(len(after))
        goes_on = ~(columns["terminated"] | columns["truncated"])
        self._changes += np.square(after - states)[goes_on].sum(axis=0)
        self._changed += int(goes_on.sum())
        actions = columns["ground"][rows, columns["action"]].astype(np.int64)
        predicted = predicted_states(model, states, actions)
        there = np.isfinite(predicted).all(axis=1)
        self._predicted += np.square(predicted - states)[there].sum(axis=0)
        while self._steps > self._width * _WINDOWS:
            self._width *= 2
            self._squares, self._counts = _halved(self._squares), _halved(self._counts)
        windows = columns["step"][there] // self._width
        np.add.at(self._squares, windows, np.square(after - predicted)[there])
        np.add.at(self._counts, windows, 1)

    @property
    def vetoes(self) -> dict[str, int]:
        """Reason → number of proposals that were refused for it, the most frequent first."""
        return dict(self._vetoes.most_common())

    def errors(self) -> tuple[list[int], dict[str, list[float]]]:
        """Return where the windows end, in steps, and fluent → error in each; the largest."""
        filled = self._counts > 0
        if self._model is None or self._steps < _LEAST_STEPS or not filled.any():
            return [], {}
        usual = np.sqrt(self._changes / max(1, self._changed))
        units = error_units(self._model, usual, np.sqrt(self._predicted / self._counts.sum()))
        errors = in_units(np.sqrt(self._squares[filled] / self._counts[filled, None]), units)
        largest = np.argsort(-errors.mean(axis=0), kind="stable").tolist()
        shown = [k for k in largest if self._changes[k] or errors[:, k].any()][:_MOST_FLUENTS]
        ends = np.minimum((np.flatnonzero(filled) + 1) * self._width, self._steps)
        names = [fluent.name for fluent in self._model.fluents]
        return ends.tolist(), {names[k]: errors[:, k].tolist() for k in shown}


def _halved(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sums of two neighbours each, and zeros behind them."""
    halved = np.zeros_like(sums)
    halved[: _WINDOWS // 2] = sums[::2] + sums[1::2]
    return halved
