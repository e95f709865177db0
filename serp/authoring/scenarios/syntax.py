"""What a scenario file says; see docs/reference/scenarios.md."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Final

from serp._util.text import readable
from serp.agent.decision import Reason
from serp.pddl.source import Place

SUFFIX: Final = ".scenarios"
"""Ending of the name of a scenario file."""
REASONS: Final = {
    "unsafe": Reason.UNSAFE,
    "unsafe ahead": Reason.UNSAFE_AHEAD,
    "few ways on": Reason.FEW_WAYS_ON,
    "too risky": Reason.TOO_RISKY,
    "not applicable": Reason.NOT_APPLICABLE,
    "undefined": Reason.UNDEFINED,
    "low reward": Reason.LOW_REWARD,
}
"""What may follow `because` → the reason of a veto."""


@dataclass(frozen=True)
class Bounds:
    """The numbers that `is about`, `is at least` and `is at most` allow, both ends included.

    `text` is what is written.
    """

    least: float
    most: float
    text: str

    @classmethod
    def about(cls, written: str, within: float | None) -> Bounds:
        """Return the numbers within a distance, by default those that round to what is written."""
        number = Decimal(written)
        if within is None:
            exponent = number.as_tuple().exponent
            assert isinstance(exponent, int)  # the number is finite
            half = Decimal(5).scaleb(exponent - 1)
            return cls(float(number - half), float(number + half), f"about {written}")
        value, text = float(number), f"about {written} within {readable(within)}"
        return cls(value - within, value + within, text)

    def __contains__(self, value: float) -> bool:
        return self.least <= value <= self.most

    def __str__(self) -> str:
        if not self.text.startswith("about"):
            return self.text
        return f"{self.text} ({readable(self.least)} to {readable(self.most)})"


@dataclass(frozen=True)
class StepOfRun:
    """`like step 12 of RUN`, `like step 3 of episode 2 of RUN`: a situation of a run.

    Steps count from 0, as in `serp why`; without an episode, over the whole run.
    """

    step: int
    episode: int | None
    run: str
    place: Place


@dataclass(frozen=True)
class Chooses:
    """`chooses A or B`, `does not choose A`: the controller's action is, or is not, one of some."""

    actions: tuple[int, ...]
    negated: bool
    place: Place


@dataclass(frozen=True)
class Refuses:
    """`refuses A`, `refuses A because unsafe`, `allows A`: the action is vetoed, or it is not."""

    action: int
    reason: str
    negated: bool
    place: Place


@dataclass(frozen=True)
class Indifferent:
    """`is indifferent`: all safe actions are worth the same to the planner."""

    place: Place


@dataclass(frozen=True)
class Rates:
    """`value of A is ...`, `reward of A is ...`: the best return with A first, A's reward alone."""

    what: str
    action: int
    bounds: Bounds
    place: Place


@dataclass(frozen=True)
class After:
    """`after STEPS ...`: what holds after some steps by the model.

    `steps` is a number of steps of the controller's choice, or the ground actions to be executed.
    `fluent` is a fluent, `reward` (the sum over the steps), or a flag (whether any step sets it).
    """

    steps: int | tuple[int, ...]
    fluent: str
    bounds: Bounds
    place: Place


Expectation = Chooses | Refuses | Indifferent | Rates | After


@dataclass(frozen=True)
class Scenario:
    """A situation, and what is expected in it, in the order of the file.

    The situation begins with a `recorded` step, or with the initial state; `given` are the values
    that differ, 0 and 1 for truth. `place` is the line of the title.
    """

    title: str
    place: Place
    recorded: StepOfRun | None = None
    given: Mapping[str, float] = field(default_factory=dict)
    expectations: tuple[Expectation, ...] = field(default=(), repr=False)
