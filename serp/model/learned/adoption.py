"""Which parts of an adapted model are in use, and why others are not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from serp._util.did_you_mean import listed
from serp._util.text import percent, plural


class TrackRecord(NamedTuple):
    """What was learned beside the file of one function or predicate, after one action.

    Errors of the file and of what was learned are prequential: of predictions of steps that were
    not learned from yet. It is the mean absolute error of a number, the Brier score of outcomes.
    """

    schema: str
    used: bool  # whether it predicts instead of the file alone
    steps: int
    written: float
    learned: float
    hindrance: str = ""  # why nothing can be learned; empty if it can


class FluentAdoption(NamedTuple):
    """What predicts one function or predicate of the file, over all actions and objects.

    `residual` and `outcomes` are the action schemas after which a residual, or counts, are in use;
    `why` says why they are, or not, as judged by so many steps.
    """

    fluent: str
    residual: tuple[str, ...]
    outcomes: tuple[str, ...]
    steps: int
    why: str

    @property
    def adapted(self) -> bool:
        """Whether anything learned is in use."""
        return bool(self.residual or self.outcomes)

    def as_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        after = {"residual": list(self.residual), "outcomes": list(self.outcomes)}
        return {**self._asdict(), **after, "adapted": self.adapted}


class Reliability(NamedTuple):
    """Steps with similar predicted chances of an end: their mean, and the fraction that ended."""

    steps: int
    chance: float
    ended: float


class WorthAdoption(NamedTuple):
    """What predicts the reward or the end of a step.

    Errors, by the file and of what is in use, are mean squared ones of the newest steps, each
    before it was learned from; of ends they are Brier scores.
    """

    name: str
    corrected: bool
    steps: int
    written: float
    in_use: float
    reliability: tuple[Reliability, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return {**self._asdict(), "reliability": [each._asdict() for each in self.reliability]}


class AdoptedParameter(NamedTuple):
    """A number of the file that is replaced by an estimate."""

    line: int
    text: str
    written: float
    in_use: float


class ModelAdoption(NamedTuple):
    """What the planner's model is made of; `parameters` are those not used as written."""

    adapts: bool
    parameters: tuple[AdoptedParameter, ...] = ()
    fluents: tuple[FluentAdoption, ...] = ()
    worth: tuple[WorthAdoption, ...] = ()

    @property
    def in_use(self) -> bool:
        """Whether the planner uses anything that was learned."""
        adapted = any(fluent.adapted for fluent in self.fluents)
        return bool(self.parameters) or adapted or any(each.corrected for each in self.worth)

    def as_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return {
            "adapts": self.adapts,
            "in_use": self.in_use,
            "sentence": str(self),
            "parameters": [parameter._asdict() for parameter in self.parameters],
            "fluents": [fluent.as_dict() for fluent in self.fluents],
            "worth": [each.as_dict() for each in self.worth],
        }

    def __str__(self) -> str:
        if not self.adapts:
            return "as written; nothing is learned"
        if not self.in_use:
            return "as written; it may adapt, but nothing learned is in use"
        parts = []
        if self.parameters:
            parts.append(f"estimates of {plural(len(self.parameters), 'number')} in the file")
        for what, names in (
            ("residual", [f.fluent for f in self.fluents if f.residual]),
            ("counted outcomes", [f.fluent for f in self.fluents if f.outcomes]),
            ("correction", [f"({each.name})" for each in self.worth if each.corrected]),
        ):
            if names:
                parts.append(f"{what} for {listed(names)}")
        left = [f.fluent for f in self.fluents if not f.adapted]
        said = f"adapted: {'; '.join(parts)}"
        return f"{said}; unchanged from the file: {listed(left)}" if left else said


def adoption_of(
    fluent: str, residuals: Sequence[TrackRecord], outcomes: Sequence[TrackRecord]
) -> FluentAdoption:
    """Return what predicts a function or predicate, given the track records after each action."""
    residual, counted = (
        tuple(dict.fromkeys(record.schema for record in kind if record.used))
        for kind in (residuals, outcomes)
    )
    records = [r for r in (*residuals, *outcomes) if r.steps and not r.hindrance]
    records = [record for record in records if record.used] or records
    steps = sum(record.steps for record in records)
    written = sum(record.steps * record.written for record in records)
    learned = sum(record.steps * record.learned for record in records)
    if not records:
        hindrances = dict.fromkeys(r.hindrance for r in (*residuals, *outcomes) if r.hindrance)
        why = "; ".join(hindrances) or "no step has been compared"
    elif written == 0.0:
        why = f"the file was right in {plural(steps, 'step')}"
    else:
        ratio = percent(learned / written)
        why = f"in {plural(steps, 'step')}, the learned model's error is {ratio} of the file's"
    return FluentAdoption(fluent, residual, counted, steps, why)
