"""What is measured of a run while it is recorded, each step once."""

from __future__ import annotations

import threading
from collections import Counter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp.model.transition_model import TransitionModel, Vector
from serp.runs.recording import Recording
from serp.runs.recording_format import Columns
from serp.studio.recorded import vetoed

_WINDOWS: Final = 40
"""Most windows; when they are full, each takes in its neighbour."""
_LEAST_STEPS: Final = 2 * _WINDOWS
_MOST_FLUENTS: Final = 6
_READ: Final = (
    "reason", "proposed_by", "episode", "state", "action", "ground", "terminated", "truncated",
)  # fmt: skip


class MeasuredRun:
    """Vetoes, and the error of a model one step ahead, of the steps that were read so far.

    Steps that end an episode, and actions that the model does not know, have no error.

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
        self._open: Columns | None = None

    def read(self, recording: Recording) -> None:
        """Take in the steps of a recording that have come since it was read last."""
        with self._reading:  # a page that has just taken over may ask at the same time
            if len(recording) > self._steps:
                self.take(recording.columns(*_READ, since=self._steps), recording)

    def take(self, columns: Columns, recording: Recording) -> None:
        """Take in the next steps of a recording."""
        layout, first = recording.layout, self._steps
        reasons = columns["reason"][vetoed(columns, layout)]
        self._vetoes.update(layout.reasons[k] for k in reasons.tolist())
        self._steps += len(columns["reason"])
        model = self._model
        if model is None or tuple(each.name for each in model.fluents) != layout.fluents:
            return
        columns = {**columns, "step": np.arange(first, self._steps)}
        if self._open is not None:
            columns = {k: np.concatenate([self._open[k], columns[k]]) for k in self._open}
        order = np.argsort(columns["episode"], kind="stable")
        goes_on = np.diff(columns["episode"][order]) == 0
        self._take_pairs(columns, order[:-1][goes_on], order[1:][goes_on], model)
        last = order[np.append(~goes_on, True)]
        last = last[~(columns["terminated"] | columns["truncated"])[last]]
        self._open = {name: values[last] for name, values in columns.items()}

    def _take_pairs(
        self,
        columns: dict[str, NDArray[Any]],
        before: NDArray[np.int64],
        after: NDArray[np.int64],
        model: TransitionModel,
    ) -> None:
        """Take in the steps `before`, whose next ones are `after`."""
        states = columns["state"]
        self._changes += np.square(states[after] - states[before]).sum(axis=0)
        self._changed += len(before)
        actions = columns["ground"][before, columns["action"][before]].astype(np.int64)
        known = actions >= 0
        before, after, actions = before[known], after[known], actions[known]
        if not len(before):
            return
        predicted = model.step(states[before], actions)
        there = predicted.applicable
        squares = np.square(states[after] - predicted.state)[there]
        while self._steps > self._width * _WINDOWS:
            self._width *= 2
            self._squares, self._counts = _halved(self._squares), _halved(self._counts)
        windows = columns["step"][before[there]] // self._width
        np.add.at(self._squares, windows, squares)
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
        usual: Vector = np.sqrt(self._changes / max(1, self._changed))
        with np.errstate(divide="ignore", invalid="ignore"):
            errors = np.sqrt(self._squares[filled] / self._counts[filled, None]) / usual
        largest = np.argsort(-np.nan_to_num(errors).mean(axis=0), kind="stable")
        shown = [k for k in largest.tolist() if usual[k] > 0][:_MOST_FLUENTS]
        ends = np.minimum((np.flatnonzero(filled) + 1) * self._width, self._steps)
        names = [fluent.name for fluent in self._model.fluents]
        return ends.tolist(), {names[k]: errors[:, k].tolist() for k in shown}


def _halved(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sums of two neighbours each, and zeros behind them."""
    halved = np.zeros_like(sums)
    halved[: _WINDOWS // 2] = sums[::2] + sums[1::2]
    return halved
