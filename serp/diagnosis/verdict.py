"""Sentences on the accuracy of a file, and on what the findings do not explain."""

from __future__ import annotations

from collections.abc import Sequence

from serp._util.number_format import percent, readable
from serp.diagnosis.accuracy import END, REWARD, WELL, Quantity

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
            error = f"one step ahead every error is at most {percent(worst.off)} of the change"
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
        f"{percent(WELL)} of the change; {listed}. The largest error is "
        f"{percent(worst.off)} of the change, that of {worst.shown}."
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
    listed = f"; with the findings {percent(q.off_left)}" if differs else ""
    mostly = f"; most of it after `{q.action}`" if q.most > 0.5 and q.squared else ""
    if q.name == END:
        missed = int(q.change) - q.right
        what = f"the task ended in {q.change:,.0f} of {q.steps:,} steps"
        said = f"; {q.said:,} ends were predicted, {q.right:,} of them correctly, and {missed:,} "
        said += "ends were not predicted"
        mostly = ""
    elif not q.numeric:
        what = f"{q.shown} changes {q.change:,.0f} times in {q.steps:,} steps"
        said = f"; {q.said:,} changes were predicted, {q.right:,} of them correctly"
        said += f" (wrong {percent(q.off)} as often as it changes)"
    elif not q.change:
        still = "the reward is 0" if q.name == REWARD else f"{q.shown} does not change"
        what, said = f"{still} in all {q.steps:,} steps", ", though the file predicts that it does"
    else:
        moves = "the reward is" if q.name == REWARD else f"{q.shown} changes by"
        what = f"{moves} {readable(q.change)} a step"
        error = readable(q.change * q.off)
        said = f", the error of the file is {error} ({percent(q.off)})"
    if q.change and not q.written:
        said = ", and nothing in the file says so"
    return f"{what}{said}{listed}{mostly}"


def _names(quantities: Sequence[Quantity]) -> str:
    fluents = sum(q.name not in (REWARD, END) for q in quantities)
    named = [f"{fluents} fluents" if fluents > 1 else "a fluent"] if fluents else []
    others = {REWARD: "the reward", END: "the end"}
    named += [others[q.name] for q in quantities if q.name in others]
    return " and ".join([", ".join(named[:-1]), named[-1]] if len(named) > 1 else named)
