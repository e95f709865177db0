"""Generating the transition function of a ground model as a syntax tree.

The generated functions are straight-line code over flat sequences of floats:

    step(s, a, theta, dt, out) -> flags
    judge(s, a, n, theta, dt, out) -> flags

`s` is the state, `a` the position of the action (-1: none that the model knows), `theta` the
literals, `dt` the control period. `step` expects in `out` a copy of `s` with one more slot and
leaves there the next state and, in the last slot, the reward. `judge` reads the rewards and flags
off a transition that was observed: `n` is the observed next state and `out` a copy of it. The
result is a sum of APPLICABLE, UNSAFE and TERMINAL; 0 means that the action is not applicable.

The same functions run in CPython on lists and, compiled by numba, on pointers. Every identifier is
made here and every literal is read from `theta`, so no text of a domain file becomes program text,
and two domains that differ in literals alone share one function.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from serp.domain import ground as g
from serp.domain.syntax import Change, Kind

APPLICABLE = 1
UNSAFE = 2
TERMINAL = 4

_FLAG_NAMES = {g.UNSAFE_TARGET: "unsafe", g.TERMINAL_TARGET: "terminal"}
_COMPARISONS: dict[str, ast.cmpop] = {
    "<": ast.Lt(),
    "<=": ast.LtE(),
    "=": ast.Eq(),
    ">=": ast.GtE(),
    ">": ast.Gt(),
}
_OPERATIONS: dict[str, ast.operator] = {"+": ast.Add(), "-": ast.Sub(), "*": ast.Mult()}
_GROUP = {Change.ASSIGN: 1, Change.INCREASE: 2, Change.DECREASE: 2}
_SCALE = 3


@dataclass(frozen=True, slots=True)
class Site:
    """A place in the generated code that a traced run reports when it passes there.

    Attributes:
        what: `failed` (a precondition that does not hold), `effect` (of an action or event that
            was applied), `rate` (of a process that was applied), `conflict` (effects that
            contradict each other) or `undefined` (a result that is no finite number).
        schema: The ground action, process or event; None for the reward as a whole.
        item: The precondition or effect; None where the schema as a whole is meant.
    """

    what: Literal["failed", "effect", "rate", "conflict", "undefined"]
    schema: g.GroundSchema | None
    item: g.Test | g.GroundEffect | None


@dataclass(frozen=True)
class Generated:
    """A generated function.

    Attributes:
        name: `step` or `judge`.
        tree: A module that defines it.
        sites: What the positions reported to `trace.append` mean; empty unless traced.
    """

    name: str
    tree: ast.Module
    sites: tuple[Site, ...]


def generate_step(model: g.GroundModel, *, traced: bool = False) -> Generated:
    """Generate the transition function; traced, it takes a list `trace` as last argument."""
    return _Generator(model, "step", traced=traced).step()


def generate_judge(model: g.GroundModel) -> Generated:
    """Generate the function that reads reward and flags off an observed transition."""
    return _Generator(model, "judge", traced=False).judge()


def _name(identifier: str) -> ast.Name:
    return ast.Name(identifier, ast.Load())


def _const(value: float | bool) -> ast.Constant:
    return ast.Constant(value)


def _item(array: str, index: int) -> ast.Subscript:
    return ast.Subscript(_name(array), ast.Constant(index), ast.Load())


def _assign(identifier: str, value: ast.expr) -> ast.stmt:
    return ast.Assign([ast.Name(identifier, ast.Store())], value)


def _store(index: int, value: ast.expr) -> ast.stmt:
    target = ast.Subscript(_name("out"), ast.Constant(index), ast.Store())
    return ast.Assign([target], value)


def _not(test: ast.expr) -> ast.expr:
    return ast.UnaryOp(ast.Not(), test)


def _both(tests: Sequence[ast.expr]) -> ast.expr:
    return tests[0] if len(tests) == 1 else ast.BoolOp(ast.And(), list(tests))


_Emit = Callable[[g.GroundSchema], None]


class _Generator:
    def __init__(self, model: g.GroundModel, name: str, *, traced: bool) -> None:
        self.model = model
        self.name = name
        self.traced = traced
        self.sites: list[Site] = []
        self.temporaries = 0
        self.body: list[ast.stmt] = []

    # The two functions -------------------------------------------------------------------------

    def step(self) -> Generated:
        self._begin()
        self._dispatch(self._action)
        self._processes()
        self._events()
        self._finish("out")
        return self._function(["s", "a", "theta", "dt", "out"])

    def judge(self) -> Generated:
        self._begin()
        self._dispatch(self._judged_action)
        self._judged_processes()
        self._events()
        self._finish("n")
        return self._function(["s", "a", "n", "theta", "dt", "out"])

    def _function(self, arguments: list[str]) -> Generated:
        if self.traced:
            arguments = [*arguments, "trace"]
        function = ast.FunctionDef(
            name=self.name,
            args=ast.arguments(
                posonlyargs=[],
                args=[ast.arg(a) for a in arguments],
                kwonlyargs=[],
                kw_defaults=[],
                defaults=[],
            ),
            body=self.body,
            decorator_list=[],
        )
        if hasattr(function, "type_params"):  # a required field from Python 3.12 on
            function.type_params = []
        tree = ast.fix_missing_locations(ast.Module([function], []))
        return Generated(self.name, tree, tuple(self.sites))

    def _begin(self) -> None:
        self.body += [
            _assign("reward", _const(0.0)),
            _assign("unsafe", _const(False)),
            _assign("terminal", _const(False)),
        ]

    def _finish(self, result: str) -> None:
        """Emit metric, goal and flags; metric and goal look at the next state, named `result`."""
        metric = self.model.metric
        if metric is not None:
            after = self._value(metric.value, result, elapsed=_name("dt"))
            before = self._value(metric.value, "s", elapsed=_const(0.0))
            pair = (after, before) if metric.maximize else (before, after)
            self.body.append(_assign("reward", ast.BinOp(pair[0], ast.Sub(), pair[1])))
        self._require_finite(_name("reward"), Site("undefined", None, None))
        if self.model.goal is not None:
            goal = self._test(self.model.goal, result)
            self.body.append(ast.If(goal, [_assign("terminal", _const(True))], []))
        flags: ast.expr = ast.Constant(APPLICABLE)
        for name, bit in (("unsafe", UNSAFE), ("terminal", TERMINAL)):
            chosen = ast.IfExp(_name(name), ast.Constant(bit), ast.Constant(0))
            flags = ast.BinOp(flags, ast.BitOr(), chosen)
        self.body += [
            _store(len(self.model.fluents), _name("reward")),
            ast.Return(flags),
        ]

    # Statements --------------------------------------------------------------------------------

    def _temporary(self, value: ast.expr) -> ast.Name:
        identifier = f"t{self.temporaries}"
        self.temporaries += 1
        self.body.append(_assign(identifier, value))
        return _name(identifier)

    def _report(self, site: Site) -> list[ast.stmt]:
        if not self.traced:
            return []
        self.sites.append(site)
        append = ast.Attribute(_name("trace"), "append", ast.Load())
        return [ast.Expr(ast.Call(append, [ast.Constant(len(self.sites) - 1)], []))]

    def _refuse(self, test: ast.expr, site: Site) -> None:
        self.body.append(ast.If(test, [*self._report(site), ast.Return(ast.Constant(0))], []))

    def _require_finite(self, value: ast.expr, site: Site) -> None:
        # x - x is 0 for every finite x, and NaN for the others.
        difference = ast.BinOp(value, ast.Sub(), value)
        self._refuse(ast.Compare(difference, [ast.NotEq()], [_const(0.0)]), site)

    def _under(self, condition: ast.expr | None, statements: list[ast.stmt]) -> None:
        if condition is None:
            self.body += statements
        else:
            self.body.append(ast.If(condition, statements, []))

    def _collect(self) -> list[ast.stmt]:
        """Start a new list of statements and return the present one."""
        outer, self.body = self.body, []
        return outer

    # Actions -----------------------------------------------------------------------------------

    def _dispatch(self, emit: _Emit) -> None:
        """Emit a binary search over the position of the action."""
        if not self.model.actions:
            return
        tree = self._search(0, len(self.model.actions), emit)
        known = ast.Compare(_name("a"), [ast.GtE()], [ast.Constant(0)])
        self.body.append(ast.If(known, tree or [ast.Pass()], []))

    def _search(self, start: int, end: int, emit: _Emit) -> list[ast.stmt]:
        outer = self._collect()
        if end - start == 1:
            emit(self.model.actions[start])
        else:
            middle = (start + end) // 2
            before = ast.Compare(_name("a"), [ast.Lt()], [ast.Constant(middle)])
            left = self._search(start, middle, emit) or [ast.Pass()]
            self.body.append(ast.If(before, left, self._search(middle, end, emit)))
        branch, self.body = self.body, outer
        return branch

    def _action(self, action: g.GroundSchema) -> None:
        for test in action.preconditions:
            self._refuse(_not(self._test(test, "s")), Site("failed", action, test))
        self._effects(action, action.effects, "s")

    def _judged_action(self, action: g.GroundSchema) -> None:
        self._effects(action, [e for e in action.effects if e.target < 0], "s")

    # Effects -----------------------------------------------------------------------------------

    def _effects(
        self, schema: g.GroundSchema, effects: Sequence[g.GroundEffect], source: str
    ) -> None:
        """Emit effects that are all evaluated before any is applied.

        An action reads `s` and writes `out`, so nothing it reads can change underway; an event
        reads what it writes and keeps conditions and values in temporaries.
        """
        numbers = [e for e in effects if isinstance(e, g.SetNumber)]
        booleans = [e for e in effects if isinstance(e, g.SetBoolean)]
        booleans.sort(key=lambda e: e.value)  # delete before add (PDDL 2.1, definition 9)
        checked = _contested(numbers)
        keep = source == "out" and len(effects) > 1
        ordered: list[g.GroundEffect] = [*booleans, *numbers]
        prepared = []
        uses = Counter(id(effect.condition) for effect in ordered)
        shared: dict[int, ast.expr] = {}
        for effect in ordered:
            same = id(effect.condition)
            if same not in shared:
                tested = self._condition(effect.condition, source)
                if tested is not None and uses[same] > 1:
                    tested = self._temporary(tested)
                if tested is not None:
                    shared[same] = tested
            condition = shared.get(same)
            value = self._value(effect.value, source) if isinstance(effect, g.SetNumber) else None
            if keep:
                condition = self._temporary(condition) if condition is not None else None
                value = self._temporary(value) if value is not None else None
            prepared.append((effect, condition, value))
        self.body += [_assign(f"kind{target}", ast.Constant(0)) for target in sorted(checked)]
        for effect, condition, value in prepared:
            outer = self._collect()
            if isinstance(effect, g.SetBoolean):
                self._set_boolean(effect)
            else:
                assert value is not None
                self._set_number(schema, effect, value, contested=effect.target in checked)
            self.body += self._report(Site("effect", schema, effect))
            statements, self.body = self.body, outer
            self._under(condition, statements)
        for target in sorted({e.target for e in numbers if e.target >= 0}):
            self._require_finite(_item("out", target), Site("undefined", schema, None))

    def _set_boolean(self, effect: g.SetBoolean) -> None:
        if effect.target in _FLAG_NAMES:
            self.body.append(_assign(_FLAG_NAMES[effect.target], _const(effect.value)))
        else:
            self.body.append(_store(effect.target, _const(1.0 if effect.value else 0.0)))

    def _set_number(
        self, schema: g.GroundSchema, effect: g.SetNumber, value: ast.expr, *, contested: bool
    ) -> None:
        kind = f"kind{effect.target}"
        group = _GROUP.get(effect.change, _SCALE)
        if contested:
            others = [k for k in (1, 2, _SCALE) if k != group]
            clash: ast.expr = ast.BoolOp(
                ast.Or(),
                [ast.Compare(_name(kind), [ast.Eq()], [ast.Constant(k)]) for k in others],
            )
            if group == 1:
                value = self._temporary(value)
                same_kind = ast.Compare(_name(kind), [ast.Eq()], [ast.Constant(1)])
                differs = ast.Compare(_item("out", effect.target), [ast.NotEq()], [value])
                both = ast.BoolOp(ast.And(), [same_kind, differs])
                clash = ast.BoolOp(ast.Or(), [clash, both])
            self._refuse(clash, Site("conflict", schema, effect))
            self.body.append(_assign(kind, ast.Constant(group)))
        self._apply(effect, value)

    def _apply(self, effect: g.SetNumber, value: ast.expr) -> None:
        reward = effect.target == g.REWARD_TARGET
        old: ast.expr = _name("reward") if reward else _item("out", effect.target)
        match effect.change:
            case Change.ASSIGN:
                new = value
            case Change.INCREASE:
                new = ast.BinOp(old, ast.Add(), value)
            case Change.DECREASE:
                new = ast.BinOp(old, ast.Sub(), value)
            case Change.SCALE_UP:
                new = ast.BinOp(old, ast.Mult(), value)
            case Change.SCALE_DOWN:
                new = self._quotient(old, value)
        self.body.append(_assign("reward", new) if reward else _store(effect.target, new))

    # Processes and events ----------------------------------------------------------------------

    def _processes(self) -> None:
        self._flow(self.model.processes, "out", rewards_only=False)

    def _judged_processes(self) -> None:
        self._flow(self.model.processes, "n", rewards_only=True)

    def _flow(
        self, processes: Iterable[g.GroundSchema], source: str, *, rewards_only: bool
    ) -> None:
        """Emit one explicit Euler step: every rate is evaluated before any is applied."""
        prepared = []
        for process in processes:
            effects = [e for e in process.effects if isinstance(e, g.SetNumber)]
            if rewards_only:
                effects = [e for e in effects if e.target == g.REWARD_TARGET]
            if not effects:
                continue
            tests = [self._test(test, source) for test in process.preconditions]
            condition = self._temporary(_both(tests)) if tests else None
            for effect in effects:
                rate = self._value(effect.value, source)
                change = self._temporary(ast.BinOp(_name("dt"), ast.Mult(), rate))
                prepared.append((process, effect, condition, change))
        for process, effect, condition, change in prepared:
            outer = self._collect()
            self._apply(effect, change)
            self.body += self._report(Site("rate", process, effect))
            statements, self.body = self.body, outer
            self._under(condition, statements)
        written = {(e.target, p) for p, e, _, _ in prepared if e.target >= 0}
        for target in sorted({target for target, _ in written}):
            process = next(p for p, e, _, _ in prepared if e.target == target)
            self._require_finite(_item("out", target), Site("undefined", process, None))

    def _events(self) -> None:
        events = self.model.events
        if _need_sweeps(events):
            names = [f"fired{k}" for k in range(len(events))]
            self.body += [_assign(name, _const(False)) for name in names]
            self.body.append(_assign("again", _const(True)))
            outer = self._collect()
            self.body.append(_assign("again", _const(False)))
            for event, name in zip(events, names, strict=True):
                self._event(event, name)
            sweep, self.body = self.body, outer
            self.body.append(ast.While(_name("again"), sweep, []))
        else:
            for event in events:
                self._event(event, None)

    def _event(self, event: g.GroundSchema, fired: str | None) -> None:
        tests = [self._test(test, "out") for test in event.preconditions]
        outer = self._collect()
        if fired is not None:
            tests.insert(0, _not(_name(fired)))
            self.body += [_assign(fired, _const(True)), _assign("again", _const(True))]
        self._effects(event, event.effects, "out")
        statements, self.body = self.body or [ast.Pass()], outer
        self._under(_both(tests) if tests else None, statements)

    # Expressions -------------------------------------------------------------------------------

    def _condition(self, test: g.Test, source: str) -> ast.expr | None:
        if isinstance(test, g.Constant) and test.value:
            return None
        return self._test(test, source)

    def _test(self, test: g.Test, source: str) -> ast.expr:
        match test:
            case g.Constant(value):
                return _const(value)
            case g.Holds(fluent):
                if fluent in _FLAG_NAMES:  # before the action, both are false
                    return _const(False) if source == "s" else _name(_FLAG_NAMES[fluent])
                return ast.Compare(_item(source, fluent), [ast.NotEq()], [_const(0.0)])
            case g.Compare(operator, left, right):
                values = self._value(left, source), self._value(right, source)
                return ast.Compare(values[0], [_COMPARISONS[operator]], [values[1]])
            case g.Not(operand):
                return _not(self._test(operand, source))
            case g.All(operands):
                return ast.BoolOp(ast.And(), [self._test(o, source) for o in operands])
            case g.AnyOf(operands):
                return ast.BoolOp(ast.Or(), [self._test(o, source) for o in operands])

    def _value(self, value: g.Value, source: str, elapsed: ast.expr | None = None) -> ast.expr:
        match value:
            case g.Read(fluent):
                return _item(source, fluent)
            case g.Literal(parameter):
                return _item("theta", parameter)
            case g.Elapsed():
                return elapsed or _name("dt")
            case g.Negation(operand):
                return ast.UnaryOp(ast.USub(), self._value(operand, source, elapsed))
            case g.Operation(operator, left, right):
                operands = (
                    self._value(left, source, elapsed),
                    self._value(right, source, elapsed),
                )
                if operator == "/":
                    return self._quotient(*operands)
                return ast.BinOp(operands[0], _OPERATIONS[operator], operands[1])

    def _quotient(self, dividend: ast.expr, divisor: ast.expr) -> ast.expr:
        """Divide without an exception: a division by zero gives NaN, which is then refused."""
        if not isinstance(divisor, ast.Name | ast.Subscript):
            divisor = self._temporary(divisor)
        nonzero = ast.Compare(divisor, [ast.NotEq()], [_const(0.0)])
        return ast.IfExp(nonzero, ast.BinOp(dividend, ast.Div(), divisor), _const(float("nan")))


def _contested(effects: Sequence[g.SetNumber]) -> set[int]:
    """Return the targets whose effects can contradict each other.

    Increases and decreases commute, and so do scalings; an assignment beside anything else, or a
    mixture of the two, has no defined result (PDDL 2.1, definition 8).
    """
    groups: dict[int, list[int]] = {}
    for effect in effects:
        groups.setdefault(effect.target, []).append(_GROUP.get(effect.change, _SCALE))
    return {t for t, kinds in groups.items() if len(set(kinds)) > 1 or kinds.count(1) > 1}


def _need_sweeps(events: Sequence[g.GroundSchema]) -> bool:
    """Whether an event can enable one before it, so that one pass in file order is not enough."""
    assert all(event.kind is Kind.EVENT for event in events)
    read_before: set[int] = set()
    for event in events:
        if g.writes(event) & read_before:
            return True
        for test in event.preconditions:
            read_before.update(g.fluents_of(test))
    return False
