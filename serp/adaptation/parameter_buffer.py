"""The memory that the compiled adapted step reads: parameters and weights in one array.

Everything is a float64 in one array that never moves, so that every holder of its address sees each
adaptation at once. Whole numbers (addresses, offsets) are floats too; they are exact below 2^53.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import Arrays, Saved, nested, part_of
from serp.adaptation.feature_groups import FeatureGroup, Key
from serp.errors import RunError
from serp.model.transition_model import Vector

MODES: Final = 16
"""Most modes (values of a group's predicates) with a separate linear model."""
FOURIER: Final = 100
"""Number of random Fourier features of a nonlinear model (Rahimi & Recht, 2007)."""

# Header of the buffer.
(
    STEP, FLOW, SETTLE, WIDTH, ACTIVE, STOCHASTIC, FLAGGING, REVISED, WRITTEN, PARAMETERS,
    TABLE, OTHERS, SCHEMAS, HEADER,
) = range(14)  # fmt: skip
# A feature group of an action.
G_INPUTS, G_TARGETS, G_DEPTH, G_COUNT, G_SHARED, GROUP = range(6)
# The part shared by groups of one key.
(
    S_MODES, S_BITS, S_FOURIER, S_CODES, S_POSITIONS, S_KINDS, S_LINEAR, S_CENTRE, S_SHRINK,
    S_FREQUENCY, S_PHASE, S_AMPLITUDE, S_OUTCOMES, SHARED,
) = range(14)  # fmt: skip

FILE, LINEAR, NONLINEAR, OWN = range(4)
"""The predictor of a fluent in a mode: the file only, or the file with a linear model, a linear
model with random features, or a separate linear model of the mode."""


def _entry(index: int, kind: Callable[[float], int]) -> Any:
    """Return a property that is stored as one float64 of the owner's `_header`."""

    def write(owner: Any, value: int) -> None:
        owner._header[index] = value

    return property(lambda owner: kind(owner._header[index]), write)


class GroupParameters:
    """Views of the part of the buffer that feature groups of one key share.

    Attributes:
        codes: `[1 + MODES]` bit patterns of the modes; entry 0 stands for all others.
        kinds: `[1 + MODES, T]` the predictor in use.
        linear: `[1 + MODES + 1, T, 1 + d]` weights of a constant and the inputs: of all modes, of
            each mode, and those used with the random features.
        centre, shrink: `[d]` the inputs of the random features are (x - centre) · shrink.
        frequency: `[FOURIER, d]`.
        phase: `[FOURIER]`.
        amplitude: `[T, FOURIER]`.
        modes: Number of modes with a separate model.
        fourier: Random features in use: 0 or `FOURIER`.
    """

    modes = _entry(S_MODES, int)
    fourier = _entry(S_FOURIER, int)

    def __init__(self, buffer: Vector, start: int, group: FeatureGroup) -> None:
        self._header = buffer[start : start + SHARED]
        self._base = buffer.ctypes.data
        self._outcomes: Vector | None = None
        at = start + SHARED
        parts: dict[int, Vector] = {}
        for name, shape in self._shapes(group).items():
            size = int(np.prod(shape))
            self._header[name] = at
            parts[name] = buffer[at : at + size].reshape(shape)
            at += size
        self._header[S_BITS] = len(group.bits)
        parts[S_POSITIONS][:] = group.bits
        self.kinds, self.codes, self.linear = parts[S_KINDS], parts[S_CODES], parts[S_LINEAR]
        self.centre, self.shrink = parts[S_CENTRE], parts[S_SHRINK]
        self.frequency, self.phase = parts[S_FREQUENCY], parts[S_PHASE]
        self.amplitude = parts[S_AMPLITUDE]
        self._weights = buffer[int(self._header[S_KINDS]) : at]

    @staticmethod
    def _shapes(group: FeatureGroup) -> dict[int, tuple[int, ...]]:
        depth, count = len(group.inputs), len(group.targets)
        return {
            S_POSITIONS: (len(group.bits),),
            S_KINDS: (1 + MODES, count),
            S_CODES: (1 + MODES,),
            S_LINEAR: (2 + MODES, count, 1 + depth),
            S_CENTRE: (depth,),
            S_SHRINK: (depth,),
            S_FREQUENCY: (FOURIER, depth),
            S_PHASE: (FOURIER,),
            S_AMPLITUDE: (count, FOURIER),
        }

    @classmethod
    def size(cls, group: FeatureGroup) -> int:
        """Return the number of entries of the shared parameters of a group."""
        return SHARED + sum(int(np.prod(shape)) for shape in cls._shapes(group).values())

    @property
    def outcomes(self) -> Vector | None:
        """The outcome counts in use, see `serp.adaptation.outcomes.table_kernels`, or None."""
        return self._outcomes

    @outcomes.setter
    def outcomes(self, table: Vector | None) -> None:
        # The table is a separate array; its address is stored relative to the buffer's.
        offset = 0 if table is None else (table.ctypes.data - self._base) // table.itemsize
        self._outcomes = table
        self._header[S_OUTCOMES] = offset

    def clear(self) -> None:
        """Use only the file for predictions."""
        self.clear_residual()
        self.outcomes = None

    def clear_residual(self) -> None:
        """Remove the residual; outcome counts are kept."""
        self.kinds[:] = FILE
        self.codes[:] = 0.0
        self.linear[:] = 0.0
        self.amplitude[:] = 0.0
        self.modes = self.fourier = 0

    def contents(self) -> Arrays:
        """Return what is published, without outcome counts."""
        return {"sizes": np.array([self.modes, self.fourier]), "weights": self._weights.copy()}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Publish what `contents` returned; the owner of the outcome counts restores these."""
        saved = Saved("adaptation", arrays, {})
        modes, fourier = saved.array("sizes", np.int64, (2,), 0, FOURIER).tolist()
        weights = saved.array("weights", np.float64, self._weights.shape)
        kinds = weights[: self.kinds.size]
        if modes > MODES or fourier % FOURIER or not np.isin(kinds, range(1 + OWN)).all():
            raise saved.wrong("modes, random features or predictors are out of range")
        self._weights[:] = weights
        self.modes, self.fourier = modes, fourier
        self.outcomes = None


class ParameterBuffer:
    """The array and its parts.

    `groups` are the feature groups of every ground action, in the order of the model; `others`
    `[A, S]` are the ground actions of each schema with the same arguments, -1 for none and for its
    own schema; `flagging` says whether events can make `unsafe` true; `addresses` are those of the
    compiled `step`, `flow` and `settle`.

    Attributes:
        array: The whole array.
        parameters: `[P]` the parameters in use, read-only; see `adopt`.
        shared: Key → the part that its groups share.
        active: Whether anything is adapted.
        stochastic: Whether outcome counts are used anywhere.
        revised: Whether parameters in use differ from those written.
    """

    active = _entry(ACTIVE, bool)
    stochastic = _entry(STOCHASTIC, bool)
    revised = _entry(REVISED, bool)

    def __init__(
        self,
        groups: Sequence[Sequence[FeatureGroup]],
        others: NDArray[np.int64],
        width: int,
        theta: Vector,
        flagging: bool,
        addresses: Iterable[float],
    ) -> None:
        numbers = [0.0] * HEADER
        numbers[STEP : SETTLE + 1] = addresses
        numbers[WIDTH], numbers[FLAGGING] = width, flagging
        numbers[WRITTEN], numbers[PARAMETERS] = HEADER, HEADER + len(theta)
        numbers += [*theta, *theta]
        numbers[OTHERS], numbers[SCHEMAS] = len(numbers), others.shape[1]
        numbers += others.ravel().tolist()
        table = len(numbers)
        numbers[TABLE] = table
        numbers += [0.0] * (2 * len(groups))
        keys = {group.key: group for of_action in groups for group in of_action}
        starts: dict[Key, int] = {}
        for key, group in keys.items():
            starts[key] = len(numbers)
            numbers += [0.0] * GroupParameters.size(group)
        for action, of_action in enumerate(groups):
            first = len(numbers)
            numbers[table + 2 * action : table + 2 * action + 2] = len(of_action), first
            inputs = first + GROUP * len(of_action)
            for group in of_action:
                targets = inputs + len(group.inputs)
                depth, count = len(group.inputs), len(group.targets)
                numbers += [inputs, targets, depth, count, starts[group.key]]
                inputs = targets + count
            for group in of_action:
                numbers += [*group.inputs, *group.targets]
        self.array = self._header = np.array(numbers)
        self._written, self._parameters = self.array[HEADER : HEADER + 2 * len(theta)].reshape(
            2, -1
        )
        self.parameters = self._parameters.view()
        self.parameters.flags.writeable = False
        self.shared = {
            key: GroupParameters(self.array, starts[key], group) for key, group in keys.items()
        }

    def adopt(self, parameters: Vector) -> None:
        """Use parameters `[P]` from now on."""
        self._parameters[:] = parameters
        self.revised = bool((self._parameters != self._written).any())

    def contents(self) -> Arrays:
        """Return the published values, without offsets, outcome counts and addresses."""
        arrays = {
            "written": self._written.copy(),
            "parameters": self._parameters.copy(),
            "flags": np.array([self.active, self.stochastic]),
        }
        for k, shared in enumerate(self.shared.values()):
            arrays |= nested(f"group{k}", shared.contents())
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Publish what `contents` returned; the owner of the outcome counts restores these.

        Raises:
            RunError: It belongs to a model of another shape or with other parameters, or is
                damaged.
        """
        if not np.array_equal(arrays.get("written", ()), self._written):
            raise RunError(
                "the saved adaptation belongs to another domain file; continue with the one it "
                "was learned with"
            )
        saved = Saved("adaptation", arrays, {})
        parameters = saved.array("parameters", np.float64, self._parameters.shape)
        flags = saved.array("flags", np.bool_, (2,))
        for k, shared in enumerate(self.shared.values()):
            shared.restore(part_of(arrays, f"group{k}"))
        self.adopt(parameters)
        self.active, self.stochastic = map(bool, flags)
