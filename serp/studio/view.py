"""What is shown of a version in a situation: the table of actions, the graph, what is wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from serp._util.text import plural
from serp.errors import SerpError
from serp.explanation.decision import Explanation, explain
from serp.explanation.sentences import between, special_about
from serp.lint.findings import Finding
from serp.model.transition_model import Vector
from serp.planning.replanner import MonitorReplanner, Plan
from serp.studio.reading import Surroundings, Version, read
from serp.studio.shown_state import Control, ShownState, controls
from serp.tasks.task import Draw
from serp.viz.plan_svg import plan_svg

_MOST_ACTIONS: Final = 60


@dataclass(frozen=True)
class DecisionView:
    """A decision of the planner.

    Attributes:
        account: The account of it.
        order: Positions of the actions that are shown: as in the file, those that are not
            applicable last; or the best first where there are too many.
        verdict: Sentences that sum it up.
        graph: The planning graph as SVG.
        controls: How the fluents of the state can be set.
    """

    account: Explanation
    order: tuple[int, ...]
    verdict: tuple[str, ...]
    graph: str
    controls: tuple[Control, ...]


@dataclass(frozen=True)
class View:
    """What is shown at a time.

    Attributes:
        findings: What is wrong in the files.
        failure: Why there is no decision though the files are right; else empty.
        decision: The decision; None where there is none.
        drawing: The state as the task draws it, an SVG; empty where it does not.
    """

    findings: tuple[Finding, ...]
    failure: str = ""
    decision: DecisionView | None = None
    drawing: str = ""


def look(
    version: Version,
    surroundings: Surroundings,
    shown: ShownState,
    seen: Mapping[str, tuple[float, float]],
    draw: Draw | None = None,
) -> View:
    """Read a version and decide in a situation.

    Args:
        version: The texts.
        surroundings: Control period and planner.
        shown: The state.
        seen: Fluent → the least and greatest value that was observed.
        draw: See `Task.draw`.
    """
    findings: tuple[Finding, ...] = ()
    try:
        reading = read(version, surroundings)
        findings = reading.findings
        if reading.planner is None:
            return View(findings)
        model = reading.planner.model
        state = shown.state(model)
        drawing = "" if draw is None else _drawn(draw, model.values(state))
        return View(findings, "", decide(reading.planner, state, seen), drawing)
    except SerpError as error:
        return View(findings, str(error))


def _drawn(draw: Draw, values: Mapping[str, float | bool]) -> str:
    """Return a drawing; empty where a fluent that it needs is gone, or it fails otherwise."""
    try:
        return str(draw(values))
    except Exception:  # a function of the task, on values that no environment may ever give
        return ""


def decide(
    planner: MonitorReplanner, state: Vector, seen: Mapping[str, tuple[float, float]]
) -> DecisionView:
    """Return what is shown of the planner's decision in a state `[F]`."""
    plan = planner.plan(state)
    discount = planner.settings.discount
    account = explain(
        planner.model, state, plan.forecast, plan.action, paths=plan.paths, discount=discount
    )
    there = plan.forecast.applicable
    order = sorted(range(len(there)), key=lambda k: not there[k])
    if len(order) > _MOST_ACTIONS:
        order.sort(key=lambda k: (k != plan.action, -plan.forecast.value[k]))
    shown = tuple(order[:_MOST_ACTIONS])
    for k in shown:
        account.alternatives[k].behind  # noqa: B018  (traced now, in this thread)
    return DecisionView(
        account,
        shown,
        tuple(_verdict(plan, account)),
        plan_svg(plan, planner),
        tuple(controls(planner.model, state, seen)),
    )


def _verdict(plan: Plan, account: Explanation) -> list[str]:
    if plan.name is None:
        return ["No action is applicable here."]
    said = special_about(plan.forecast)
    if account.runner_up is not None and not plan.indifferent:
        said.insert(0, between(account.runner_up, plan.name))
    looked = f"{plural(plan.depth, 'action')} ahead, {plural(plan.nodes, 'state')}"
    return [*said, f"Looked {looked}."]
