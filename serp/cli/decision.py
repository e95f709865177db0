"""What one decision of the planner looks like: as text for people, as JSON for programs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from serp._util.number_format import percent, readable
from serp._util.text import plural
from serp.cli.chosen_planner import ChosenPlanner
from serp.cli.output import print_table
from serp.model.explanation import unsafe_ahead, why_not_applicable, why_unsafe
from serp.model.flags import APPLICABLE, RISKY, TERMINAL, UNSAFE, risk_of
from serp.planning.forecast import SAFE, score_of
from serp.planning.limits import Bound

if TYPE_CHECKING:
    from rich.console import Console

    from serp.model.transition_model import TransitionModel, Vector
    from serp.planning.replanner import MonitorReplanner, Plan

_ACTIONS_SHOWN = 30
_FLUENTS_SHOWN = 24


def describe(
    domain: str, origin: str, planner: MonitorReplanner, state: Vector, plan: Plan
) -> dict[str, Any]:
    """Return a decision as JSON values (infinities and NaN among them)."""
    model, forecast = planner.model, plan.forecast
    actions = [
        {
            "name": action.name,
            "applicable": bool(forecast.applicable[k]),
            "unsafe": bool(forecast.unsafe[k]),
            "risk": float(forecast.risk[k]),
            "path_risk": float(forecast.path_risk[k]),
            "terminal": bool(forecast.terminal[k]),
            "reward": float(forecast.reward[k]) if forecast.applicable[k] else None,
            "best_return": float(forecast.value[k]),
            "safe_steps": None if forecast.safe_steps[k] == SAFE else int(forecast.safe_steps[k]),
            "remark": remark(planner, state, plan, k),
        }
        for k, action in enumerate(model.actions)
    ]
    return {
        "domain": domain,
        "state_from": origin,
        "state": model.values(state),
        "action": plan.name,
        "best_return": plan.reward,
        "safe": plan.safe,
        "indifferent": plan.indifferent,
        "depth": plan.depth,
        "discount": planner.settings.discount,
        "repeat": planner.settings.repeat,
        "control_period": model.dt,
        "bound": plan.bound.name.lower(),
        "nodes": plan.nodes,
        "actions": actions,
        "path": [
            {
                "action": step.action,
                "reward": step.reward,
                "unsafe": step.unsafe,
                "risk": step.risk,
                "state": model.values(step.state),
            }
            for step in plan.path
        ],
    }


def remark(planner: MonitorReplanner, state: Vector, plan: Plan, action: int) -> str:
    """Return what is to be known of a first action, in the words of the domain file."""
    model = planner.model
    name = model.actions[action].name
    flags, steps = int(plan.forecast.flags[action]), int(plan.forecast.safe_steps[action])
    if not flags & APPLICABLE:
        why = why_not_applicable(model, state, action).removeprefix(f"{name}: ")
        return f"not applicable: {why}"
    remarks = []
    if flags & UNSAFE:
        remarks.append("unsafe: " + why_unsafe(model, state, action).removeprefix(f"{name}: "))
    elif flags & RISKY:
        remarks.append("too risky: " + why_unsafe(model, state, action).removeprefix(f"{name}: "))
    else:
        if risk_of(flags):
            remarks.append(f"risk {percent(risk_of(flags))}, accepted")
        if steps != SAFE:
            remarks.append(unsafe_ahead(steps))
    if flags & TERMINAL:
        remarks.append("ends the task")
    return "; ".join(remarks)


def print_plan(
    console: Console, domain: str, origin: str, planner: MonitorReplanner, state: Vector, plan: Plan
) -> None:
    """Print a decision: the state, what each action is predicted to bring, and the best path."""
    console.print(f"{domain}, {origin}", style="bold")
    _print_state(console, planner.model, state)
    console.print("")
    _print_actions(console, planner, state, plan)
    console.print("")
    for line in verdict(planner, plan):
        console.print(line)
    if plan.path:
        console.print("")
        _print_path(console, planner, state, plan)


def verdict(planner: MonitorReplanner, plan: Plan) -> list[str]:
    """Return the sentences that sum a decision up."""
    if plan.name is None:
        if not planner.model.actions:
            return ["The domain has no ground action: there is nothing to decide."]
        return ["No action is applicable here."]
    lines = [f"Chosen: {plan.name}, best return {readable(plan.reward)}."]
    if plan.indifferent:
        lines.append(
            "All safe actions have the same best return (the planner is indifferent): what "
            "matters lies beyond what it sees. The first in the file is taken."
        )
    if not plan.safe and plan.action is not None:
        lines.append(_why_unsafe_chosen(plan, plan.action))
    if isinstance(planner, ChosenPlanner):
        return [*lines, planner.sight(plan)]
    settings = planner.settings
    each = f", each repeated for {settings.repeat} control periods" if settings.repeat > 1 else ""
    ended = {
        Bound.DEPTH: "",
        Bound.NODES: " The next layer would exceed the limits on nodes and edges.",
        Bound.TIME: " The time budget ended the lookahead there.",
        Bound.EXHAUSTED: " No state is left to expand.",
    }
    lines.append(
        f"Looked ahead {plural(plan.depth, 'action')}{each}: {plural(plan.nodes, 'state')}, "
        f"discount {settings.discount:g}.{ended[plan.bound]}"
    )
    return lines


def _why_unsafe_chosen(plan: Plan, action: int) -> str:
    forecast = plan.forecast
    steps, risk = int(forecast.safe_steps[action]), float(forecast.path_risk[action])
    if forecast.unsafe[action]:
        return "Every action is predicted unsafe. The one with the best return is taken."
    if risk < 1.0:
        where = "Every action is" if steps == 0 else "Every path leads to something"
        return f"{where} too risky. The one with the least risk, {percent(risk)}, is taken."
    return (
        "Every path leads to something unsafe. The one that stays safe the longest, for "
        f"{plural(steps, 'control period')}, is taken."
    )


def _print_state(console: Console, model: TransitionModel, state: Vector) -> None:
    numeric = [(f.name, readable(float(state[f.index]))) for f in model.fluents if f.numeric]
    true = [f.name for f in model.fluents if not f.numeric and state[f.index]]
    for name, value in numeric[:_FLUENTS_SHOWN]:
        console.print(f"  {name} = {value}")
    if len(numeric) > _FLUENTS_SHOWN:
        console.print(f"  … and {len(numeric) - _FLUENTS_SHOWN} more numbers (--json has all)")
    if true:
        console.print(f"  true: {_shortened(true)}")


def _print_actions(console: Console, planner: MonitorReplanner, state: Vector, plan: Plan) -> None:
    model, forecast = planner.model, plan.forecast
    # The best first where there are too many to show; else as in the file.
    order = list(range(len(model.actions)))
    if len(order) > _ACTIONS_SHOWN:
        order.sort(key=lambda k: score_of(forecast, k), reverse=True)
    rows, styles = [], []
    for k in order[:_ACTIONS_SHOWN]:
        numbers, style = ("–", "–"), "dim"
        if forecast.applicable[k]:
            numbers = readable(float(forecast.reward[k])), readable(float(forecast.value[k]))
            unsafe = forecast.unsafe[k] or forecast.safe_steps[k] != SAFE
            style = "red" if unsafe else "bold blue" if k == plan.action else ""
        mark = "→" if k == plan.action else ""
        rows.append((mark, model.actions[k].name, *numbers, remark(planner, state, plan, k)))
        styles.append(style)
    head = ("", "action", "reward", "best return", "remarks")
    print_table(console, head, rows, styles=styles, right=(2, 3))
    if len(order) > _ACTIONS_SHOWN:
        rest = plural(len(order) - _ACTIONS_SHOWN, "more action")
        console.print(f"  … and {rest}, no better than these (--json has all)")


def _print_path(console: Console, planner: MonitorReplanner, state: Vector, plan: Plan) -> None:
    rows, before = [], tuple(state.tolist())
    for k, step in enumerate(plan.path, 1):
        mark = " (unsafe)" if step.unsafe else f" (risk {percent(step.risk)})" if step.risk else ""
        changes = [
            f"{fluent.name} = {readable(after) if fluent.numeric else str(bool(after)).lower()}"
            for fluent, old, after in zip(planner.model.fluents, before, step.state, strict=True)
            if old != after
        ]
        rows.append((str(k), step.action + mark, readable(step.reward), _shortened(changes)))
        before = step.state
    print_table(console, ("", "best path", "reward", "what changes"), rows, right=(2,))


def _shortened(texts: list[str]) -> str:
    more = f" … and {len(texts) - _FLUENTS_SHOWN} more" if len(texts) > _FLUENTS_SHOWN else ""
    return ", ".join(texts[:_FLUENTS_SHOWN]) + more
