"""The functions of the transition model, rebuilt from syntax trees that are stored as data.

A tree is JSON: a number or truth value, or a list whose first item says what it is. Names and
positions are checked, so that a tree can be nothing but arithmetic on the arrays of a step; no text
becomes program text.

Statements are `["set", target, value]`, `["when", test, statements]`, `["while", test, statements]`
and `["return", value]`. Values are `["at", array, position]`, `["var", name]`, `["choose", test,
value, value]`, `["inf"]`, and operators and functions with their operands. A body ends with a
return; those before it give flags without `APPLICABLE`, so that bodies can follow one another in
one function.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Sequence
from typing import Any

from .reading import Entry

Function = Callable[..., Any]

_VARIABLE = re.compile(r"(t|kind|fired)\d{1,9}|reward|unsafe|terminal|again|flags|dt")
_APPLICABLE = 1
_BINARY: dict[str, Any] = {
    "+": ast.Add, "-": ast.Sub, "*": ast.Mult, "/": ast.Div, "|": ast.BitOr, "&": ast.BitAnd,
}  # fmt: skip
_COMPARISON: dict[str, tuple[Any, Callable[[Any, Any], bool]]] = {
    "<": (ast.Lt, operator.lt), "<=": (ast.LtE, operator.le), "==": (ast.Eq, operator.eq),
    ">": (ast.Gt, operator.gt), ">=": (ast.GtE, operator.ge), "!=": (ast.NotEq, operator.ne),
}  # fmt: skip
FUNCTIONS: dict[str, tuple[int, Callable[..., float]]] = {
    **{"sqrt": (1, math.sqrt), "sin": (1, math.sin), "cos": (1, math.cos)},
    "atan2": (2, math.atan2),
}
"""Name → number of operands, and the function."""


class Parameters:
    """What the trees of a model may read beside the state; its numbers become constants of code.

    Attributes:
        width: Length of a state.
        theta: Parameters.
        dt: Control period.
    """

    def __init__(self, policy: Entry, theta: Sequence[float]) -> None:
        self.width = len(policy["fluents"].items())
        self.theta = [float(value) for value in theta]
        self.dt = policy["dt"].number()


def make_function(
    arguments: Sequence[str], parts: Sequence[Entry], parameters: Parameters
) -> Function:
    """Return the function that carries out bodies, one after the other.

    Its arguments are the state `s` alone, or `s`, `flags` and what was computed so far, `out`. It
    returns a new `out`, the next state followed by the reward, and the flags.

    Raises:
        ControllerError: A body is not what the module describes.
    """
    builder = _LocalsBuilder(parameters)
    functions = {name: function for name, (_, function) in FUNCTIONS.items()}
    body = builder.begin(arguments[-1])
    for part in parts:
        body += body_of(part, builder)
    return compiled_function(arguments, [*body, builder.end()], functions, parts[-1])


def body_of(part: Entry, builder: TreeBuilder) -> list[ast.stmt]:
    """Return the statements of a body.

    Raises:
        ControllerError: It is not what the module describes; the message names it.
    """
    try:
        return builder.function(part.value)
    except (TypeError, ValueError, IndexError, RecursionError) as error:
        raise part.wrong(str(error)) from None


def compiled_function(
    arguments: Sequence[str], body: list[ast.stmt], names: dict[str, Any], part: Entry
) -> Function:
    """Return the function with a body; it reaches these names and no builtins."""
    given = ast.arguments(
        posonlyargs=[], args=[ast.arg(name) for name in arguments], kwonlyargs=[], kw_defaults=[],
        defaults=[],
    )  # fmt: skip
    function = ast.FunctionDef(
        name="function", args=given, body=body, decorator_list=[], lineno=1, col_offset=0
    )
    if "type_params" in ast.FunctionDef._fields:  # from Python 3.12 on
        function.type_params = []  # type: ignore[attr-defined, unused-ignore]
    module = ast.fix_missing_locations(ast.Module(body=[function], type_ignores=[]))
    try:
        code = compile(module, "<policy>", "exec")
    except (TypeError, ValueError, SyntaxError, RecursionError) as error:
        raise part.wrong(str(error)) from None
    namespace: dict[str, Any] = {"__builtins__": {}, **names}
    exec(code, namespace)
    made: Function = namespace["function"]
    return made


class TreeBuilder:
    """Builds syntax trees; whatever is not known raises one of the errors that `body_of` tells."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self.known: set[str] = set()
        """Variables that were set."""
        self._sizes = {"s": parameters.width, "out": parameters.width + 1}

    def function(self, statements: Any) -> list[ast.stmt]:
        """Return a body; it ends with the flags."""
        if not isinstance(statements, list) or not statements or statements[-1][0] != "return":
            raise ValueError("a body must end with a return")
        *others, (_, flags) = statements
        return [*self.block(others), *self.last(self.value(flags))]

    def block(self, statements: Any) -> list[ast.stmt]:
        """Return the statements of a block."""
        return [made for each in statements for made in self.statement(*each)]

    def last(self, flags: ast.expr) -> list[ast.stmt]:
        """Return what ends a body."""
        raise NotImplementedError

    def statement(self, kind: str, *parts: Any) -> list[ast.stmt]:
        """Return what a statement becomes."""
        raise NotImplementedError

    def target(self, target: Any) -> ast.expr:
        """Return what a statement changes."""
        kind, name, *position = target
        if kind == "var" and not position:
            return self._variable(name, ast.Store())
        if kind == "at" and name == "out":
            return self._entry(name, position, ast.Store())
        raise ValueError(f"{target!r} cannot be changed")

    def refusal(self, value: Any) -> ast.expr:
        """Return the flags of a return within a body, which are 0 or begin with another bit."""
        known = value[1] if isinstance(value, list) and value[:1] == ["|"] else value
        if type(known) is not int or (known != 0 and value is known) or known & _APPLICABLE:
            raise ValueError(f"{value!r} cannot be returned before the end")
        return self.value(value)

    def _variable(self, name: Any, context: ast.expr_context) -> ast.expr:
        if not isinstance(name, str) or not _VARIABLE.fullmatch(name):
            raise ValueError(f"there is no variable {name!r}")
        if isinstance(context, ast.Store):
            if name in ("dt", "flags"):
                raise ValueError(f"{name} cannot be changed")
            self.known.add(name)
        elif name == "dt":
            return ast.Constant(value=self._parameters.dt)
        elif name not in self.known:
            raise ValueError(f"{name} is read before it is set")
        return ast.Name(id=name, ctx=context)

    def _entry(self, array: Any, positions: list[Any], context: ast.expr_context) -> ast.expr:
        (position,) = positions
        theta = self._parameters.theta
        sizes = {**self._sizes, "theta": len(theta)}
        if array not in sizes or type(position) is not int:
            raise ValueError(f"there is no entry {position!r} of {array!r}")
        if not 0 <= position < sizes[array]:
            raise ValueError(f"{array} has no entry {position}")
        if array == "theta":
            return ast.Constant(value=theta[position])
        return self.entry(array, position, context)

    def entry(self, array: str, position: int, context: ast.expr_context) -> ast.expr:
        """Return an entry of the state or of `out`."""
        place = ast.Constant(value=position)
        return ast.Subscript(value=name_of(array), slice=place, ctx=context)

    def value(self, value: Any) -> ast.expr:
        """Return the expression of a value."""
        if type(value) in (bool, int, float):
            return ast.Constant(value=value)
        kind, *parts = value
        if kind == "at":
            return self._entry(parts[0], parts[1:], ast.Load())
        if kind == "var":
            (name,) = parts
            return self._variable(name, ast.Load())
        if kind == "inf" and not parts:
            return ast.Constant(value=math.inf)
        values = [self.value(part) for part in parts]
        if kind in _BINARY:
            left, right = values
            return ast.BinOp(left=left, op=_BINARY[kind](), right=right)
        if kind in _COMPARISON:
            left, right = values
            made, compare = _COMPARISON[kind]
            if isinstance(left, ast.Constant) and isinstance(right, ast.Constant):
                return ast.Constant(value=compare(left.value, right.value))
            return ast.Compare(left=left, ops=[made()], comparators=[right])
        if kind == "neg":
            (operand,) = values
            return ast.UnaryOp(op=ast.USub(), operand=operand)
        if kind in FUNCTIONS and len(values) == FUNCTIONS[kind][0]:
            return ast.Call(func=ast.Name(id=kind, ctx=ast.Load()), args=values, keywords=[])
        sizes = {"not": (1, 1), "choose": (3, 3), "and": (2, len(values)), "or": (2, len(values))}
        if kind in sizes and sizes[kind][0] <= len(values) <= sizes[kind][1]:
            if kind == "choose" and isinstance(values[0], ast.Constant):
                return values[1] if values[0].value else values[2]
            return self.combined(kind, values)
        raise ValueError(f"there is no value {kind!r}")

    def combined(self, kind: str, values: list[ast.expr]) -> ast.expr:
        """Return a negation, junction or choice."""
        if kind == "not":
            return ast.UnaryOp(op=ast.Not(), operand=values[0])
        if kind == "choose":
            return ast.IfExp(test=values[0], body=values[1], orelse=values[2])
        return ast.BoolOp(op=ast.And() if kind == "and" else ast.Or(), values=values)


class _LocalsBuilder(TreeBuilder):
    """Builds functions of one state, whose result is in local variables, the fastest there are."""

    def begin(self, start: str) -> list[ast.stmt]:
        """Return the statements that make local variables of a state, or of `out`."""
        width = self._parameters.width
        stored: list[ast.expr] = [ast.Name(id=f"o{k}", ctx=ast.Store()) for k in range(width + 1)]
        if start == "out":
            self.known.add("flags")
            targets = ast.Tuple(elts=stored, ctx=ast.Store())
            return [ast.Assign(targets=[targets], value=name_of(start))]
        reward = ast.Assign(targets=[stored[-1]], value=ast.Constant(value=0.0))
        targets = ast.Tuple(elts=stored[:-1], ctx=ast.Store())
        return [ast.Assign(targets=[targets], value=name_of(start)), reward]

    def end(self, flags: ast.expr | None = None) -> ast.stmt:
        """Return the statement that gives the result, with these flags or those computed."""
        made = ast.List(
            elts=[name_of(f"o{k}") for k in range(self._parameters.width + 1)], ctx=ast.Load()
        )
        return ast.Return(value=ast.Tuple(elts=[made, flags or name_of("flags")], ctx=ast.Load()))

    def last(self, flags: ast.expr) -> list[ast.stmt]:
        """Keep the flags for what follows."""
        self.known.add("flags")
        return [ast.Assign(targets=[ast.Name(id="flags", ctx=ast.Store())], value=flags)]

    def statement(self, kind: str, *parts: Any) -> list[ast.stmt]:
        """Return what a statement becomes: one of Python's."""
        if kind == "set":
            target, value = parts[0], self.value(parts[1])
            return [ast.Assign(targets=[self.target(target)], value=value)]
        if kind == "return":
            (value,) = parts
            return [self.end(self.refusal(value))]
        if kind in ("when", "while"):
            test, made = self.value(parts[0]), ast.If if kind == "when" else ast.While
            return [made(test=test, body=self.block(parts[1]) or [ast.Pass()], orelse=[])]
        raise ValueError(f"there is no statement {kind!r}")

    def entry(self, array: str, position: int, context: ast.expr_context) -> ast.expr:
        """Return an entry of the state, or the variable of one of `out`."""
        if array == "out":
            return ast.Name(id=f"o{position}", ctx=context)
        return super().entry(array, position, context)


def name_of(name: str) -> ast.expr:
    """Return the value of a name."""
    return ast.Name(id=name, ctx=ast.Load())
