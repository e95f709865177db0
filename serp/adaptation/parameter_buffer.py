"""The memory that the compiled adapted step reads: parameters and weights in one array.

Everything is a float64 in one array that never moves, so that every holder of its address sees each
adaptation at once. Whole numbers (addresses, offsets) are floats too; they are exact below 2^53.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, Generic, TypeVar

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
    STEP, FLOW, SETTLE, WIDTH, ACTIVE, STOCHASTIC, ENABLED, FLAGGING, REVISED, WRITTEN, PARAMETERS,
    TABLE, HEADER,
) = range(13)  # fmt: skip
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

_T = TypeVar("_T", bound=int)


class _Entry(Generic[_T]):
    """An attribute that is stored as one float64 of the owner's `_header`."""

    def __init__(self, index: int, kind: Callable[[float], _T]) -> None:
        self._index = index
        self._kind = kind

    def __get__(self, owner: Any, _: type | None = None) -> _T:
        return self._kind(owner._header[self._index])

    def __set__(self, owner: Any, value: _T) -> None:
        owner._header[self._index] = value


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

    modes = _Entry(S_MODES, int)
    fourier = _Entry(S_FOURIER, int)

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
        self.end = at
        self._header[S_BITS] = len(group.bits)
        parts[S_POSITIONS][:] = group.bits
        self.codes, self.kinds, self.linear = parts[S_CODES], parts[S_KINDS], parts[S_LINEAR]
        self.centre, self.shrink = parts[S_CENTRE], parts[S_SHRINK]
        self.frequency, self.phase = parts[S_FREQUENCY], parts[S_PHASE]
        self.amplitude = parts[S_AMPLITUDE]

    @staticmethod
    def _shapes(group: FeatureGroup) -> dict[int, tuple[int, ...]]:
        depth, count = len(group.inputs), len(group.targets)
        return {
            S_CODES: (1 + MODES,),
            S_POSITIONS: (len(group.bits),),
            S_KINDS: (1 + MODES, count),
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
        """The table of outcome counts in use, see `serp.adaptation.outcome_kernels`, or None."""
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
        """Return the published weights, without outcome counts."""
        sizes = np.array([self.modes, self.fourier])
        return {"sizes": sizes, **{name: getattr(self, name).copy() for name in self._SAVED}}

    def checked(self, arrays: Mapping[str, NDArray[Any]]) -> Mapping[str, NDArray[Any]]:
        """Check what `contents` returned, and return it.

        Raises:
            RunError: It belongs to another group, or is damaged.
        """
        saved = Saved("adaptation", arrays, {})
        modes, fourier = saved.array("sizes", np.int64, (2,), 0, max(MODES, FOURIER)).tolist()
        for name in self._SAVED:
            array = saved.array(name, np.float64, getattr(self, name).shape)
            if name == "kinds" and not np.isin(array, (FILE, LINEAR, NONLINEAR, OWN)).all():
                raise saved.wrong("kinds are out of range")
        if modes > MODES or fourier not in (0, FOURIER):
            raise saved.wrong(f"there are {modes} modes and {fourier} random features")
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Publish the result of `checked`; the owner of the outcome counts restores these."""
        for name in self._SAVED:
            getattr(self, name)[:] = arrays[name]
        self.modes, self.fourier = arrays["sizes"].tolist()
        self.outcomes = None

    _SAVED: Final = (
        "codes", "kinds", "linear", "centre", "shrink", "frequency", "phase", "amplitude",
    )  # fmt: skip


class ParameterBuffer:
    """The array and its parts.

    Args:
        groups: Feature groups of every ground action, in the order of the model.
        width: F.
        theta: Parameters as written.
        flagging: Whether events can make `unsafe` true.
        addresses: Addresses of the compiled `step`, `flow` and `settle`.

    Attributes:
        array: The whole array.
        parameters: `[P]` the parameters in use, read-only; see `adopt`.
        shared: Key → the part that its groups share.
        active: Whether anything is adapted.
        enabled: Whether residuals and outcome counts are used.
        stochastic: Whether outcome counts are used anywhere.
        revised: Whether parameters in use differ from those written.
    """

    active = _Entry(ACTIVE, bool)
    enabled = _Entry(ENABLED, bool)
    stochastic = _Entry(STOCHASTIC, bool)
    revised = _Entry(REVISED, bool)

    def __init__(
        self,
        groups: Sequence[Sequence[FeatureGroup]],
        width: int,
        theta: Vector,
        flagging: bool,
        addresses: Iterable[float],
    ) -> None:
        flat = [group for of_action in groups for group in of_action]
        keys = {group.key: group for group in flat}
        size = HEADER + 2 * len(theta) + 2 * len(groups)
        size += sum(GROUP + len(group.inputs) + len(group.targets) for group in flat)
        size += sum(GroupParameters.size(group) for group in keys.values())
        self.array: Vector = np.zeros(size)
        array = self._header = self.array
        array[[STEP, FLOW, SETTLE]] = list(addresses)
        array[WIDTH], array[FLAGGING], array[ENABLED] = width, flagging, True
        at = HEADER
        array[WRITTEN], array[PARAMETERS] = at, at + len(theta)
        self._parameters = array[at + len(theta) : at + 2 * len(theta)]
        self._written = array[at : at + len(theta)]
        self._written[:] = self._parameters[:] = theta
        self.parameters = self._parameters.view()
        self.parameters.flags.writeable = False
        at += 2 * len(theta)
        table = at
        array[TABLE] = table
        at += 2 * len(groups)
        self.shared: dict[Key, GroupParameters] = {}
        starts: dict[Key, int] = {}
        for key, group in keys.items():
            starts[key] = at
            self.shared[key] = GroupParameters(array, at, group)
            at = self.shared[key].end
        for action, of_action in enumerate(groups):
            array[table + 2 * action : table + 2 * action + 2] = len(of_action), at
            lists = at + GROUP * len(of_action)
            for group in of_action:
                inputs, targets = lists, lists + len(group.inputs)
                array[at : at + GROUP] = (
                    inputs, targets, len(group.inputs), len(group.targets), starts[group.key],
                )  # fmt: skip
                array[inputs:targets] = group.inputs
                lists = targets + len(group.targets)
                array[targets:lists] = group.targets
                at += GROUP
            at = lists

    def adopt(self, parameters: Vector) -> None:
        """Use parameters `[P]` from now on."""
        self._parameters[:] = parameters
        self.revised = bool((self._parameters != self._written).any())

    def contents(self) -> Arrays:
        """Return the published values, without offsets, outcome counts and addresses."""
        arrays = {
            "written": self._written.copy(),
            "parameters": self._parameters.copy(),
            "flags": np.array([self.active, self.enabled, self.stochastic]),
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
        flags = saved.array("flags", np.bool_, (3,))
        parts = [
            shared.checked(part_of(arrays, f"group{k}"))
            for k, shared in enumerate(self.shared.values())
        ]
        for shared, part in zip(self.shared.values(), parts, strict=True):
            shared.restore(part)
        self.adopt(parameters)
        self.active, self.enabled, self.stochastic = map(bool, flags)
