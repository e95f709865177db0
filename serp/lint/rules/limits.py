"""Rule: limits of numbers that only ever move away from them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from typing import NamedTuple

from serp.lint.rules.exclusion import threshold
from serp.lint.subject import LintSubject
from serp.model import ground as g
from serp.model.linear import linear
from serp.pddl.source import DomainWarning, Place
from serp.pddl.syntax import Change

_BELOW, _ABOVE = ("<", "<="), (">", ">=")


class _Limit(NamedTuple):
    """A comparison of a fluent with a number: `operator` as if the fluent stood on the left."""

    fluent: int
    operator: str
    number: float
    place: Place


class _Change(NamedTuple):
    """How an effect changes a fluent: by a number of a sign (0: not known), within limits."""

    sign: int
    limits: list[_Limit]
    place: Place


def _one_way(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find limits on the side that a number comes from, in files that only ever move it away.

    One is the condition of the change itself, where nothing else waits for the number farther on;
    the other one is that of an event which sets the number back to the limit.
    """
    changes: dict[int, list[_Change]] = defaultdict(list)
    stops: dict[int, list[_Limit]] = defaultdict(list)
    waiting: list[_Limit] = []
    for schema in subject.anywhere.schemas:
        for test in (*schema.preconditions, *(effect.condition for effect in schema.effects)):
            waiting += _limits(g.comparisons_of(test), subject.theta)
        for effect in schema.effects:
            if not isinstance(effect, g.SetNumber) or effect.target < 0:
                continue
            tests = (*schema.preconditions, *_conjuncts(effect.condition))
            compared = [test for test in tests if isinstance(test, g.Compare)]
            limits = [limit for limit in _limits(compared, subject.theta)
                      if limit.fluent == effect.target]  # fmt: skip
            value = linear(effect.value, subject.theta)
            number = None if value.terms else float(value.constant)
            if effect.change is Change.ASSIGN and number in [limit.number for limit in limits]:
                stops[effect.target] += limits
            else:
                sign = 0 if number is None else _sign(effect.change, number)
                changes[effect.target].append(_Change(sign, limits, effect.place))
    for fluent, found in changes.items():
        (sign, *others) = {change.sign for change in found}
        if not sign or others:
            continue
        name = subject.anywhere.fluents[fluent].name
        never = f"nothing makes `{name}` {'less' if sign > 0 else 'more'}"
        behind, ahead = (_ABOVE, _BELOW) if sign > 0 else (_BELOW, _ABOVE)
        for limit in stops[fluent]:
            if limit.operator in ahead:
                yield DomainWarning(
                    f"{never}, so `{limit.place.text}` does not come about",
                    limit.place,
                    advice="is a sign, or the comparison, the wrong way round?",
                )
        for change in found:
            operators = {limit.operator for limit in change.limits}
            if not operators or not operators.issubset(behind) or stops[fluent]:
                continue
            if any(
                other.fluent == fluent
                and other.operator in behind
                and (other.number - limit.number) * sign > 0
                for limit in change.limits
                for other in waiting
            ):
                continue
            yield DomainWarning(
                f"{never}, and `{change.limits[0].place.text}` does not stop this change of it",
                change.place,
                advice="is a sign, or the comparison, the wrong way round?",
            )


def _limits(comparisons: Iterator[g.Compare] | list[g.Compare], theta: list[float]) -> list[_Limit]:
    found = ((comparison, threshold(comparison, theta)) for comparison in comparisons)
    return [_Limit(*limit, comparison.place) for comparison, limit in found if limit is not None]


def _conjuncts(test: g.Test) -> tuple[g.Test, ...]:
    return test.operands if isinstance(test, g.All) else (test,)


def _sign(change: Change, number: float) -> int:
    """Return which way a change by a number goes; 0 where that depends on the state."""
    if change.group != "add" or not number:
        return 0
    return 1 if (number > 0) == (change is Change.INCREASE) else -1


RULES = {"one-way": _one_way}
