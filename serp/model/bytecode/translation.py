"""Translation of the statements of a generated function to instructions."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from serp.errors import SerpError
from serp.model.bytecode.instructions import REGISTERS, SHIFT, VARIABLES, Code, Memory, Table

_ARRAYS: Final = {"s": Memory.STATE, "out": Memory.OUT, "theta": Memory.THETA}
_ARITHMETIC: Final[dict[type, Code]] = {
    ast.Add: Code.ADD, ast.Sub: Code.SUBTRACT, ast.Mult: Code.MULTIPLY, ast.Div: Code.DIVIDE,
}  # fmt: skip
_CALLS: Final = {"sqrt": Code.SQRT, "sin": Code.SIN, "cos": Code.COS, "atan2": Code.ATAN2}
# Comparison → code, whether the sides change places, whether it is negated.
_COMPARISONS: Final[dict[type, tuple[Code, bool, bool]]] = {
    ast.Lt: (Code.IF_LESS, False, False),
    ast.LtE: (Code.IF_LESS_OR_EQUAL, False, False),
    ast.Gt: (Code.IF_LESS, True, False),
    ast.GtE: (Code.IF_LESS_OR_EQUAL, True, False),
    ast.Eq: (Code.IF_EQUAL, False, False),
    ast.NotEq: (Code.IF_EQUAL, False, True),
}
_NEGATED: Final = Code.UNLESS_LESS - Code.IF_LESS


@dataclass(frozen=True)
class Shape:
    """The instructions of functions that differ only in positions.

    Attributes:
        table: `[n, 4]`; operands in state, out and θ have position 0, jumps are relative.
        rows, columns: Where the positions belong.
        order: Which occurrence in the text each is.
        jumps: Rows of jumps.
    """

    table: Table
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    order: NDArray[np.int64]
    jumps: NDArray[np.int64]


def translate(text: str, constants: dict[float, int]) -> Shape:
    """Translate statements, in which every position in an array is that of the occurrence.

    Args:
        text: The statements.
        constants: The numbers that are written in the text; extended.
    """
    return _Translation(constants).shape(text)


class _Translation:
    """Translates the statements of one function."""

    def __init__(self, constants: dict[float, int]) -> None:
        self.constants = constants
        self.rows: list[list[int]] = []
        self.places: list[tuple[int, int, int]] = []
        self.labels: list[int] = []
        self.jumps: list[int] = []
        self.variables = {name: k for k, name in enumerate(VARIABLES)}
        self.total: Counter[str] = Counter()
        self.free: list[int] = []
        self.used = len(VARIABLES)

    def shape(self, text: str) -> Shape:
        tree = ast.parse(text)
        self.total = _names(tree.body)
        self._block(tree.body)
        for row in self.jumps:
            self.rows[row][3] = self.labels[self.rows[row][3]]
        places = np.array(self.places, dtype=np.int64).reshape(-1, 3)
        table = np.array(self.rows, dtype=np.int32).reshape(-1, 4)
        jumps = np.array(self.jumps, dtype=np.int64)
        return Shape(table, places[:, 0], places[:, 1], places[:, 2], jumps)

    # Instructions ------------------------------------------------------------------------------

    def _emit(self, code: Code, *operands: ast.expr | int) -> None:
        row = [int(code), 0, 0, 0]
        for column, operand in enumerate(operands, 1):
            if isinstance(operand, int):
                row[column] = operand
            else:
                row[column], order = self._place(operand)
                if order >= 0:
                    self.places.append((len(self.rows), column, order))
        self.rows.append(row)

    def _jump(self, code: Code, label: int, *operands: ast.expr | int) -> None:
        self.jumps.append(len(self.rows))
        self._emit(code, *operands)
        self.rows[-1][3] = label

    def _label(self) -> int:
        self.labels.append(-1)
        return len(self.labels) - 1

    def _here(self, label: int) -> None:
        self.labels[label] = len(self.rows)

    def _place(self, leaf: ast.expr) -> tuple[int, int]:
        """Return the operand of a simple expression, and which occurrence in the text it is."""
        match leaf:
            case ast.Name(name):
                return self._variable(name), -1
            case ast.Subscript(ast.Name(array), ast.Constant(int(order))):
                return _ARRAYS[array] << SHIFT, order
            case ast.Constant(bool() | int() | float() as value):
                index = self.constants.setdefault(float(value), len(self.constants))
                return Memory.CONSTANTS << SHIFT | index, -1
        raise AssertionError(ast.dump(leaf))

    def _variable(self, name: str) -> int:
        if name not in self.variables:
            self.variables[name] = self._register()
        return self.variables[name]

    def _register(self) -> int:
        if self.free:
            return self.free.pop()
        if self.used == REGISTERS:
            raise SerpError(
                f"the domain is too large to be planned in: an action, or the events together, has "
                f"more than {REGISTERS:,} intermediate results; write fewer conditional effects"
            )
        self.used += 1
        return self.used - 1

    # Statements --------------------------------------------------------------------------------

    def _block(self, statements: Sequence[ast.stmt]) -> None:
        """Translate statements; free the registers of variables after their last use.

        A variable of a loop is assigned anew in every round, or else also used outside of it.
        """
        found = [_names([statement]) for statement in statements]
        within = sum(found, Counter[str]())
        last = {name: k for k, names in enumerate(found) for name in names}
        for k, (statement, names) in enumerate(zip(statements, found, strict=True)):
            self._statement(statement)
            for name in names:
                if last[name] == k and within[name] == self.total[name] and name in self.variables:
                    self.free.append(self.variables.pop(name))

    def _statement(self, statement: ast.stmt) -> None:
        match statement:
            case ast.Assign([target], value):
                self._assign(target, value)
            case ast.If(test, body, []):
                end = self._label()
                self._jump_if(test, False, end)
                self._block(body)
                self._here(end)
            case ast.While(test, body):
                begin, end = self._label(), self._label()
                self._here(begin)
                self._jump_if(test, False, end)
                self._block(body)
                self._jump(Code.JUMP, begin)
                self._here(end)
            case ast.Return(value) if value is not None:
                base, mask = _flags(value)
                self._emit(Code.RETURN, base, mask)
            case ast.Pass():
                pass
            case _:
                raise AssertionError(ast.dump(statement))

    def _assign(self, target: ast.expr, value: ast.expr) -> None:
        """Emit: the target gets a value; nothing is written before the value is known."""
        match value:
            case ast.BinOp(left, operator, right):
                with self._held() as held:
                    sides = self._leaf(left, held), self._leaf(right, held)
                    self._emit(_ARITHMETIC[type(operator)], target, *sides)
            case ast.UnaryOp(ast.USub(), operand):
                with self._held() as held:
                    self._emit(Code.NEGATE, target, self._leaf(operand, held))
            case ast.Call(ast.Name(name), operands):
                with self._held() as held:
                    self._emit(_CALLS[name], target, *[self._leaf(o, held) for o in operands])
            case ast.IfExp(test, body, orelse):
                self._choose(target, test, body, orelse)
            case ast.BoolOp() | ast.Compare() | ast.UnaryOp(ast.Not()):
                self._choose(target, value, ast.Constant(1.0), ast.Constant(0.0))
            case _:
                self._emit(Code.MOVE, target, value)

    def _choose(self, target: ast.expr, test: ast.expr, one: ast.expr, other: ast.expr) -> None:
        otherwise, end = self._label(), self._label()
        self._jump_if(test, False, otherwise)
        self._assign(target, one)
        self._jump(Code.JUMP, end)
        self._here(otherwise)
        self._assign(target, other)
        self._here(end)

    # Expressions -------------------------------------------------------------------------------

    @contextmanager
    def _held(self) -> Iterator[list[int]]:
        """Collect registers of intermediate results, and free them at the end."""
        held: list[int] = []
        yield held
        self.free += held

    def _leaf(self, value: ast.expr, held: list[int]) -> ast.expr:
        """Return a simple expression for a value: itself, or the register that it is put into."""
        if isinstance(value, ast.Name | ast.Subscript | ast.Constant):
            return value
        register = self._register()
        held.append(register)
        name = f"register {register}"
        self.variables[name] = register
        self._assign(ast.Name(name), value)
        return ast.Name(name)

    def _jump_if(self, test: ast.expr, wanted: bool, label: int) -> None:
        """Emit: jump where the truth value of a condition is `wanted`."""
        match test:
            case ast.Constant(value):
                if bool(value) == wanted:
                    self._jump(Code.JUMP, label)
            case ast.UnaryOp(ast.Not(), operand):
                self._jump_if(operand, not wanted, label)
            case ast.BoolOp(operator, values):
                decides = isinstance(operator, ast.Or)
                skip = label if wanted == decides else self._label()
                for part in values[:-1]:
                    self._jump_if(part, decides, skip)
                self._jump_if(values[-1], wanted, label)
                if skip != label:
                    self._here(skip)
            case ast.Compare(left, [ast.NotEq()], [ast.Constant(0.0)]) if _simple(left):
                self._jump(Code.JUMP_IF if wanted else Code.JUMP_UNLESS, label, left)
            case ast.Compare(left, [operator], [right]):
                code, swapped, negated = _COMPARISONS[type(operator)]
                with self._held() as held:
                    sides = [self._leaf(left, held), self._leaf(right, held)]
                    if swapped:
                        sides.reverse()
                    unless = wanted == negated
                    self._jump(Code(code + _NEGATED * unless), label, *sides)
            case _:
                self._jump(Code.JUMP_IF if wanted else Code.JUMP_UNLESS, label, test)


def _simple(value: ast.expr) -> bool:
    return isinstance(value, ast.Name | ast.Subscript)


def _names(statements: Sequence[ast.stmt]) -> Counter[str]:
    """Return how often each variable occurs, without those of fixed registers."""
    nodes = (node for statement in statements for node in ast.walk(statement))
    names = (node.id for node in nodes if isinstance(node, ast.Name))
    return Counter(name for name in names if name not in VARIABLES and name not in _ARRAYS)


def _flags(value: ast.expr) -> tuple[int, int]:
    """Return the flags that are certain, and those that are set where their variable is."""
    match value:
        case ast.Constant(int(flags)):
            return flags, 0
        case ast.IfExp(ast.Name(), ast.Constant(int(flags)), _):
            return 0, flags
        case ast.BinOp(left, ast.BitOr(), right):
            (one, mask), (other, more) = _flags(left), _flags(right)
            return one | other, mask | more
    raise AssertionError(ast.dump(value))
