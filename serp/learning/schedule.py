"""A value that moves in a straight line over the env steps and then stays."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LinearSchedule:
    """From `start` at step 0 to `end` at step `steps`, and `end` from there on.

    Attributes:
        start: the value at step 0.
        end: the value from step `steps` on.
        steps: env steps from one to the other; 0 means `end` at once.
    """

    start: float
    end: float
    steps: int

    def __call__(self, step: int) -> float:
        """The value at env step `step` ≥ 0."""
        if step >= self.steps:
            return self.end
        return self.start + (self.end - self.start) * (step / self.steps)
