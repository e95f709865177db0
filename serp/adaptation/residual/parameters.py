"""What compiled code reads of one regression: its layout within the parameter buffer.

A regression is shared by all actions whose feature groups have the same roles, inputs and targets.
Shapes: d inputs, T targets, H heads (action schemas), R rows (heads, then modes of heads).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import Arrays, Saved
from serp.adaptation.feature_groups import FeatureGroup
from serp.model.transition_model import Vector

MODES: Final = 8
"""Most combinations of a head and values of the group's predicates with their own linear part."""
RANGE: Final = 1.3
"""Normalised inputs larger than this are outside of the range of the data; if samples have them,
all are normalised anew."""
SMOOTH, FEATURES = 64, 256
"""Numbers of random Fourier features: of a smooth model and of a full one."""
CODES: Final = 64
"""Number of values of a group's predicates; the code of a mode is head · CODES + value."""
MAX_INPUTS: Final = 96  # compiled code keeps them on the stack
MAX_COLUMNS: Final = 640
"""Most columns of the linear part of a regression, which is solved often."""

_WIDEST, _NARROWEST = 0.4, 1.2
"""Frequencies are drawn with standard deviations in this range, for normalised inputs: a mixture of
kernels."""

FILE, LINEAR, CURVED, FULL = range(4)
"""The predictor of a fluent: the file alone, or the file with a linear model, one with the
smoothest random features, or one with all of them."""

(
    R_HEADS, R_MODES, R_BITS, R_FEATURES, R_KNOWN, R_POSITIONS, R_CODES, R_KINDS, R_LINEAR,
    R_AMPLITUDE, R_CENTRE, R_SHRINK, R_FREQUENCY, R_PHASE, R_INVERSE, R_TYPICAL,
    R_SCALE, R_ROWS, HEADER,
) = range(19)  # fmt: skip


def entry(index: int, kind: Callable[[float], int]) -> Any:
    """Return a property that is stored as one float64 of the owner's `_header`."""

    def write(owner: Any, value: int) -> None:
        owner._header[index] = value

    return property(lambda owner: kind(owner._header[index]), write)


class RegressionParameters:
    """Views of the part of the buffer that belongs to one regression.

    Attributes:
        heads, rows, depth, count: H, R, d and T.
        modes: Number of modes with a separate linear part.
        features: Number of random features in use: 0 or `FEATURES`.
        known: Columns of `inverse` in use; 0 before the first solution.
        columns: Number of columns of the linear part of the design matrix.
        codes: `[R]` codes of modes.
        kinds: `[T]` the predictor in use.
        linear: `[R, 3, T, 1 + d]` weights of a constant and the normalised inputs, by kind.
        amplitude: `[2, T, FEATURES]` weights of the random features, by kind.
        centre, shrink: `[d]` normalised inputs are (x - centre) · shrink.
        frequency: `[d, FEATURES]`.
        phase: `[FEATURES]`.
        inverse: `[columns + SMOOTH, same]` inverse of the Cholesky factor of the smooth model.
        typical: `[R, T]` typical error of the predictor in use.
        scale: `[4, T]` typical error where nothing is known, typical change, and two sums that the
            first is computed from.
    """

    modes, features, known = (entry(index, int) for index in (R_MODES, R_FEATURES, R_KNOWN))

    def __init__(self, buffer: Vector, start: int, group: FeatureGroup, heads: int) -> None:
        self._header = buffer[start : start + HEADER]
        self.heads, self.rows, self.depth = heads, rows_of(group, heads), len(group.inputs)
        self.count, self.columns = len(group.targets), columns_of(group, heads)
        at = start + HEADER
        parts: dict[int, Vector] = {}
        for name, shape in _shapes(group, heads).items():
            size = int(np.prod(shape))
            self._header[name] = at
            parts[name] = buffer[at : at + size].reshape(shape)
            at += size
        self._header[R_HEADS], self._header[R_BITS] = heads, len(group.bits)
        self._header[R_ROWS] = self.rows
        parts[R_POSITIONS][:] = group.bits
        self.codes, self.kinds, self.linear = parts[R_CODES], parts[R_KINDS], parts[R_LINEAR]
        self.amplitude, self.centre = parts[R_AMPLITUDE], parts[R_CENTRE]
        self.shrink, self.frequency = parts[R_SHRINK], parts[R_FREQUENCY]
        self.phase, self.inverse = parts[R_PHASE], parts[R_INVERSE]
        self.typical, self.scale = parts[R_TYPICAL], parts[R_SCALE]
        self.all = buffer[start:at]
        self._weights = buffer[int(self._header[R_CODES]) : at]

    @property
    def head_of_rows(self) -> NDArray[np.int64]:
        """The head of each row, `[R]`."""
        of_modes = self.codes[self.heads :].astype(np.int64) // CODES
        return np.concatenate((np.arange(self.heads), of_modes))

    def draw(self, seed: np.random.SeedSequence) -> None:
        """Draw random features, the smoothest first."""
        random = np.random.default_rng(seed)
        width = np.exp(random.uniform(np.log(_WIDEST), np.log(_NARROWEST), FEATURES))
        frequency = width * random.standard_normal(self.frequency.shape)
        order = np.argsort((frequency**2).sum(axis=0), kind="stable")
        self.frequency[:] = frequency[:, order]
        self.phase[:] = random.uniform(0.0, 2.0 * np.pi, FEATURES)
        self.features = FEATURES

    def clear(self) -> None:
        """Use the file alone."""
        self._weights[:] = 0.0
        self.modes = self.features = self.known = 0

    def contents(self) -> Arrays:
        """Return what is published."""
        sizes = np.array([self.modes, self.features, self.known])
        return {"sizes": sizes, "weights": self._weights.copy()}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Publish what `contents` returned; a `RunError` refuses what does not fit."""
        saved = Saved("adaptation", arrays, {})
        sizes = saved.array("sizes", np.int64, (3,), 0, MAX_COLUMNS + SMOOTH)
        weights = saved.array("weights", np.float64, self._weights.shape)
        modes, features, known = sizes.tolist()
        first = self.codes.size
        kinds = weights[first : first + self.kinds.size]
        codes = weights[:first]
        if (
            modes > self.rows - self.heads
            or features not in (0, FEATURES)
            or known not in (0, self.columns, self.columns + SMOOTH)
            or (known > self.columns and not features)
            or not np.isin(kinds, range(1 + FULL)).all()
            or not np.isin(codes, range(self.heads * CODES)).all()
        ):
            raise saved.wrong("modes, random features or predictors are out of range")
        self._weights[:] = weights
        self.modes, self.features, self.known = modes, features, known


def rows_of(group: FeatureGroup, heads: int) -> int:
    """Return the number of rows of a regression."""
    return heads + (min(MODES, heads * 2 ** len(group.bits)) if group.bits else 0)


def columns_of(group: FeatureGroup, heads: int) -> int:
    """Return the number of columns of the linear part: shared by all rows, and of each row."""
    return (1 + rows_of(group, heads)) * (1 + len(group.inputs))


def learnable(group: FeatureGroup, heads: int) -> bool:
    """Return whether there are few enough inputs to learn from."""
    return len(group.inputs) <= MAX_INPUTS and columns_of(group, heads) <= MAX_COLUMNS


def size_of(group: FeatureGroup, heads: int) -> int:
    """Return the number of entries of a regression in the buffer."""
    return HEADER + sum(int(np.prod(shape)) for shape in _shapes(group, heads).values())


def _shapes(group: FeatureGroup, heads: int) -> dict[int, tuple[int, ...]]:
    depth, count, rows = len(group.inputs), len(group.targets), rows_of(group, heads)
    size = columns_of(group, heads) + SMOOTH
    return {
        R_POSITIONS: (len(group.bits),),
        R_CODES: (rows,),
        R_KINDS: (count,),
        R_LINEAR: (rows, 3, count, 1 + depth),
        R_AMPLITUDE: (2, count, FEATURES),
        R_CENTRE: (depth,),
        R_SHRINK: (depth,),
        R_FREQUENCY: (depth, FEATURES),
        R_PHASE: (FEATURES,),
        R_INVERSE: (size, size),
        R_TYPICAL: (rows, count),
        R_SCALE: (4, count),
    }
