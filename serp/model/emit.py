"""Writing conditions and numbers as expressions of the generated code.

Conditions are three-valued (Kleene's strong logic). A comparison with a side that is not a number
(a division by zero, a difference of two overflows) is undefined, and so is every condition whose
truth depends on it. The step then has no result (`Emitter.truth`): an action must not count as safe
because NaN compares as false.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

from serp.model import ground_model as g
from serp.model.flags import UNDEFINED, UNSAFE
from serp.model.traced_step import Passage as Passage
from serp.model.traced_step import Site
from serp.pddl.syntax import Change

FLAG_NAMES = {g.UNSAFE_TARGET: "unsafe", g.TERMINAL_TARGET: "terminal"}
# Where every one of these is false, the comparison holds or a side is NaN.
_REFUTATIONS = {"<": (">=",), "<=": (">",), "=": ("<", ">"), ">=": ("<",), ">": ("<=",)}
_CHAINED = {"+": "+-", "-": "+-", "*": "*", "/": ""}
"""Operator → those of a left operand that needs no parentheses."""
_SIMPLE = re.compile(r"\w+(\[\d+\])?")
_NAN = "(1e999 - 1e999)"
_QUOTIENT = f"({{0}} / {{1}} if {{1}} != 0.0 else {_NAN})"
# Without a library where it can be done, and without an exception. NaN gives NaN.
_APPLIED = {
    "abs": "({0} if {0} > 0.0 else 0.0 - {0})",
    "min": "({0} if {0} < {1} or {0} != {0} else {1})",
    "max": "({0} if {0} > {1} or {0} != {0} else {1})",
    "sqrt": f"(sqrt({{0}}) if {{0}} >= 0.0 else {_NAN})",
    "sin": f"(sin({{0}}) if {{0}} - {{0}} == 0.0 else {_NAN})",
    "cos": f"(cos({{0}}) if {{0}} - {{0}} == 0.0 else {_NAN})",
    "atan2": "atan2({0}, {1})",
}
"""Operator → an expression of its operands, which are variables or entries of arrays."""


def joined(operator: str, tests: Sequence[str]) -> str:
    """Join tests by `and` or `or`."""
    return tests[0] if len(tests) == 1 else f"({f' {operator} '.join(tests)})"


def block(head: str, statements: Sequence[str]) -> list[str]:
    """Return the lines of a compound statement."""
    return [head, *(f" {line}" for line in statements or ["pass"])]


class Emitter:
    """Collects statements, and writes conditions and numbers as expressions over arrays.

    Where `traced`, the code reports the sites that it passes.
    """

    def __init__(self, *, traced: bool) -> None:
        self.traced = traced
        self.sites: list[Site] = []
        self.body: list[str] = []
        self._temporaries = 0
        self._sides: dict[int, tuple[str, str]] = {}

    # Statements --------------------------------------------------------------------------------

    def temporary(self, value: str) -> str:
        """Assign a value to a new variable and return it."""
        identifier = f"t{self._temporaries}"
        self._temporaries += 1
        self.body.append(f"{identifier} = {value}")
        return identifier

    @contextmanager
    def collected(self) -> Iterator[list[str]]:
        """Collect the statements emitted within the context in a separate list."""
        outer, self.body = self.body, []
        yield self.body
        self.body = outer

    @contextmanager
    def under(self, condition: str | None) -> Iterator[None]:
        """Put the statements emitted within the context under a condition; None: always true."""
        with self.collected() as statements:
            yield
        self.body += statements if condition is None else block(f"if {condition}:", statements)

    def report(self, site: Site) -> list[str]:
        """Return the statements that report a site; none unless traced."""
        if not self.traced:
            return []
        self.sites.append(site)
        return [f"trace.append(({len(self.sites) - 1}, {self.gained()}, out[:]))"]

    def gained(self) -> str:
        """Return the expression of the reward of the step so far."""
        return "reward"

    def refuse(self, test: str, site: Site) -> None:
        """Emit: where `test` is true, the step has no result.

        A failed precondition sets no flag. Everything else sets UNDEFINED, and UNSAFE where that is
        certain by then: a step that cannot be predicted must not count as safe.
        """
        flags = "0" if site.what == "failed" else f"{UNDEFINED} | ({UNSAFE} if unsafe else 0)"
        self.body += block(f"if {test}:", [*self.report(site), f"return {flags}"])

    def require_finite(self, value: str, site: Site) -> None:
        """Emit: where a value is NaN or infinite, the step has no result."""
        # x - x is 0 for every finite x, and NaN for the others.
        self.refuse(f"{value} - {value} != 0.0", site)

    # Conditions --------------------------------------------------------------------------------

    def truth(
        self, test: g.Test, source: str, schema: g.GroundSchema | None, unless: str | None = None
    ) -> str:
        """Emit code that ends the step where a condition is undefined; return its truth value.

        Where `unless` is true, the condition is irrelevant.
        """
        certain, doubt = self.decide(test, source, unless)
        if doubt is not None:
            self.refuse(doubt, Site("undefined", schema, test))
        return certain

    def decide(
        self, test: g.Test, source: str, unless: str | None = None
    ) -> tuple[str, str | None]:
        """Return whether a condition is true, and whether it is undefined (None: it never is)."""
        if not _may_be_undefined(test):
            return self._certain(test, source), None
        for comparison in g.comparisons_of(test):
            if _may_be_nan(comparison.left) or _may_be_nan(comparison.right):
                left = self.temporary(self.value(comparison.left, source))
                right = self.temporary(self.value(comparison.right, source))
                self._sides[id(comparison)] = left, right
        certain = self.temporary(self._certain(test, source))
        doubts = [] if unless is None else [f"not {unless}"]
        doubts += [self._possible(test, source), f"not {certain}"]
        self._sides.clear()
        return certain, joined("and", doubts)

    def _certain(self, test: g.Test, source: str) -> str:
        """Return whether a condition is certainly true: neither false nor undefined."""
        match test:
            case g.Constant(value):
                return str(value)
            case g.Holds(fluent):
                if fluent in FLAG_NAMES:  # before the action, both are false
                    return "False" if source == "s" else FLAG_NAMES[fluent]
                return f"{source}[{fluent}] != 0.0"
            case g.Compare(operator):
                left, right = self._compared(test, source)
                return f"{left} {'==' if operator == '=' else operator} {right}"
            case g.Not(operand):
                return f"not {self._possible(operand, source)}"
            case g.All(operands):
                return joined("and", [self._certain(o, source) for o in operands])
            case g.AnyOf(operands):
                return joined("or", [self._certain(o, source) for o in operands])

    def _possible(self, test: g.Test, source: str) -> str:
        """Return whether a condition is possibly true: true or undefined."""
        match test:
            case g.Compare(operator) if id(test) in self._sides:
                left, right = self._sides[id(test)]
                refuted = [f"{left} {against} {right}" for against in _REFUTATIONS[operator]]
                return f"not {joined('or', refuted)}"
            case g.Not(operand):
                return f"not {self._certain(operand, source)}"
            case g.All(operands):
                return joined("and", [self._possible(o, source) for o in operands])
            case g.AnyOf(operands):
                return joined("or", [self._possible(o, source) for o in operands])
            case _:
                return self._certain(test, source)

    def _compared(self, test: g.Compare, source: str) -> tuple[str, str]:
        """Return both sides of a comparison, evaluated once where they may be NaN."""
        if id(test) in self._sides:
            return self._sides[id(test)]
        return self.value(test.left, source), self.value(test.right, source)

    # Numbers -----------------------------------------------------------------------------------

    def value(self, value: g.Value, source: str, elapsed: str = "dt") -> str:
        """Return a numeric expression over the array `source`; NaN where it has no result."""
        match value:
            case g.Read(fluent):
                return f"{source}[{fluent}]"
            case g.ParameterRef(parameter):
                return f"theta[{parameter}]"
            case g.Elapsed():
                return elapsed
            case g.Unary("-", operand):
                return f"-{self.value(operand, source, elapsed)}"
            case g.Unary(operator, operand):
                return self._applied(operator, self.value(operand, source, elapsed))
            case g.Operation(operator, left, right):
                one, other = (self.value(side, source, elapsed) for side in (left, right))
                if operator == "/":
                    return self.quotient(one, other)
                if operator not in _CHAINED:
                    return self._applied(operator, one, other)
                if isinstance(left, g.Operation) and left.operator in _CHAINED[operator]:
                    one = one[1:-1]
                return f"({one} {operator} {other})"

    def quotient(self, dividend: str, divisor: str) -> str:
        """Divide without an exception: a division by zero gives NaN."""
        return _QUOTIENT.format(dividend, self._named(divisor))

    def _applied(self, operator: str, *operands: str) -> str:
        return _APPLIED[operator].format(*map(self._named, operands))

    def _named(self, value: str) -> str:
        """Return a value that may occur several times: a variable, unless it is simple."""
        return value if _SIMPLE.fullmatch(value) else self.temporary(value)


def _may_be_undefined(test: g.Test) -> bool:
    return any(_may_be_nan(c.left) or _may_be_nan(c.right) for c in g.comparisons_of(test))


def _may_be_nan(value: g.Value) -> bool:
    """Whether an expression over finite numbers can be NaN.

    One sum or product of finite numbers can overflow. NaN arises only from an operation on an
    overflowed value, from a division by zero, or from a root of a negative number.
    """
    match value:
        case g.Operation("min" | "max" | "atan2", left, right):
            return _may_be_nan(left) or _may_be_nan(right)
        case g.Operation(operator, left, right):
            return operator == "/" or _may_overflow(left) or _may_overflow(right)
        case g.Unary("-" | "abs", operand):
            return _may_be_nan(operand)
        case g.Unary(operator, operand):
            return operator == "sqrt" or _may_overflow(operand)
        case _:
            return False


def _may_overflow(value: g.Value) -> bool:
    """Whether an expression over finite numbers can be infinite or NaN."""
    match value:
        case g.Operation("min" | "max" | "atan2", left, right):
            return _may_overflow(left) or _may_overflow(right)
        case g.Unary(operator, operand):
            return operator == "sqrt" or _may_overflow(operand)
        case _:
            return isinstance(value, g.Operation)


# Changes of one group commute; 0 is the group of a number that has not changed yet.
_KINDS = {"assign": 1, "add": 2, "scale": 3}
_OPERATORS = {Change.INCREASE: "+", Change.DECREASE: "-", Change.SCALE_UP: "*"}


class EffectEmitter(Emitter):
    """Emits effects as statements that change `out`, `reward`, `unsafe` and `terminal`."""

    def effects(
        self, schema: g.GroundSchema, effects: Sequence[g.GroundEffect], source: str
    ) -> None:
        """Emit effects that are all evaluated before any is applied.

        An action reads `s` and writes `out`, so nothing that it reads changes in between. An event
        reads what it writes and keeps conditions and values in temporaries.
        """
        numbers = [e for e in effects if isinstance(e, g.SetNumber)]
        booleans = [e for e in effects if isinstance(e, g.SetBoolean)]
        booleans.sort(key=lambda e: e.value)  # delete before add (PDDL 2.1, definition 9)
        contested = _contested(numbers)
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
        self.body += [f"kind{target} = 0" for target in sorted(contested)]
        for effect, condition, value in prepared:
            with self.under(condition):
                if isinstance(effect, g.SetBoolean):
                    self._set_boolean(effect)
                else:
                    assert value is not None
                    if effect.target in contested:
                        value = self._refuse_conflict(schema, effect, value)
                    self._set_number(effect, value)
                self.body += self.report(Site("effect", schema, effect))
        for target in sorted({e.target for e in numbers if e.target >= 0}):
            self.require_finite(f"out[{target}]", Site("undefined", schema, None))

    def rates(self, processes: Iterable[g.GroundSchema], source: str, *, rewards: bool) -> None:
        """Emit one explicit Euler step: every rate is evaluated before any is applied.

        With `rewards`, only changes of the reward are emitted.
        """
        prepared = []
        for process in processes:
            effects = [e for e in process.effects if isinstance(e, g.SetNumber)]
            if rewards:
                effects = [e for e in effects if e.target == g.REWARD_TARGET]
            if not effects:
                continue
            test = conjunction(process)
            condition = None
            if test is not None:
                condition = self.temporary(self.truth(test, source, process))
            for effect in effects:
                rate = self.value(effect.value, source)
                change = self.temporary(f"dt * {rate}")
                prepared.append((process, effect, condition, change))
        for process, effect, condition, change in prepared:
            with self.under(condition):
                self._set_number(effect, change)
                self.body += self.report(Site("rate", process, effect))
        first = {effect.target: process for process, effect, _, _ in reversed(prepared)}
        for target in sorted(t for t in first if t >= 0):
            self.require_finite(f"out[{target}]", Site("undefined", first[target], None))

    def _conditions(
        self, schema: g.GroundSchema, effects: Sequence[g.GroundEffect], source: str
    ) -> dict[int, str | None]:
        """Emit the conditions of effects, each once; return them by id, None where always true.

        Where one of them is undefined, the effects on `(unsafe)` whose conditions hold still count.
        """
        uses = Counter(id(effect.condition) for effect in effects)
        found: dict[int, str | None] = {}
        doubts: list[tuple[str, g.Test]] = []
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
            with self.under(joined("or", [doubt for doubt, _ in doubts])):
                for condition in damaging:
                    with self.under(condition):
                        self.body.append("unsafe = True")
        for doubt, test in doubts:
            self.refuse(doubt, Site("undefined", schema, test))
        return found

    def _set_boolean(self, effect: g.SetBoolean) -> None:
        if effect.target in FLAG_NAMES:
            self.body.append(f"{FLAG_NAMES[effect.target]} = {effect.value}")
        else:
            self.body.append(f"out[{effect.target}] = {float(effect.value)}")

    def _refuse_conflict(self, schema: g.GroundSchema, effect: g.SetNumber, value: str) -> str:
        """Emit code that ends the step where another effect contradicts this one."""
        kind, group = f"kind{effect.target}", effect.change.group
        clashes = [f"{kind} == {code}" for other, code in _KINDS.items() if other != group]
        if group == "assign":
            value = self.temporary(value)
            clashes.append(f"({kind} == {_KINDS[group]} and out[{effect.target}] != {value})")
        self.refuse(joined("or", clashes), Site("conflict", schema, effect))
        self.body.append(f"{kind} = {_KINDS[group]}")
        return value

    def _set_number(self, effect: g.SetNumber, value: str) -> None:
        target = "reward" if effect.target == g.REWARD_TARGET else f"out[{effect.target}]"
        if effect.change is Change.SCALE_DOWN:
            value = self.quotient(target, value)
        elif effect.change is not Change.ASSIGN:
            value = f"{target} {_OPERATORS[effect.change]} {value}"
        self.body.append(f"{target} = {value}")


def conjunction(schema: g.GroundSchema) -> g.Test | None:
    """Return the whole precondition; None where there is none."""
    tests = schema.preconditions
    if len(tests) < 2:
        return tests[0] if tests else None
    return g.All(tests, schema.place)


def _contested(effects: Sequence[g.SetNumber]) -> set[int]:
    """Return the targets whose effects can contradict each other.

    Increases and decreases commute, and so do scalings. An assignment together with another
    effect, or a mixture of both kinds, has no defined result (PDDL 2.1, definition 8).
    """
    groups: dict[int, list[str]] = {}
    for effect in effects:
        groups.setdefault(effect.target, []).append(effect.change.group)
    return {t for t, of in groups.items() if len(set(of)) > 1 or of.count("assign") > 1}
