"""What of a file is behind the prediction for an action: rewards, ends, flags, failed conditions.

A cause comes from a site that the traced step passes (`serp.model.traced_step`). Its amount is what
the reward of the step changed by there, so that the amounts of a step add up to its reward.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from serp._util.text import plural, readable
from serp.model import ground_model as g
from serp.model.flags import APPLICABLE, TERMINAL, UNSAFE
from serp.model.traced_step import Passage
from serp.model.transition_model import Judgement, TransitionModel, Vector
from serp.pddl.source import Place, comment_of
from serp.pddl.syntax import Kind

What = Literal["change", "reward", "unsafe", "risk", "end", "failed", "conflict", "undefined"]
Origin = Literal["action", "event", "process", "goal", "metric", "chance", "learned"]


@dataclass(frozen=True)
class Location:
    """A stretch of a file: its name as given, lines and columns from 1; its end is exclusive."""

    file: str
    line: int
    column: int
    end_line: int
    end_column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


@dataclass(frozen=True)
class Cause:
    """Something that a step brings, and what of the file is behind it.

    Attributes:
        what: `change` of a fluent; `reward`; `unsafe` (the file flags the step); `risk` (an outcome
            that was learned is unsafe); `end` of the task; `failed` (a precondition that does not
            hold); `conflict` (an effect that contradicts another) or `undefined` (a condition that
            is neither true nor false, or numbers that are not finite), for both of which the step
            has no result.
        amount: Of `change` and `reward` the difference, of `risk` the probability; else None.
        origin: The kind of the schema; `goal`, `metric`; `chance`: other outcomes that the file
            gives the action; or `learned`: what the run learned.
        name: The ground action, process or event; empty for others.
        text: What is written there: the effect or the failed condition, in one line.
        condition: The conditions under which it takes place, as written; empty where always.
        reads: Fluent → value that those conditions, or the failed one, and the effect's number read
            when it takes place.
        comment: What the expert wrote beside or above it; else at its schema.
        place: Where it is written; None for `chance` and `learned`.
        after: Control periods of the path before the one in which it takes place.
    """

    what: What
    amount: float | None
    origin: Origin
    name: str
    text: str
    condition: str = ""
    reads: dict[str, float | bool] = field(default_factory=dict)
    comment: str = ""
    place: Location | None = None
    after: int = 0

    @property
    def schema(self) -> str:
        """What it belongs to: `event push-wins left`, `the goal`."""
        return f"{self.origin} {self.name}" if self.name else f"the {self.origin}"

    @property
    def quoted(self) -> str:
        """Its text with its line, and the schema through which it comes if that is no action."""
        line = "" if self.place is None else f" (line {self.place.line})"
        through = "" if self.origin == "action" else f" through {self.schema}"
        return f"`{self.text}`{line}{through}"

    def failure(self, *, located: bool = True) -> str:
        """Say what keeps a step from having a result; with its line, unless not `located`."""
        quote = self.quoted if located else f"`{self.text}`"
        if self.what == "failed":
            reads = listed_values(self.reads)
            return f"{quote} does not hold" + (f" ({reads})" if reads else "")
        if self.what == "conflict":
            return f"{quote} contradicts another effect"
        if not self.text:
            return f"{self.name or 'the reward'} does not give a finite number"
        return f"{quote} has no value, so it is neither true nor false"


def listed_values(values: Mapping[str, float | bool]) -> str:
    """Return at most 6 values as `x = 1.2, open = true`, and how many more there are."""
    shown = [f"{name} = {readable(value)}" for name, value in values.items()]
    more = f" and {plural(len(shown) - 6, 'more value')}" if len(shown) > 6 else ""
    return ", ".join(shown[:6]) + more


def why_not_applicable(causes: Iterable[Cause]) -> str:
    """Return why an action is not applicable, given what is behind its step.

    The reason is a failed precondition, with the values that it reads; effects that contradict each
    other or have no finite result; or a condition without a value, such as a division by zero.
    """
    failing = (cause for cause in causes if cause.what in ("failed", "conflict", "undefined"))
    first = next(failing, None)
    return "it has no result" if first is None else first.failure()


def causes_of(
    model: TransitionModel, state: Vector, action: int, *, unsafe: bool = False
) -> list[Cause]:
    """Return what is behind a predicted step of a ground action, in its order.

    If the step has no result, this is the failed precondition, or what gives no result and, where
    it is certain by then, what makes the step unsafe. Of an adapted model the likeliest unsafe
    outcome is traced, if there is one; its amounts are not those of the expected reward. Of an
    action with chance the likeliest outcome is traced, or the likeliest `unsafe` one.
    """
    if action >= 0 and (others := model.actions[action].outcomes):
        values = state.tolist()
        traces = [model.traced(values, action, outcome=k) for k in range(1 + len(others))]
        told = next((t for t in traces if unsafe and t.flags & UNSAFE), traces[0])
        return causes_passed(model.written, state, told.passages, told.flags, told.out)
    passages, flags = model.passages(state, action)
    out, _ = model.transition(state.tolist(), action)
    return causes_passed(model, state, passages, flags, out)


def causes_passed(
    model: TransitionModel, state: Vector, passages: Sequence[Passage], flags: int, out: list[float]
) -> list[Cause]:
    """Return what is behind a step that was traced, see `TransitionModel.traced`."""
    return list(_Tracing(model, state.tolist(), passages).causes(flags, out[:-1], out[-1]))


def observed_causes(
    model: TransitionModel, state: Vector, action: int, next_state: Vector
) -> tuple[list[Cause], Judgement]:
    """Return what of the file is behind an observed transition, and what it makes of it.

    Arguments and errors are those of `TransitionModel.judge`.
    """
    judged = model.judge(state, action, next_state)
    passages = model.judged_passages(state, action, next_state)
    flags = APPLICABLE | UNSAFE * judged.unsafe | TERMINAL * judged.terminal
    if model.ground.metric is not None:  # it is read off the two states as a whole
        passages = [passage._replace(gained=0.0) for passage in passages]
    after: list[float] = next_state.tolist()
    tracing = _Tracing(model, state.tolist(), passages, after)
    return list(tracing.causes(flags, after, judged.reward)), judged


def changes_passed(
    model: TransitionModel, state: Vector, passages: Sequence[Passage]
) -> dict[int, list[Cause]]:
    """Return position of a fluent → what changed it in a step that was traced, in order."""
    return _Tracing(model, state.tolist(), passages).changes()


def location_of(place: Place) -> Location:
    """Return a place as values."""
    end = place.source.place(place.end, place.end)
    return Location(place.source.name, place.line, place.column, end.line, end.column)


class _Tracing:
    """Reads the passages of one step."""

    def __init__(
        self,
        model: TransitionModel,
        state: list[float],
        passages: Sequence[Passage],
        observed: list[float] | None = None,
    ) -> None:
        self._model = model
        self._passages = passages
        self._state = state
        self._world = state if observed is None else observed
        """What processes and events read before anything has changed."""
        self._exact = model.as_written
        """Whether nothing but the sites changes the state: an adapted model does in between."""

    def causes(self, flags: int, after: list[float], reward: float) -> Iterator[Cause]:
        """Yield the causes, given the flags of the step, next state and reward."""
        gained = 0.0
        for k, passage in enumerate(self._passages):
            site = passage.site
            if site.what not in ("effect", "rate"):
                yield self._without_result(passage)
                continue
            effect, schema = site.item, site.schema
            assert isinstance(effect, g.SetBoolean | g.SetNumber) and schema is not None
            amount, gained = passage.gained - gained, passage.gained
            if amount != 0.0 and flags & APPLICABLE:
                yield self._of_effect("reward", amount, schema, effect, k)
            if isinstance(effect, g.SetBoolean) and effect.value:
                if effect.target == g.UNSAFE_TARGET and flags & UNSAFE:
                    yield self._of_effect("unsafe", None, schema, effect, k)
                elif effect.target == g.TERMINAL_TARGET and flags & TERMINAL:
                    yield self._of_effect("end", None, schema, effect, k)
        if flags & APPLICABLE and self._exact:
            yield from self._of_problem(reward, gained, flags, after)

    def changes(self) -> dict[int, list[Cause]]:
        """Return position of a fluent → what changed it, in order."""
        found: dict[int, list[Cause]] = {}
        for k, passage in enumerate(self._passages):
            effect, schema = passage.site.item, passage.site.schema
            if not isinstance(effect, g.SetBoolean | g.SetNumber) or schema is None:
                continue
            if effect.target < 0 or passage.site.what not in ("effect", "rate"):
                continue
            before = self._passages[k - 1].values if k else self._state
            amount = passage.values[effect.target] - before[effect.target]
            if amount != 0.0:
                cause = self._of_effect("change", amount, schema, effect, k)
                found.setdefault(effect.target, []).append(cause)
        return found

    def _of_effect(
        self,
        what: What,
        amount: float | None,
        schema: g.GroundSchema,
        effect: g.GroundEffect,
        at: int,
    ) -> Cause:
        tests = [effect.condition]
        if schema.kind is not Kind.ACTION:
            tests = [*schema.preconditions, effect.condition]
        read: list[g.Test | g.Value] = [*tests]
        if isinstance(effect, g.SetNumber):
            read.append(effect.value)
        values = self._before(schema, at)
        return _cause(
            what,
            schema,
            effect.place,
            amount=amount,
            condition=" ".join(test.place.text for test in tests if isinstance(test, _PLACED)),
            reads={} if values is None else self._reads(read, values),
        )

    def _of_problem(
        self, reward: float, gained: float, flags: int, after: list[float]
    ) -> Iterator[Cause]:
        """Yield what goal and metric add to a step."""
        ground, rest = self._model.ground, reward - gained
        goal, metric = ground.goal, ground.metric
        reached = flags & TERMINAL and goal is not None and self._model.at_goal(np.array(after))
        place = getattr(goal, "place", None)
        reads = {} if goal is None else self._reads([goal], after)
        if reached and ground.goal_rewarded:
            worth = rest
            if ground.goal_parameter is not None:
                worth = float(self._model.theta[ground.goal_parameter])
            rest -= worth
            yield _cause("reward", "goal", place, amount=worth, reads=reads)
        if abs(rest) > 1e-12 * max(1.0, abs(reward)):  # less is rounding
            yield _cause("reward", "metric", None if metric is None else metric.place, amount=rest)
        if reached:
            yield _cause("end", "goal", place, reads=reads)

    def _without_result(self, passage: Passage) -> Cause:
        what, schema, item = passage.site.what, passage.site.schema, passage.site.item
        assert what in ("failed", "conflict", "undefined")
        place = item.place if isinstance(item, _PLACED) else None
        reads = self._reads([item], self._state) if isinstance(item, _TESTS) else {}
        cause = _cause(what, schema or "metric", place, reads=reads)
        if place is None and schema is not None:
            return replace(cause, place=location_of(schema.place))
        return cause

    def _before(self, schema: g.GroundSchema, at: int) -> Sequence[float] | None:
        """Return the values that the effects of a schema read; None where that is not known."""
        if schema.kind is Kind.ACTION:
            return self._state
        if not self._exact:
            return None
        for passage in reversed(self._passages[:at]):
            other = passage.site.schema
            assert other is not None
            together = schema.kind is Kind.PROCESS and other.kind is Kind.PROCESS
            if other is not schema and not together:
                return passage.values
        return self._world

    def _reads(
        self, nodes: Iterable[g.Test | g.Value], values: Sequence[float]
    ) -> dict[str, float | bool]:
        found: dict[str, float | bool] = {}
        for node in nodes:
            for index in g.fluents_of(node):
                if index >= 0:
                    fluent = self._model.fluents[index]
                    value = values[index]
                    found[fluent.name] = value if fluent.numeric else bool(value)
        return found


_PLACED = (g.Holds, g.Compare, g.Not, g.All, g.AnyOf, g.SetBoolean, g.SetNumber)
_TESTS = (g.Holds, g.Compare, g.Not, g.All, g.AnyOf)


def _cause(
    what: What,
    of: g.GroundSchema | Origin,
    place: Place | None,
    *,
    amount: float | None = None,
    condition: str = "",
    reads: dict[str, float | bool] | None = None,
) -> Cause:
    """Return a cause of a schema, or of goal or metric, whose comment stands above its line."""
    schema = of if isinstance(of, g.GroundSchema) else None
    commented = place if schema is not None or place is None else _line_of(place)
    comment = "" if commented is None else comment_of(commented)
    if schema is not None:
        comment = comment or comment_of(schema.place)
    return Cause(
        what,
        amount,
        of.kind.value if isinstance(of, g.GroundSchema) else of,
        "" if schema is None else schema.name,
        "" if place is None else place.text,
        condition,
        reads or {},
        comment,
        None if place is None else location_of(place),
    )


def _line_of(place: Place) -> Place:
    """Return a place from the beginning of its line on: a goal stands behind `(:goal`."""
    line = place.source_line
    begin = place.start - (place.column - 1) + len(line) - len(line.lstrip())
    return place.source.place(begin, place.end)
