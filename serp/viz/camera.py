"""Pictures of a task's environment, by Gymnasium's render modes `rgb_array` and `rgb_array_list`.

An environment that lists `rgb_array_list` itself draws several pictures a step; of all others every
step gives one.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from serp._util.numbers import real
from serp.errors import EnvironmentFailure, TaskError
from serp.tasks.bound_task import BoundTask
from serp.training.run import Run

RGB_ARRAY: Final = "rgb_array"
RGB_ARRAY_LIST: Final = "rgb_array_list"
Picture = NDArray[np.uint8]


def render_mode_of(run: Run) -> str:
    """Return the render mode that gives the most pictures of a run's environment.

    Raises:
        TaskError: The environment draws no pictures.
    """
    with run.environment(RGB_ARRAY) as task:
        modes = task.env.metadata.get("render_modes") or ()
        for mode in (RGB_ARRAY_LIST, RGB_ARRAY):
            if mode in modes:
                return mode
        raise TaskError(
            f"task {task.name}: the environment draws no pictures; it needs the render mode "
            f"`{RGB_ARRAY}`, and among metadata['render_modes'] are {', '.join(modes) or 'none'}"
        )


class Camera:
    """Takes the pictures of a task whose environment was made with one of the two modes."""

    def __init__(self, task: BoundTask) -> None:
        self._task = task
        self._several = task.env.render_mode == RGB_ARRAY_LIST
        self._rate = real(task.env.metadata.get("render_fps"))

    def take(self) -> list[Picture]:
        """Return the pictures since the last call, each uint8 of shape `(height, width, 3)`.

        Raises:
            EnvironmentFailure: The environment cannot draw, or gave something else.
        """
        try:
            seen: Any = self._task.env.render()
        except DependencyNotInstalled as error:
            raise self._failure(
                f"the environment cannot draw: {error} (what serp's own environments need comes "
                "with pip install 'serp[watch]')"
            ) from error
        except (Exception, SystemExit) as error:
            raise self._failure(f"render failed: {type(error).__name__}: {error}") from error
        pictures = seen if self._several and isinstance(seen, list) else [seen]
        return [self._checked(picture) for picture in pictures]

    def _checked(self, picture: Any) -> Picture:
        array = np.asarray(picture)
        if array.dtype != np.uint8 or array.ndim != 3 or array.shape[2] != 3 or not array.size:
            raise self._failure(
                f"render returned {type(picture).__name__} {array.shape} of {array.dtype}; a "
                "picture is uint8 of shape (height, width, 3)"
            )
        return array

    def _failure(self, why: str) -> EnvironmentFailure:
        return EnvironmentFailure(f"task {self._task.name}: {why}")

    def period(self, count: int) -> float:
        """Return the duration of each of a step's pictures, s of the task's time.

        A single picture lasts a control period. For several, the environment's `render_fps` gives
        the duration; without it they share the control period.
        """
        if self._several and self._rate is not None and self._rate > 0:
            return 1.0 / self._rate
        return self._task.model.dt / max(count, 1)
