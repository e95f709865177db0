"""Model adaptation: learning from every env step beside the domain file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from serp._core import ObservedStep
from serp._util.did_you_mean import listed
from serp._util.saved_state import MOST, Arrays, Saved, nested
from serp.errors import RunError
from serp.model.learned.adapted_model import AdaptedModel
from serp.model.learned.adoption import (
    AdoptedParameter,
    FluentAdoption,
    ModelAdoption,
    TrackRecord,
    WorthAdoption,
    adoption_of,
)
from serp.model.learned.outcome_counts import OutcomeCounts
from serp.model.learned.residual import ResidualRegression, WorthRegression
from serp.model.learned.transitions import TransitionMemory
from serp.model.transition_model import TransitionModel, Vector
from serp.settings import AdaptationSettings

if TYPE_CHECKING:
    from serp.model.learned.parameter_fit import ParameterEstimation


Meta = dict[str, Any]


class GroupLearners:
    """Learns residuals and outcome counts from env steps, and publishes them in the model.

    Each fluent has its own predictor: the one that has predicted new samples best, which may be the
    file. So have the end, and the reward if `rewards` and the file gives any. `whole` `[F]` says
    whether each fluent has always been a whole number.
    """

    def __init__(
        self, model: AdaptedModel, seed: np.random.SeedSequence, rewards: bool = False
    ) -> None:
        self._model = model
        self._rewarded = rewards and model.rewarding
        self._seed = seed
        self._groups = {group.key: group for groups in model.feature_groups for group in groups}
        self._numeric = np.array([fluent.numeric for fluent in model.fluents], dtype=np.bool_)
        symbols: dict[str, list[int]] = {}
        for fluent in model.fluents:
            symbols.setdefault(fluent.symbol, []).append(fluent.index)
        self._alike = [np.array(columns) for columns in symbols.values() if len(columns) > 1]
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        seed = np.random.SeedSequence(self._seed.entropy, spawn_key=self._seed.spawn_key)
        self.whole = np.ones(len(self._numeric), dtype=np.bool_)
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
        self._learn_with = [
            [
                (
                    self._counts[g.key], self._model.shared[g.key], self._residuals.get(g.key[1:]),
                    np.array(g.inputs, np.int64), np.array(g.targets, np.int64),
                )
                for g in groups
            ]
            for groups in self._model.feature_groups
        ]  # fmt: skip
        """What learns from a step of each ground action."""

    @property
    def notice(self) -> str | None:
        """A message on actions with too many inputs to learn; None if there is none."""
        known = self._model.regressions
        wide = {key[0] for key, g in self._groups.items() if g.targets and key[1:] not in known}
        if not wide:
            return None
        return (
            f"{listed(sorted(wide), len(wide))} can depend on more fluents than the adaptation can "
            "learn from; the numbers that they change are predicted as written"
        )

    def adoption(self) -> tuple[tuple[FluentAdoption, ...], tuple[WorthAdoption, ...]]:
        """Return what predicts each function and predicate that can change, and reward and end."""
        fluents = self._model.fluents
        records: dict[str, tuple[list[TrackRecord], list[TrackRecord]]] = {
            fluent.symbol: ([], []) for fluent in fluents
        }
        for key, group in self._groups.items():
            schema, counts = key[0], self._counts[key].track_record(key[0])
            hindrance = "it can depend on more fluents than the adaptation can learn from"
            judged = [TrackRecord(schema, False, 0, 0.0, 0.0, hindrance)] * len(group.targets)
            if key[1:] in self._residuals:
                head = self._model.shared[key].head
                judged = self._residuals[key[1:]].track_records(schema, head)
            for column, residual in zip(group.targets, judged, strict=True):
                residuals, outcomes = records[fluents[column].symbol]
                if self.whole[column]:
                    outcomes.append(counts)
                else:
                    residuals.append(residual)
            for column in group.predicates:
                records[fluents[column].symbol][1].append(counts)
        adopted = (adoption_of(symbol, *both) for symbol, both in records.items() if any(both))
        return tuple(adopted), () if self._worth is None else self._worth.adoption()

    def learn(self, step: ObservedStep, action: int) -> None:
        """Learn from an env step of a ground action, unless it holds NaN or huge numbers.

        After the end of an episode the state need not be what the file says: only the outcomes that
        ended it are learned, and its reward and end.
        """
        if step.over:
            for each in self._residuals.values():
                each.begin_episode()
        if not step.usable:
            return
        if not step.over and step.note_fractions(self.whole, self._numeric):
            self._share_wholeness()
        if self._worth is not None:
            self._worth.learn_worth(action, step, self._rewarded)
        for counts, shared, residual, inputs, targets in self._learn_with[action]:
            if not counts.learn(inputs, step, self.whole):
                self.whole[targets] = False
                self._share_wholeness()
            counts.publish(shared)
            if residual is not None and not step.over:
                residual.learn(shared.head, step, inputs, targets, self.whole)

    def _share_wholeness(self) -> None:
        """Treat a function as whole-numbered only if it is so for all objects."""
        for columns in self._alike:
            self.whole[columns] = self.whole[columns].all()

    @property
    def parts(self) -> dict[str, ResidualRegression | OutcomeCounts]:
        """Residuals and counts with the names that they are saved under."""
        parts = {f"residual{k}": each for k, each in enumerate(self._residuals.values())}
        counts = {f"outcome_counts{k}": each for k, each in enumerate(self._counts.values())}
        worth = {} if self._worth is None else {"worth": self._worth}
        return {**parts, **worth, **counts}

    def restore(self, whole: NDArray[np.bool_]) -> None:
        """Restore which fluents have always been whole numbers `[F]`, after the parts."""
        self.whole[:] = whole.view(np.uint8) != 0  # a saved truth value may have any bits
        for key, counts in self._counts.items():
            counts.publish(self._model.shared[key])


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
        self._alike: list[NDArray[np.int64] | int] = list(range(len(written.actions)))
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
        self, state: Vector, action: int, next_state: Vector, over: bool, reward: float = 0.0
    ) -> None:
        """Record an env step and learn from it; the arguments are those of `TransitionMemory.add`.

        `next_state` is that before any reset, the reward in the unit of the file's rewards.
        """
        self.experience.add(state, action, next_state, over, reward)
        if action >= 0:
            self._learn(state, action, next_state, over, reward)
        seen = self.experience.seen
        if self._estimation is not None and seen >= 32 and seen & (seen - 1) == 0:
            self._estimate_parameters()
        if self._adapted is not None:
            self._adapted.revision = self._revision

    @property
    def adoption(self) -> ModelAdoption:
        """Which parts of the model are in use, and why others are not."""
        adapted = self._adapted
        if adapted is None:
            return ModelAdoption(adapts=False)
        fluents, worth = ((), ()) if self._learners is None else self._learners.adoption()
        values = self._written.theta.tolist(), adapted.core.parameters.tolist()
        parameters = tuple(
            AdoptedParameter(p.place.line, p.place.text, written, used)
            for p, written, used in zip(adapted.ground.parameters, *values, strict=True)
            if used != written
        )
        return ModelAdoption(True, parameters, fluents, worth)

    def reset_visits(self) -> None:
        """Treat all actions as unknown."""
        self.visits[:] = 0

    def _learn(
        self, state: Vector, action: int, next_state: Vector, over: bool, reward: float
    ) -> None:
        if self._adapted is not None and self._learners is not None:
            step = self._adapted.core.observe(state, action, next_state, bool(over), reward)
            if step is not None:
                self._learners.learn(step, action)

    @property
    def _revision(self) -> int:
        """A number that grows with every twentieth part of the env steps; 0 for the file alone."""
        if self._adapted is None or self._adapted.as_written:
            return 0
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
        seen = self.experience
        columns = seen.states, seen.actions, seen.next_states, seen.over, seen.rewards
        for k in _newest_of_each(seen.actions, 500):
            state, action, next_state, over, reward = (column[k] for column in columns)
            self._learn(state, int(action), next_state, over, float(reward))

    def state_dict(self) -> tuple[Arrays, Meta]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays: Arrays = {"visits": self.visits.copy(), "written": self._written.theta.copy()}
        meta: Meta = {}
        if self._adapted is not None:
            arrays["parameters"] = self._adapted.core.parameters
        if self._learners is not None:
            arrays["whole"] = self._learners.whole.copy()
        for name, part in self._parts.items():
            own, meta[name] = part.state_dict()
            arrays |= nested(name, own)
        return arrays, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned; a `RunError` refuses what does not fit.

        It does not fit a model of another shape or with other written parameters: its steps would
        be flagged by what another file says.
        """
        if not np.array_equal(arrays.get("written", ()), self._written.theta):
            raise RunError(
                "the saved adaptation belongs to another domain file; continue with "
                "the original file"
            )
        saved = Saved("adaptation", arrays, meta)
        self.visits[:] = saved.array("visits", np.int64, self.visits.shape, 0, MOST)
        if self._adapted is not None:
            shape = self._written.theta.shape
            self._adapted.core.adopt(saved.array("parameters", np.float64, shape))
        for name, part in self._parts.items():
            part.load_state_dict(*saved.part(name))
        if self._learners is not None:
            whole = self._learners.whole
            self._learners.restore(saved.array("whole", whole.dtype, whole.shape))
        if self._adapted is not None:
            self._adapted.revision = self._revision

    @property
    def _parts(self) -> dict[str, Any]:
        """The saved parts by name."""
        learned = {} if self._learners is None else self._learners.parts
        return {"experience": self.experience, **learned}


def _alike_actions(model: AdaptedModel) -> list[NDArray[np.int64] | int]:
    """Return, for each ground action, those with which it shares all that is learned.

    A number stands for the action alone: an array of one takes ten times as long.
    """
    keys = [
        (action.schema, *(group.key for group in groups))
        for action, groups in zip(model.actions, model.feature_groups, strict=True)
    ]
    alike: dict[tuple[object, ...], list[int]] = {}
    for k, key in enumerate(keys):
        alike.setdefault(key, []).append(k)
    return [np.array(own) if len(own := alike[key]) > 1 else own[0] for key in keys]


def _newest_of_each(actions: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Return the positions of the newest steps of each action (not of -1), in order of time."""
    known = np.flatnonzero(actions >= 0)
    if not len(known):
        return known
    newest = [known[actions[known] == action][-count:] for action in np.unique(actions[known])]
    return np.sort(np.concatenate(newest))
