"""A ground model as plain data, from which a planning problem is built in another process.

Planning engines know actions that take no time, a goal and costs. What our files say beyond that
becomes:

* An action where it is unsafe, or ends the task without success, is not applicable.
* An action after which an event would be unsafe, or end the task so, may be taken, but nothing
  after it: such an event forbids all actions in its state, and an unsafe one the goal, too.
* Without `(:goal ...)` in the problem the goal is what ends the task with a reward: an event's
  precondition, or that such an action was taken.
* Rewards become costs of the actions, where all of these are numbers and none is negative.

Numbers that were learned are those of the model, not of the file. Expressions are numbers, strings
for fluents and lists `[operator, operand, ...]`, so that all of it is JSON.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import Any, Final

from serp.model import ground_model as g
from serp.model.ground_model import Linear, linear
from serp.model.transition_model import TransitionModel, Vector
from serp.pddl.source import DomainError, Place
from serp.pddl.syntax import Change, Kind
from serp.planning.goal_search import succeeds
from serp.planning.inert import inert_fluents

_ADVICE: Final = "use the planner `far-sight` or `lookahead`, which can plan with it"
_OPPOSITE: Final = {"<": ">=", "<=": ">", ">=": "<", ">": "<="}
_SIGNS: Final = {Change.INCREASE: 1, Change.DECREASE: -1}
SUCCESS: Final = "success"
"""The fluent that says that an action ended the task with a reward."""


def translated(model: TransitionModel) -> dict[str, Any]:
    """Return the planning problem of a model, without an initial state.

    Returns:
        `fluents`: name → column, and whether it is numeric; `actions`: position, preconditions and
        effects; `costs`: those of the actions, or None; `goal`.

    Raises:
        DomainError: There is no goal, or a process or an event changes a fluent.
    """
    return _Translation(model).problem()


def values_in(task: Mapping[str, Any], state: Vector) -> dict[str, float | bool]:
    """Return the values of a problem's fluents in a state `[F]`."""
    return {
        name: float(state[column]) if numeric else bool(state[column])
        for name, (column, numeric) in task["fluents"].items()
        if name != SUCCESS
    }


class _Translation:
    def __init__(self, model: TransitionModel) -> None:
        self.model, self.ground = model, model.ground
        self.theta = model.theta.tolist()
        self.left_out = set(inert_fluents(model).tolist())
        schemas = self.ground.schemas if self.ground.goal is None else ()
        self.successes = {id(s): s for s in schemas if succeeds(s, self.theta)}
        self.others = [event for event in self.ground.events if id(event) not in self.successes]

    def problem(self) -> dict[str, Any]:
        ground = self.ground
        if ground.processes:
            raise DomainError(
                "planning engines of unified-planning know no time that passes between actions",
                ground.processes[0].place, _ADVICE,
            )  # fmt: skip
        for event in ground.events:
            for effect in event.effects:
                if effect.target >= 0 and effect.target not in self.left_out:
                    raise DomainError(
                        "planning engines of unified-planning know no event that changes fluents",
                        effect.place, f"write it as an effect of the actions; or {_ADVICE}",
                    )  # fmt: skip
        if ground.goal is None and not self.successes:
            raise DomainError(
                "planning engines of unified-planning need a goal", ground.syntax.place,
                "write `(:goal ...)` in the problem file; or write an event here with the effects "
                "`(increase (reward) 1)` and `(terminal)`",
            )  # fmt: skip
        no_end, no_harm = (
            [test for event in self.others for test in self.never(event, flag)]
            for flag in (g.TERMINAL_TARGET, g.UNSAFE_TARGET)
        )
        forbidden = [*no_end, *no_harm]
        if ground.goal is not None:
            goal = self.test(ground.goal)
        else:
            goal = _any(
                SUCCESS if schema.kind is Kind.ACTION else self.all(schema.preconditions)
                for schema in self.successes.values()
            )
        return {
            "fluents": self.fluents(),
            "actions": [
                self.action(k, action, forbidden, id(action) in self.successes)
                for k, action in enumerate(ground.actions)
            ],
            "costs": self.costs(),
            "goal": _all([goal, *no_harm]),
        }

    def fluents(self) -> dict[str, list[Any]]:
        found: dict[str, list[Any]] = {
            _name(f.index): [f.index, f.numeric]
            for f in self.ground.fluents
            if f.index not in self.left_out
        }
        if any(schema.kind is Kind.ACTION for schema in self.successes.values()):
            found[SUCCESS] = [-1, False]
        return found

    def action(
        self, position: int, action: g.GroundSchema, forbidden: list[Any], success: bool
    ) -> list[Any]:
        preconditions = [*map(self.test, action.preconditions), *forbidden]
        for flag in (g.UNSAFE_TARGET, g.TERMINAL_TARGET):
            if flag == g.UNSAFE_TARGET or not success:
                preconditions += self.never(action, flag)
        effects = [self.effect(e) for e in action.effects if self.matters(e)]
        if success:
            effects.append(["assign", SUCCESS, True, True])
        return [position, preconditions, effects]

    def matters(self, effect: g.GroundEffect) -> bool:
        return effect.target >= 0 and effect.target not in self.left_out

    def effect(self, effect: g.GroundEffect) -> list[Any]:
        name, condition = _name(effect.target), self.test(effect.condition)
        if isinstance(effect, g.SetBoolean):
            return ["assign", name, effect.value, condition]
        value = self.value(effect.value, effect.place)
        if effect.change in (Change.SCALE_UP, Change.SCALE_DOWN):
            operator = "*" if effect.change is Change.SCALE_UP else "/"
            return ["assign", name, [operator, name, value], condition]
        return [effect.change.value, name, value, condition]

    def never(self, schema: g.GroundSchema, flag: int) -> list[Any]:
        """Return the conditions under which a schema does not set a flag."""
        return [self.all(tests, wanted=False) for tests in g.flagging(schema, flag)]

    # Expressions -------------------------------------------------------------------------------

    def test(self, test: g.Test, wanted: bool = True) -> Any:
        """Return that a condition is `wanted`, in negation normal form.

        Engines without disjunctions take `(or (not a) (not b))` as one, and not `(not (and a b))`.
        """
        match test:
            case g.Constant(value):
                return value == wanted
            case g.Holds(fluent):
                if fluent < 0:  # flags start afresh in each step
                    return not wanted
                return _name(fluent) if wanted else ["not", _name(fluent)]
            case g.Compare(operator, left, right, place):
                sides = self.value(left, place), self.value(right, place)
                if not wanted and operator == "=":
                    return ["or", ["<", *sides], [">", *sides]]
                return [operator if wanted else _OPPOSITE[operator], *sides]
            case g.Not(operand):
                return self.test(operand, not wanted)
            case g.All(operands):
                return self.all(operands, wanted)
            case g.AnyOf(operands):
                either = _any if wanted else _all
                return either(self.test(operand, wanted) for operand in operands)

    def all(self, tests: Iterable[g.Test], wanted: bool = True) -> Any:
        """Return that some conditions hold together, or that they do not."""
        either = _all if wanted else _any
        return either(self.test(test, wanted) for test in tests)

    def value(self, value: g.Value, place: Place) -> Any:
        match value:
            case g.Read(fluent):
                return _name(fluent)
            case g.ParameterRef(parameter):
                return self.theta[parameter]
            case g.Operation("+" | "-" | "*" | "/" as operator, left, right):
                return [operator, self.value(left, place), self.value(right, place)]
            case g.Unary("-", operand):
                return ["-", 0.0, self.value(operand, place)]
            case g.Elapsed():
                return self.model.dt
            case g.Operation(operator) | g.Unary(operator):
                raise DomainError(
                    f"planning engines of unified-planning do not know `{operator}`", place, _ADVICE
                )

    # Costs -------------------------------------------------------------------------------------

    def costs(self) -> list[float] | None:
        """Return the costs of the actions; None where they are not known, or do not differ."""
        weights = self.weights()
        if weights is None or any(e.target in weights for s in self.others for e in s.effects):
            return None
        costs = []
        for action in self.ground.actions:
            gain = Fraction(0)
            for effect in action.effects:
                weight = weights.get(effect.target)
                if weight is None or not isinstance(effect, g.SetNumber):
                    continue
                amount, sign = linear(effect.value, self.theta), _SIGNS.get(effect.change)
                if sign is None or amount.terms or effect.condition != g.Constant(True):
                    return None
                gain += sign * weight * amount.constant
            costs.append(float(-gain))
        return costs if len(set(costs)) > 1 and min(costs) >= 0.0 else None

    def weights(self) -> dict[int, Fraction] | None:
        """Return target → what one more of it is worth; None where that is not a number."""
        metric = self.ground.metric
        if metric is None:
            return {g.REWARD_TARGET: Fraction(1)}
        form: Linear = linear(metric.value, self.theta)
        if not all(isinstance(atom, int) for atom in form.terms):
            return None
        sign = 1 if metric.maximize else -1
        return {atom: sign * factor for atom, factor in form.terms.items() if isinstance(atom, int)}


def _name(fluent: int) -> str:
    return f"f{fluent}"


def _all(tests: Iterable[Any]) -> Any:
    return _joined("and", tests, neutral=True)


def _any(tests: Iterable[Any]) -> Any:
    return _joined("or", tests, neutral=False)


def _joined(operator: str, tests: Iterable[Any], *, neutral: bool) -> Any:
    left = [test for test in tests if test is not neutral]
    if any(test is (not neutral) for test in left):
        return not neutral
    return left[0] if len(left) == 1 else [operator, *left] if left else neutral
