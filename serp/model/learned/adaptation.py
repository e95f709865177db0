"""Model adaptation: learning from every env step beside the domain file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from serp._core import ObservedStep
from serp._util.saved_state import MOST, Arrays, Saved, nested, part_of
from serp.model.learned.adapted_model import AdaptedModel
from serp.model.learned.adoption import (
    FluentAdoption,
    ModelAdoption,
    TrackRecord,
    WorthAdoption,
    adoption_of,
    parameters_in_use,
)
from serp.model.learned.feature_groups import Key
from serp.model.learned.outcome_counts import OutcomeCounts
from serp.model.learned.residual import ResidualRegression, WorthRegression
from serp.model.learned.transitions import OVER, TransitionMemory
from serp.model.transition_model import TransitionModel, Vector
from serp.settings import AdaptationSettings

if TYPE_CHECKING:
    from serp.model.learned.parameter_fit import ParameterEstimation


Meta = dict[str, Any]


class GroupLearners:
    """Learns residuals and outcome counts from env steps, and publishes them in the model.

    Each fluent has its own predictor: the one that has predicted new samples best, which may be the
    file. So have the end, and the reward if `rewards` and the file gives any.
    """

    def __init__(
        self, model: AdaptedModel, seed: np.random.SeedSequence, rewards: bool = False
    ) -> None:
        self._model = model
        self._rewarded = rewards and model.rewarding
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
        regressions = self._model.regressions
        self._residuals = {
            roles: ResidualRegression(parameters, own)
            for (roles, parameters), own in zip(
                regressions.items(), seed.spawn(len(regressions)), strict=True
            )
        }
        worth, (own,) = self._model.worth, seed.spawn(1)
        self._worth = None if worth is None else WorthRegression(worth, own)
        for shared in self._model.shared.values():
            shared.outcomes = None

    @property
    def notice(self) -> str | None:
        """A message on actions with too many inputs to learn; None if there is none."""
        known = self._model.regressions
        wide = sorted(
            {key[0] for key, g in self._groups.items() if g.targets and key[1:] not in known}
        )
        if not wide:
            return None
        return (
            f"{', '.join(f'`{name}`' for name in wide)} can depend on more fluents than the "
            "adaptation can learn from; the numbers that they change are predicted as written"
        )

    def adoption(self) -> tuple[FluentAdoption, ...]:
        """Return what predicts each function and predicate that can change."""
        fluents = self._model.fluents
        symbols = dict.fromkeys(fluent.symbol for fluent in fluents)
        residuals: dict[str, list[TrackRecord]] = {symbol: [] for symbol in symbols}
        outcomes: dict[str, list[TrackRecord]] = {symbol: [] for symbol in symbols}
        for key, group in self._groups.items():
            schema, counts = key[0], self._counts[key].track_record(key[0])
            numbers = [fluents[column].symbol for column in group.targets]
            whole = [self._whole[column] for column in group.targets]
            hindrance = "it can depend on more fluents than the adaptation can learn from"
            judged = [TrackRecord(schema, False, 0, 0.0, 0.0, hindrance)] * len(numbers)
            if key[1:] in self._residuals:
                head = self._model.shared[key].head
                judged = self._residuals[key[1:]].track_records(schema, head)
            for symbol, counted, track_record in zip(numbers, whole, judged, strict=True):
                if counted:
                    outcomes[symbol].append(counts)
                else:
                    residuals[symbol].append(track_record)
            for column in group.predicates:
                outcomes[fluents[column].symbol].append(counts)
        return tuple(
            adoption_of(symbol, residuals[symbol], outcomes[symbol])
            for symbol in symbols
            if residuals[symbol] or outcomes[symbol]
        )

    def worth_adoption(self) -> tuple[WorthAdoption, ...]:
        """Return what predicts reward and end; nothing where they cannot be learned."""
        return () if self._worth is None else self._worth.adoption()

    def learn(self, step: ObservedStep, action: int) -> None:
        """Learn from an env step of a ground action, unless it holds NaN or huge numbers.

        After the end of an episode the state need not be what the file says: only the outcomes that
        ended it are learned, and its reward and end.
        """
        if step.over:
            for residual in self._residuals.values():
                residual.begin_episode()
        if not step.usable:
            return
        if not step.over:
            self._share_wholeness(step.count_whole(self._whole, self._numeric))
        if self._worth is not None:
            self._worth.learn_worth(action, step, self._rewarded)
        for key, inputs, targets in self._columns[action]:
            if not self._counts[key].learn(inputs, step, self._whole):
                self._whole[targets] = False
                self._share_wholeness(int(np.count_nonzero(self._whole)))
            self._publish(key)
            if key[1:] in self._residuals and not step.over:
                head = self._model.shared[key].head
                self._residuals[key[1:]].learn(head, step, inputs, targets, self._whole)

    def _share_wholeness(self, wholes: int) -> None:
        """Treat a function as whole-numbered only if it is so for all objects."""
        if wholes != self._wholes:
            for columns in self._alike:
                self._whole[columns] = self._whole[columns].all()
            self._wholes = int(np.count_nonzero(self._whole))

    def _publish(self, *keys: Key) -> None:
        """Let the model use the outcome counts of some keys, or stop using them."""
        for key in keys:
            counts, shared = self._counts[key], self._model.shared[key]
            table = counts.table if counts.used else None
            if table is not shared.outcomes:
                shared.outcomes = table

    def state_dict(self) -> tuple[Arrays, Meta]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays: Arrays = {"whole": self._whole.copy()}
        meta: Meta = {}
        for name, part in self._parts():
            own, meta[name] = part.state_dict()
            arrays |= nested(name, own)
        return arrays, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned, after the model; `RunError` if it does not fit."""
        saved = Saved("adaptation", arrays, meta)
        self._whole[:] = saved.array("whole", np.bool_, self._whole.shape)
        self._wholes = int(np.count_nonzero(self._whole))
        for name, part in self._parts():
            part.load_state_dict(*saved.part(name))
        self._publish(*self._counts)

    def _parts(self) -> list[tuple[str, ResidualRegression | OutcomeCounts]]:
        """Return residuals and counts with the names that they are saved under."""
        residuals = self._residuals.values()
        return [
            *((f"residual{k}", residual) for k, residual in enumerate(residuals)),
            *([] if self._worth is None else [("worth", self._worth)]),
            *((f"outcome_counts{k}", counts) for k, counts in enumerate(self._counts.values())),
        ]


class ModelAdaptation:
    """Records every env step, and adapts the model to what was observed.

    Attributes:
        model: The model to plan with: the adapted one, or `written` where nothing is adapted.
        experience: The newest transitions.
        visits: `[A]` how often each ground action, or an equivalent one of its schema, was visited
            since the last `reset_visits`.
        notice: A message on what is not adapted despite the settings; None if there is none.
    """

    def __init__(
        self, written: TransitionModel, settings: AdaptationSettings, seed: np.random.SeedSequence
    ) -> None:
        width = len(written.fluents)
        self.experience = TransitionMemory.of(written)
        self.visits = np.zeros(len(written.actions), dtype=np.int64)
        self.notice: str | None = None
        self._alike: list[list[int]] = [[k] for k in range(len(written.actions))]
        self._written = written
        self._adapted: AdaptedModel | None = None
        self._learners: GroupLearners | None = None
        self._estimation: ParameterEstimation | None = None
        if settings.mode != "off" and width:
            self._adapted = adapted = AdaptedModel(written)
            self._alike = _alike_actions(adapted)
            if settings.residual:
                self._learners = GroupLearners(adapted, seed, settings.mode == "rewards")
                self.notice = self._learners.notice
            if settings.parameters:
                from serp.model.learned.parameter_fit import ParameterEstimation

                self._estimation = ParameterEstimation(written)
        self.model: TransitionModel = self._adapted or written

    def visit(self, action: int) -> None:
        """Count a visit of a ground action; -1 for none."""
        if action >= 0:
            self.visits[self._alike[action]] += 1

    def observe(
        self, state: Vector, action: int, next_state: Vector, ending: int, reward: float = 0.0
    ) -> None:
        """Record an env step and learn from it; the arguments are those of `TransitionMemory.add`.

        `next_state` is that before any reset, the reward in the unit of the file's rewards.
        """
        self.experience.add(state, action, next_state, ending, reward)
        adapted = self._adapted
        if action >= 0 and adapted is not None and self._learners is not None:
            self._learn(adapted, state, action, next_state, ending == OVER, reward)
        if self._estimation is not None and self._estimation.due(self.experience.seen):
            self._estimate_parameters()
        if adapted is not None:
            adapted.revision = 0 if adapted.as_written else self._revision

    @property
    def adoption(self) -> ModelAdoption:
        """Which parts of the model are in use, and why others are not."""
        adapted = self._adapted
        if adapted is None:
            return ModelAdoption(adapts=False)
        return ModelAdoption(
            adapts=True,
            parameters=parameters_in_use(
                adapted.ground.parameters,
                self._written.theta.tolist(),
                adapted.core.parameters.tolist(),
            ),
            fluents=() if self._learners is None else self._learners.adoption(),
            worth=() if self._learners is None else self._learners.worth_adoption(),
        )

    def reset_visits(self) -> None:
        """Treat all actions as unknown."""
        self.visits[:] = 0

    def _learn(
        self, adapted: AdaptedModel, state: Vector, action: int, next_state: Vector, over: bool,
        reward: float,
    ) -> None:  # fmt: skip
        assert self._learners is not None
        step = adapted.core.observe(state, action, next_state, over, reward)
        if step is not None:
            self._learners.learn(step, action)

    @property
    def _revision(self) -> int:
        """A number that grows with every twentieth part of the env steps."""
        return 1 + int(20.0 * math.log(max(1, self.experience.seen)))

    def _estimate_parameters(self) -> None:
        """Estimate the parameters; if they change, learn the residual anew."""
        adapted, estimation = self._adapted, self._estimation
        assert adapted is not None and estimation is not None
        parameters = adapted.core.parameters
        adopted = estimation.reconsider(self.experience, parameters)
        if (adopted == parameters).all():
            return
        adapted.core.adopt(adopted)
        if self._learners is None:
            return
        self._learners.reset()
        states, next_states = self.experience.states, self.experience.next_states
        actions, over = self.experience.actions, self.experience.over
        rewards = self.experience.rewards
        for k in _newest_of_each(actions, 500):
            row = states[k], int(actions[k]), next_states[k], bool(over[k]), float(rewards[k])
            self._learn(adapted, *row)

    def state_dict(self) -> tuple[Arrays, Meta]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays: Arrays = {"visits": self.visits.copy()}
        meta: Meta = {}
        for name, part in self._parts().items():
            own, meta[name] = part.state_dict()
            arrays |= nested(name, own)
        if self._adapted is not None:
            arrays |= nested("model", self._adapted.contents())
        return arrays, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned; a `RunError` refuses what does not fit."""
        saved = Saved("adaptation", arrays, meta)
        self.visits[:] = saved.array("visits", np.int64, self.visits.shape, 0, MOST)
        if self._adapted is not None:
            self._adapted.restore(part_of(arrays, "model"))
        for name, part in self._parts().items():
            part.load_state_dict(*saved.part(name))
        if self._adapted is not None and not self._adapted.as_written:
            self._adapted.revision = self._revision

    def _parts(self) -> dict[str, Any]:
        """Return the saved parts by name."""
        parts = {"experience": self.experience, "learners": self._learners}
        return {name: part for name, part in parts.items() if part is not None}


def _alike_actions(model: AdaptedModel) -> list[list[int]]:
    """Return, for each ground action, those with which it shares all that is learned."""
    keys = [
        (action.schema, *(group.key for group in groups))
        for action, groups in zip(model.actions, model.feature_groups, strict=True)
    ]
    alike: dict[tuple[object, ...], list[int]] = {}
    for k, key in enumerate(keys):
        alike.setdefault(key, []).append(k)
    return [alike[key] for key in keys]


def _newest_of_each(actions: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Return the positions of the newest steps of each action (not of -1), in order of time."""
    known = np.flatnonzero(actions >= 0)
    if not len(known):
        return known
    newest = [known[actions[known] == action][-count:] for action in np.unique(actions[known])]
    return np.sort(np.concatenate(newest))
