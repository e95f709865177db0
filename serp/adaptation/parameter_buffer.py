"""The memory that the compiled corrected step reads: literals, views and weights in one array.

Everything is a float64 in one array that never moves, so that whoever holds its address sees each
correction at once. Whole numbers (addresses, offsets) are kept as floats too; they are exact below
2^53.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import Arrays, Saved, nested, part_of
from serp.adaptation.feature_groups import FeatureGroup, Key
from serp.errors import RunError

MODES: Final = 16
"""Modes (truth values of the predicates in view) that have a model of their own, at most."""
WAVES: Final = 100
"""Random Fourier features of a nonlinear model (Rahimi & Recht, 2007)."""

# Header.
(
    STEP, FLOW, SETTLE, WIDTH, ACTIVE, CHANCY, AMENDS, JUDGED, REVISED, WRITTEN, LITERALS, TABLE,
    HEADER,
) = range(13)  # fmt: skip
# View.
V_INPUTS, V_TARGETS, V_DEPTH, V_COUNT, V_GROUP, VIEW = range(6)
# Group: what views of one key share.
(
    G_MODES, G_BITS, G_WAVES, G_CODES, G_POSITIONS, G_KINDS, G_LINEAR, G_CENTRE, G_SHRINK,
    G_FREQUENCY, G_PHASE, G_AMPLITUDE, G_CHANCE, GROUP,
) = range(14)  # fmt: skip

FILE, LINEAR, WAVY, OWN = range(4)
"""Who predicts a fluent in a mode: the file alone, or beside it a linear model, one with random
features, or a linear model of this mode's own."""

Array = NDArray[np.float64]


class GroupMemory:
    """Views into the block of what one group publishes.

    Attributes:
        codes: `[1 + MODES]` bit patterns of the modes; entry 0 stands for all others.
        kinds: `[1 + MODES, T]` who predicts.
        linear: `[1 + MODES + 1, T, 1 + d]` weights of a constant and the inputs: of all modes, of
            each mode, and those that go with the random features.
        centre, shrink: `[d]` the inputs of the random features are (x - centre) · shrink.
        frequency: `[WAVES, d]`.
        phase: `[WAVES]`.
        amplitude: `[T, WAVES]`.
        start: Where it begins.
    """

    def __init__(self, block: Array, start: int, view: FeatureGroup) -> None:
        depth, count = len(view.inputs), len(view.targets)
        self.start = start
        self._header = block[start : start + GROUP]
        self._base = block.ctypes.data
        self._chance: Array | None = None
        at = start + GROUP
        shapes: dict[int, tuple[int, ...]] = {
            G_CODES: (1 + MODES,),
            G_POSITIONS: (len(view.bits),),
            G_KINDS: (1 + MODES, count),
            G_LINEAR: (2 + MODES, count, 1 + depth),
            G_CENTRE: (depth,),
            G_SHRINK: (depth,),
            G_FREQUENCY: (WAVES, depth),
            G_PHASE: (WAVES,),
            G_AMPLITUDE: (count, WAVES),
        }
        parts: dict[int, Array] = {}
        for name, shape in shapes.items():
            size = int(np.prod(shape))
            self._header[name] = at
            parts[name] = block[at : at + size].reshape(shape)
            at += size
        self.end = at
        self._header[G_BITS] = len(view.bits)
        parts[G_POSITIONS][:] = view.bits
        self.codes, self.kinds, self.linear = parts[G_CODES], parts[G_KINDS], parts[G_LINEAR]
        self.centre, self.shrink = parts[G_CENTRE], parts[G_SHRINK]
        self.frequency, self.phase = parts[G_FREQUENCY], parts[G_PHASE]
        self.amplitude = parts[G_AMPLITUDE]

    @staticmethod
    def size(view: FeatureGroup) -> int:
        """Return how many entries a group of such views takes."""
        depth, count = len(view.inputs), len(view.targets)
        linear = (1 + MODES) + (1 + MODES) * count + (2 + MODES) * count * (1 + depth)
        return GROUP + len(view.bits) + linear + 2 * depth + WAVES * (depth + 1 + count)

    def clear(self) -> None:
        """Let the file alone predict again."""
        self.unlearn()
        self.chance = None

    def unlearn(self) -> None:
        """Forget what was learned of numbers; outcomes are counted as before."""
        self.kinds[:] = FILE
        self.codes[:] = 0.0
        self.linear[:] = 0.0
        self.amplitude[:] = 0.0
        self.modes = self.waves = 0

    def contents(self) -> Arrays:
        """Return what is published, but for counted outcomes."""
        sizes = np.array([self.modes, self.waves])
        return {"sizes": sizes, **{name: getattr(self, name).copy() for name in self._PARTS}}

    def checked(self, arrays: Mapping[str, NDArray[Any]]) -> Mapping[str, NDArray[Any]]:
        """Return what `contents` returned, if it can be published here.

        Raises:
            RunError: It belongs to another group, or is damaged.
        """
        saved = Saved("correction", arrays, {})
        modes, waves = saved.array("sizes", np.int64, (2,), 0, max(MODES, WAVES)).tolist()
        for name in self._PARTS:
            array = saved.array(name, np.float64, getattr(self, name).shape)
            if name == "kinds" and not np.isin(array, (FILE, LINEAR, WAVY, OWN)).all():
                raise saved.wrong("kinds are others than there are")
        if modes > MODES or waves not in (0, WAVES):
            raise saved.wrong(f"there are {modes} modes and {waves} random features")
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Publish what `checked` returned; no outcomes are counted before their owner says so."""
        for name in self._PARTS:
            getattr(self, name)[:] = arrays[name]
        self.modes, self.waves = arrays["sizes"].tolist()
        self.chance = None

    _PARTS: Final = (
        "codes", "kinds", "linear", "centre", "shrink", "frequency", "phase", "amplitude",
    )  # fmt: skip

    @property
    def modes(self) -> int:
        """How many modes have a model of their own."""
        return int(self._header[G_MODES])

    @modes.setter
    def modes(self, number: int) -> None:
        self._header[G_MODES] = number

    @property
    def chance(self) -> Array | None:
        """The table of counted outcomes that is in use; see `serp.adaptation.outcome_kernels`."""
        return self._chance

    @chance.setter
    def chance(self, table: Array | None) -> None:
        # The table lies elsewhere; its place is told relative to the block's.
        away = 0 if table is None else (table.ctypes.data - self._base) // table.itemsize
        self._chance = table
        self._header[G_CHANCE] = away

    @property
    def waves(self) -> int:
        """How many random features there are: 0 or `WAVES`."""
        return int(self._header[G_WAVES])

    @waves.setter
    def waves(self, number: int) -> None:
        self._header[G_WAVES] = number


class ParameterBuffer:
    """The array and its parts.

    Args:
        views: Of every ground action, in the order of the model.
        width: F.
        theta: Literals as written.
        judged: Whether events have a say in what is unsafe.
        addresses: Of the compiled `step`, `flow` and `settle`.

    Attributes:
        array: All of it.
        literals: `[P]` the literals in use, for reading; see `adopt`.
        groups: Key → what is published for it.
    """

    def __init__(
        self,
        views: Sequence[Sequence[FeatureGroup]],
        width: int,
        theta: Array,
        judged: bool,
        addresses: Iterable[float],
    ) -> None:
        flat = [view for of_action in views for view in of_action]
        kinds = {view.key: view for view in flat}
        size = HEADER + 2 * len(theta) + 2 * len(views)
        size += sum(VIEW + len(v.inputs) + len(v.targets) for v in flat)
        size += sum(GroupMemory.size(view) for view in kinds.values())
        self.array: Array = np.zeros(size)
        array = self.array
        array[[STEP, FLOW, SETTLE]] = list(addresses)
        array[WIDTH], array[JUDGED], array[AMENDS] = width, judged, True
        at = HEADER
        array[WRITTEN], array[LITERALS] = at, at + len(theta)
        self._literals = array[at + len(theta) : at + 2 * len(theta)]
        self._written = array[at : at + len(theta)]
        self._written[:] = self._literals[:] = theta
        self.literals = self._literals.view()
        self.literals.flags.writeable = False
        at += 2 * len(theta)
        table = at
        array[TABLE] = table
        at += 2 * len(views)
        self.groups: dict[Key, GroupMemory] = {}
        starts: dict[Key, int] = {}
        for key, view in kinds.items():
            starts[key] = at
            self.groups[key] = GroupMemory(array, at, view)
            at = self.groups[key].end
        for action, of_action in enumerate(views):
            array[table + 2 * action : table + 2 * action + 2] = len(of_action), at
            lists = at + VIEW * len(of_action)
            for view in of_action:
                inputs, targets = lists, lists + len(view.inputs)
                array[at : at + VIEW] = (
                    inputs, targets, len(view.inputs), len(view.targets), starts[view.key],
                )  # fmt: skip
                array[inputs:targets] = view.inputs
                lists = targets + len(view.targets)
                array[targets:lists] = view.targets
                at += VIEW
            at = lists

    def adopt(self, literals: Array) -> None:
        """Use literals `[P]` from now on."""
        self._literals[:] = literals
        self.array[REVISED] = (self._literals != self._written).any()

    @property
    def revised(self) -> bool:
        """Whether literals in use are others than those written."""
        return bool(self.array[REVISED])

    @property
    def active(self) -> bool:
        """Whether anything is corrected."""
        return bool(self.array[ACTIVE])

    @active.setter
    def active(self, value: bool) -> None:
        self.array[ACTIVE] = value

    @property
    def amends(self) -> bool:
        """Whether what is published of residuals and counted outcomes is used."""
        return bool(self.array[AMENDS])

    @amends.setter
    def amends(self, value: bool) -> None:
        self.array[AMENDS] = value

    @property
    def chancy(self) -> bool:
        """Whether counted outcomes are used anywhere."""
        return bool(self.array[CHANCY])

    @chancy.setter
    def chancy(self, value: bool) -> None:
        self.array[CHANCY] = value

    def contents(self) -> Arrays:
        """Return what is published; not where it lies, nor counted outcomes, nor addresses."""
        arrays = {
            "written": self._written.copy(),
            "literals": self._literals.copy(),
            "flags": np.array([self.active, self.amends, self.chancy]),
        }
        for k, group in enumerate(self.groups.values()):
            arrays |= nested(f"group{k}", group.contents())
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Publish what `contents` returned; outcomes are not counted before their owner says so.

        Raises:
            RunError: It belongs to a model of another shape, or with other numbers in its file, or
                is damaged.
        """
        if not np.array_equal(arrays.get("written", ()), self._written):
            raise RunError(
                "the saved correction belongs to another domain file; continue with the one it "
                "was learned with"
            )
        saved = Saved("correction", arrays, {})
        literals = saved.array("literals", np.float64, self._literals.shape)
        flags = saved.array("flags", np.bool_, (3,))
        parts = [
            group.checked(part_of(arrays, f"group{k}"))
            for k, group in enumerate(self.groups.values())
        ]
        for group, part in zip(self.groups.values(), parts, strict=True):
            group.restore(part)
        self.adopt(literals)
        self.active, self.amends, self.chancy = map(bool, flags)
