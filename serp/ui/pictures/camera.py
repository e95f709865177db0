"""Pictures that an environment draws, checked, and encoded for pages."""

from __future__ import annotations

import io
import os
from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray
from PIL import Image

from serp._util.numbers import real
from serp.errors import EnvironmentFailure
from serp.tasks.environment import BoundTask

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # environments draw with SDL on no screen
Picture = NDArray[np.uint8]


class Camera:
    """Takes the pictures of a task whose environment draws arrays, or lists of them."""

    def __init__(self, task: BoundTask) -> None:
        self._task = task
        self._several = task.env.render_mode == "rgb_array_list"
        self._rate = real(task.env.metadata.get("render_fps"))

    def take(self) -> list[Picture]:
        """Return the pictures since the last call, each uint8 of shape `(height, width, 3)`.

        Raises:
            EnvironmentFailure: The environment cannot draw, or gave something else.
        """
        try:
            rendered: Any = self._task.env.render()
        except DependencyNotInstalled as error:
            raise self._failure(
                f"the environment cannot draw: {error} (for serp's own environments: "
                "pip install 'serp[watch]')"
            ) from error
        except (Exception, SystemExit) as error:
            raise self._failure(f"render failed: {type(error).__name__}: {error}") from error
        pictures = rendered if self._several and isinstance(rendered, list) else [rendered]
        return [self._checked(picture) for picture in pictures]

    def _checked(self, picture: Any) -> Picture:
        array = np.asarray(picture)
        if array.dtype != np.uint8 or array.ndim != 3 or array.shape[2] != 3 or not array.size:
            raise self._failure(
                f"render returned {type(picture).__name__} {array.shape} of {array.dtype}; "
                "expected uint8 of shape (height, width, 3)"
            )
        return array

    def _failure(self, why: str) -> EnvironmentFailure:
        return EnvironmentFailure(f"task {self._task.name}: {why}")

    def period(self, count: int) -> float:
        """Return the duration of each of a step's pictures, s of the task's time.

        Pictures share the control period, unless the environment's `render_fps` says how long each
        of several lasts.
        """
        if self._several and self._rate is not None and self._rate > 0:
            return 1.0 / self._rate
        return self._task.model.dt / max(count, 1)


def webp(picture: Picture, width: int) -> bytes:
    """Return a picture of at most a width, pixels, as a WebP."""
    image, buffer = Image.fromarray(picture), io.BytesIO()
    if image.width > width:
        size = (width, max(1, round(image.height * width / image.width)))
        image = image.resize(size, Image.Resampling.HAMMING, reducing_gap=1.0)
    image.save(buffer, "WEBP", quality=60, method=2)
    return buffer.getvalue()
