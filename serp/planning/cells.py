"""The values of cells of the state space in a checkpoint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._core import CellValues
from serp._util.saved_state import Arrays, Saved

_COLUMNS: Final = ("low", "scale", "area", "states", "value", "area_value")
"""Values of areas are saved, too: they are those of when the cells were found."""


def saved_values(values: CellValues | None) -> Arrays:
    """Return arrays that `restored_values` takes."""
    return dict.fromkeys(_COLUMNS, np.zeros(0)) if values is None else values.columns()


def restored_values(arrays: Mapping[str, NDArray[Any]], width: int) -> CellValues | None:
    """Return what `saved_values` was given; a state has `width` numbers.

    Raises:
        RunError: The arrays are damaged.
    """
    saved = Saved("values of cells", arrays, {})
    columns = {name: saved.array(name, np.float64, (-1,)) for name in _COLUMNS}
    if not any(column.size for column in columns.values()):
        return None
    low = columns["low"]
    if len(low) != width:
        raise saved.wrong(f"low has {len(low)} numbers for {width} fluents")
    try:
        return CellValues(**columns)
    except ValueError as error:
        raise saved.wrong(str(error)) from None
