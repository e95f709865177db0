"""Running bytecode as machine code: one compiled loop for all domains.

The loop is a C callback with the signature of every compiled transition function. Its data are
the numbers of one array: three positions, the parameters θ, the constants, the entry of each
action, and the instructions, as 32-bit integers. Nothing is compiled for a domain. The results are
those of the generated functions in CPython, bit for bit.
"""

from __future__ import annotations

import ast
import functools
import itertools
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from serp._util.compilation import cached_cfunc
from serp.errors import SerpError
from serp.model.codegen import statements_of
from serp.model.flags import TERMINAL, UNSAFE
from serp.model.ground_model import GroundModel
from serp.model.native import STEP_SIGNATURE, advanced, stack_room

Table = NDArray[np.int32]

REGISTERS: Final = 32_768
"""They lie on the stack: 256 KB, of which few are used."""
SHIFT: Final = 24
"""An operand is `memory << SHIFT | position`."""


class Memory(IntEnum):
    """What an operand refers to."""

    REGISTERS = 0
    STATE = 1
    OUT = 2
    THETA = 3
    CONSTANTS = 4


class Code(IntEnum):
    """What an instruction does."""

    JUMP_IF = 0
    """Jump where operand 1 is not 0."""
    JUMP_UNLESS = 1
    MOVE = 2
    """Operand 1 becomes operand 2."""
    JUMP = 3
    RETURN = 4
    """Return the flags: operand 1, and of the mask in operand 2 those that are set."""
    ADD = 5
    """Operand 1 becomes operand 2 + operand 3; the following ones likewise."""
    SUBTRACT = 6
    MULTIPLY = 7
    DIVIDE = 8
    ATAN2 = 9
    NEGATE = 10
    """Operand 1 becomes −operand 2; the following ones likewise."""
    SQRT = 11
    SIN = 12
    COS = 13
    IF_LESS = 14
    """Jump where operand 1 < operand 2; the following ones likewise."""
    IF_LESS_OR_EQUAL = 15
    IF_EQUAL = 16
    UNLESS_LESS = 17
    UNLESS_LESS_OR_EQUAL = 18
    UNLESS_EQUAL = 19


VARIABLES: Final = ("dt", "reward", "unsafe", "terminal")
DT, REWARD, UNSAFE_SET, TERMINAL_SET = range(len(VARIABLES))
"""The registers of these variables."""

JUMPS: Final = {
    Code.JUMP_IF, Code.JUMP_UNLESS, Code.JUMP, Code.IF_LESS, Code.IF_LESS_OR_EQUAL, Code.IF_EQUAL,
    Code.UNLESS_LESS, Code.UNLESS_LESS_OR_EQUAL, Code.UNLESS_EQUAL,
}  # fmt: skip
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


class Shape(NamedTuple):
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


class _Translation:
    """Translates statements, in which every position in an array is that of the occurrence.

    `constants` are the numbers that are written in the text; they are extended.
    """

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


_INDEX: Final = re.compile(r"\b(s|out|theta)\[(\d+)\]")


class Assembler:
    """Translates statements of the generated code to one table.

    `constants` are the numbers that are written in the text.
    """

    def __init__(self) -> None:
        self.constants: dict[float, int] = {}
        self._shapes: dict[str, Shape] = {}
        self._tables: list[Table] = []
        self._length = 0

    def add(self, statements: Sequence[str], following: int = -1) -> int:
        """Append lines of generated code; return the position of the first.

        `following` is the position of the next instruction, -1 where they end with a return.
        """
        text = "\n".join(statements)
        found = [int(index) for _, index in _INDEX.findall(text)]
        form = _INDEX.sub(r"\1[]", text)
        shape = self._shapes.get(form)
        if shape is None:
            count = itertools.count()
            numbered = _INDEX.sub(lambda found: f"{found[1]}[{next(count)}]", text)
            shape = self._shapes[form] = _Translation(self.constants).shape(numbered)
        start, end = self._length, [(Code.JUMP, 0, 0, following)] if following >= 0 else []
        table = np.concatenate((shape.table, np.array(end, dtype=np.int32).reshape(-1, 4)))
        table[shape.rows, shape.columns] += np.array(found, dtype=np.int32)[shape.order]
        table[shape.jumps, 3] += start
        self._tables.append(table)
        self._length += len(table)
        return start

    def table(self) -> Table:
        """Return all instructions, `[n, 4]`."""
        return np.concatenate(self._tables)


# mypy: disable-error-code="no-untyped-def, no-untyped-call, untyped-decorator, no-any-return"

_HEAD: Final = 3
_CONSTANTS, _ENTRIES, _CODE = range(_HEAD)
"""Positions in the data of the positions of its parts; θ follows them."""

_MEMORIES: Final = len(Memory)
_POSITION: Final = (1 << SHIFT) - 1
"""The bits of an operand that are the position."""

_POINTER = types.CPointer(types.float64)
_INTEGERS = types.CPointer(types.int32)
_intrinsic: Any = intrinsic

# As plain numbers: the compiled loop is slower with members of an enumeration.
(
    _JUMP_IF, _JUMP_UNLESS, _MOVE, _JUMP, _RETURN, _ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _ATAN2,
    _NEGATE, _SQRT, _SIN, _COS, _IF_LESS, _IF_LESS_OR_EQUAL, _IF_EQUAL,
    _UNLESS_LESS, _UNLESS_LESS_OR_EQUAL, _UNLESS_EQUAL,
) = map(int, Code)  # fmt: skip


def _address(builder, memories, position):
    table = builder.bitcast(memories, ir.DoubleType().as_pointer().as_pointer())
    return builder.gep(table, [position])


@_intrinsic
def _put(typing_context, memories, position, pointer):
    """Set the address of a memory."""

    def generate(context, builder, signature, arguments):
        memories, position, pointer = arguments
        builder.store(pointer, _address(builder, memories, position))
        return context.get_dummy_value()

    return types.void(memories, position, pointer), generate


@_intrinsic
def _at(typing_context, memories, memory):
    """Return the address of a memory."""

    def generate(context, builder, signature, arguments):
        return builder.load(_address(builder, *arguments))

    return _POINTER(memories, memory), generate


@_intrinsic
def _as_integers(typing_context, pointer):
    """Return a pointer to the same place that reads 32-bit integers."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], ir.IntType(32).as_pointer())

    return _INTEGERS(pointer), generate


def _run(state, action, data, dt, out):
    """Execute the instructions of an action; see `serp.model.codegen` for the arguments."""
    memories, registers = stack_room(_MEMORIES), stack_room(REGISTERS)
    _put(memories, 0, registers)
    _put(memories, 1, state)
    _put(memories, 2, out)
    _put(memories, 3, advanced(data, _HEAD))
    _put(memories, 4, advanced(data, np.int64(data[_CONSTANTS])))
    registers[DT] = dt
    registers[REWARD] = 0.0
    registers[UNSAFE_SET] = 0.0
    registers[TERMINAL_SET] = 0.0
    code = _as_integers(advanced(data, np.int64(data[_CODE])))
    at = np.int64(data[np.int64(data[_ENTRIES]) + action])
    while True:
        kind = code[at]
        a, b, c = np.int64(code[at + 1]), np.int64(code[at + 2]), np.int64(code[at + 3])
        at += 4
        one = _at(memories, a >> SHIFT)
        i = a & _POSITION
        if kind == _JUMP_IF:
            if one[i] != 0.0:
                at = c
        elif kind == _JUMP_UNLESS:
            if one[i] == 0.0:
                at = c
        elif kind == _JUMP:
            at = c
        elif kind == _RETURN:
            flags = np.int64(0)
            if registers[UNSAFE_SET] != 0.0:
                flags |= UNSAFE
            if registers[TERMINAL_SET] != 0.0:
                flags |= TERMINAL
            return a | (flags & b)
        else:
            y = _at(memories, b >> SHIFT)[b & _POSITION]
            if kind == _MOVE:
                one[i] = y
            elif kind == _NEGATE:
                one[i] = -y
            elif kind < _NEGATE:
                z = _at(memories, c >> SHIFT)[c & _POSITION]
                if kind == _ADD:
                    one[i] = y + z
                elif kind == _SUBTRACT:
                    one[i] = y - z
                elif kind == _MULTIPLY:
                    one[i] = y * z
                elif kind == _DIVIDE:
                    one[i] = y / z
                else:
                    one[i] = math.atan2(y, z)
            elif kind < _IF_LESS:
                if kind == _SQRT:
                    one[i] = math.sqrt(y)
                elif kind == _SIN:
                    one[i] = math.sin(y)
                else:
                    one[i] = math.cos(y)
            else:
                x = one[i]
                if kind == _IF_LESS:
                    jumps = x < y
                elif kind == _IF_LESS_OR_EQUAL:
                    jumps = x <= y
                elif kind == _IF_EQUAL:
                    jumps = x == y
                elif kind == _UNLESS_LESS:
                    jumps = not x < y
                elif kind == _UNLESS_LESS_OR_EQUAL:
                    jumps = not x <= y
                else:
                    jumps = x != y
                if jumps:
                    at = c


@functools.cache
def virtual_step() -> Any:
    """Return the compiled C callback that executes bytecode; its data is `Machine.data`."""
    return cached_cfunc(STEP_SIGNATURE, error_model="numpy")(_run)


class Machine:
    """The bytecode of the whole step of a ground model.

    Raises:
        SerpError: It does not fit into the registers.
    """

    def __init__(self, ground: GroundModel) -> None:
        assembler, actions = Assembler(), range(len(ground.actions))
        following = assembler.add(statements_of(ground, -1))
        entries = [assembler.add(statements_of(ground, action), following) for action in actions]
        table = assembler.table()
        self._constants = np.array(list(assembler.constants), dtype=np.float64)
        self._entries = np.array(entries, dtype=np.float64) * table.shape[1]
        jumps = np.isin(table[:, 0], list(JUMPS))
        table[jumps, 3] *= table.shape[1]
        self._code = table.reshape(-1).view(np.float64)

    def data(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the data of `virtual_step` for parameters `[P]`."""
        parts = (np.zeros(_HEAD), theta, self._constants, self._entries, self._code)
        data = np.concatenate(parts)
        starts = np.cumsum([len(part) for part in parts])
        data[[_CONSTANTS, _ENTRIES, _CODE]] = starts[1:4]
        data.flags.writeable = False
        return data
