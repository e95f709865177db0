"""Generating the transition function of a ground model as syntax trees.

The generated functions are straight-line code over flat sequences of floats. The whole step is

    step(s, a, theta, dt, out) -> flags

and CPython runs it in three parts, so that a domain of thousands of actions costs what is used of
it:

    action(s, theta, dt, out) -> flags               the effects of one action
    drift(s, flags, theta, dt, out) -> flags         processes
    settle(s, flags, theta, dt, out) -> flags        events, goal, metric

`flow(s, a, theta, dt, out)` is the effects of all actions and the processes, for those who change
what the file predicts before its events look at it.

`s` is the state, `a` the position of the action, `theta` the literals, `dt` the control period;
`out` comes as a copy of `s` with one more slot, 0, and leaves as the next state and, in the last
slot, the reward. Flags are a sum of APPLICABLE, UNSAFE and TERMINAL; without APPLICABLE there is no
next state: the precondition fails (0), or the result is UNDEFINED (and UNSAFE where that is certain
all the same). Two more read the rewards and flags off a transition that was observed:

    judged_action(s, theta, dt, out) -> flags
    judged_aftermath(s, n, flags, theta, dt, out) -> flags

`n` is the observed next state and `out` comes as a copy of it.

Every identifier is made here and every literal is read from `theta`, so no text of a domain file
becomes program text, and two domains that differ in literals alone share one `step`, which numba
compiles for pointers.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from serp.model import ground as g
from serp.model.emit import (
    FLAG_NAMES,
    Emitter,
    Site,
    assign,
    constant,
    entry,
    joined,
    negated,
    store,
    variable,
)
from serp.model.flags import APPLICABLE, TERMINAL, UNSAFE
from serp.pddl.syntax import Change, Kind

_BITS = (("unsafe", UNSAFE), ("terminal", TERMINAL))
_GROUP = {Change.ASSIGN: 1, Change.INCREASE: 2, Change.DECREASE: 2}
_SCALE = 3


@dataclass(frozen=True)
class Generated:
    """A generated function.

    Attributes:
        name: One of those above.
        tree: A module that defines it.
        sites: What the positions reported to `trace.append` mean; empty unless traced.
    """

    name: str
    tree: ast.Module
    sites: tuple[Site, ...]


def generate_step(model: g.GroundModel) -> Generated:
    """Generate the transition function of all actions."""
    return _Generator(model).step()


def generate_action(
    model: g.GroundModel, action: g.GroundSchema, *, traced: bool = False
) -> Generated:
    """Generate what an action does; traced, it takes a list `trace` as last argument."""
    return _Generator(model, traced=traced).action(action)


def generate_drift(model: g.GroundModel, *, traced: bool = False) -> Generated:
    """Generate what the world does by itself; traced, it takes a list `trace` as last argument."""
    return _Generator(model, traced=traced).drift()


def generate_settle(model: g.GroundModel, *, traced: bool = False) -> Generated:
    """Generate what follows from where a step led; traced, it takes a list `trace` last."""
    return _Generator(model, traced=traced).settle()


def generate_flow(model: g.GroundModel) -> Generated:
    """Generate the effects of all actions, and what the world does by itself."""
    return _Generator(model).flow()


def generate_judged_action(
    model: g.GroundModel, action: g.GroundSchema, *, traced: bool = False
) -> Generated:
    """Generate what an action's own effects say of an observed transition."""
    return _Generator(model, traced=traced).judged_action(action)


def generate_judged_aftermath(model: g.GroundModel, *, traced: bool = False) -> Generated:
    """Generate what processes, events, goal and metric say of an observed transition."""
    return _Generator(model, traced=traced).judged_aftermath()


class _Generator(Emitter):
    def __init__(self, model: g.GroundModel, *, traced: bool = False) -> None:
        super().__init__(traced=traced)
        self.model = model
        self.reward_slot = len(model.fluents)

    # The functions -----------------------------------------------------------------------------

    def step(self) -> Generated:
        self._actions()
        self._processes()
        self._events()
        self._finish("out")
        return self._function("step", ["s", "a", "theta", "dt", "out"])

    def flow(self) -> Generated:
        self._actions()
        self._processes()
        self._end()
        return self._function("flow", ["s", "a", "theta", "dt", "out"])

    def action(self, action: g.GroundSchema) -> Generated:
        self._begin()
        self._action(action)
        self._end()
        return self._function("action", ["s", "theta", "dt", "out"])

    def drift(self) -> Generated:
        self._resume()
        self._processes()
        self._end()
        return self._function("drift", ["s", "flags", "theta", "dt", "out"])

    def settle(self) -> Generated:
        self._resume()
        self._events()
        self._finish("out")
        return self._function("settle", ["s", "flags", "theta", "dt", "out"])

    def judged_action(self, action: g.GroundSchema) -> Generated:
        self._begin()
        self._effects(action, [e for e in action.effects if e.target < 0], "s")
        self._end()
        return self._function("judged_action", ["s", "theta", "dt", "out"])

    def judged_aftermath(self) -> Generated:
        self._resume()
        self._judged_processes()
        self._events()
        self._finish("n")
        return self._function("judged_aftermath", ["s", "n", "flags", "theta", "dt", "out"])

    def _function(self, name: str, arguments: list[str]) -> Generated:
        if self.traced:
            arguments = [*arguments, "trace"]
        function = ast.FunctionDef(
            name=name,
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
        return Generated(name, tree, tuple(self.sites))

    def _begin(self) -> None:
        self.body += [
            assign("reward", constant(0.0)),
            assign("unsafe", constant(False)),
            assign("terminal", constant(False)),
        ]

    def _resume(self) -> None:
        """Emit: go on where a function that ended with `_end` has stopped."""
        self.body.append(assign("reward", entry("out", self.reward_slot)))
        for name, bit in _BITS:
            masked = ast.BinOp(variable("flags"), ast.BitAnd(), ast.Constant(bit))
            self.body.append(assign(name, ast.Compare(masked, [ast.NotEq()], [ast.Constant(0)])))

    def _end(self) -> None:
        """Emit: leave the reward in its slot, and return the flags."""
        flags: ast.expr = ast.Constant(APPLICABLE)
        for name, bit in _BITS:
            chosen = ast.IfExp(variable(name), ast.Constant(bit), ast.Constant(0))
            flags = ast.BinOp(flags, ast.BitOr(), chosen)
        self.body += [store(self.reward_slot, variable("reward")), ast.Return(flags)]

    def _finish(self, result: str) -> None:
        """Emit metric, goal and flags; metric and goal look at the next state, named `result`."""
        metric = self.model.metric
        if metric is not None:
            after = self.value(metric.value, result, elapsed=variable("dt"))
            before = self.value(metric.value, "s", elapsed=constant(0.0))
            pair = (after, before) if metric.maximize else (before, after)
            self.body.append(assign("reward", ast.BinOp(pair[0], ast.Sub(), pair[1])))
        if self.model.goal is not None:
            reached = [assign("terminal", constant(True))]
            if self.model.goal_rewarded:
                worth = self.model.goal_worth
                gained: ast.expr = constant(1.0)
                if worth is not None:
                    value = self.value(g.ParameterRef(worth.parameter), result)
                    gained = ast.BinOp(variable("reward"), ast.Add(), value)
                reached.append(assign("reward", gained))
            self.under(self.truth(self.model.goal, result, None), reached)
        self.require_finite(variable("reward"), Site("undefined", None, None))
        self._end()

    # Actions -----------------------------------------------------------------------------------

    def _actions(self) -> None:
        self._begin()
        if self.model.actions:
            self.body += self._search(0, len(self.model.actions))

    def _search(self, start: int, end: int) -> list[ast.stmt]:
        """Return a binary search over the position of the action."""
        outer = self.collect()
        if end - start == 1:
            self._action(self.model.actions[start])
        else:
            middle = (start + end) // 2
            before = ast.Compare(variable("a"), [ast.Lt()], [ast.Constant(middle)])
            left = self._search(start, middle) or [ast.Pass()]
            self.body.append(ast.If(before, left, self._search(middle, end)))
        branch, self.body = self.body, outer
        return branch

    def _action(self, action: g.GroundSchema) -> None:
        doubts = []
        for test in action.preconditions:
            certain, doubt = self.decide(test, "s")
            if doubt is not None:
                doubt = self.temporary(doubt)
                doubts.append((doubt, test))
                certain = joined(ast.Or(), [certain, doubt])
            self.refuse(negated(certain), Site("failed", action, test))
        for doubt, test in doubts:
            self.refuse(doubt, Site("undefined", action, test))
        self._effects(action, action.effects, "s")

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
        conditions = self._conditions(schema, ordered, source)
        prepared = []
        for effect in ordered:
            condition = conditions[id(effect.condition)]
            value = self.value(effect.value, source) if isinstance(effect, g.SetNumber) else None
            if keep:
                condition = self.temporary(condition) if condition is not None else None
                value = self.temporary(value) if value is not None else None
            prepared.append((effect, condition, value))
        self.body += [assign(f"kind{target}", ast.Constant(0)) for target in sorted(checked)]
        for effect, condition, value in prepared:
            outer = self.collect()
            if isinstance(effect, g.SetBoolean):
                self._set_boolean(effect)
            else:
                assert value is not None
                self._set_number(schema, effect, value, contested=effect.target in checked)
            self.body += self.report(Site("effect", schema, effect))
            statements, self.body = self.body, outer
            self.under(condition, statements)
        for target in sorted({e.target for e in numbers if e.target >= 0}):
            self.require_finite(entry("out", target), Site("undefined", schema, None))

    def _conditions(
        self, schema: g.GroundSchema, effects: Sequence[g.GroundEffect], source: str
    ) -> dict[int, ast.expr | None]:
        """Emit the conditions of effects, each once; return them by id, None where always true.

        Where one of them is undefined, those of `(unsafe)` that hold still count.
        """
        uses = Counter(id(effect.condition) for effect in effects)
        found: dict[int, ast.expr | None] = {}
        doubts: list[tuple[ast.expr, g.Test]] = []
        for effect in effects:
            test, key = effect.condition, id(effect.condition)
            if key in found:
                continue
            if isinstance(test, g.Constant) and test.value:
                found[key] = None
                continue
            certain, doubt = self.decide(test, source)
            if doubt is not None:
                doubts.append((self.temporary(doubt), test))
            found[key] = self.temporary(certain) if uses[key] > 1 else certain
        damaging = [found[id(e.condition)] for e in effects if e.target == g.UNSAFE_TARGET]
        if doubts and damaging:
            outer = self.collect()
            for condition in damaging:
                self.under(condition, [assign("unsafe", constant(True))])
            statements, self.body = self.body, outer
            self.under(joined(ast.Or(), [doubt for doubt, _ in doubts]), statements)
        for doubt, test in doubts:
            self.refuse(doubt, Site("undefined", schema, test))
        return found

    def _set_boolean(self, effect: g.SetBoolean) -> None:
        if effect.target in FLAG_NAMES:
            self.body.append(assign(FLAG_NAMES[effect.target], constant(effect.value)))
        else:
            self.body.append(store(effect.target, constant(1.0 if effect.value else 0.0)))

    def _set_number(
        self, schema: g.GroundSchema, effect: g.SetNumber, value: ast.expr, *, contested: bool
    ) -> None:
        kind = f"kind{effect.target}"
        group = _GROUP.get(effect.change, _SCALE)
        if contested:
            others = [k for k in (1, 2, _SCALE) if k != group]
            clash: ast.expr = ast.BoolOp(
                ast.Or(),
                [ast.Compare(variable(kind), [ast.Eq()], [ast.Constant(k)]) for k in others],
            )
            if group == 1:
                value = self.temporary(value)
                same_kind = ast.Compare(variable(kind), [ast.Eq()], [ast.Constant(1)])
                differs = ast.Compare(entry("out", effect.target), [ast.NotEq()], [value])
                both = ast.BoolOp(ast.And(), [same_kind, differs])
                clash = ast.BoolOp(ast.Or(), [clash, both])
            self.refuse(clash, Site("conflict", schema, effect))
            self.body.append(assign(kind, ast.Constant(group)))
        self._apply(effect, value)

    def _apply(self, effect: g.SetNumber, value: ast.expr) -> None:
        reward = effect.target == g.REWARD_TARGET
        old: ast.expr = variable("reward") if reward else entry("out", effect.target)
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
                new = self.quotient(old, value)
        self.body.append(assign("reward", new) if reward else store(effect.target, new))

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
            test = _conjunction(process)
            condition = None
            if test is not None:
                condition = self.temporary(self.truth(test, source, process))
            for effect in effects:
                rate = self.value(effect.value, source)
                change = self.temporary(ast.BinOp(variable("dt"), ast.Mult(), rate))
                prepared.append((process, effect, condition, change))
        for process, effect, condition, change in prepared:
            outer = self.collect()
            self._apply(effect, change)
            self.body += self.report(Site("rate", process, effect))
            statements, self.body = self.body, outer
            self.under(condition, statements)
        written = {(e.target, p) for p, e, _, _ in prepared if e.target >= 0}
        for target in sorted({target for target, _ in written}):
            process = next(p for p, e, _, _ in prepared if e.target == target)
            self.require_finite(entry("out", target), Site("undefined", process, None))

    def _events(self) -> None:
        events = self.model.events
        if _need_sweeps(events):
            names = [f"fired{k}" for k in range(len(events))]
            self.body += [assign(name, constant(False)) for name in names]
            self.body.append(assign("again", constant(True)))
            outer = self.collect()
            self.body.append(assign("again", constant(False)))
            for event, name in zip(events, names, strict=True):
                self._event(event, name)
            sweep, self.body = self.body, outer
            self.body.append(ast.While(variable("again"), sweep, []))
        else:
            for event in events:
                self._event(event, None)

    def _event(self, event: g.GroundSchema, fired: str | None) -> None:
        once = variable(fired) if fired is not None else None
        test = _conjunction(event)
        tests = [negated(once)] if once is not None else []
        if test is not None:
            tests.append(self.truth(test, "out", event, unless=once))
        outer = self.collect()
        if fired is not None:
            self.body += [assign(fired, constant(True)), assign("again", constant(True))]
        self._effects(event, event.effects, "out")
        statements, self.body = self.body or [ast.Pass()], outer
        self.under(joined(ast.And(), tests) if tests else None, statements)


def _conjunction(schema: g.GroundSchema) -> g.Test | None:
    """Return the whole precondition; None where it asks for nothing."""
    tests = schema.preconditions
    if len(tests) < 2:
        return tests[0] if tests else None
    return g.All(tests, schema.place)


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
