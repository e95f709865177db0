"""What the page shows of the texts in a state: findings, a decision, a drawing."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from serp._util.text import plural
from serp.agent.explanation import Alternative, Explanation, explain
from serp.agent.sentences import between, special_about
from serp.authoring.lint.contradiction import limits_in
from serp.authoring.lint.findings import Finding, examine
from serp.errors import SerpError
from serp.model.domain import Domain
from serp.model.transition_model import TransitionModel, Vector
from serp.pddl.source import DomainError, Source
from serp.planning.replanner import MonitorReplanner, Plan
from serp.settings import PlannerSettings
from serp.tasks.task import Task
from serp.ui.account import best_of
from serp.ui.pictures.plan_picture import plan_svg

Ranges = Mapping[str, tuple[float, float]]
"""Fluent → the least and greatest value that was observed."""


class Version(NamedTuple):
    """Name of the file and text of a domain, and of its problem."""

    domain: tuple[str, str]
    problem: tuple[str, str] | None

    def sources(self) -> tuple[Source, Source | None]:
        """Return the domain and the problem as sources."""
        return Source(*self.domain), None if self.problem is None else Source(*self.problem)


@dataclass(frozen=True)
class Surroundings:
    """What a decision depends on beside the texts: control period, and settings of the lookahead.

    `observed`: whether any state can be shown, or only what is reached from `:init`; `supplied`:
    the names of the fluents that are observed.
    """

    dt: float = 1.0
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    observed: bool = True
    supplied: frozenset[str] = frozenset()

    def planner_of(self, domain: Domain) -> MonitorReplanner:
        """Return the lookahead of a domain, interpreted: a keystroke waits for no compiler."""
        model = TransitionModel(domain.model.ground, dt=self.dt)
        return MonitorReplanner(model, self.planner)


@functools.lru_cache(1)
def read(
    version: Version, surroundings: Surroundings
) -> tuple[tuple[Finding, ...], MonitorReplanner | None]:
    """Return what is wrong in a version, and its planner; None where an error leaves no model."""
    examined = examine(*version.sources())
    findings = tuple(examined.findings)
    domain = examined.domain
    if domain is None:
        return findings, None
    if surroundings.observed:
        try:
            observed = domain.observed(surroundings.supplied)
            observed.model  # noqa: B018  (instantiated now)
            domain = observed
        except DomainError:
            pass  # too large for any state; `domain.model` says what else is wrong
    return findings, surroundings.planner_of(domain)


@dataclass(frozen=True)
class ShownState:
    """A state by name, so that it outlives edits of the file.

    Attributes:
        values: Fluent → value, of some or all fluents.
        origin: Where they come from, for people.
    """

    values: Mapping[str, float | bool] = field(default_factory=dict)
    origin: str = ""

    def state(self, model: TransitionModel) -> Vector:
        """Return the state `[F]` of a model; what has no value here is initial, or else 0."""
        initial = model.initial_state
        state = np.zeros(len(model.fluents)) if initial is None else np.array(initial)
        for fluent in model.fluents:
            value = float(self.values.get(fluent.name, math.nan))
            if math.isfinite(value):
                state[fluent.index] = value if fluent.numeric else float(value != 0.0)
        return state


@dataclass(frozen=True)
class Control:
    """A fluent as it can be set; low, high and step are those of a slider."""

    name: str
    numeric: bool
    value: float
    low: float
    high: float
    step: float


def controls(model: TransitionModel, state: Vector, seen: Ranges) -> list[Control]:
    """Return how each fluent can be set.

    The range of a number covers what was seen of it, the numbers that conditions of the file
    compare it with, and some more.
    """
    compared: dict[int, list[float]] = {}
    for limit in limits_in(model.ground, model.theta.tolist()):
        compared.setdefault(limit.fluent, []).append(limit.number)
    settable = []
    for fluent, value in zip(model.fluents, state.tolist(), strict=True):
        known = (0.0, value, *compared.get(fluent.index, ()))
        limits = _slider(known, seen.get(fluent.name, ()))
        settable.append(Control(fluent.name, fluent.numeric, value, *limits))
    return settable


def _slider(known: Sequence[float], seen: Sequence[float]) -> tuple[float, float, float]:
    """Return low, high and step."""
    margin = 0.25  # beyond the known numbers, as a share of their range
    numbers = (*known, *seen)
    low, high = min(numbers), max(numbers)
    if seen and high - low >= 2 and all(number.is_integer() for number in numbers):
        return low, high, 1.0
    width = high - low or 1.0
    step = float(f"{width / 200:.0e}")
    low -= margin * width if low < 0 else 0.0
    high += margin * width if high > low else 1.0
    low, high = (float(f"{round(limit / step) * step:.12g}") for limit in (low, high))
    return low, high, step


@dataclass(frozen=True)
class ShownDecision:
    """A decision of the planner, the actions to show, a summary, the planning graph as SVG."""

    account: Explanation
    shown: list[Alternative]
    verdict: str
    graph: str
    controls: tuple[Control, ...]


@dataclass(frozen=True)
class View:
    """What is shown at a time: findings, a decision, the state as the task draws it, an SVG.

    `failure` says why there is no decision though the files are right; else it is empty.
    """

    findings: tuple[Finding, ...]
    failure: str = ""
    decision: ShownDecision | None = None
    drawing: str = ""


@dataclass(frozen=True)
class Request:
    """What is shown is asked of this; whatever is edited meanwhile does not change it.

    `seen` has the ranges of the fluents; `task` is None for a file alone.
    """

    version: Version
    surroundings: Surroundings
    shown: ShownState
    seen: Ranges
    task: Task | None

    def view(self) -> View:
        """Read the version and decide in the state; this may run in a thread."""
        findings: tuple[Finding, ...] = ()
        try:
            findings, planner = read(self.version, self.surroundings)
            if planner is None:
                return View(findings)
            state = self.shown.state(planner.model)
            decision = decide(planner, state, self.seen)
        except SerpError as error:
            return View(findings, str(error))
        drawing = ""
        if self.task is not None and self.task.draw is not None:
            # The task's own code, on values that no environment may ever give.
            with contextlib.suppress(Exception):
                drawing = str(self.task.draw(planner.model.values(state)))
        return View(findings, "", decision, drawing)


def decide(planner: MonitorReplanner, state: Vector, seen: Ranges) -> ShownDecision:
    """Return what is shown of the planner's decision in a state `[F]`."""
    plan, model = planner.plan(state), planner.model
    discount = planner.settings.discount
    account = explain(model, state, plan.forecast, plan.action, paths=plan.paths, discount=discount)
    shown = best_of(account, 60)
    for each in shown:
        each.as_dict()  # traced now, in this thread
    settable = tuple(controls(model, state, seen))
    return ShownDecision(account, shown, _verdict(plan, account), plan_svg(plan, planner), settable)


def _verdict(plan: Plan, account: Explanation) -> str:
    if plan.name is None:
        return "No action is applicable here."
    sentences = special_about(plan.forecast)
    if account.runner_up is not None and not plan.indifferent:
        sentences.insert(0, between(account.runner_up, plan.name))
    looked = f"Looked {plural(plan.depth, 'action')} ahead, {plural(plan.nodes, 'state')}."
    return " ".join([*sentences, looked])
