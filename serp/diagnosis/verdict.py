"""Sentences on the accuracy of a file, and on what the findings do not explain."""

from __future__ import annotations

from collections.abc import Sequence

from serp._util.number_format import number, percent
from serp.diagnosis.accuracy import WELL, Quantity
from serp.sysid.monitor import END, REWARD

_EXACT = 1e-9


def verdict(quantities: Sequence[Quantity], found: bool) -> str:
    """Return a sentence on the accuracy of a file one step ahead.

    Args:
        quantities: All quantities that change or are predicted to. A file predicts well if the
            error of each is at most 10 % of its change.
        found: Whether any finding is worth mentioning.
    """
    if not quantities:
        return "Nothing changed in these steps, as predicted; they show nothing more of the file."
    well = [q for q in quantities if q.off <= WELL]
    worst = max(quantities, key=lambda q: q.off)
    if len(well) == len(quantities):
        error = "one step ahead it is exact"
        if worst.off > _EXACT:
            error = f"one step ahead every error is at most {percent(worst.off, 2)} of the change"
            error += f", that of {worst.shown}"
        rest = "The findings below would improve it." if found else "Nothing more was found."
        return f"The file predicts well: {error}. {rest}"
    counted = f"{len(well)} of {len(quantities)}"
    listed = "no improvement was found"
    if found:
        chance = ", apart from chance," if any(q.squared_chance for q in quantities) else ""
        better = sum(q.unexplained <= WELL for q in quantities)
        listed = f"with the findings below{chance} {better} of {len(quantities)}"
    return (
        f"One step ahead the file as written predicts {counted} ({_names(quantities)}) to within "
        f"{percent(WELL, 2)} of the change; {listed}. The largest error is "
        f"{percent(worst.off, 2)} of the change, that of {worst.shown}."
    )


def unexplained(quantities: Sequence[Quantity]) -> list[str]:
    """Return a sentence for each unexplained quantity, the worst first.

    A quantity is explained if the patched file predicts it to within 10 % of its change, apart
    from the expected error of the stochastic effects found.
    """
    rest = sorted((q for q in quantities if q.unexplained > WELL), key=lambda q: -q.unexplained)
    return [_sentence(quantity) for quantity in rest]


def _sentence(q: Quantity) -> str:
    differs = abs(q.squared_left - q.squared) > 0.01 * q.squared
    listed = f"; with the findings {percent(q.off_left, 2)}" if differs else ""
    mostly = f"; most of it after `{q.action}`" if q.most > 0.5 and q.squared else ""
    if q.name == END:
        return _end(q) + listed
    steps = f"of {q.steps:,} steps"
    if not q.numeric:
        changes = f"{q.shown} changes {q.change:,.0f} times in {q.steps:,} steps"
        if not q.written:
            return f"{changes}, and nothing in the file says so{listed}{mostly}"
        wrong = f"{q.said:,} changes were predicted, {q.right:,} of them correctly"
        wrong += f" (wrong {percent(q.off, 2)} as often as it changes)"
        return f"{changes}; {wrong}{listed}{mostly}"
    if q.name == REWARD:
        changes = f"the reward is {number(q.change)} a step"
    else:
        changes = f"{q.shown} changes by {number(q.change)} a step"
    if not q.change:
        what = "the reward is 0" if q.name == REWARD else f"{q.shown} does not change"
        return f"{what} in all {steps[3:]}, though the file predicts that it does{listed}{mostly}"
    if not q.written:
        return f"{changes}, and nothing in the file says so{listed}{mostly}"
    error = number(q.change * q.off)
    return f"{changes}, the error of the file is {error} ({percent(q.off, 2)}){listed}{mostly}"


def _end(q: Quantity) -> str:
    ended = f"the task ended in {q.change:,.0f} of {q.steps:,} steps"
    if not q.written:
        return f"{ended}, and nothing in the file says so"
    missed = int(q.change) - q.right
    return (
        f"{ended}; {q.said:,} ends were predicted, {q.right:,} of them correctly, and {missed:,} "
        "ends were not predicted"
    )


def _names(quantities: Sequence[Quantity]) -> str:
    fluents = sum(q.name not in (REWARD, END) for q in quantities)
    named = [f"{fluents} fluents" if fluents > 1 else "a fluent"] if fluents else []
    named += ["the reward"] if any(q.name == REWARD for q in quantities) else []
    named += ["the end"] if any(q.name == END for q in quantities) else []
    return " and ".join([", ".join(named[:-1]), named[-1]] if len(named) > 1 else named)
