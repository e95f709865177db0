"""Bytecode: the generated functions as tables of numbers, for models too large to be compiled.

The text of a generated function (see `serp.model.codegen`) is translated statement by statement, so
that the table means what the text means. A compiled loop executes it, see
`serp.model.bytecode.virtual_machine`. Ground actions of one shape, which differ only in the
positions that they read and write, are parsed once.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from serp.model.bytecode.instructions import Code, Table
from serp.model.bytecode.translation import Shape, translate

_INDEX: Final = re.compile(r"\b(s|out|theta)\[(\d+)\]")


class Assembler:
    """Translates statements of the generated code to one table.

    Attributes:
        constants: The numbers that are written in the text.
    """

    def __init__(self) -> None:
        self.constants: dict[float, int] = {}
        self._shapes: dict[str, Shape] = {}
        self._tables: list[Table] = []
        self._length = 0

    def add(self, statements: Sequence[str], following: int = -1) -> int:
        """Append statements; return the position of the first.

        Args:
            statements: Lines of generated code.
            following: Position of the instruction that follows; -1 where the statements end with
                a return.
        """
        text = "\n".join(statements)
        found = [int(index) for _, index in _INDEX.findall(text)]
        form = _INDEX.sub(r"\1[]", text)
        shape = self._shapes.get(form)
        if shape is None:
            count = itertools.count()
            numbered = _INDEX.sub(lambda found: f"{found[1]}[{next(count)}]", text)
            shape = self._shapes[form] = translate(numbered, self.constants)
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
