"""Findings about a domain file from observed transitions, and how a sentence or a file says them.

`samples` is the number of transitions that a finding is based on. `cost` is the fraction of the
one-step prediction error that it accounts for: the reduction of the squared error of its quantity,
divided by the squared change of that quantity. Costs are comparable across kinds of findings and
across fluents, rewards and ends of any scale.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

from serp._util.text import measured, percent_measured, plain, plural, readable
from serp.model.ground_model import GroundModel, Parameter
from serp.model.learned.robust_regression import CERTAIN
from serp.pddl.source import Place
from serp.pddl.syntax import TERMINAL


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


class _OfFluent:
    """A finding on one fluent, function, the reward or the end."""

    fluent: str

    @property
    def symbols(self) -> set[str]:
        """The symbol of the fluent or function; `reward` or `terminal`."""
        return {symbol_of(self.fluent)}


@dataclass(frozen=True)
class ParameterFinding(_OfFluent):
    """An estimate of a number that the file writes in an effect or a rate of a schema.

    `fluent` is the function that it changes, `error` the standard error of the estimate.
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
    def place(self) -> Place:
        """Where the number is written."""
        return self.parameter.place

    @property
    def number(self) -> str:
        """What the file should have; 0 where the estimate has an uncertain sign and turned."""
        turned = self.estimate * self.written < 0.0
        if turned and abs(self.estimate) <= CERTAIN * self.error:
            return "0"
        return decimal(self.estimate, self.error)

    def sentence(self, ground: GroundModel) -> str:
        """Return what to write, and what was observed."""
        return (
            f"{_where(self)}: write {self.number} instead of {self.place.text} for "
            f"`({self.fluent})`; observed {measured(self.estimate, self.error)} in "
            f"{plural(self.samples, 'step')}"
        )


@dataclass(frozen=True)
class MissingEffect(_OfFluent):
    """An observed change that the file does not mention, of a fluent such as `battery ?robot`."""

    schema: str  # of the action; empty for a change per unit of time under every action
    place: Place | None  # of the schema
    fluent: str
    terms: tuple[EffectTerm, ...]  # the summands of the change
    samples: int
    cost: float

    def effect(self, term: EffectTerm) -> str:
        """Return the effect of one term in PDDL."""
        value = term.size if self.schema else f"(* #t {term.size})"
        return f"({'decrease' if term.coefficient < 0 else 'increase'} ({self.fluent}) {value})"

    def sentence(self, ground: GroundModel) -> str:
        """Return what to add."""
        effects = " ".join(map(self.effect, self.terms))
        how = f"{_where(self)}: add" if self.schema else "after every action: add a process with"
        return f"{how} `{effects}`; observed in {plural(self.samples, 'step')}"


@dataclass(frozen=True)
class ObservedOutcome:
    """One outcome of a stochastic effect, with its probability and its standard error.

    `like` is the action schema whose effect in the file it is, with its conditions, such as walls.
    """

    changes: tuple[tuple[str, float], ...]  # (name of the fluent, its change)
    probability: float
    error: float
    written: bool  # whether it is the effect in the file
    like: str = ""  # empty for a change

    def text(self, predicates: set[str]) -> str:
        """Return the changes as a part of a sentence."""
        if not self.changes:
            return "nothing changes"
        return " and ".join(
            f"({fluent}) becomes {'true' if change > 0 else 'false'}"
            if symbol_of(fluent) in predicates
            else f"({fluent}) {'+' if change > 0 else '−'}{plain(abs(change))}"
            for fluent, change in self.changes
        )


@dataclass(frozen=True)
class StochasticEffect:
    """An action schema with several outcomes, or with another outcome than in the file."""

    schema: str
    place: Place
    outcomes: tuple[ObservedOutcome, ...]
    samples: int
    cost: float

    @property
    def symbols(self) -> set[str]:
        """The symbols of all fluents that change."""
        return {symbol_of(name) for outcome in self.outcomes for name, _ in outcome.changes}

    def sentence(self, ground: GroundModel) -> str:
        """Return what happens, and how often."""
        return f"{_where(self)}: {self.observation(ground)}"

    def observation(self, ground: GroundModel) -> str:
        """Return the observed outcomes as a part of a sentence."""
        predicates = {f.symbol for f in ground.fluents if not f.numeric}
        written = [o for o in self.outcomes if o.written]
        steps = plural(self.samples, "step")
        text = f"never does what the file says, in {steps}"
        if written:
            share = percent_measured(sum(o.probability for o in written), written[0].error)
            own = written[0].text(predicates)
            text = f"does what the file says ({own}) in {share} of {steps}"
        instead = ", ".join(
            f"{o.text(predicates)} in {percent_measured(o.probability, o.error)}"
            for o in self.outcomes
            if not o.written
        )
        return f"{text}; instead {instead}" if instead else text


@dataclass(frozen=True)
class RuleFinding(_OfFluent):
    """A line of the file on rewards or ends whose prediction differs from what was observed.

    Rewards and ends specify the task, so nothing is estimated here.

    Attributes:
        schema: Name of the action, process or event; `goal` or `metric`; empty for rewards or ends
            that no line predicts.
        unpredicted: Steps in which the line applies to the observed state but was not predicted to;
            without a line, steps with an unpredicted reward or end.
        expected: Mean predicted reward of the steps counted by `predicted`; 1 for ends.
        observed: Mean observed reward of these steps, or fraction of ends; of the steps counted by
            `unpredicted` where `predicted` is 0.
    """

    schema: str
    place: Place | None
    fluent: str  # `reward` or `terminal`
    predicted: int  # steps in which the line was predicted to apply
    correct: int  # of these with the predicted reward or end
    unpredicted: int
    expected: float
    observed: float
    samples: int
    cost: float

    def sentence(self, ground: GroundModel) -> str:
        """Return which line differs, and how."""
        where = _where(self)
        if self.place is not None:
            where += f": `{self.place.text}`"
        return f"{where}, {self.observation(ground)}" if where else self.observation(ground)

    def observation(self, ground: GroundModel) -> str:
        """Return what was observed of the line, as a part of a sentence."""
        ends, unpredicted = self.fluent == TERMINAL, plural(self.unpredicted, "step")
        observed = readable(self.observed)
        if not self.schema:
            if ends:
                return f"in {unpredicted} the task ended although no line predicted an end"
            return f"no line predicted the reward in {unpredicted} ({observed} on average)"
        if not self.predicted:
            reward = "" if ends else f", with reward {observed} on average"
            return f"never predicted; this line took effect in {unpredicted}{reward}"
        text = f"predicted in {plural(self.predicted, 'step')}"
        if ends:
            text += f"; the task ended in {self.correct:,} of them"
        else:
            text += f": predicted mean reward {readable(self.expected)}, observed {observed}"
            text += f"; {self.correct:,} of {plural(self.predicted, 'step')} matched"
        return text + (f"; observed but not predicted in {unpredicted}" if self.unpredicted else "")


Finding = ParameterFinding | MissingEffect | StochasticEffect | RuleFinding


@dataclass(frozen=True)
class Findings:
    """Findings about a domain file by kind."""

    parameters: tuple[ParameterFinding, ...] = ()
    missing: tuple[MissingEffect, ...] = ()
    stochastic: tuple[StochasticEffect, ...] = ()
    rules: tuple[RuleFinding, ...] = ()

    @classmethod
    def of(cls, finding: Finding) -> Self:
        """Return a single finding as findings."""
        match finding:
            case ParameterFinding():
                return cls(parameters=(finding,))
            case MissingEffect():
                return cls(missing=(finding,))
            case StochasticEffect():
                return cls(stochastic=(finding,))
        return cls(rules=(finding,))


def _where(finding: Finding) -> str:
    where, place = f"`{finding.schema}`" if finding.schema else "", finding.place
    if place is not None:
        file = "problem, " if place.source.name.endswith("problem.pddl") else ""
        where += f", {file}line {place.line}"
    return where


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
