"""Compiling a ground model to the instruction table that `serp._core` executes.

Conditions are three-valued (Kleene's strong logic). A comparison with a side that is not a number
(a division by zero, a difference of two overflows) is undefined, and so is every condition whose
truth depends on it. The step then has no result: an action must not count as safe because NaN
compares as false. `traced_step.py` is the same semantics in readable form, and the oracle of this.

An operand of an instruction is a position in the frame: the memory that holds the control period,
flags, constants, θ, the state, its successor and intermediate results, see `program.hpp`. A
condition becomes jumps. A jump is written before its target is known: a label is the list of the
places to fill in.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.model import ground_model as g
from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED, UNSAFE
from serp.pddl.syntax import Change, nodes_in

# The codes of program.hpp. The beginning of the frame is that of program.cpp: the constants 0 to 3
# follow the flags.
(
    _RETURN, _COPY, _CLEAR, _MOVE, _ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _MIN, _MAX, _ATAN2,
    _NEGATE, _ABS, _SQRT, _SIN, _COS, _JUMP, _JUMP_IF, _JUMP_UNLESS, _IF_LESS, _IF_LESS_OR_EQUAL,
    _IF_EQUAL, _UNLESS_LESS, _UNLESS_LESS_OR_EQUAL, _UNLESS_EQUAL, _UNLESS_FINITE, _REPEAT,
) = range(27)  # fmt: skip
_ELAPSED, _UNSAFE, _TERMINAL, _ZERO, _ONE, _TWO, _THREE, _THETA = range(8)

_FLAGS: Final = {g.UNSAFE_TARGET: _UNSAFE, g.TERMINAL_TARGET: _TERMINAL}
_OPERATIONS: Final = {
    "+": _ADD, "-": _SUBTRACT, "*": _MULTIPLY, "/": _DIVIDE, "min": _MIN, "max": _MAX,
    "atan2": _ATAN2,
}  # fmt: skip
_UNARY: Final = {"-": _NEGATE, "abs": _ABS, "sqrt": _SQRT, "sin": _SIN, "cos": _COS}
_CHANGES: Final = {
    Change.INCREASE: _ADD, Change.DECREASE: _SUBTRACT, Change.SCALE_UP: _MULTIPLY,
    Change.SCALE_DOWN: _DIVIDE,
}  # fmt: skip
# Operator → code of a jump where it holds, whether the sides change places.
_COMPARISONS: Final = {
    "<": (_IF_LESS, False), "<=": (_IF_LESS_OR_EQUAL, False), "=": (_IF_EQUAL, False),
    ">": (_IF_LESS, True), ">=": (_IF_LESS_OR_EQUAL, True),
}  # fmt: skip
_NEGATED: Final = _UNLESS_LESS - _IF_LESS
# Operator → those that refute it. Where none of them holds, it holds or a side is NaN.
_REFUTATIONS: Final = {"<": (">=",), "<=": (">",), "=": ("<", ">"), ">=": ("<",), ">": ("<=",)}
# Of numbers that are not NaN these give a number, even of infinite ones.
_SELECTIONS: Final = ("min", "max", "atan2", "abs")
# Changes of one group commute; 0 is the group of a number that has not changed yet.
_GROUPS: Final = {"assign": _ONE, "add": _TWO, "scale": _THREE}

Label = list[int]


class InstructionTable(NamedTuple):
    """The arguments of `_core.Program`."""

    code: NDArray[np.uint32]
    entries: NDArray[np.uint32]
    fluents: int
    parameters: int
    intermediate: int
    first_chance: NDArray[np.uint32]
    chances: NDArray[np.float64]


def instruction_table(ground: g.GroundModel) -> InstructionTable:
    """Return the instruction table of a ground model."""
    return _Compiler(ground).table()


class _Compiler:
    """Writes instructions. Registers are taken as from a stack, see `scope`."""

    def __init__(self, ground: g.GroundModel) -> None:
        self.ground = ground
        self.next_state = _THETA + len(ground.parameters)
        self.out = self.next_state + len(ground.fluents)
        self.reward = self.out + len(ground.fluents)
        self.state = self.reward + 1  # differs from the others even where there is no fluent
        self.first = self.used = self.most = self.state + len(ground.fluents)
        self.rows: list[int] = []
        # Registers of both sides of a comparison that may be undefined, by its id.
        self.sides: dict[int, tuple[int, int]] = {}
        # Where these jumps lead, the step ends without a result.
        self.failed: Label = []
        self.undefined: Label = []

    def table(self) -> InstructionTable:
        """Compile all parts."""
        ground = self.ground
        # The actions, each with its likeliest effects, then all their other outcomes.
        schemas = [*ground.actions, *(a.as_outcome(k) for a in ground.actions
                                      for k in range(1, len(a.outcomes) + 1))]  # fmt: skip
        chances: list[float] = []
        first_chance = [0]
        for action in ground.actions:
            others = [outcome.probability for outcome in action.outcomes]
            chances += [1.0 - sum(others), *others]
            first_chance.append(len(chances))
        actions = [self._part(partial(self._act, action)) for action in schemas]
        unjudged = self._part()
        judged = [
            self._part(partial(self._judge, action))
            if any(effect.target < 0 for effect in action.effects)
            else unjudged
            for action in schemas
        ]
        drift = self._part(partial(self._rates, self.out, rewards=False))
        settle = self._part(self._events, partial(self._goal_and_metric, self.out))
        aftermath = self._part(
            partial(self._rates, self.next_state, rewards=True),
            self._events,
            partial(self._goal_and_metric, self.next_state),
        )
        self._place(self.failed)
        self._emit(_RETURN, 0, 0)
        self._place(self.undefined)
        self._emit(_RETURN, UNDEFINED, UNSAFE)
        return InstructionTable(
            code=np.array(self.rows, dtype=np.uint32).reshape(-1, 4),
            entries=np.array([drift, settle, aftermath, *actions, *judged], dtype=np.uint32),
            fluents=len(ground.fluents), parameters=len(ground.parameters),
            intermediate=self.most - self.first,
            first_chance=np.array(first_chance, dtype=np.uint32), chances=np.array(chances),
        )  # fmt: skip

    # Parts -------------------------------------------------------------------------------------

    def _part(self, *steps: Callable[[], None]) -> int:
        """Compile steps as a part that returns at its end; return where it begins."""
        start = self._here()
        for step in steps:
            step()
        self._emit(_RETURN, APPLICABLE, UNSAFE | TERMINAL)
        return start

    def _act(self, action: g.GroundSchema) -> None:
        with self.scope():
            tests = action.preconditions
            doubtful = [self._evaluate_sides(test, self.state) for test in tests]
            for test, may_be_undefined in zip(tests, doubtful, strict=True):
                self._jump(test, self.state, False, self.failed, possible=may_be_undefined)
            for test, may_be_undefined in zip(tests, doubtful, strict=True):
                if may_be_undefined:
                    self._jump(test, self.state, False, self.undefined)
            self._emit(_COPY)
            self._effects(action.effects, self.state)

    def _judge(self, action: g.GroundSchema) -> None:
        """Compile what an action does to reward and flags; nothing where it is inapplicable."""
        end = Label()
        with self.scope():
            for test in action.preconditions:
                self._evaluate_sides(test, self.state)
                self._jump(test, self.state, False, end)
            self._effects([effect for effect in action.effects if effect.target < 0], self.state)
        self._place(end)

    def _events(self) -> None:
        events = self.ground.events
        if not enabling_earlier(events):
            for event in events:
                with self._where(g.All(event.preconditions, event.place), self.out):
                    self._effects(event.effects, self.out)
            return
        with self.scope():
            again = self._register()
            fired = [self._register() for _ in events]
            self._emit(_CLEAR, fired[0], fired[-1])
            begin = self._here()
            self._emit(_MOVE, again, _ZERO)
            enabling = enabling_earlier(events)
            for k, event in enumerate(events):
                with self._where(g.All(event.preconditions, event.place), self.out, fired[k]):
                    self._emit(_MOVE, fired[k], _ONE)
                    if k in enabling:
                        self._emit(_MOVE, again, _ONE)
                    self._effects(event.effects, self.out)
            self._emit(_REPEAT, again, 0, begin)

    def _goal_and_metric(self, result: int) -> None:
        """Compile metric and goal, which read the next state from the memory `result`."""
        ground = self.ground
        if ground.metric is not None:
            with self.scope():
                after = self._value(ground.metric.value, result)
                before = self._value(ground.metric.value, self.state, elapsed=_ZERO)
                gain = (after, before) if ground.metric.maximize else (before, after)
                self._emit(_SUBTRACT, self.reward, *gain)
        if ground.goal is not None:
            with self._where(ground.goal, result):
                self._emit(_MOVE, _TERMINAL, _ONE)
                if ground.goal_rewarded and ground.goal_parameter is None:
                    self._emit(_MOVE, self.reward, _ONE)
                elif ground.goal_rewarded:
                    worth = _THETA + ground.goal_parameter  # type: ignore[operator]
                    self._emit(_ADD, self.reward, self.reward, worth)
        self._require_finite(self.reward)

    # Effects -----------------------------------------------------------------------------------

    def _effects(self, effects: Sequence[g.GroundEffect], source: int) -> None:
        """Compile effects that are all evaluated before any is applied.

        An action reads the state and writes `out`, so nothing that it reads changes in between. An
        event reads what it writes and keeps conditions and values in registers.
        """
        numbers = [e for e in effects if isinstance(e, g.SetNumber)]
        booleans = [e for e in effects if isinstance(e, g.SetBoolean)]
        booleans.sort(key=lambda e: e.value)  # delete before add (PDDL 2.1, definition 9)
        ordered: list[g.GroundEffect] = [*booleans, *numbers]
        keep = source == self.out and len(effects) > 1
        with self.scope():
            conditions = self._conditions(ordered, source, keep)
            values: dict[int, int] = {}
            if keep:
                for number in numbers:
                    fixed = isinstance(number.value, g.ParameterRef)
                    register = None if fixed else self._register()
                    values[id(number)] = self._value(number.value, source, register)
            groups = {target: self._register() for target in contested(numbers)}
            for register in groups.values():
                self._emit(_MOVE, register, _ZERO)
            for effect in ordered:
                end = Label()
                condition = conditions.get(id(effect.condition))
                if condition is not None:
                    self._branch(_JUMP_UNLESS, end, condition)
                elif not _always(effect.condition):
                    self._jump(effect.condition, source, False, end)
                if isinstance(effect, g.SetBoolean):
                    target = _FLAGS.get(effect.target, self.out + effect.target)
                    self._emit(_MOVE, target, _ONE if effect.value else _ZERO)
                else:
                    self._change(effect, source, values.get(id(effect)), groups)
                self._place(end)
        calculated = {
            e.target
            for e in numbers
            if not (e.change is Change.ASSIGN and isinstance(e.value, g.ParameterRef))
        }
        for fluent in sorted(calculated):
            if fluent >= 0:
                self._require_finite(self.out + fluent)

    def _conditions(
        self, effects: Sequence[g.GroundEffect], source: int, keep: bool
    ) -> dict[int, int]:
        """Evaluate conditions of effects, each once; return their registers by id.

        Without a register are those that always hold, and those that one effect has alone, if that
        can be evaluated where it is applied. Where a condition is undefined, the effects on
        `(unsafe)` whose conditions hold still count.
        """
        uses = Counter(id(effect.condition) for effect in effects)
        tests = {id(e.condition): e.condition for e in effects if not _always(e.condition)}
        registers: dict[int, int] = {}
        doubtful = []
        for key, test in tests.items():
            may_be_undefined = self._evaluate_sides(test, source)
            if may_be_undefined:
                doubtful.append(test)
            if may_be_undefined or keep or uses[key] > 1:
                registers[key] = self._truth(test, source)
        if doubtful:
            damaging = [e.condition for e in effects if e.target == g.UNSAFE_TARGET]
            doubt = Label() if damaging else self.undefined
            for test in doubtful:
                certain = Label()
                self._branch(_JUMP_IF, certain, registers[id(test)])
                self._jump(test, source, True, doubt, possible=True)
                self._place(certain)
            if damaging:
                over = Label()
                self._branch(_JUMP, over)
                self._place(doubt)
                for test in damaging:
                    skip = Label()
                    self._jump(test, source, False, skip)
                    self._emit(_MOVE, _UNSAFE, _ONE)
                    self._place(skip)
                self._branch(_JUMP, self.undefined)
                self._place(over)
        return registers

    def _change(
        self, effect: g.SetNumber, source: int, value: int | None, groups: dict[int, int]
    ) -> None:
        """Compile a change of a number by a value, which is evaluated here if it is None."""
        target = self.reward if effect.target == g.REWARD_TARGET else self.out + effect.target
        with self.scope():
            if effect.target in groups:
                if value is None:
                    value = self._value(effect.value, source)
                self._refuse_conflict(effect, value, groups[effect.target])
            if effect.change is not Change.ASSIGN:
                operand = self._value(effect.value, source) if value is None else value
                self._emit(_CHANGES[effect.change], target, target, operand)
            elif value is None:
                self._value(effect.value, source, target)
            else:
                self._emit(_MOVE, target, value)

    def _refuse_conflict(self, effect: g.SetNumber, value: int, register: int) -> None:
        """End the step where another effect contradicts this one."""
        group = effect.change.group
        for other, code in _GROUPS.items():
            if other != group:
                self._branch(_IF_EQUAL, self.undefined, register, code)
        own = _GROUPS[group]
        if group == "assign":
            first = Label()
            self._branch(_UNLESS_EQUAL, first, register, own)
            self._branch(_UNLESS_EQUAL, self.undefined, self.out + effect.target, value)
            self._place(first)
        self._emit(_MOVE, register, own)

    def _rates(self, source: int, *, rewards: bool) -> None:
        """Compile one explicit Euler step: every rate is evaluated before any is applied.

        With `rewards`, only changes of the reward are compiled.
        """
        prepared: list[tuple[g.SetNumber, int | None, int]] = []
        with self.scope():
            for process in self.ground.processes:
                effects = [e for e in process.effects if isinstance(e, g.SetNumber)]
                if rewards:
                    effects = [e for e in effects if e.target == g.REWARD_TARGET]
                if not effects:
                    continue
                condition = None
                if process.preconditions:
                    condition = self._register()
                    self._emit(_MOVE, condition, _ZERO)
                    with self._where(g.All(process.preconditions, process.place), source):
                        self._emit(_MOVE, condition, _ONE)
                for effect in effects:
                    change = self._register()
                    with self.scope():
                        rate = self._value(effect.value, source)
                        self._emit(_MULTIPLY, change, _ELAPSED, rate)
                    prepared.append((effect, condition, change))
            for effect, condition, change in prepared:
                end = Label()
                if condition is not None:
                    self._branch(_JUMP_UNLESS, end, condition)
                self._change(effect, source, change, {})
                self._place(end)
        for fluent in sorted({effect.target for effect, _, _ in prepared if effect.target >= 0}):
            self._require_finite(self.out + fluent)

    def _require_finite(self, operand: int) -> None:
        self._branch(_UNLESS_FINITE, self.undefined, operand)

    # Conditions --------------------------------------------------------------------------------

    @contextmanager
    def _where(self, test: g.Test, source: int, unless: int | None = None) -> Iterator[None]:
        """Execute what is compiled within where a condition holds; end where it is undefined.

        Where the register `unless` is set, the condition is irrelevant.
        """
        end = Label()
        with self.scope():
            if self._evaluate_sides(test, source):
                holds = Label()
                if unless is not None:
                    self._branch(_JUMP_IF, end, unless)
                self._jump(test, source, True, holds)
                self._jump(test, source, True, self.undefined, possible=True)
                self._branch(_JUMP, end)
                self._place(holds)
            else:
                self._jump(test, source, False, end)
                if unless is not None:
                    self._branch(_JUMP_IF, end, unless)
            yield
        self._place(end)

    def _truth(self, test: g.Test, source: int) -> int:
        """Return a register that is 1 where a condition certainly holds, else 0."""
        register, end = self._register(), Label()
        self._emit(_MOVE, register, _ZERO)
        self._jump(test, source, False, end)
        self._emit(_MOVE, register, _ONE)
        self._place(end)
        return register

    def _evaluate_sides(self, test: g.Test, source: int) -> bool:
        """Return whether a condition may be undefined; evaluate what that depends on once."""
        doubtful = [
            c for c in g.comparisons_of(test) if _may_be_nan(c.left) or _may_be_nan(c.right)
        ]
        for comparison in doubtful:
            left = self._value(comparison.left, source)
            self.sides[id(comparison)] = left, self._value(comparison.right, source)
        return bool(doubtful)

    def _jump(
        self, test: g.Test, source: int, wanted: bool, label: Label, *, possible: bool = False
    ) -> None:
        """Jump where the truth value is `wanted`: of certainly, or of possibly (or undefined)."""
        match test:
            case g.Constant(value):
                if value == wanted:
                    self._branch(_JUMP, label)
            case g.Holds(fluent):
                if fluent >= 0:
                    self._branch(_JUMP_IF if wanted else _JUMP_UNLESS, label, source + fluent)
                elif source != self.state:
                    self._branch(_JUMP_IF if wanted else _JUMP_UNLESS, label, _FLAGS[fluent])
                elif not wanted:  # before the action, both flags are false
                    self._branch(_JUMP, label)
            case g.Compare():
                self._jump_compared(test, source, wanted, label, possible)
            case g.Not(operand):
                self._jump(operand, source, not wanted, label, possible=not possible)
            case g.All(operands) | g.AnyOf(operands):
                decides = isinstance(test, g.AnyOf)
                skip = label if wanted == decides else Label()
                for operand in operands[:-1]:
                    self._jump(operand, source, decides, skip, possible=possible)
                if operands:
                    self._jump(operands[-1], source, wanted, label, possible=possible)
                elif wanted != decides:  # the empty conjunction holds
                    self._branch(_JUMP, label)
                if skip is not label:
                    self._place(skip)

    def _jump_compared(
        self, test: g.Compare, source: int, wanted: bool, label: Label, possible: bool
    ) -> None:
        with self.scope():
            sides = self.sides.get(id(test))
            if sides is None:
                sides = self._value(test.left, source), self._value(test.right, source)
                possible = False
            if not possible:
                self._compare(test.operator, sides, wanted, label)
            elif not wanted:
                for operator in _REFUTATIONS[test.operator]:
                    self._compare(operator, sides, True, label)
            else:
                skip, (*first, last) = Label(), _REFUTATIONS[test.operator]
                for operator in first:
                    self._compare(operator, sides, True, skip)
                self._compare(last, sides, False, label)
                self._place(skip)

    def _compare(self, operator: str, sides: tuple[int, int], wanted: bool, label: Label) -> None:
        code, swapped = _COMPARISONS[operator]
        left, right = reversed(sides) if swapped else sides
        self._branch(code if wanted else code + _NEGATED, label, left, right)

    # Numbers -----------------------------------------------------------------------------------

    def _value(
        self, value: g.Value, source: int, into: int | None = None, elapsed: int = _ELAPSED
    ) -> int:
        """Compile a number; return the operand that it is, or `into`, to which it is written."""
        match value:
            case g.Read(fluent):
                operand = source + fluent
            case g.ParameterRef(parameter):
                operand = _THETA + parameter
            case g.Elapsed():
                operand = elapsed
            case g.Unary(operator, inner):
                with self.scope():
                    one = self._value(inner, source, elapsed=elapsed)
                operand = self._register() if into is None else into
                self._emit(_UNARY[operator], operand, one)
                return operand
            case g.Operation(operator, left, right):
                with self.scope():
                    one = self._value(left, source, elapsed=elapsed)
                    other = self._value(right, source, elapsed=elapsed)
                operand = self._register() if into is None else into
                self._emit(_OPERATIONS[operator], operand, one, other)
                return operand
        if into is None:
            return operand
        self._emit(_MOVE, into, operand)
        return into

    # Instructions ------------------------------------------------------------------------------

    def _emit(self, code: int, a: int = 0, b: int = 0, c: int = 0) -> None:
        self.rows += (code, a, b, c)

    def _branch(self, code: int, label: Label, a: int = 0, b: int = 0) -> None:
        self.rows += (code, a, b, 0)
        label.append(len(self.rows) - 1)

    def _here(self) -> int:
        return len(self.rows) // 4

    def _place(self, label: Label) -> None:
        """Let the jumps to a label lead here."""
        here = len(self.rows) // 4
        for place in label:
            self.rows[place] = here

    def _register(self) -> int:
        register = self.used
        self.used += 1
        self.most = max(self.most, self.used)
        return register

    @contextmanager
    def scope(self) -> Iterator[None]:
        """Free the registers that are taken within."""
        used = self.used
        yield
        self.used = used


def _always(test: g.Test) -> bool:
    return isinstance(test, g.Constant) and test.value


def contested(effects: Sequence[g.SetNumber]) -> set[int]:
    """Return the targets whose effects can contradict each other.

    Increases and decreases commute, and so do scalings. An assignment together with another
    effect, or a mixture of both kinds, has no defined result (PDDL 2.1, definition 8).
    """
    groups: dict[int, list[str]] = {}
    for effect in effects:
        groups.setdefault(effect.target, []).append(effect.change.group)
    return {t for t, of in groups.items() if len(set(of)) > 1 or of.count("assign") > 1}


def enabling_earlier(events: Sequence[g.GroundSchema]) -> set[int]:
    """Return which events can enable one before it: after these, one pass is not enough."""
    read_before: set[int] = set()
    enabling = set()
    for k, event in enumerate(events):
        if g.writes(event) & read_before:
            enabling.add(k)
        read_before.update(g.fluents_of(event.preconditions))
    return enabling


def _may_be_nan(value: g.Value) -> bool:
    """Whether an expression over finite numbers can be NaN.

    One sum or product of finite numbers can overflow. NaN arises only from a further operation on
    that, from a division by zero, or from a root of a negative number.
    """
    calculated = [
        node.operator
        for node in nodes_in(value)
        if isinstance(node, g.Operation | g.Unary) and node.operator not in _SELECTIONS
    ]
    return len(calculated) > 1 or not {"/", "sqrt"}.isdisjoint(calculated)
