"""What the page shows of the texts in a state: findings, a decision, a drawing."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

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
Values = Mapping[str, float | bool]
"""Fluent → value, of some or all fluents: a state by name outlives edits of the file."""
Version = tuple[tuple[str, str], ...]
"""Name of the file and text of a domain, and of its problem if there is one."""

MOST_CHARACTERS = 1 << 19
"""Most characters that are examined while they are edited; it takes some seconds."""


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
    examined = examine(*(Source(*file) for file in version))
    findings, domain = tuple(examined.findings), examined.domain
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


def state_of(model: TransitionModel, values: Values) -> Vector:
    """Return a state `[F]`; what has no value here is initial, or else 0."""
    initial = model.initial_state
    state = np.zeros(len(model.fluents)) if initial is None else np.array(initial)
    for fluent in model.fluents:
        value = float(values.get(fluent.name, math.nan))
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
    numbers = (*known, *seen)
    low, high = min(numbers), max(numbers)
    if seen and high - low >= 2 and all(number.is_integer() for number in numbers):
        return low, high, 1.0
    width = high - low or 4.0
    step, margin = float(f"{width / 200:.0e}"), width / 4  # beyond the known numbers
    low, high = low - (margin if low < 0 else 0.0), high + margin
    low, high = (float(f"{round(limit / step) * step:.12g}") for limit in (low, high))
    return low, high, step


@dataclass(frozen=True)
class ShownDecision:
    """A decision of the planner, the actions to show, a summary, the planning graph as SVG."""

    account: Explanation
    shown: list[Alternative]
    verdict: str
    graph: str
    controls: list[Control]


@dataclass(frozen=True)
class View:
    """What is shown of a version: findings, a decision, the state as the task draws it, an SVG.

    `failure` says why there is no decision though the files are right; else it is empty.
    """

    version: Version
    findings: tuple[Finding, ...]
    failure: str = ""
    decision: ShownDecision | None = None
    drawing: str = ""


def view_of(
    version: Version, surroundings: Surroundings, values: Values, seen: Ranges, task: Task | None
) -> View:
    """Read a version and decide in a state; this may run in a thread.

    `seen` has the ranges of the fluents; `task` is None for a file alone.
    """
    findings: tuple[Finding, ...] = ()
    size = sum(len(text) for _, text in version)
    if size > MOST_CHARACTERS:
        return View(version, findings, f"This file is too large to be checked here ({size:,} of "
                    f"{MOST_CHARACTERS:,} characters). Save it, and use `serp check`.")  # fmt: skip
    try:
        findings, planner = read(version, surroundings)
        if planner is None:
            return View(version, findings)
        state = state_of(planner.model, values)
        decision = decide(planner, state, seen)
    except SerpError as error:
        return View(version, findings, str(error))
    drawing = ""
    if task is not None and task.draw is not None:
        # The task's own code, on values that no environment may ever give.
        with contextlib.suppress(Exception):
            drawing = str(task.draw(planner.model.values(state)))
    return View(version, findings, "", decision, drawing)


def decide(planner: MonitorReplanner, state: Vector, seen: Ranges) -> ShownDecision:
    """Return what is shown of the planner's decision in a state `[F]`."""
    plan, model = planner.plan(state), planner.model
    discount = planner.settings.discount
    account = explain(model, state, plan.forecast, plan.action, paths=plan.paths, discount=discount)
    shown = best_of(account, 60)
    for each in shown:
        each.as_dict()  # traced now, in this thread
    settable = controls(model, state, seen)
    return ShownDecision(account, shown, _verdict(plan, account), plan_svg(plan, planner), settable)


def _verdict(plan: Plan, account: Explanation) -> str:
    if plan.name is None:
        return "No action is applicable here."
    sentences = special_about(plan.forecast)
    if account.runner_up is not None and not plan.forecast.indifferent:
        sentences.insert(0, between(account.runner_up, plan.name))
    looked = f"Looked {plural(plan.forecast.depth, 'action')} ahead, {plural(plan.nodes, 'state')}."
    return " ".join([*sentences, looked])
