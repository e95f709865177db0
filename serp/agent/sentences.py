"""Sentences about causes and alternatives, for people."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from serp._util.text import percent, plural, readable
from serp.agent.causes import Cause, listed_values
from serp.agent.counterfactuals import Counterfactual, Counterfactuals
from serp.agent.explanation import Alternative, RunnerUp
from serp.planning.edges import Bound
from serp.planning.forecast import Forecast

TO_THE_UNKNOWN: Final = (
    "The planner found nothing better within reach, so it explores. Unknown states are valued "
    "optimistically."
)
"""What the bound `UNKNOWN` of a planner's sight means."""
PARTIAL: Final = (
    "The planner did not see to the end of the task: a partial return omits what comes later."
)
"""What a bound that is `partial` means."""


def kind_of_return(partial: bool) -> str:
    """Return what the return of an action is called; `partial` as in `Explanation`."""
    return "partial return" if partial else "best return"


def line_of_cause(cause: Cause) -> str:
    """Return a cause as a line."""
    return _line([[cause]])


def lines_of(alternative: Alternative) -> list[str]:
    """Return what is behind an alternative, now and ahead, a line for each schema of the file."""
    return [
        *lines_of_causes((*alternative.causes, *alternative.ahead)),
        *beyond_of(alternative),
    ]


def beyond_of(alternative: Alternative) -> list[str]:
    """Return the line about what of a best return is not listed, if there is anything."""
    beyond = alternative.beyond
    return [f"{_signed(beyond)} estimated after these steps, discounted."] if beyond else []


def lines_of_causes(causes: Iterable[Cause]) -> list[str]:
    """Return causes as lines.

    What a schema brings in one control period is one line, and so is what it brings in several
    periods in succession.
    """
    by_schema: dict[tuple[str, str], dict[int, list[Cause]]] = {}
    for cause in causes:
        periods = by_schema.setdefault((cause.origin, cause.name), {})
        periods.setdefault(cause.after, []).append(cause)
    runs = [run for periods in by_schema.values() for run in _runs(periods)]
    return [_line(run) for run in sorted(runs, key=lambda run: run[0][0].after)]


def between(runner_up: RunnerUp, name: str) -> str:
    """Say what is between the action taken and the best other one."""
    other = runner_up.name
    if runner_up.ahead:
        return f"Next best: {other}, {lesser(runner_up)}."
    if runner_up.by == "order":
        return f"To the planner {other} is worth the same and comes first in the file."
    better = {
        "value": f"its return is larger by {readable(abs(runner_up.gap))}",
        "delay": "it is worth as much, and does not put that off",
        "rank": "it is safer one step ahead",
        "risk": f"its path has less risk{_risks(runner_up)}",
        "safe steps": "its path stays safe for longer",
    }[runner_up.by]
    return f"By the planner's values {other} comes before {name}: {better}."


def lesser(other: RunnerUp) -> str:
    """Say, to follow its name, why the planner prefers the action taken to another one."""
    return {
        "order": "which is worth the same and comes later in the file",
        "value": f"whose return is smaller by {readable(abs(other.gap))} (units of reward)",
        "delay": "which is worth as much, but puts that off",
        "rank": "which is less safe one step ahead, whatever it gains",
        "risk": f"whose path has more risk{_risks(other)}, whatever it gains",
        "safe steps": "whose path stays safe for less long, whatever it gains",
    }[other.by]


def _risks(other: RunnerUp) -> str:
    taken, own = map(percent, other.path_risks)
    return f" ({own} against {taken})"


def special_about(forecast: Forecast) -> list[str]:
    """Say what is special about the planner's choice: that all is the same, or nothing safe."""
    chosen, sentences = forecast.choice, []
    if forecast.indifferent:
        why = "what matters lies beyond its lookahead"
        if forecast.bound is Bound.EXHAUSTED:
            why = "nothing that can be reached makes a difference"
        sentences.append(
            "All safe actions have the same best return (the planner is indifferent): "
            f"{why}. The first in the file is taken."
        )
    if chosen >= 0 and forecast.bound.partial:
        sentences.append(PARTIAL)
    if chosen < 0 or forecast.safe:
        return sentences
    steps, risk = int(forecast.safe_steps[chosen]), float(forecast.path_risk[chosen])
    if forecast.unsafe[chosen]:
        sentences.append("Every action is predicted unsafe. The one with the best return is taken.")
    elif risk < 1.0:
        where = "Every action is" if steps == 0 else "Every path leads to something"
        sentences.append(
            f"{where} too risky. The best path whose risk is the least one, up to the accepted "
            f"difference, is taken: {percent(risk)}."
        )
    else:
        sentences.append(
            "Every path leads to something unsafe. The one that stays safe the longest, for "
            f"{plural(steps, 'control period')}, is taken."
        )
    return sentences


def lines_of_changes(found: Counterfactuals, outcome: str = "") -> list[str]:
    """Say with which changes the outcome is another one: by default another choice."""
    lines = [
        f"{_change(change)}, {outcome or f'the planner would have chosen {change.outcome}'}."
        for change in found.changes[:_CHANGES_SHOWN]
    ]
    other = outcome or "the planner would have chosen otherwise"
    return lines or [f"No change of a single fluent was found with which {other}."]


def _change(change: Counterfactual) -> str:
    """Return the condition of a change: `With x at least 0.31 instead of 0.28`."""
    if isinstance(change.becomes, bool):
        return f"If {change.fluent} were {str(change.becomes).lower()}"
    now, then = readable(float(change.value)), readable(change.becomes)
    if float(change.value).is_integer() and change.becomes.is_integer():
        return f"With {change.fluent} = {then} instead of {now}"
    side = "at least" if change.becomes > change.value else "at most"
    return f"With {change.fluent} {side} {then} instead of {now}"


def _runs(periods: dict[int, list[Cause]]) -> list[list[list[Cause]]]:
    """Return the causes of a schema in runs of control periods in succession with the same ones.

    The first period is a run of its own: it is what the action itself brings.
    """
    runs: list[list[list[Cause]]] = []
    for after, unordered in sorted(periods.items()):
        causes = sorted(unordered, key=lambda cause: _ORDER.index(cause.what))
        before = runs[-1][-1] if runs else []
        same = [(c.what, c.text) for c in before] == [(c.what, c.text) for c in causes]
        if same and before[0].after == after - 1 > 0:
            runs[-1].append(causes)
        else:
            runs.append([causes])
    return runs


def _line(run: Sequence[Sequence[Cause]]) -> str:
    """Return the line of what a schema brings in some control periods in succession."""
    causes, after = run[0], run[0][0].after
    when = f"in step {after + 1}: " if after else ""
    if len(run) > 1:
        when = f"in steps {after + 1} to {after + len(run)}: "
    amounts = [
        None if cause.amount is None else sum(period[k].amount or 0.0 for period in run)
        for k, cause in enumerate(causes)
    ]
    brought = ", ".join(map(_what, causes, amounts))
    first = causes[0]
    by = f" by {first.schema}" if first.what in _BROUGHT else ""
    if first.origin == "learned":
        by = " by what the run has learned"
    return f"{when}{brought}{by}{_where(causes)}"


_CHANGES_SHOWN: Final = 3
_BROUGHT: Final = ("reward", "unsafe", "risk", "end")
_ORDER: Final = (*_BROUGHT, "failed", "conflict", "undefined")


def _what(cause: Cause, amount: float | None) -> str:
    match cause.what:
        case "reward":
            return _signed(amount)
        case "unsafe":
            return "unsafe"
        case "risk":
            return f"a risk of {percent(amount or 0.0)} to be unsafe"
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


def _signed(amount: float | None) -> str:
    text = readable(amount)
    return text if text.startswith(("−", "–")) else f"+{text}"
