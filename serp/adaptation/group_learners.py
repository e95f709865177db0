"""What is learned beside the file: of each kind of view its residual and its counts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import Arrays, Saved, nested
from serp.adaptation.adapted_model import AdaptedModel
from serp.adaptation.feature_groups import FeatureGroup, Key
from serp.adaptation.outcome_counts import OutcomeCounts
from serp.adaptation.parameter_buffer import MODES
from serp.adaptation.residual.outliers import note_whole
from serp.adaptation.residual.residual import OnlineResidual
from serp.model.transition_model import Vector

_MOST_STATISTICS: Final = 600_000

Meta = dict[str, Any]


class GroupLearners:
    """Learns from env steps what the file does not say, and publishes it in the model.

    All of it is planned with or nothing. A plan weighs one number against another (who is first at
    the ball?), and where one of them is corrected and the other one cannot be, it is led astray by
    the difference, however small the errors of one step are. So where not even half of what
    happens to some number can be foreseen, the file's structure is planned with, as it is.

    Args:
        model: The model that it corrects.
        seed: Seed of the random features.
        nonlinear: Whether residuals may use random features.
    """

    def __init__(self, model: AdaptedModel, seed: np.random.SeedSequence, nonlinear: bool) -> None:
        self._block = model.block
        self._seed = seed
        self._nonlinear = nonlinear
        self._views = {view.key: view for views in model.views for view in views}
        self._places = {key: k for k, key in enumerate(self._views)}
        self._columns = [[_Columns(view) for view in views] for views in model.views]
        self._numeric = np.array([fluent.numeric for fluent in model.fluents], dtype=np.bool_)
        symbols: dict[str, list[int]] = {}
        for fluent in model.fluents:
            symbols.setdefault(fluent.symbol, []).append(fluent.index)
        self._alike = [np.array(columns) for columns in symbols.values() if len(columns) > 1]
        self.begin()

    def begin(self) -> None:
        """Forget everything."""
        again = np.random.SeedSequence(self._seed.entropy, spawn_key=self._seed.spawn_key)
        seeds = again.spawn(len(self._views))
        self._whole = np.ones(len(self._numeric), dtype=np.bool_)
        self._wholes = len(self._whole)
        self._residuals: dict[Key, OnlineResidual] = {}
        self._chances = {key: OutcomeCounts(view) for key, view in self._views.items()}
        alike: dict[Key, list[OnlineResidual]] = {}
        for view, own in zip(self._views.values(), seeds, strict=True):
            memory = self._block.groups[view.key]
            memory.clear()
            if view.targets and _learnable(view):
                residual = OnlineResidual(view, memory, own, self._nonlinear)
                self._residuals[view.key] = residual
                alike.setdefault(view.key[1:], []).append(residual)
                residual.siblings = alike[view.key[1:]]
        self._corrects = dict.fromkeys(self._residuals, False)
        self._foreseen = dict.fromkeys(alike, True)
        self._block.amends = True
        self._block.chancy = False

    @property
    def notice(self) -> str | None:
        """What is too wide to be learned; None where nothing is."""
        wide = sorted({view.key[0] for view in self._views.values() if not _learnable(view)})
        if not wide:
            return None
        return (
            f"more fluents are in view of {', '.join(f'`{name}`' for name in wide)} than a "
            "correction can learn from; their numbers are predicted as written"
        )

    @property
    def corrects(self) -> bool:
        """Whether anything is corrected."""
        return self._block.chancy or (self._block.amends and any(self._corrects.values()))

    def learn(
        self, state: Vector, action: int, next_state: Vector, flow: Vector, settled: Vector
    ) -> None:
        """Learn from an env step; of one with NaN or numbers beyond all bounds nothing is learned.

        Args:
            state: `[F]` before it.
            action: Ground action.
            next_state: `[F]` observed.
            flow: `[F]` by effects and processes, with the literals in use.
            settled: `[F]` the same after events.
        """
        if not note_whole(state, next_state, self._numeric, self._whole):
            return
        self._share_wholeness()
        # Where an event has the last word, what effects and processes have done cannot be seen.
        seen = flow == settled
        counted = self._block.chancy
        for view in self._columns[action]:
            key, targets = view.key, view.targets
            chances = self._chances[key]
            if not chances.learn(view.inputs, state, settled, next_state, self._whole):
                self._whole[targets] = False
                self._share_wholeness()
            memory = self._block.groups[key]
            if chances.used or memory.chance is not None:
                memory.chance = chances.table if chances.used else None
                counted = True
            if key in self._residuals:
                self._corrects[key] = self._residuals[key].learn(
                    state[view.inputs],
                    next_state[targets] - flow[targets],
                    seen[targets],
                    next_state[targets] - state[targets],
                    ~self._whole[targets],
                )
                self._foreseen[key[1:]] = self._residuals[key].foresees(~self._whole[targets])
        amends = all(self._foreseen.values())
        if counted or amends != self._block.amends:
            self._block.amends = amends
            self._note_chances()

    def _share_wholeness(self) -> None:
        """A function is whole if it is that of all objects: what is learned of them is shared."""
        wholes = int(np.count_nonzero(self._whole))
        if wholes != self._wholes:
            for columns in self._alike:
                self._whole[columns] = self._whole[columns].all()
            self._wholes = int(np.count_nonzero(self._whole))

    def _note_chances(self) -> None:
        groups = self._block.groups.values()
        counted = any(group.chance is not None for group in groups)
        self._block.chancy = counted and self._block.amends

    # State -------------------------------------------------------------------------------------

    def state_dict(self) -> tuple[Arrays, Meta]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays: Arrays = {"whole": self._whole.copy()}
        meta: Meta = {
            "corrects": [bool(corrects) for corrects in self._corrects.values()],
            "foreseen": [bool(foreseen) for foreseen in self._foreseen.values()],
        }
        parts: tuple[tuple[str, Mapping[Key, OnlineResidual | OutcomeCounts]], ...] = (
            ("residual", self._residuals),
            ("chances", self._chances),
        )
        for kind, of_views in parts:
            for key, part in of_views.items():
                name = self._name(kind, key)
                own, meta[name] = part.state_dict()
                arrays |= nested(name, own)
        return arrays, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned; the block is restored by its owner, before.

        Raises:
            RunError: It belongs to another domain, or is damaged.
        """
        saved = Saved("correction", arrays, meta)
        self._whole[:] = saved.array("whole", np.bool_, self._whole.shape)
        self._wholes = int(np.count_nonzero(self._whole))
        for name, truths in (("corrects", self._corrects), ("foreseen", self._foreseen)):
            truths.update(zip(truths, saved.truths(name, len(truths)), strict=True))
        for key, residual in self._residuals.items():
            residual.load_state_dict(*saved.part(self._name("residual", key)))
        for key, chances in self._chances.items():
            chances.load_state_dict(*saved.part(self._name("chances", key)))
            self._block.groups[key].chance = chances.table if chances.used else None
        self._note_chances()

    def _name(self, part: str, key: Key) -> str:
        """Return the name of a part, by where its view is among all."""
        return f"{part}{self._places[key]}"


def _learnable(view: FeatureGroup) -> bool:
    """Whether the statistics of a view are small enough to be kept and solved in every step."""
    return (1 + MODES) * len(view.targets) * (1 + len(view.inputs)) ** 2 <= _MOST_STATISTICS


class _Columns:
    """A view with its columns as arrays."""

    def __init__(self, view: FeatureGroup) -> None:
        self.key = view.key
        self.inputs = np.array(view.inputs, dtype=np.int64)
        self.targets = np.array(view.targets, dtype=np.int64)
