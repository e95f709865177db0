"""Learning beside the file: a residual and outcome counts for each kind of feature group."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import Arrays, Saved, nested
from serp.adaptation.adapted_model import AdaptedModel
from serp.adaptation.adoption import FluentAdoption, TrackRecord, adoption_of
from serp.adaptation.feature_groups import FeatureGroup, Key
from serp.adaptation.outcomes.outcome_counts import OutcomeCounts
from serp.adaptation.parameter_buffer import MODES
from serp.adaptation.residual.online_residual import OnlineResidual
from serp.adaptation.residual.outliers import update_whole
from serp.model.transition_model import Vector

_MAX_STATISTICS: Final = 600_000
"""Most entries of the statistics of one residual, which is updated and solved in every step."""

_TOO_WIDE: Final = "it can depend on more fluents than the adaptation can learn from"

Meta = dict[str, Any]


class GroupLearners:
    """Learns residuals and outcome counts from env steps, and publishes them in the model.

    Each fluent has its own predictor: the one that has predicted new samples best, which may be the
    file.
    """

    def __init__(self, model: AdaptedModel, seed: np.random.SeedSequence, nonlinear: bool) -> None:
        self._model = model
        self._buffer = model.buffer
        self._seed = seed
        self._nonlinear = nonlinear
        self._groups = {group.key: group for groups in model.feature_groups for group in groups}
        self._columns = [
            [(g.key, np.array(g.inputs), np.array(g.targets, np.int64)) for g in groups]
            for groups in model.feature_groups
        ]
        self._numeric = np.array([fluent.numeric for fluent in model.fluents], dtype=np.bool_)
        symbols: dict[str, list[int]] = {}
        for fluent in model.fluents:
            symbols.setdefault(fluent.symbol, []).append(fluent.index)
        self._alike = [np.array(columns) for columns in symbols.values() if len(columns) > 1]
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        seed = np.random.SeedSequence(self._seed.entropy, spawn_key=self._seed.spawn_key)
        self._whole = np.ones(len(self._numeric), dtype=np.bool_)
        self._wholes = len(self._whole)
        self._residuals: dict[Key, OnlineResidual] = {}
        schemas = len({action.schema for action in self._model.actions})
        self._counts = {key: OutcomeCounts(group, schemas) for key, group in self._groups.items()}
        alike: dict[Key, list[OnlineResidual]] = {}
        for (key, group), own in zip(
            self._groups.items(), seed.spawn(len(self._groups)), strict=True
        ):
            shared = self._buffer.shared[key]
            shared.clear()
            if group.targets and _learnable(group):
                residual = OnlineResidual(group, shared, own, self._nonlinear)
                self._residuals[key] = residual
                alike.setdefault(key[1:], []).append(residual)
                residual.siblings = alike[key[1:]]
        self._used = dict.fromkeys(self._residuals, False)
        self._buffer.stochastic = False

    @property
    def notice(self) -> str | None:
        """A message on actions with too many inputs to learn; None if there is none."""
        wide = sorted({group.key[0] for group in self._groups.values() if not _learnable(group)})
        if not wide:
            return None
        return (
            f"{', '.join(f'`{name}`' for name in wide)} can depend on more fluents than the "
            "adaptation can learn from; the numbers that they change are predicted as written"
        )

    @property
    def active(self) -> bool:
        """Whether anything learned is used."""
        return self._buffer.stochastic or any(self._used.values())

    def adoption(self, skills: Mapping[str, float | None]) -> tuple[FluentAdoption, ...]:
        """Return what predicts each function and predicate that can change.

        `skills` are the forecast skills by their names.
        """
        residuals: dict[str, list[TrackRecord]] = {symbol: [] for symbol in skills}
        outcomes: dict[str, list[TrackRecord]] = {symbol: [] for symbol in skills}
        fluents, changing = self._model.fluents, set[str]()
        for key, group in self._groups.items():
            schema, counts = key[0], self._counts[key].track_record(key[0])
            numbers = [fluents[column].symbol for column in group.targets]
            predicates = [fluents[column].symbol for column in group.predicates]
            changing.update(numbers, predicates)
            whole = [self._whole[column] for column in group.targets]
            judged = [TrackRecord(schema, False, 0, 0.0, 0.0, 0.0, _TOO_WIDE)] * len(numbers)
            if key in self._residuals:
                judged = self._residuals[key].track_records(schema)
            for symbol, counted, track_record in zip(numbers, whole, judged, strict=True):
                (outcomes if counted else residuals)[symbol].append(
                    counts if counted else track_record
                )
            for symbol in predicates:
                outcomes[symbol].append(counts)
        return tuple(
            adoption_of(symbol, residuals[symbol], outcomes[symbol], skill)
            for symbol, skill in skills.items()
            if symbol in changing
        )

    def learn(
        self,
        state: Vector,
        action: int,
        next_state: Vector,
        flow: Vector,
        settled: Vector,
        over: bool,
    ) -> None:
        """Learn from an env step, unless it holds NaN or huge numbers.

        All states are `[F]`; `flow` is predicted by effects and processes, with the parameters in
        use, and `settled` is the same after events. Where the episode is `over`, `next_state` need
        not be what the file says: only the outcomes that ended it are learned.
        """
        if over:
            self._learn_end(state, action, next_state)
            return
        if not update_whole(state, next_state, self._numeric, self._whole):
            return
        self._share_wholeness()
        # Where an event changes a fluent, the result of effects and processes is not observed.
        observed = flow == settled
        for position, (key, inputs, targets) in enumerate(self._columns[action]):
            counts = self._counts[key]
            place = (self._model.data, action, position, self._model.dt)
            if not counts.learn(place, inputs, state, settled, next_state, self._whole):
                self._whole[targets] = False
                self._share_wholeness()
            self._publish_counts(key)
            if key in self._residuals:
                self._used[key] = self._residuals[key].learn(
                    state[inputs],
                    next_state[targets] - flow[targets],
                    observed[targets],
                    next_state[targets] - state[targets],
                    ~self._whole[targets],
                )

    def _learn_end(self, state: Vector, action: int, next_state: Vector) -> None:
        if not np.isfinite(state).all():
            return
        for position, (key, _, _) in enumerate(self._columns[action]):
            place = (self._model.data, action, position, self._model.dt)
            self._counts[key].learn_end(place, state, next_state)
            self._publish_counts(key)

    def _share_wholeness(self) -> None:
        """Treat a function as whole-numbered only if it is so for all objects."""
        wholes = int(np.count_nonzero(self._whole))
        if wholes != self._wholes:
            for columns in self._alike:
                self._whole[columns] = self._whole[columns].all()
            self._wholes = int(np.count_nonzero(self._whole))

    def _publish_counts(self, key: Key) -> None:
        counts, shared = self._counts[key], self._buffer.shared[key]
        table = counts.table if counts.used else None
        if table is not shared.outcomes:
            shared.outcomes = table
            self._update_stochastic()

    def _update_stochastic(self) -> None:
        counted = any(shared.outcomes is not None for shared in self._buffer.shared.values())
        self._buffer.stochastic = counted

    def state_dict(self) -> tuple[Arrays, Meta]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays: Arrays = {"whole": self._whole.copy()}
        meta: Meta = {"used": [bool(used) for used in self._used.values()]}
        for name, part in self._parts():
            own, meta[name] = part.state_dict()
            arrays |= nested(name, own)
        return arrays, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned, after the buffer; `RunError` if it does not fit."""
        saved = Saved("adaptation", arrays, meta)
        self._whole[:] = saved.array("whole", np.bool_, self._whole.shape)
        self._wholes = int(np.count_nonzero(self._whole))
        self._used.update(zip(self._used, saved.truths("used", len(self._used)), strict=True))
        for name, part in self._parts():
            part.load_state_dict(*saved.part(name))
        for key, counts in self._counts.items():
            self._buffer.shared[key].outcomes = counts.table if counts.used else None
        self._update_stochastic()

    def _parts(self) -> list[tuple[str, OnlineResidual | OutcomeCounts]]:
        """Return residuals and counts with the names that they are saved under."""
        parts: list[tuple[str, OnlineResidual | OutcomeCounts]] = []
        for k, key in enumerate(self._groups):
            if key in self._residuals:
                parts.append((f"residual{k}", self._residuals[key]))
            parts.append((f"outcome_counts{k}", self._counts[key]))
        return parts


def _learnable(group: FeatureGroup) -> bool:
    """Return whether the statistics of a group are small enough to be solved in every step."""
    return (1 + MODES) * len(group.targets) * (1 + len(group.inputs)) ** 2 <= _MAX_STATISTICS
