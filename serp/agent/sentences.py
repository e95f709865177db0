"""Sentences about decisions, their causes and alternatives, for people."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from serp._util.text import percent, plural, readable
from serp.agent.causes import Cause, listed_values
from serp.agent.counterfactuals import Counterfactual, Counterfactuals
from serp.agent.decision import Actor, Reason
from serp.agent.explanation import Alternative, RunnerUp, unsafe_ahead
from serp.planning.forecast import Bound, Forecast, held_back

TO_THE_UNKNOWN: Final = (
    "The planner found nothing better within reach, so it explores. Unknown states are valued "
    "optimistically."
)
"""What the bound `UNKNOWN` of a planner's sight means."""
PARTIAL: Final = (
    "The planner did not see as far as the end of the task; partial returns omit what comes later."
)
"""What a bound that is `partial` means."""


def kind_of_return(partial: bool) -> str:
    """Return what the return of an action is called; `partial` as in `Explanation`."""
    return "partial return" if partial else "best return"


def lines_of(alternative: Alternative, most: int | None = None) -> list[str]:
    """Return what is behind an alternative, now and ahead, a line for each schema of the file.

    Of more than `most` lines the last one says how many more there are.
    """
    lines = lines_of_causes((*alternative.causes, *alternative.ahead))
    if most is not None and len(lines) > most:
        lines[most:] = [f"… and {len(lines) - most} more (--json has all)"]
    if alternative.beyond:
        lines.append(f"{signed(alternative.beyond)} comes after these steps (discounted).")
    return lines


def lines_of_causes(causes: Iterable[Cause]) -> list[str]:
    """Return causes as lines, see `runs_of`."""
    return [line_of_run(run) for run in runs_of(causes)]


def runs_of(causes: Iterable[Cause]) -> list[list[list[Cause]]]:
    """Return causes in runs of control periods, those that begin first first.

    A run has, of each period in succession, what a schema brings in it, which is the same in all of
    them. The first period is a run of its own: it is what the action itself brings.
    """
    periods: dict[tuple[str, str, int], list[Cause]] = {}
    for cause in causes:
        periods.setdefault((cause.origin, cause.name, cause.after), []).append(cause)
    by_schema: dict[tuple[str, str], list[list[list[Cause]]]] = {}
    for (origin, name, after), unordered in sorted(periods.items(), key=lambda item: item[0][2]):
        brought = sorted(unordered, key=lambda cause: _ORDER.index(cause.what))
        runs = by_schema.setdefault((origin, name), [])
        before = runs[-1][-1] if runs else []
        same = [(c.what, c.text) for c in before] == [(c.what, c.text) for c in brought]
        if same and before[0].after == after - 1 > 0:
            runs[-1].append(brought)
        else:
            runs.append([brought])
    every = [run for runs in by_schema.values() for run in runs]
    return sorted(every, key=lambda run: run[0][0].after)


def between(runner_up: RunnerUp, name: str) -> str:
    """Say what is between the action taken and the best other one."""
    other = runner_up.name
    if runner_up.ahead:
        return f"Next best: {other}, {lesser(runner_up)}."
    turned = replace(runner_up, path_risks=runner_up.path_risks[::-1])
    return f"The planner ranks {other} before {name}, {lesser(turned)}."


def lesser(other: RunnerUp) -> str:
    """Say, to follow its name, why the planner prefers the action taken to another one."""
    taken, own = map(percent, other.path_risks)
    if taken == own:
        taken, own = (f"{100 * risk:.6g} %" for risk in other.path_risks)
    return {
        "order": "which is worth the same and comes later in the file",
        "value": f"whose return is smaller by {readable(abs(other.gap))} (units of reward)",
        "delay": "whose return is the same but comes later",
        "rank": "which is less safe in the next step; safety comes before return",
        "risk": f"whose path has more risk ({own} versus {taken}); risk comes before return",
        "safe steps": "whose path stays safe for fewer steps; safety comes before return",
    }[other.by]


def special_about(forecast: Forecast) -> list[str]:
    """Say what is special about the planner's choice: that all is the same, or nothing safe."""
    chosen, sentences = forecast.choice, []
    if forecast.indifferent:
        why = "what matters lies beyond its lookahead"
        if forecast.bound is Bound.EXHAUSTED:
            why = "nothing within reach makes a difference"
        sentences.append(
            "All safe actions have the same best return (the planner is indifferent): "
            f"{why}. The first in the file is taken."
        )
    if chosen >= 0 and forecast.bound.partial:
        sentences.append(PARTIAL)
    if needed := held_back(forecast):
        sentences.append(
            "A more valuable action is excluded because of its risk; "
            f"planner.accepted_risk={readable(needed)} would allow it."
        )
    if chosen < 0 or forecast.safe:
        return sentences
    steps, risk = int(forecast.safe_steps[chosen]), float(forecast.path_risk[chosen])
    if forecast.unsafe[chosen]:
        sentences.append("Every action is predicted unsafe. The best return decides.")
    elif risk < 1.0:
        where = "Every action is" if steps == 0 else "Every path leads to something"
        sentences.append(
            f"{where} too risky. The planner takes the best path whose risk exceeds the least by "
            f"at most planner.accepted_risk. Its risk is {percent(risk)}."
        )
    else:
        sentences.append(
            "Every path leads to something unsafe. The planner takes the path that stays safe the "
            f"longest: {plural(steps, 'control period')}."
        )
    return sentences


def who_decided(
    reason: Reason,
    proposed: tuple[str, Actor],
    executed: tuple[str, Actor],
    *,
    rho: float,
    indifferent: bool,
    bound: Bound,
    why: str,
) -> list[str]:
    """Say who decided and why, and what the planner's values leave out, or take of the unknown.

    `proposed` and `executed` are names of actions and whose they are; the former is empty for no
    proposal. ρ is NaN if it need not be told. `why` follows a refusal, see `why_refused`.
    """
    of_all = (Reason.NO_SAFE_ACTION, Reason.LEAST_RISK, Reason.NO_APPLICABLE_ACTION)
    (proposal, proposer), (action, actor) = proposed, executed
    who = "Random exploration" if proposer is Actor.EXPLORATION else f"The {proposer}"
    if reason in (Reason.PLANNER_TURN, Reason.LITTLE_TRIED):
        rarely = ", because it had rarely been tried" if reason is Reason.LITTLE_TRIED else ""
        lines = [f"It was the planner's turn: {action} was executed{rarely}."]
    elif reason is Reason.ACCEPTED:
        lead = "" if math.isnan(rho) else f" (ρ = {readable(rho)})"
        if indifferent:
            lead = ", because all plans had the same value for the planner"
        lines = [f"{who} chose {action}{lead}, without a veto."]
    else:
        lines = [f"{who} proposed {proposal}."] if proposal else []
        if reason in of_all and why and proposal:  # what is behind it is its alone
            why = f"; {proposal}{why}"
        problem = str(reason).capitalize() if reason in of_all else f"Refused: {reason}"
        lines.append(f"{problem}{why}.")
        whose = {Actor.PLANNER: "the planner's choice", Actor.FALLBACK: "as the least bad"}
        lines.append(
            f"{action} was executed instead, {whose.get(actor, 'as proposed')}."
            if action != proposal
            else f"{action} was executed anyway, because nothing better was available."
        )
    if bound is Bound.UNKNOWN:
        lines.append(TO_THE_UNKNOWN)
    return [*lines, PARTIAL] if bound.partial else lines


def why_refused(
    reason: Reason, causes: Iterable[Cause], reward: float | None, safe_steps: int | None
) -> str:
    """Return what of the file is behind a refusal, to follow the sentence about its reason.

    `causes`, `reward` and `safe_steps` are those of the proposed action, as in `Alternative`.
    """
    wanted = ("unsafe", "risk", "failed", "conflict", "undefined")
    for cause in causes:
        if cause.what in wanted:
            text = line_of_run([[cause]]).rstrip(".")
            known = ("unsafe", "not applicable", "no defined result")
            shorter = [text.removeprefix(begin) for begin in known if text.startswith(begin)]
            return shorter[0] if shorter else f": {text}"
    if reason is Reason.LOW_REWARD:
        return f": it is {readable(reward)}"
    if reason is Reason.FEW_WAYS_ON:
        return " beyond the lookahead; another action leaves more"
    return "" if safe_steps is None else f": {unsafe_ahead(safe_steps)}"


def lines_of_changes(found: Counterfactuals, outcome: str = "") -> list[str]:
    """Say with which changes the outcome is another one: by default another choice."""
    lines = [
        f"{_change(change)}, {outcome or f'the planner would have chosen {change.outcome}'}."
        for change in found.changes[:3]
    ]
    other = outcome or "the planner would have chosen otherwise"
    return lines or [f"No change in a single fluent was found for which {other}."]


def _change(change: Counterfactual) -> str:
    """Return the condition of a change: `With x at least 0.31 instead of 0.28`."""
    if isinstance(change.becomes, bool):
        return f"If {change.fluent} were {readable(change.becomes)}"
    now, then = readable(float(change.value)), readable(change.becomes)
    if float(change.value).is_integer() and change.becomes.is_integer():
        return f"With {change.fluent} = {then} instead of {now}"
    side = "at least" if change.becomes > change.value else "at most"
    return f"With {change.fluent} {side} {then} instead of {now}"


def line_of_run(run: Sequence[Sequence[Cause]]) -> str:
    """Return the line of what a schema brings in some control periods in succession."""
    causes, after = run[0], run[0][0].after
    when = f"{plural(after, 'step')} later: " if after else ""
    if len(run) > 1:
        last = after + len(run) - 1
        when = f"{after} to {last} steps later: " if after else f"in the next {last + 1} steps: "
    amounts = [
        None if cause.amount is None else sum(period[k].amount or 0.0 for period in run)
        for k, cause in enumerate(causes)
    ]
    brought = ", ".join(map(_what, causes, amounts))
    first = causes[0]
    by = f" by {first.schema}" if first.what in _BROUGHT else ""
    if first.origin == "learned":
        by = " on average over the learned outcomes"
    elif first.origin == "chance":
        by = " by its other outcomes"
    return f"{when}{brought}{by}{_where(causes)}"


_BROUGHT: Final = ("reward", "unsafe", "risk", "end")
_ORDER: Final = (*_BROUGHT, "failed", "conflict", "undefined")


def _what(cause: Cause, amount: float | None) -> str:
    match cause.what:
        case "reward":
            return signed(amount)
        case "unsafe":
            return "unsafe"
        case "risk":
            return f"a {percent(amount or 0.0)} risk of being unsafe"
        case "end":
            return "the end of the task"
        case "failed":
            return f"not applicable: {cause.failure(located=False)}"
        case _:
            return f"no defined result: {cause.failure(located=False)}"


def _where(causes: Sequence[Cause]) -> str:
    """Return comment, place, and the values that were read."""
    comments = dict.fromkeys(cause.comment.strip(". ") for cause in causes if cause.comment)
    text = "".join(f": {comment}" for comment in comments)
    first = causes[0]
    if first.place is None:
        return f"{text}."
    details = [f"{Path(first.place.file).name}:{first.place.line}"]
    if first.what in _BROUGHT:
        details[0] += "".join(f" `{text}`" for text in dict.fromkeys(c.text for c in causes))
        reads = {name: value for cause in causes for name, value in cause.reads.items()}
        if reads:
            details.append(listed_values(reads))
    return f"{text}. [{'; '.join(details)}]"


def signed(amount: float | None) -> str:
    """Return an amount with its sign: `+0.5`, `−1`."""
    text = readable(amount)
    return text if text.startswith(("−", "–")) else f"+{text}"
