"""The memory that the compiled adapted step reads, and the file's step with the parameters in use.

Everything is a float64 in one array that never moves, so that every holder of its address sees each
adaptation at once. Whole numbers (addresses, offsets) are floats too; they are exact below 2^53.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp._util.saved_state import Arrays, Saved, nested, part_of
from serp.errors import RunError
from serp.model.flags import APPLICABLE
from serp.model.learned.residual_features import (
    FeatureGroup,
    Key,
    RegressionParameters,
    entry,
    learnable,
    size_of,
)
from serp.model.native import advanced, call_step, pointer_to
from serp.model.transition_model import Vector

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

# Header of the buffer.
(
    STEP, FLOW, SETTLE, WIDTH, ACTIVE, STOCHASTIC, FLAGGING, REVISED, WRITTEN, PARAMETERS,
    TABLE, OTHERS, SCHEMAS, HEADER,
) = range(14)  # fmt: skip
# A feature group of an action.
G_INPUTS, G_TARGETS, G_DEPTH, G_COUNT, G_SHARED, GROUP = range(6)
# The part shared by groups of one key: the position of its regression (0: none), the head of its
# schema in it, and the offset of its outcome counts.
S_REGRESSION, S_HEAD, S_OUTCOMES, SHARED = range(4)


class GroupParameters:
    """The part of the buffer that feature groups of one key share.

    Attributes:
        regression: The regression of its residual; None where there are too many inputs to learn.
    """

    def __init__(self, buffer: Vector, start: int, regression: RegressionParameters | None) -> None:
        self._header = buffer[start : start + SHARED]
        self._base = buffer.ctypes.data
        self._outcomes: Vector | None = None
        self.regression = regression

    @property
    def head(self) -> int:
        """Position of the schema among those that share the regression."""
        return int(self._header[S_HEAD])

    @property
    def outcomes(self) -> Vector | None:
        """The outcome counts in use, see `serp.model.learned.outcome_table`, or None."""
        return self._outcomes

    @outcomes.setter
    def outcomes(self, table: Vector | None) -> None:
        # The table is a separate array; its address is stored relative to the buffer's.
        offset = 0 if table is None else (table.ctypes.data - self._base) // table.itemsize
        self._outcomes = table
        self._header[S_OUTCOMES] = offset


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
        regressions: Key without the schema → the part of the regression of its residual.
        active: Whether anything is adapted.
        stochastic: Whether outcome counts are used anywhere.
        revised: Whether parameters in use differ from those written.
    """

    active = entry(ACTIVE, bool)
    stochastic = entry(STOCHASTIC, bool)
    revised = entry(REVISED, bool)

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
        heads: dict[Key, list[FeatureGroup]] = {}
        for key, group in keys.items():
            heads.setdefault(key[1:], []).append(group)
        parts: dict[Key, int] = {}
        for roles, alike in heads.items():
            learned = bool(alike[0].targets) and learnable(alike[0], len(alike))
            parts[roles] = len(numbers) if learned else 0
            numbers += [0.0] * (size_of(alike[0], len(alike)) if learned else 0)
            for head, group in enumerate(alike):
                starts[group.key] = len(numbers)
                numbers += [parts[roles], head, 0.0]
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
        self.regressions = {
            roles: RegressionParameters(self.array, start, heads[roles][0], len(heads[roles]))
            for roles, start in parts.items()
            if start
        }
        self.shared = {
            key: GroupParameters(self.array, starts[key], self.regressions.get(key[1:]))
            for key in keys
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
        for k, regression in enumerate(self.regressions.values()):
            arrays |= nested(f"regression{k}", regression.contents())
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
        for k, regression in enumerate(self.regressions.values()):
            regression.restore(part_of(arrays, f"regression{k}"))
        for shared in self.shared.values():
            shared.outcomes = None
        self.adopt(parameters)
        self.active, self.stochastic = map(bool, flags)


# The file's step; `buffer` is a pointer unless said otherwise.


@cached_njit(nogil=True, forceinline=True)
def flow(buffer, action, state, dt, out):
    """Write the state after effects and processes, and the reward, to `out`; return the flags."""
    for i in range(int(buffer[WIDTH])):
        out[i] = state[i]
    out[int(buffer[WIDTH])] = 0.0
    parameters = advanced(buffer, int(buffer[PARAMETERS]))
    return call_step(int(buffer[FLOW]), state, action, parameters, dt, out)


@cached_njit(nogil=True, forceinline=True)
def settle(buffer, state, flags, dt, out):
    """Apply events to `out`, a step that has such flags so far; return the flags."""
    parameters = advanced(buffer, int(buffer[PARAMETERS]))
    return call_step(int(buffer[SETTLE]), state, flags, parameters, dt, out)


@cached_njit(nogil=True)
def _flow_and_settle(buffer, action, state, dt, flowed, settled):
    base, source = pointer_to(buffer, 0), pointer_to(state, 0)
    flags = flow(base, action, source, dt, pointer_to(flowed, 0))
    settled[:] = flowed
    if flags & APPLICABLE:
        settle(base, source, flags, dt, pointer_to(settled, 0))
    return flags


class ObservedStep(NamedTuple):
    """An observed transition, beside what the file says of it.

    Attributes:
        state, action, next_state: The transition; states are `[F]`.
        over: Whether it ended the episode.
        flowed: `[F + 1]` state and reward after effects and processes.
        settled: `[F + 1]` the same after events.
        flags: Flags of the former.
    """

    state: Vector
    action: int
    next_state: Vector
    over: bool
    flowed: Vector
    settled: Vector
    flags: int


def observed_step(
    buffer: Vector, dt: float, state: Vector, action: int, next_state: Vector, over: bool
) -> ObservedStep | None:
    """Return a transition to learn from; None if its action is not applicable by the file.

    `buffer` is the array.
    """
    flowed, settled = np.empty((2, len(state) + 1))
    flags = int(_flow_and_settle(buffer, action, state, dt, flowed, settled))
    if not flags & APPLICABLE:
        return None
    return ObservedStep(state, action, next_state, over, flowed, settled, flags)
