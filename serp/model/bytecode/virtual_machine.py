"""Running bytecode as machine code: one compiled loop for all domains.

The loop is a C callback with the signature of every compiled transition function. Its data are
the numbers of one array: three positions, the parameters θ, the constants, the entry of each
action, and the instructions, as 32-bit integers. Nothing is compiled for a domain. The results are
those of the generated functions in CPython, bit for bit.
"""

from __future__ import annotations

import functools
import math
from typing import Any, Final

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from serp._util.compilation import cached_cfunc
from serp.model.bytecode.assembler import Assembler
from serp.model.bytecode.instructions import (
    DT,
    JUMPS,
    POSITION,
    REGISTERS,
    REWARD,
    SHIFT,
    TERMINAL_SET,
    UNSAFE_SET,
    Memory,
    check,
)
from serp.model.codegen import statements_of
from serp.model.flags import TERMINAL, UNSAFE
from serp.model.ground import GroundModel
from serp.model.native import STEP_SIGNATURE, advanced, stack_room

# mypy: disable-error-code="no-untyped-def, no-untyped-call, untyped-decorator, no-any-return"

_HEAD: Final = 3
_CONSTANTS, _ENTRIES, _CODE = range(_HEAD)
"""Positions in the data of the positions of its parts; θ follows them."""

_MEMORIES: Final = len(Memory)

_POINTER = types.CPointer(types.float64)
_INTEGERS = types.CPointer(types.int32)
_intrinsic: Any = intrinsic

_JUMP_IF, _JUMP_UNLESS, _MOVE, _JUMP, _RETURN = 0, 1, 2, 3, 4
_ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _ATAN2 = 5, 6, 7, 8, 9
_NEGATE, _SQRT, _SIN, _COS = 10, 11, 12, 13
_LESS, _LESS_OR_EQUAL, _EQUAL = 14, 15, 16
_NOT_LESS, _NOT_LESS_OR_EQUAL, _NOT_EQUAL = 17, 18, 19


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
        i = a & POSITION
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
            y = _at(memories, b >> SHIFT)[b & POSITION]
            if kind == _MOVE:
                one[i] = y
            elif kind == _NEGATE:
                one[i] = -y
            elif kind < _NEGATE:
                z = _at(memories, c >> SHIFT)[c & POSITION]
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
            elif kind < _LESS:
                if kind == _SQRT:
                    one[i] = math.sqrt(y)
                elif kind == _SIN:
                    one[i] = math.sin(y)
                else:
                    one[i] = math.cos(y)
            else:
                x = one[i]
                if kind == _LESS:
                    jumps = x < y
                elif kind == _LESS_OR_EQUAL:
                    jumps = x <= y
                elif kind == _EQUAL:
                    jumps = x == y
                elif kind == _NOT_LESS:
                    jumps = not x < y
                elif kind == _NOT_LESS_OR_EQUAL:
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

    Args:
        ground: The model.

    Raises:
        SerpError: It does not fit into the registers.
    """

    def __init__(self, ground: GroundModel) -> None:
        assembler, actions = Assembler(), range(len(ground.actions))
        following = assembler.add(statements_of(ground, -1))
        entries = [assembler.add(statements_of(ground, action), following) for action in actions]
        table = assembler.table()
        self._parameters = len(ground.parameters)
        self._constants = np.array(list(assembler.constants), dtype=np.float64)
        self._entries = np.array(entries, dtype=np.float64) * table.shape[1]
        sizes = {
            Memory.REGISTERS: REGISTERS,
            Memory.STATE: len(ground.fluents),
            Memory.OUT: len(ground.fluents) + 1,
            Memory.THETA: self._parameters,
            Memory.CONSTANTS: len(self._constants),
        }
        check(table, sizes)
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
