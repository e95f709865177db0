"""Learning beside the file: residuals and outcome counts of each kind of feature group."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import Arrays, Saved, nested
from serp.adaptation.adapted_model import AdaptedModel
from serp.adaptation.adoption import FluentAdoption, TrackRecord, adoption_of
from serp.adaptation.feature_groups import Key
from serp.adaptation.file_step import ObservedStep
from serp.adaptation.outcomes.outcome_counts import OutcomeCounts
from serp.adaptation.residual.evidence import update_whole
from serp.adaptation.residual.regression import ResidualRegression

_TOO_WIDE: Final = "it can depend on more fluents than the adaptation can learn from"

Meta = dict[str, Any]


class GroupLearners:
    """Learns residuals and outcome counts from env steps, and publishes them in the model.

    Each fluent has its own predictor: the one that has predicted new samples best, which may be the
    file.
    """

    def __init__(self, model: AdaptedModel, seed: np.random.SeedSequence) -> None:
        self._model = model
        self._buffer = model.buffer
        self._seed = seed
        self._groups = {group.key: group for groups in model.feature_groups for group in groups}
        self._columns = [
            [(g.key, np.array(g.inputs, np.int64), np.array(g.targets, np.int64)) for g in groups]
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
        schemas = len({action.schema for action in self._model.actions})
        self._counts = {key: OutcomeCounts(group, schemas) for key, group in self._groups.items()}
        first = {key[1:]: group for key, group in reversed(self._groups.items())}
        regressions = self._buffer.regressions
        self._residuals = {
            roles: ResidualRegression(first[roles], parameters, own)
            for (roles, parameters), own in zip(
                regressions.items(), seed.spawn(len(regressions)), strict=True
            )
        }
        for shared in self._buffer.shared.values():
            shared.outcomes = None
        self._used = dict.fromkeys(self._residuals, False)
        self._buffer.stochastic = False

    @property
    def notice(self) -> str | None:
        """A message on actions with too many inputs to learn; None if there is none."""
        known = self._buffer.regressions
        wide = sorted(
            {key[0] for key, g in self._groups.items() if g.targets and key[1:] not in known}
        )
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

    def adoption(self) -> tuple[FluentAdoption, ...]:
        """Return what predicts each function and predicate that can change."""
        fluents, changing = self._model.fluents, set[str]()
        symbols = dict.fromkeys(fluent.symbol for fluent in fluents)
        residuals: dict[str, list[TrackRecord]] = {symbol: [] for symbol in symbols}
        outcomes: dict[str, list[TrackRecord]] = {symbol: [] for symbol in symbols}
        for key, group in self._groups.items():
            schema, counts = key[0], self._counts[key].track_record(key[0])
            numbers = [fluents[column].symbol for column in group.targets]
            predicates = [fluents[column].symbol for column in group.predicates]
            changing.update(numbers, predicates)
            whole = [self._whole[column] for column in group.targets]
            judged = [TrackRecord(schema, False, 0, 0.0, 0.0, _TOO_WIDE)] * len(numbers)
            if key[1:] in self._residuals:
                head = self._buffer.shared[key].head
                judged = self._residuals[key[1:]].track_records(schema, head)
            for symbol, counted, track_record in zip(numbers, whole, judged, strict=True):
                (outcomes if counted else residuals)[symbol].append(
                    counts if counted else track_record
                )
            for symbol in predicates:
                outcomes[symbol].append(counts)
        return tuple(
            adoption_of(symbol, residuals[symbol], outcomes[symbol])
            for symbol in symbols
            if symbol in changing
        )

    def learn(self, step: ObservedStep) -> None:
        """Learn from an env step, unless it holds NaN or huge numbers.

        After the end of an episode the state need not be what the file says: only the outcomes that
        ended it are learned.
        """
        state, action, next_state, over, flowed, settled, _ = step
        if over:
            for residual in self._residuals.values():
                residual.begin_episode()
            if not np.isfinite(state).all():
                return
        else:
            if not update_whole(state, next_state, self._numeric, self._whole):
                return
            self._share_wholeness()
        # Where an event changes a fluent, the result of effects and processes is not observed.
        observed = flowed == settled
        for position, (key, inputs, targets) in enumerate(self._columns[action]):
            place = self._model.data, position, self._model.dt
            if not self._counts[key].learn(place, inputs, step, self._whole):
                self._whole[targets] = False
                self._share_wholeness()
            self._publish_counts(key)
            if key[1:] in self._residuals and not over:
                self._used[key[1:]] = self._residuals[key[1:]].learn(
                    self._buffer.shared[key].head,
                    state[inputs],
                    next_state[targets] - flowed[targets],
                    observed[targets],
                    next_state[targets] - state[targets],
                    ~self._whole[targets],
                )

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

    def _parts(self) -> list[tuple[str, ResidualRegression | OutcomeCounts]]:
        """Return residuals and counts with the names that they are saved under."""
        residuals = self._residuals.values()
        return [
            *((f"residual{k}", residual) for k, residual in enumerate(residuals)),
            *((f"outcome_counts{k}", counts) for k, counts in enumerate(self._counts.values())),
        ]
