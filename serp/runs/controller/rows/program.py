"""The functions of the transition model for many states at once.

The same trees as those of `controller.program`, with NumPy arrays of N states in place of numbers.
Every statement is carried out for all states, and changes those for which its conditions hold: `m0`
are the states that have not returned, `m1` those of them for which the outer condition holds, and
so on.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..program import (
    FUNCTIONS,
    Function,
    Parameters,
    TreeBuilder,
    body_of,
    compiled_function,
    name_of,
)
from ..reading import Entry


def make_rows_function(part: Entry, parameters: Parameters) -> Function:
    """Return the function that carries out a body for states `[F, N]`.

    Its arguments are the states `s`, `flags` `[N]`, and what was computed so far, `out`
    `[F + 1, N]`, which is changed. It returns the flags, and leaves out states without
    `APPLICABLE`.
    """
    names: dict[str, Any] = {"where": np.where, "put": _put, "some": np.count_nonzero}
    names |= {name: _of_each(function) for name, (_, function) in FUNCTIONS.items()}
    builder = _RowsBuilder(parameters)
    applicable = ast.BinOp(left=name_of("flags"), op=ast.BitAnd(), right=ast.Constant(value=1))
    begin = [
        _assign("m0", _compared(applicable)),
        _assign("result", name_of("flags")),
    ]
    body = [*begin, *body_of(part, builder), ast.Return(value=name_of("result"))]
    return compiled_function(("s", "flags", "out"), body, names, part)


def _put(row: NDArray[np.float64], value: Any, where: NDArray[np.bool_]) -> None:
    np.copyto(row, value, where=where)


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

    def __init__(self, parameters: Parameters) -> None:
        super().__init__(parameters)
        self.known.add("flags")
        self._everywhere: set[str] = set()
        """Variables that have a value for every state."""
        self._level = 0

    @property
    def _mask(self) -> ast.expr:
        return name_of(f"m{self._level}")

    def last(self, flags: ast.expr) -> list[ast.stmt]:
        """Set the flags of the states that have not returned."""
        return [_assign("result", _where(self._mask, flags, name_of("result")))]

    def statement(self, kind: str, *parts: Any) -> list[ast.stmt]:
        """Return statements that carry out one for the states under its conditions."""
        if kind == "set":
            return [self._set(*parts)]
        if kind == "return":
            (value,) = parts
            chosen = _where(self._mask, self.refusal(value), name_of("result"))
            masks = [
                _assign(f"m{k}", _both(name_of(f"m{k}"), name_of("left")))
                for k in range(self._level + 1)
            ]
            return [_assign("result", chosen), _assign("left", _negated(self._mask)), *masks]
        if kind not in ("when", "while"):
            raise ValueError(f"there is no statement {kind!r}")
        test = _both(self._mask, self.value(parts[0]))
        before = set(self._everywhere)
        self._level += 1
        inner = f"m{self._level}"
        body = self.block(parts[1]) or [ast.Pass()]
        any_row = ast.Call(func=name_of("some"), args=[name_of(inner)], keywords=[])
        self._level -= 1
        self._everywhere = before  # what a block that no state enters would have set
        if kind == "when":
            return [_assign(inner, test), ast.If(test=any_row, body=body, orelse=[])]
        still = _assign(inner, _both(name_of(inner), self.value(parts[0])))
        return [_assign(inner, test), ast.While(test=any_row, body=[*body, still], orelse=[])]

    def _set(self, target: Any, given: Any) -> ast.stmt:
        value = self.value(given)
        if target[0] == "at":
            stored = self.target(target)
            assert isinstance(stored, ast.Subscript)
            row = ast.Subscript(value=stored.value, slice=stored.slice, ctx=ast.Load())
            put = ast.Call(func=name_of("put"), args=[row, value, self._mask], keywords=[])
            return ast.Expr(value=put)
        if isinstance(value, ast.Subscript):  # a row of `out` may change afterwards
            copy = ast.Attribute(value=value, attr="copy", ctx=ast.Load())
            value = ast.Call(func=copy, args=[], keywords=[])
        stored, name = self.target(target), target[1]
        # An intermediate result t0, t1 ... is read only where it was set.
        if name in self._everywhere and (name == "terminal" or not name.startswith("t")):
            value = _where(self._mask, value, self.value(target))
        self._everywhere.add(name)
        return ast.Assign(targets=[stored], value=value)

    def combined(self, kind: str, values: list[ast.expr]) -> ast.expr:
        """Return a negation, junction or choice of arrays."""
        if kind == "not":
            return _negated(values[0])
        if kind == "choose":
            return _where(*values)
        made = values[0]
        for each in values[1:]:
            junction = ast.BitAnd() if kind == "and" else ast.BitOr()
            made = ast.BinOp(left=made, op=junction, right=each)
        return made


def _assign(name: str, value: ast.expr) -> ast.stmt:
    return ast.Assign(targets=[ast.Name(id=name, ctx=ast.Store())], value=value)


def _both(one: ast.expr, other: ast.expr) -> ast.expr:
    return ast.BinOp(left=one, op=ast.BitAnd(), right=other)


def _negated(value: ast.expr) -> ast.expr:
    return ast.BinOp(left=value, op=ast.BitXor(), right=ast.Constant(value=True))


def _compared(value: ast.expr) -> ast.expr:
    return ast.Compare(left=value, ops=[ast.NotEq()], comparators=[ast.Constant(value=0)])


def _where(test: ast.expr, one: ast.expr, other: ast.expr) -> ast.expr:
    return ast.Call(func=name_of("where"), args=[test, one, other], keywords=[])
