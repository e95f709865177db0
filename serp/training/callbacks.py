"""Functions of the user that a training calls: once per env step, once per episode."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypedDict

from serp.control.step_record import OnStep, StepRecord
from serp.errors import SettingsError
from serp.runs.rows import MetricsRow

OnEpisode = Callable[[MetricsRow], None]
"""Called with the row of the metrics of every episode, after the episode."""


class TrainingCallbacks(TypedDict, total=False):
    """Functions that a training calls; their results are ignored.

    Attributes:
        on_step: Called with every env step, after learning from it.
        on_episode: Called with the metrics of every episode. A resumed run calls it for the new
            episodes only.
    """

    on_step: OnStep
    on_episode: OnEpisode


class Callbacks:
    """Calls the functions of the user until one of them fails.

    A failure does not interrupt the episode, because a run is saved between episodes only.

    Attributes:
        failure: What a function raised; no function is called after that.
    """

    def __init__(self, functions: TrainingCallbacks) -> None:
        for name, function in functions.items():
            if name not in TrainingCallbacks.__annotations__:
                raise TypeError(f"plan_and_learn() got an unexpected keyword argument {name!r}")
            if function is not None and not callable(function):
                raise SettingsError(f"{name} must be a function of one argument, not {function!r}")
        self._on_step = functions.get("on_step")
        self._on_episode = functions.get("on_episode")
        self.failure: Exception | None = None

    def step(self, record: StepRecord) -> None:
        """Call `on_step`."""
        if self._on_step is not None:
            self._call(self._on_step, record)

    def episode(self, row: MetricsRow) -> None:
        """Call `on_episode`."""
        if self._on_episode is not None:
            self._call(self._on_episode, row)

    def _call(self, function: Callable[[Any], None], record: Any) -> None:
        if self.failure is None:
            try:
                function(record)
            except Exception as error:
                self.failure = error
