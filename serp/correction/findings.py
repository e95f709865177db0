"""What the observed transitions say about a domain file: the words of `diagnose` and `repair`.

Everywhere `cost` is how much of the one-step prediction error a finding accounts for: the
reduction of the summed squared error, each fluent in units of its observed range, per step. Costs
of all kinds of findings can therefore be compared.
"""

from __future__ import annotations

from dataclasses import dataclass

from serp.domain.ground import Parameter
from serp.domain.source import Place


@dataclass(frozen=True)
class Term:
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
class LiteralFinding:
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
    terms: tuple[Term, ...]
    rate: bool
    samples: int
    cost: float


@dataclass(frozen=True)
class Outcome:
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
    outcomes: tuple[Outcome, ...]
    samples: int
    cost: float


@dataclass(frozen=True)
class FluentFit:
    """How well one fluent is predicted one step ahead, after one ground action.

    Attributes:
        action: Name of the ground action.
        fluent: Name of the fluent.
        rmse_written: Root mean squared error of the file as written.
        rmse_estimated: The same with all findings taken into account.
        scale: Observed range of the fluent.
        samples: Transitions that it rests on.
    """

    action: str
    fluent: str
    rmse_written: float
    rmse_estimated: float
    scale: float
    samples: int


@dataclass(frozen=True)
class Findings:
    """Everything that the transitions say about a domain file.

    Attributes:
        literals, missing, outcomes, fits: The findings by kind.
        samples: Transitions looked at.
        skipped: Transitions left out: not finite, or not applicable by the file.
    """

    literals: tuple[LiteralFinding, ...]
    missing: tuple[MissingEffect, ...]
    outcomes: tuple[OutcomeFinding, ...]
    fits: tuple[FluentFit, ...]
    samples: int
    skipped: int
