"""The account of a decision as tables and sentences."""

from __future__ import annotations

import math
from typing import Any

from serp._util.text import percent, plural, readable
from serp.agent.chosen_planner import ChosenPlanner
from serp.agent.explanation import Alternative, Explanation
from serp.agent.sentences import between, kind_of_return, lines_of, special_about
from serp.planning.replanner import Plan
from serp.ui.output import changes_between, print_table, show


def describe(planner: ChosenPlanner, account: Explanation, plan: Plan) -> dict[str, Any]:
    """Return a plan as JSON values (infinities and NaN among them)."""
    steps = [{**step._asdict(), "state": planner.model.values(step.state)} for step in plan.path]
    return {
        "account": account.as_dict(),
        "action": plan.name,
        "best_return": plan.reward,
        "safe": plan.safe,
        "indifferent": plan.forecast.indifferent,
        "depth": plan.forecast.depth,
        "discount": planner.settings.discount,
        "control_period": planner.model.dt,
        "bound": plan.forecast.bound.name.lower(),
        "nodes": plan.nodes,
        "path": steps,
    }


def print_plan(title: str, planner: ChosenPlanner, account: Explanation, plan: Plan) -> None:
    """Print a decision: the state, what each action is predicted to bring, and the best path."""
    show(title, style="bold")
    print_explanation(account, _verdict(planner, plan))
    if plan.path:
        show()
        _print_path(planner, account, plan)


def print_explanation(account: Explanation, verdict: list[str], refused: str = "") -> None:
    """Print the state, the alternatives, a verdict, and what is behind the main alternatives.

    `refused` is the name of a proposal that was refused.
    """
    _print_state(account)
    show()
    _print_alternatives(account, refused)
    show()
    for line in verdict:
        show(line)
    taken, other = account.taken, account.runner_up
    if taken is None:
        return
    _print_causes(taken)
    shown = {taken.name, "" if other is None else other.name}
    for alternative in account.alternatives:
        if alternative.name == refused and refused not in shown:
            _print_causes(alternative)
    if other is not None:
        show(between(other, taken.name))
        _print_causes(account.alternatives[other.action])


def _verdict(planner: ChosenPlanner, plan: Plan) -> list[str]:
    if plan.name is None:
        return ["No action is applicable here."]
    kind = kind_of_return(plan.forecast.bound.partial)
    lines = [f"Chosen: {plan.name}, {kind} {readable(plan.reward)}."]
    return [*lines, *special_about(plan.forecast), planner.sight(plan)]


def _print_state(account: Explanation) -> None:
    state = account.state
    numbers = [(name, value) for name, value in state.items() if not isinstance(value, bool)]
    true = [name for name, value in state.items() if value is True]
    for name, value in numbers[:24]:
        show(f"  {name} = {readable(value)}")
    if len(numbers) > 24:
        show(f"  … and {len(numbers) - 24} more numbers (--json has all)")
    if true:
        show(f"  true: {_shortened(true)}")


def _print_alternatives(account: Explanation, refused: str) -> None:
    shown = best_of(account, 30)
    rows, styles = [], []
    for each in shown:
        numbers, style, taken = ("–", "–"), "dim", each.action == account.chosen
        if each.applicable:
            numbers = readable(each.reward), readable(each.best_return)
            unsafe = each.unsafe or each.safe_steps is not None
            style = "red" if unsafe else "bold blue" if taken else ""
        mark = "→" if taken else "✗" if each.name == refused else ""
        rows.append((mark, each.name, *numbers, each.remark))
        styles.append(style)
    head = ("", "action", "reward", kind_of_return(account.partial), "remarks")
    print_table(head, rows, styles=styles, right=(2, 3))
    if rest := len(account.alternatives) - len(shown):
        more = plural(rest, "more action")
        show(f"  … and {more}, no better than these (--json has all)")


def best_of(account: Explanation, most: int) -> list[Alternative]:
    """Return the actions as in the file or, where there are too many, the best ones first."""

    def score(of: Alternative) -> tuple[float, ...]:
        steps = math.inf if of.safe_steps is None else of.safe_steps
        return (of.applicable, not of.unsafe, -of.path_risk, steps, of.best_return)

    shown = list(account.alternatives)
    return sorted(shown, key=score, reverse=True)[:most] if len(shown) > most else shown


def _print_causes(alternative: Alternative) -> None:
    if lines := lines_of(alternative, most=12):
        show(f"Predicted for {alternative.name}:")
    for line in lines:
        show(f"  {line}")


def _print_path(planner: ChosenPlanner, account: Explanation, plan: Plan) -> None:
    rows, before = [], tuple(map(float, account.state.values()))
    for k, step in enumerate(plan.path):
        mark = " (unsafe)" if step.unsafe else f" (risk {percent(step.risk)})" if step.risk else ""
        changes = changes_between(planner.model, before, step.state)
        rows.append((str(k), step.action + mark, readable(step.reward), _shortened(changes)))
        before = step.state
    print_table(("", "best path", "reward", "what changes"), rows, right=(2,))


def _shortened(texts: list[str]) -> str:
    more = f" … and {len(texts) - 24} more" if len(texts) > 24 else ""
    return ", ".join(texts[:24]) + more
