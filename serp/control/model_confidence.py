"""The confidence in the model that the planner uses."""

from __future__ import annotations

from enum import IntEnum


class ModelConfidence(IntEnum):
    """What is known of the quality of the model's predictions.

    OPEN: Nothing; a model that does not adapt always has this value.
    GROWING: The model adapts, and has seen too few episodes to be judged.
    RELIABLE: The model has predicted the newest steps well.
    """

    OPEN = 0
    GROWING = 1
    RELIABLE = 2
