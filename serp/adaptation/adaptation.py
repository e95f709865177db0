"""Model adaptation: learning from every env step beside the domain file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import MOST, Arrays, Saved, nested, part_of
from serp.adaptation.adapted_model import AdaptedModel
from serp.adaptation.adoption import ModelAdoption, parameters_in_use
from serp.adaptation.file_step import observed_step
from serp.adaptation.group_learners import GroupLearners, Meta
from serp.model.transition_model import TransitionModel, Vector
from serp.settings import AdaptationSettings
from serp.sysid.transitions import OVER, TransitionMemory

if TYPE_CHECKING:
    from serp.adaptation.online_parameters import ParameterEstimation

_REVISIONS: Final = 20.0
"""A model that learns counts as changed when it has seen a twentieth more env steps."""
_RELEARNED: Final = 500
"""Newest transitions per ground action that are learned again when parameters change."""


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
        self._alike = np.arange(len(written.actions))
        self._written = written
        self._adapted: AdaptedModel | None = None
        self._learners: GroupLearners | None = None
        self._estimation: ParameterEstimation | None = None
        if settings.mode != "off" and not written.has_own_code:
            self.notice = (
                "the domain has too many ground actions to adapt its model; it is used as written"
            )
        elif settings.mode != "off" and width:
            self._adapted = adapted = AdaptedModel(written)
            self._alike = _alike_actions(adapted)
            if settings.residual:
                self._learners = GroupLearners(adapted, seed)
                self.notice = self._learners.notice
            if settings.parameters:
                from serp.adaptation.online_parameters import ParameterEstimation

                self._estimation = ParameterEstimation(written)
        self.model: TransitionModel = self._adapted or written

    def visit(self, action: int) -> None:
        """Count a visit of a ground action; -1 for none."""
        if action >= 0:
            self.visits[self._alike == self._alike[action]] += 1

    def observe(
        self, state: Vector, action: int, next_state: Vector, ending: int, reward: float = 0.0
    ) -> None:
        """Record an env step and learn from it; the arguments are those of `TransitionMemory.add`.

        `next_state` is that before any reset, the reward in the unit of the file's rewards.
        """
        self.experience.add(state, action, next_state, ending, reward)
        adapted = self._adapted
        if action >= 0 and adapted is not None and self._learners is not None:
            self._learn(adapted, state, action, next_state, ending == OVER)
            adapted.buffer.active = self._learners.active or adapted.buffer.revised
        if self._estimation is not None and self._estimation.due(self.experience.seen):
            self._estimate_parameters()
        if adapted is not None:
            adapted.revision = self._revision if adapted.buffer.active else 0

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
                adapted.buffer.parameters.tolist(),
            ),
            fluents=() if self._learners is None else self._learners.adoption(),
        )

    def reset_visits(self) -> None:
        """Treat all actions as unknown."""
        self.visits[:] = 0

    def _learn(
        self, adapted: AdaptedModel, state: Vector, action: int, next_state: Vector, over: bool
    ) -> None:
        assert self._learners is not None
        step = observed_step(adapted.data, adapted.dt, state, action, next_state, over)
        if step is not None:
            self._learners.learn(step)

    @property
    def _revision(self) -> int:
        """A number that grows with every twentieth part of the env steps."""
        return 1 + int(_REVISIONS * math.log(max(1, self.experience.seen)))

    def _estimate_parameters(self) -> None:
        """Estimate the parameters; if they change, learn the residual anew."""
        adapted, estimation = self._adapted, self._estimation
        assert adapted is not None and estimation is not None
        parameters = adapted.buffer.parameters
        adopted = estimation.reconsider(self.experience, parameters.copy())
        if (adopted == parameters).all():
            return
        adapted.buffer.adopt(adopted)
        adapted.buffer.active = True
        if self._learners is None:
            return
        self._learners.reset()
        states, next_states = self.experience.states, self.experience.next_states
        actions, over = self.experience.actions, self.experience.over
        for k in _newest_of_each(actions, _RELEARNED):
            self._learn(adapted, states[k], int(actions[k]), next_states[k], bool(over[k]))

    def state_dict(self) -> tuple[Arrays, Meta]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays: Arrays = {"visits": self.visits.copy()}
        meta: Meta = {}
        for name, part in self._parts().items():
            own, meta[name] = part.state_dict()
            arrays |= nested(name, own)
        if self._adapted is not None:
            arrays |= nested("parameter_buffer", self._adapted.buffer.contents())
        return arrays, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned; a `RunError` refuses what does not fit."""
        saved = Saved("adaptation", arrays, meta)
        self.visits[:] = saved.array("visits", np.int64, self.visits.shape, 0, MOST)
        if self._adapted is not None:
            self._adapted.buffer.restore(part_of(arrays, "parameter_buffer"))
        for name, part in self._parts().items():
            part.load_state_dict(*saved.part(name))
        if self._adapted is not None and self._adapted.buffer.active:
            self._adapted.revision = self._revision

    def _parts(self) -> dict[str, Any]:
        """Return the saved parts by name."""
        parts = {"experience": self.experience, "learners": self._learners}
        return {name: part for name, part in parts.items() if part is not None}


def _alike_actions(model: AdaptedModel) -> NDArray[np.int64]:
    """Return `[A]` numbers, equal for ground actions that share all that is learned."""
    keys = [
        (action.schema, *(group.key for group in groups))
        for action, groups in zip(model.actions, model.feature_groups, strict=True)
    ]
    first: dict[tuple[object, ...], int] = {}
    return np.array([first.setdefault(key, k) for k, key in enumerate(keys)], dtype=np.int64)


def _newest_of_each(actions: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Return the positions of the newest steps of each action (not of -1), in order of time."""
    known = np.flatnonzero(actions >= 0)
    if not len(known):
        return known
    newest = [known[actions[known] == action][-count:] for action in np.unique(actions[known])]
    return np.sort(np.concatenate(newest))
