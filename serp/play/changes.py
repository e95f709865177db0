"""What a step of a game changed, and what of the file changed it."""

from __future__ import annotations

from dataclasses import dataclass

from serp.explanation.causes import Cause, causes_passed, changes_passed
from serp.model.transition_model import TransitionModel, Vector
from serp.tasks.worlds.file_world import Happened


@dataclass(frozen=True)
class FluentChange:
    """A fluent that a step changed.

    Attributes:
        name: The fluent.
        before: Its value before the step.
        after: Its value after it.
        causes: What changed it, in order; the `amount` of each is by how much.
        noise: How much of the change is chance.
    """

    name: str
    before: float | bool
    after: float | bool
    causes: tuple[Cause, ...]
    noise: float


def changes_of(
    model: TransitionModel, before: Vector, after: Vector, happened: Happened
) -> list[FluentChange]:
    """Return the fluents that a step changed, or that something tried to change, in their order."""
    causes = changes_passed(model, before, happened.passages)
    found = []
    for fluent in model.fluents:
        old, new = float(before[fluent.index]), float(after[fluent.index])
        behind = causes.get(fluent.index, [])
        if old == new and not behind:
            continue
        rest = new - old - sum(cause.amount or 0.0 for cause in behind)
        found.append(
            FluentChange(
                fluent.name,
                old if fluent.numeric else bool(old),
                new if fluent.numeric else bool(new),
                tuple(behind),
                rest if abs(rest) > 1e-9 * max(1.0, abs(old), abs(new)) else 0.0,
            )
        )
    return found


def brought(
    model: TransitionModel, before: Vector, after: Vector, reward: float, happened: Happened
) -> list[Cause]:
    """Return what is behind reward, flags and end of a step."""
    out = [*after.tolist(), reward]
    return causes_passed(model, before, happened.passages, happened.flags, out)
