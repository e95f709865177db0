"""The instructions of bytecode, and a check of them.

An instruction is four numbers: a code and up to three operands. An operand is a memory and a
position in it; a jump has its target in the last place.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

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

POSITION: Final = (1 << SHIFT) - 1
"""The bits of an operand that are the position."""

JUMPS: Final = {
    Code.JUMP_IF, Code.JUMP_UNLESS, Code.JUMP, Code.IF_LESS, Code.IF_LESS_OR_EQUAL, Code.IF_EQUAL,
    Code.UNLESS_LESS, Code.UNLESS_LESS_OR_EQUAL, Code.UNLESS_EQUAL,
}  # fmt: skip
_OF_TWO: Final = {Code.ADD, Code.SUBTRACT, Code.MULTIPLY, Code.DIVIDE, Code.ATAN2}
_WRITES: Final = {*_OF_TWO, Code.MOVE, Code.NEGATE, Code.SQRT, Code.SIN, Code.COS}
_READS: Final = (
    {Code.JUMP_IF, Code.JUMP_UNLESS} | (JUMPS - {Code.JUMP}),
    (JUMPS - {Code.JUMP, Code.JUMP_IF, Code.JUMP_UNLESS}) | _WRITES,
    _OF_TWO,
)
"""The codes that read their first, second and third operand."""


def check(table: Table, sizes: dict[Memory, int]) -> None:
    """Check that instructions read and write only inside of the memories, and end.

    Raises:
        ValueError: One does not.
    """
    codes = table[:, 0]
    if not np.isin(codes, list(Code)).all() or codes[-1] not in (Code.RETURN, Code.JUMP):
        raise ValueError("there is no such instruction, or the last one is followed by none")
    targets = table[np.isin(codes, list(JUMPS)), 3]
    if ((targets < 0) | (targets >= len(table))).any():
        raise ValueError("a jump leaves the code")
    room = np.array([sizes[memory] for memory in Memory])
    written = np.isin(codes, list(_WRITES))
    for column, readers in enumerate(_READS, 1):
        operands = table[np.isin(codes, list(readers)) | (written & (column == 1)), column]
        memory, position = operands >> SHIFT, operands & POSITION
        if ((memory < 0) | (memory >= len(room))).any():
            raise ValueError("there is no such memory")
        if (position >= room[memory]).any():
            raise ValueError("an operand lies outside of its memory")
    targets = table[written, 1] >> SHIFT
    if not np.isin(targets, [Memory.REGISTERS, Memory.OUT]).all():
        raise ValueError("an instruction writes to what must not change")
