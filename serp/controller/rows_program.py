"""The functions of the transition model for many states at once.

The same trees as those of `program`, with NumPy arrays of N states in place of numbers. Every
statement is carried out for all states, and changes those for which its conditions hold: `m0` are
the states that have not returned, `m1` those of them for which the outer condition holds, and so
on.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .program import FUNCTIONS, TreeBuilder, compiled_function

RowsFunction = Callable[..., Any]


def make_rows_function(
    arguments: Sequence[str], statements: object, sizes: Mapping[str, int]
) -> RowsFunction:
    """Return the function with a body, for arrays `[F, N]` in place of states.

    Its last arguments are `m0` `[N]`, the states that it is carried out for, and `result` `[N]`,
    the flags of the others. It returns the flags of all.
    """
    given = (*arguments, "m0", "result")
    names: dict[str, Any] = {"where": np.where, "some": _some, "copy": np.copy}
    names |= {name: _of_each(function) for name, (_, function) in FUNCTIONS.items()}
    return compiled_function(given, statements, _RowsBuilder(sizes), names)


def _some(mask: NDArray[np.bool_]) -> bool:
    return bool(mask.any())


def _of_each(function: Callable[..., float]) -> Callable[..., NDArray[np.float64]]:
    """Return a function over arrays; it gives NaN where the function is not defined.

    NumPy's own functions of angles round differently.
    """

    def one(*operands: float) -> float:
        try:
            return function(*operands)
        except ValueError:
            return math.nan

    def over(*operands: Any) -> NDArray[np.float64]:
        each = np.broadcast_arrays(*operands)
        rows = zip(*(array.ravel().tolist() for array in each), strict=True)
        return np.array([one(*row) for row in rows]).reshape(each[0].shape)

    return over


class _RowsBuilder(TreeBuilder):
    """Builds trees of array expressions."""

    def __init__(self, sizes: Mapping[str, int]) -> None:
        super().__init__(sizes)
        self._defined: set[str] = set()

    def function(self, statements: Any) -> list[ast.stmt]:
        """Return the body of a function."""
        return [*self._rows(statements, 0), ast.Return(value=_name("result"))]

    def _rows(self, statements: Any, level: int) -> list[ast.stmt]:
        return [made for each in statements for made in self._of(each, level)]

    def _of(self, statement: Any, level: int) -> list[ast.stmt]:
        kind, *parts = statement
        mask = f"m{level}"
        if kind == "set":
            target, value = parts[0], self.value(parts[1])
            if isinstance(value, ast.Subscript):  # a row of `out` may change afterwards
                value = ast.Call(func=_name("copy"), args=[value], keywords=[])
            return [self._set(target, value, mask)]
        if kind == "return":
            (value,) = parts
            chosen = _where(_name(mask), self.value(value), _name("result"))
            left = ast.BinOp(left=_name(mask), op=ast.BitXor(), right=ast.Constant(value=True))
            masks = [
                _assign(f"m{k}", _both(_name(f"m{k}"), _name("left"))) for k in range(level + 1)
            ]
            return [_assign("result", chosen), _assign("left", left), *masks]
        inner = f"m{level + 1}"
        test = _assign(inner, _both(_name(mask), self.value(parts[0])))
        any_row = ast.Call(func=_name("some"), args=[_name(inner)], keywords=[])
        before = set(self._defined)
        body = self._rows(parts[1], level + 1) or [ast.Pass()]
        self._defined = before  # what a block that no state enters would have defined
        if kind == "when":
            return [test, ast.If(test=any_row, body=body, orelse=[])]
        if kind == "while":
            still = _both(_name(inner), self.value(parts[0]))
            return [test, ast.While(test=any_row, body=[*body, _assign(inner, still)], orelse=[])]
        raise ValueError(f"there is no statement {kind!r}")

    def _set(self, target: Any, value: ast.expr, mask: str) -> ast.stmt:
        stored = self.target(target)
        kind, name = target[:2]
        if kind == "var" and (name.startswith("t") and name != "terminal"):
            known = False  # an intermediate result: it is read only where it was set
        else:
            known = kind == "at" or name in self._defined
        if kind == "var":
            self._defined.add(name)
        if known:
            value = _where(_name(mask), value, self.value(target))
        return ast.Assign(targets=[stored], value=value)

    def combined(self, kind: str, values: list[ast.expr]) -> ast.expr:
        """Return a negation, junction or choice of arrays."""
        if kind == "not":
            return ast.BinOp(left=values[0], op=ast.BitXor(), right=ast.Constant(value=True))
        if kind == "choose":
            return _where(*values)
        made = values[0]
        for each in values[1:]:
            operator = ast.BitAnd() if kind == "and" else ast.BitOr()
            made = ast.BinOp(left=made, op=operator, right=each)
        return made


def _name(name: str) -> ast.expr:
    return ast.Name(id=name, ctx=ast.Load())


def _assign(name: str, value: ast.expr) -> ast.stmt:
    return ast.Assign(targets=[ast.Name(id=name, ctx=ast.Store())], value=value)


def _both(one: ast.expr, other: ast.expr) -> ast.expr:
    return ast.BinOp(left=one, op=ast.BitAnd(), right=other)


def _where(test: ast.expr, one: ast.expr, other: ast.expr) -> ast.expr:
    return ast.Call(func=_name("where"), args=[test, one, other], keywords=[])
