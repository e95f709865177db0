"""How far the model that is planned with can be relied on."""

from __future__ import annotations

from enum import IntEnum


class ModelConfidence(IntEnum):
    """What is known of the model's predictions.

    OPEN: Nothing is known; a model that does not adapt is always in this state.
    GROWING: It adapts, and has seen too few episodes to be judged by its predictions.
    RELIABLE: It has predicted the newest steps well.
    """

    OPEN = 0
    GROWING = 1
    RELIABLE = 2
