"""Findings about a domain file from observed transitions, and how a file writes them.

`samples` is the number of transitions that a finding is based on. `cost` is the fraction of the
one-step prediction error that it accounts for: the reduction of the squared error of its quantity,
divided by the squared change of that quantity. Costs are comparable across kinds of findings and
across fluents, rewards and ends of any scale.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from serp.model.ground import Parameter
from serp.model.learned.robust_regression import CERTAIN
from serp.pddl.source import Place


@dataclass(frozen=True)
class EffectTerm:
    """A summand of a missing effect: a coefficient times the product of the named fluents."""

    coefficient: float
    error: float
    fluents: tuple[str, ...]

    @property
    def size(self) -> str:
        """The term without its sign, in PDDL."""
        number = decimal(abs(self.coefficient), self.error)
        fluents = ""
        for name in self.fluents:
            fluents = f"(* {fluents} ({name}))" if fluents else f"({name})"
        if not fluents:
            return number
        return fluents if number == "1" else f"(* {number} {fluents})"


@dataclass(frozen=True)
class ParameterFinding:
    """An estimate of a number that the file writes in an effect or a rate.

    Attributes:
        parameter: The number, with its place.
        schema: Name of the action or process schema that contains it.
        fluent: Symbol of the function that the effect changes.
        written: Its value in the file.
        estimate: Its value estimated from the transitions.
        error: Standard error of the estimate.
    """

    parameter: Parameter
    schema: str
    fluent: str
    written: float
    estimate: float
    error: float
    samples: int
    cost: float

    @property
    def number(self) -> str:
        """What the file should have; 0 where the estimate has an uncertain sign and turned."""
        turned = self.estimate * self.written < 0.0
        if turned and abs(self.estimate) <= CERTAIN * self.error:
            return "0"
        return decimal(self.estimate, self.error)


@dataclass(frozen=True)
class MissingEffect:
    """An observed change that the file does not mention.

    Attributes:
        schema: Name of the action schema; empty for a change per unit of time under every action.
        place: Where that schema is written; None where there is none.
        fluent: Name of the fluent that changes: `battery ?robot`.
        terms: The summands of the change.
    """

    schema: str
    place: Place | None
    fluent: str
    terms: tuple[EffectTerm, ...]
    samples: int
    cost: float

    def effect(self, term: EffectTerm) -> str:
        """Return the effect of one term in PDDL."""
        value = term.size if self.schema else f"(* #t {term.size})"
        return f"({'decrease' if term.coefficient < 0 else 'increase'} ({self.fluent}) {value})"


@dataclass(frozen=True)
class ObservedOutcome:
    """One outcome of a stochastic effect.

    Attributes:
        changes: (name of the fluent, its change); `()` where nothing changes.
        probability: Its probability, 0 to 1.
        error: Standard error of the probability.
        written: Whether it is the effect in the file.
        like: Name of the action schema whose effect in the file it is, with its conditions, such as
            walls; empty for a change.
    """

    changes: tuple[tuple[str, float], ...]
    probability: float
    error: float
    written: bool
    like: str = ""


@dataclass(frozen=True)
class StochasticEffect:
    """An action schema with several outcomes, or with another outcome than in the file."""

    schema: str
    place: Place
    outcomes: tuple[ObservedOutcome, ...]
    samples: int
    cost: float


@dataclass(frozen=True)
class RuleFinding:
    """A line of the file on rewards or ends whose prediction differs from what was observed.

    Rewards and ends specify the task, so nothing is estimated here.

    Attributes:
        schema: Name of the action, process or event; `goal` or `metric`; empty for rewards or ends
            that no line predicts.
        place: Where it is written; None where there is no such place.
        fluent: `reward` or `terminal`.
        predicted: Steps in which the line was predicted to apply.
        correct: Number of these with the predicted reward or end.
        unpredicted: Steps in which the line applies to the observed state but was not predicted to;
            without a line, steps with an unpredicted reward or end.
        expected: Mean predicted reward of the steps counted by `predicted`; 1 for ends.
        observed: Mean observed reward of these steps, or fraction of ends; of the steps counted by
            `unpredicted` where `predicted` is 0.
    """

    schema: str
    place: Place | None
    fluent: str
    predicted: int
    correct: int
    unpredicted: int
    expected: float
    observed: float
    samples: int
    cost: float


Finding = ParameterFinding | MissingEffect | StochasticEffect | RuleFinding


@dataclass(frozen=True)
class Findings:
    """Findings about a domain file by kind, from a number of compared transitions."""

    parameters: tuple[ParameterFinding, ...] = ()
    missing: tuple[MissingEffect, ...] = ()
    stochastic: tuple[StochasticEffect, ...] = ()
    rules: tuple[RuleFinding, ...] = ()
    samples: int = 0


def symbol_of(name: str) -> str:
    """Return the symbol of a fluent's printed name: `battery` of `battery ?robot`."""
    return name.strip("() ").split(" ")[0]


def decimal(value: float, error: float) -> str:
    """Format a number up to the first uncertain digit, with at most four digits.

    A plain decimal, as every PDDL tool reads it: `0.21`, `-3`, never an exponent. The standard
    error is 0 if there is none.
    """
    if value == 0.0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    most = 3 - size
    decimals = most
    if error > 0.0 and math.isfinite(error):
        decimals = min(most, -math.floor(math.log10(error)))
    if round(value, decimals) == 0.0:  # no digit is certain: show the order of magnitude
        decimals = -size
    text = f"{round(value, decimals):.{max(0, decimals)}f}"
    if decimals == most and "." in text:
        text = text.rstrip("0").rstrip(".")
    return text
