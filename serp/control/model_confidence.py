"""How far the model that is planned with can be trusted."""

from __future__ import annotations

from enum import IntEnum


class ModelConfidence(IntEnum):
    """What is known of the model's predictions.

    OPEN: Nothing speaks for the model, or against it.
    GROWING: It corrects itself, and has seen too little yet to be judged by how it does.
    RELIABLE: It has foreseen what happened, of late.
    """

    OPEN = 0
    GROWING = 1
    RELIABLE = 2
