"""Findings about a domain file from observed transitions: records of `diagnose` and `repair`.

`samples` is the number of transitions that a finding is based on. `cost` is the fraction of the
one-step prediction error that it accounts for: the reduction of the squared error of its quantity,
divided by the squared change of that quantity. A file that predicts no change has an error of 1.
Costs are comparable across kinds of findings and across fluents, rewards and ends of any scale.
"""

from __future__ import annotations

from dataclasses import dataclass

from serp.model.ground import Parameter
from serp.pddl.source import Place


@dataclass(frozen=True)
class EffectTerm:
    """One summand of an effect that the file does not mention.

    Attributes:
        coefficient: Estimate, in the units of the fluents.
        error: Its standard error.
        fluents: Names of the fluents whose product it multiplies; `()` for a constant.
    """

    coefficient: float
    error: float
    fluents: tuple[str, ...]


@dataclass(frozen=True)
class ParameterFinding:
    """An estimate of a parameter: a number that the file writes in an effect or a rate.

    Attributes:
        parameter: The parameter, with its place.
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


@dataclass(frozen=True)
class MissingEffect:
    """A change that was observed and that the file does not mention.

    Attributes:
        schema: Name of the action schema; empty for a change under every action.
        place: Where that schema is written; None where there is none.
        fluent: Name of the fluent that changes.
        terms: The summands of the change.
    """

    schema: str
    place: Place | None
    fluent: str
    terms: tuple[EffectTerm, ...]
    samples: int
    cost: float

    @property
    def rate(self) -> bool:
        """Whether the terms are per unit of time and belong in a process."""
        return not self.schema


@dataclass(frozen=True)
class ObservedOutcome:
    """One outcome of a stochastic effect.

    Attributes:
        changes: (symbol of the fluent, its change); `()` where nothing changes.
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
    """An action with several outcomes, or with another outcome than in the file.

    Attributes:
        schema: Name of the action schema.
        place: Where it is written.
        outcomes: Its outcomes, the most frequent first.
    """

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
        came: Number of these with the predicted reward or end.
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
    came: int
    unpredicted: int
    expected: float
    observed: float
    samples: int
    cost: float


Finding = ParameterFinding | MissingEffect | StochasticEffect | RuleFinding


@dataclass(frozen=True)
class Findings:
    """All findings about a domain file.

    Attributes:
        parameters, missing, stochastic, rules: The findings by kind.
        samples: Transitions compared.
    """

    parameters: tuple[ParameterFinding, ...] = ()
    missing: tuple[MissingEffect, ...] = ()
    stochastic: tuple[StochasticEffect, ...] = ()
    rules: tuple[RuleFinding, ...] = ()
    samples: int = 0


def symbol_of(name: str) -> str:
    """Return the symbol of a fluent's printed name: `battery` of `battery ?robot`."""
    return name.strip("() ").split(" ")[0]
