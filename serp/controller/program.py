"""The functions of the transition model, rebuilt from syntax trees that are stored as data.

A tree is JSON: a number or truth value, or a list whose first item says what it is. Names and
positions are checked, so that a tree can be nothing but arithmetic on the arrays of a step; no text
becomes program text.

Statements are `["set", target, value]`, `["when", test, statements]`, `["while", test, statements]`
and `["return", value]`. Values are `["at", array, position]`, `["var", name]`, `["choose", test,
value, value]`, `["inf"]`, and operators and functions with their operands.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from .folder import ControllerError

Function = Callable[..., int]

_VARIABLE = re.compile(r"(t|kind|fired)\d{1,9}|reward|unsafe|terminal|again|flags|dt")
_BINARY: dict[str, Any] = {
    "+": ast.Add, "-": ast.Sub, "*": ast.Mult, "/": ast.Div, "|": ast.BitOr, "&": ast.BitAnd,
}  # fmt: skip
_COMPARISON: dict[str, Any] = {
    "<": ast.Lt, "<=": ast.LtE, ">": ast.Gt, ">=": ast.GtE, "==": ast.Eq, "!=": ast.NotEq,
}  # fmt: skip
FUNCTIONS: dict[str, tuple[int, Callable[..., float]]] = {
    **{"sqrt": (1, math.sqrt), "sin": (1, math.sin), "cos": (1, math.cos)},
    "atan2": (2, math.atan2),
}
"""Name → number of operands, and the function."""


def make_function(
    arguments: Sequence[str], statements: object, sizes: Mapping[str, int]
) -> Function:
    """Return the function with a body.

    Args:
        arguments: Names of its arguments.
        statements: The body.
        sizes: Array that may be read or, for `out`, written → its length.

    Raises:
        ControllerError: The body is not what the module describes.
    """
    functions = {name: function for name, (_, function) in FUNCTIONS.items()}
    return compiled_function(arguments, statements, TreeBuilder(sizes), functions)


def compiled_function(
    arguments: Sequence[str], statements: object, builder: TreeBuilder, names: Mapping[str, Any]
) -> Function:
    """Return the function whose body a builder makes; it reaches these names and no builtins."""
    given = ast.arguments(
        posonlyargs=[], args=[ast.arg(name) for name in arguments], kwonlyargs=[], kw_defaults=[],
        defaults=[],
    )  # fmt: skip
    try:
        body = builder.function(statements)
        function = ast.FunctionDef(
            name="function", args=given, body=body, decorator_list=[], lineno=1, col_offset=0
        )
        if "type_params" in ast.FunctionDef._fields:  # from Python 3.12 on
            function.type_params = []  # type: ignore[attr-defined, unused-ignore]
        module = ast.fix_missing_locations(ast.Module(body=[function], type_ignores=[]))
        code = compile(module, "<policy>", "exec")
    except (TypeError, ValueError, IndexError, RecursionError) as error:
        raise ControllerError(f"the model of the policy is damaged: {error}") from None
    namespace: dict[str, Any] = {"__builtins__": {}, **names}
    exec(code, namespace)
    made: Function = namespace["function"]
    return made


class TreeBuilder:
    """Builds syntax trees; whatever is not known raises one of the errors above."""

    def __init__(self, sizes: Mapping[str, int]) -> None:
        self._sizes = sizes

    def function(self, statements: Any) -> list[ast.stmt]:
        """Return the body of a function."""
        return self._block(statements)

    def _block(self, statements: Any) -> list[ast.stmt]:
        return [self._statement(*statement) for statement in statements] or [ast.Pass()]

    def _statement(self, kind: str, *parts: Any) -> ast.stmt:
        if kind == "set":
            target, value = parts
            return ast.Assign(targets=[self.target(target)], value=self.value(value))
        if kind == "return":
            return ast.Return(value=self.value(*parts))
        if kind in ("when", "while"):
            test, body = self.value(parts[0]), self._block(parts[1])
            made = ast.If if kind == "when" else ast.While
            return made(test=test, body=body, orelse=[])
        raise ValueError(f"there is no statement {kind!r}")

    def target(self, target: Any) -> ast.expr:
        """Return what a statement changes."""
        kind, name, *position = target
        if kind == "var" and not position:
            return self._variable(name, ast.Store())
        if kind == "at" and name == "out":
            return self._entry(name, position, ast.Store())
        raise ValueError(f"{target!r} cannot be changed")

    def _variable(self, name: str, context: ast.expr_context) -> ast.expr:
        if not isinstance(name, str) or not _VARIABLE.fullmatch(name):
            raise ValueError(f"there is no variable {name!r}")
        return ast.Name(id=name, ctx=context)

    def _entry(self, array: str, positions: list[Any], context: ast.expr_context) -> ast.expr:
        (position,) = positions
        if array not in self._sizes or type(position) is not int:
            raise ValueError(f"there is no entry {position!r} of {array!r}")
        if not 0 <= position < self._sizes[array]:
            raise ValueError(f"{array} has no entry {position}")
        place = ast.Constant(value=position)
        return ast.Subscript(value=ast.Name(id=array, ctx=ast.Load()), slice=place, ctx=context)

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
            return ast.Compare(left=left, ops=[_COMPARISON[kind]()], comparators=[right])
        if kind == "neg":
            (operand,) = values
            return ast.UnaryOp(op=ast.USub(), operand=operand)
        if kind in FUNCTIONS and len(values) == FUNCTIONS[kind][0]:
            return ast.Call(func=ast.Name(id=kind, ctx=ast.Load()), args=values, keywords=[])
        sizes = {"not": (1, 1), "choose": (3, 3), "and": (2, len(values)), "or": (2, len(values))}
        if kind in sizes and sizes[kind][0] <= len(values) <= sizes[kind][1]:
            return self.combined(kind, values)
        raise ValueError(f"there is no value {kind!r}")

    def combined(self, kind: str, values: list[ast.expr]) -> ast.expr:
        """Return a negation, junction or choice."""
        if kind == "not":
            return ast.UnaryOp(op=ast.Not(), operand=values[0])
        if kind == "choose":
            return ast.IfExp(test=values[0], body=values[1], orelse=values[2])
        return ast.BoolOp(op=ast.And() if kind == "and" else ast.Or(), values=values)
