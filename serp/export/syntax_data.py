"""The generated functions of a model as JSON values, see `serp.controller.program`."""

from __future__ import annotations

import ast
import math
from typing import Any, Final

from serp.model.codegen import Part, generate_code
from serp.model.ground import GroundModel

_SYMBOLS: Final[dict[type, str]] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.BitOr: "|", ast.BitAnd: "&",
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
    ast.USub: "neg", ast.Not: "not", ast.And: "and", ast.Or: "or",
}  # fmt: skip


def programs_of(ground: GroundModel) -> dict[str, Any]:
    """Return the statements of every action, of the processes, and of what comes after them."""
    return {
        "actions": [_statements(ground, "action", k) for k in range(len(ground.actions))],
        "drift": _statements(ground, "drift"),
        "settle": _statements(ground, "settle"),
    }


def _statements(ground: GroundModel, part: Part, action: int = -1) -> list[Any]:
    (function,) = ast.parse(generate_code(ground, part, action).text).body
    assert isinstance(function, ast.FunctionDef)
    return _block(function.body)


def _block(statements: list[ast.stmt]) -> list[Any]:
    return [_statement(each) for each in statements if not isinstance(each, ast.Pass)]


def _statement(statement: ast.stmt) -> list[Any]:
    match statement:
        case ast.Assign([target], value):
            return ["set", _value(target), _value(value)]
        case ast.If(test, body, []):
            return ["when", _value(test), _block(body)]
        case ast.While(test, body, []):
            return ["while", _value(test), _block(body)]
        case ast.Return(value) if value is not None:
            return ["return", _value(value)]
    raise AssertionError(ast.dump(statement))


def _value(value: ast.expr) -> Any:
    match value:
        case ast.Constant(bool() | int() | float() as number):
            return ["inf"] if number == math.inf else number
        case ast.Name(name):
            return ["var", name]
        case ast.Subscript(ast.Name(array), ast.Constant(int(position))):
            return ["at", array, position]
        case ast.BinOp(left, operator, right):
            return [_SYMBOLS[type(operator)], _value(left), _value(right)]
        case ast.Compare(left, [operator], [right]):
            return [_SYMBOLS[type(operator)], _value(left), _value(right)]
        case ast.Call(ast.Name(function), operands):
            return [function, *map(_value, operands)]
        case ast.UnaryOp(operator, operand):
            return [_SYMBOLS[type(operator)], _value(operand)]
        case ast.BoolOp(operator, values):
            return [_SYMBOLS[type(operator)], *map(_value, values)]
        case ast.IfExp(test, body, orelse):
            return ["choose", _value(test), _value(body), _value(orelse)]
    raise AssertionError(ast.dump(value))
