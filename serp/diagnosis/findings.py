"""What the observed transitions say about a domain file: the words of `diagnose` and `repair`.

Everywhere `cost` is how much of the one-step prediction error a finding accounts for: by how much
it reduces the squared error of what it is about, as a share of the squared change of that. 1 is the
error of a file that says that everything stays as it is. Costs of all kinds of findings can be
compared, of fluents that move a lot and of those that hardly do, of rewards and of ends.
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
        fluents: The names of the fluents whose product it multiplies; `()` for a constant.
    """

    coefficient: float
    error: float
    fluents: tuple[str, ...]


@dataclass(frozen=True)
class ParameterFinding:
    """A literal of the file whose value the transitions speak about.

    Attributes:
        parameter: The literal, with its place.
        schema: Name of the action or process schema in which it stands.
        fluent: Symbol of the function that the effect changes.
        written: Its value in the file.
        estimate: The value that the transitions say.
        error: Standard error of the estimate.
        samples: Transitions that it rests on.
        cost: See the module.
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
    """A change that happens and that the file does not mention.

    Attributes:
        schema: Name of the action schema; empty where it happens whatever the action.
        place: Where that schema is written; None where there is none.
        fluent: Name of the fluent that changes.
        terms: The summands of the change.
        rate: Whether the terms are per unit of time and belong into a process.
        samples: Transitions that it rests on.
        cost: See the module.
    """

    schema: str
    place: Place | None
    fluent: str
    terms: tuple[EffectTerm, ...]
    rate: bool
    samples: int
    cost: float


@dataclass(frozen=True)
class ObservedOutcome:
    """One of the things that come of an action.

    Attributes:
        changes: (symbol of the fluent, its change); `()` where nothing changes.
        probability: How often it comes, 0 to 1.
        error: Standard error of the probability.
        written: Whether it is what the file says.
    """

    changes: tuple[tuple[str, float], ...]
    probability: float
    error: float
    written: bool


@dataclass(frozen=True)
class OutcomeFinding:
    """An action of which more than one thing comes, or another than the file says.

    Attributes:
        schema: Name of the action schema.
        place: Where it is written.
        outcomes: What came of it, the most frequent first.
        samples: Transitions that it rests on.
        cost: See the module.
    """

    schema: str
    place: Place
    outcomes: tuple[ObservedOutcome, ...]
    samples: int
    cost: float


@dataclass(frozen=True)
class RuleFinding:
    """A line of the file that gives reward or ends the task, otherwise than it was observed.

    What is good and what is an end is for people to say, so nothing is estimated here.

    Attributes:
        schema: Name of the action, process or event; `goal` or `metric` for these; empty for what
            no line of the file says.
        place: Where it is written; None where there is no such place.
        fluent: `reward` or `terminal`.
        predicted: Steps in which the line was predicted to apply.
        came: Of these, the steps that went as predicted.
        unpredicted: Steps in which it applies to what was observed though it was not predicted to;
            where no line says it, those in which there was reward or an end all the same.
        promised: Mean reward predicted in the steps counted by `predicted`; 1 for ends.
        observed: Mean reward observed in these steps, or share of ends; where no line says it, in
            those counted by `unpredicted`.
        samples: Transitions looked at.
        cost: See the module.
    """

    schema: str
    place: Place | None
    fluent: str
    predicted: int
    came: int
    unpredicted: int
    promised: float
    observed: float
    samples: int
    cost: float


@dataclass(frozen=True)
class Findings:
    """Everything that the transitions say about a domain file.

    Attributes:
        literals, missing, outcomes, rules: The findings by kind.
        samples: Transitions looked at.
        skipped: Transitions left out; see `serp.sysid.regression_data.Sample.left_out`.
    """

    literals: tuple[ParameterFinding, ...]
    missing: tuple[MissingEffect, ...]
    outcomes: tuple[OutcomeFinding, ...]
    rules: tuple[RuleFinding, ...]
    samples: int
    skipped: int
