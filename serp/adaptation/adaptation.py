"""The model that corrects itself: what each env step teaches about the domain file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import MOST, Arrays, Saved, nested, part_of
from serp.adaptation.adapted_model import AdaptedModel
from serp.adaptation.feature_groups import Key
from serp.adaptation.forecast_skill import ForecastSkill
from serp.adaptation.group_learners import GroupLearners, Meta
from serp.adaptation.step_kernels import foresee
from serp.adaptation.step_recording import keep, predict_and_keep, step_and_keep
from serp.control.model_confidence import ModelConfidence
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.native import address_of
from serp.model.transition_model import TransitionModel, Vector
from serp.settings import AdaptationSettings
from serp.sysid.monitor import Monitor
from serp.sysid.transitions import GOES_ON, TransitionMemory

if TYPE_CHECKING:
    from serp.adaptation.parameter_estimation import ParameterEstimation

_GROWN: Final = 10
"""For so many episodes a model that corrects itself is not judged by how it does."""
_RELEARNED: Final = 500
"""So many of each ground action's newest transitions are learned from again where the literals
have changed."""


class ModelAdaptation:
    """Records every env step, compares it with the model, and corrects the model.

    Args:
        written: The model as the file has it.
        settings: See `AdaptationSettings`.
        seed: Seed of the random features.

    Attributes:
        model: The model to plan with: the corrected one, or `written` where nothing is corrected.
        experience: The newest transitions.
        monitor: Predictions beside observations.
        tried: `[A]` how often each ground action, or one of its schema with like objects, was
            observed since the model was last doubted.
        skill: How well the model in use has predicted of late.
        notice: What is not corrected although the settings ask for it; None where nothing.
    """

    def __init__(
        self, written: TransitionModel, settings: AdaptationSettings, seed: np.random.SeedSequence
    ) -> None:
        width = len(written.fluents)
        self.experience = TransitionMemory.of(written)
        self.monitor = Monitor(written)
        self.tried = np.zeros(len(written.actions), dtype=np.int64)
        self.skill = ForecastSkill(width)
        self.notice: str | None = None
        self._episodes = 0
        self._written = written
        self._corrected: AdaptedModel | None = None
        self._learners: GroupLearners | None = None
        self._reestimation: ParameterEstimation | None = None
        self._address: np.intp | None = None
        self._step = np.zeros((3, width + 2))
        if settings.mode != "off" and not written.compiles:
            self.notice = (
                "the domain has too many ground actions to correct its model; it is used as written"
            )
        elif settings.mode != "off" and width:
            self._corrected = corrected = AdaptedModel(written)
            self._kinds = _kinds(corrected)
            self._rows = np.zeros(4 * (width + 1))
            self._flow, self._settled = self._rows.reshape(4, -1)[1:3, :-1]
            if settings.residual:
                self._learners = GroupLearners(corrected, seed, settings.nonlinear)
                self.notice = self._learners.notice
            if settings.parameters:
                from serp.adaptation.parameter_estimation import ParameterEstimation

                self._reestimation = ParameterEstimation(written)
        self.model: TransitionModel = self._corrected or written

    def observe(
        self, state: Vector, action: int, next_state: Vector, ending: int, reward: float = 0.0
    ) -> None:
        """Take an env step into account.

        Args:
            state: `[F]` before the action.
            action: Ground action; -1 where the model knows none.
            next_state: `[F]` observed after it, before any reset.
            ending: How the step ended: `GOES_ON`, `CUT_OFF` or `OVER` of
                `serp.sysid.transitions`.
            reward: What the step was worth, in the unit of the file's rewards.
        """
        ending = int(ending)  # compiled code is made for one type
        self._episodes += ending != GOES_ON
        if action < 0:
            self.experience.add(state, action, next_state, ending, reward)
            self.monitor.observe(state, action, self._step)
        elif self._corrected is None:
            self._compare(state, action, next_state, ending, reward)
        else:
            self._compare_and_learn(self._corrected, state, action, next_state, ending, reward)
        if self._reestimation is not None and self._reestimation.due(self.experience.seen):
            self._reconsider_literals()

    @property
    def trust(self) -> ModelConfidence:
        """How far the model can be trusted; nothing is said of one that is not corrected."""
        if self._corrected is None:
            return ModelConfidence.OPEN
        if self.skill.reliable:
            return ModelConfidence.RELIABLE
        return ModelConfidence.GROWING if self._episodes < _GROWN else ModelConfidence.OPEN

    def doubt(self) -> None:
        """Take nothing for known any more: what was predicted to last has not lasted."""
        self.tried[:] = 0

    def _compare(
        self, state: Vector, action: int, next_state: Vector, ending: int, reward: float
    ) -> None:
        row, skill, model = self.monitor.row_of(action), self.skill, self._written
        head, ring, tables = self.experience.advance(), self.experience.ring, self.monitor.tables
        if self._address is None and model.compiled:
            # Who plans has compiled the model; for the monitor alone it would take too long.
            self._address = address_of(model.native_step())
        if self._address is not None:
            compared, followed = step_and_keep(
                self._address, model.data, model.dt, self.tried, self._step, state, action,
                next_state, ending, reward, head, *ring, row, *tables, skill.steps, skill.means,
            )  # fmt: skip
        else:
            self.tried[action] += 1
            out, flags = model.transition(state.tolist(), action)
            ends = bool(flags & TERMINAL)
            self._step[:] = [*out, ends] if flags & APPLICABLE else [*state, 0.0, 0.0]
            compared, followed = keep(
                self._step, state, action, next_state, ending, reward, head, *ring, row, *tables,
                skill.steps, skill.means,
            )  # fmt: skip
        self.monitor.note(row, compared)
        skill.steps += followed

    def _compare_and_learn(
        self,
        corrected: AdaptedModel,
        state: Vector,
        action: int,
        next_state: Vector,
        ending: int,
        reward: float,
    ) -> None:
        row, skill = self.monitor.row_of(action), self.skill
        compared, followed, flows = predict_and_keep(
            corrected.data, corrected.dt, self._rows, self._kinds, self.tried, self._step, state,
            action, next_state, ending, reward, self.experience.advance(), *self.experience.ring,
            row, *self.monitor.tables, skill.steps, skill.means,
        )  # fmt: skip
        self.monitor.note(row, compared)
        skill.steps += followed
        if self._learners is not None and flows:
            self._learners.learn(state, action, next_state, self._flow, self._settled)
            corrected.block.active = self._learners.corrects or corrected.block.revised

    def _reconsider_literals(self) -> None:
        """Estimate the literals anew; where they change, learn what they leave from the start."""
        corrected, reestimation = self._corrected, self._reestimation
        assert corrected is not None and reestimation is not None
        literals = corrected.block.literals
        adopted = reestimation.reconsider(self.experience, literals.copy())
        if (adopted == literals).all():
            return
        corrected.block.adopt(adopted)
        corrected.block.active = True
        if self._learners is None:
            return
        self._learners.begin()
        states, next_states = self.experience.states, self.experience.next_states
        actions = self.experience.actions
        for k in _newest_of_each(actions, _RELEARNED):
            flags = foresee(corrected.data, actions[k], states[k], corrected.dt, self._rows)
            if flags[1] & APPLICABLE:
                self._learners.learn(
                    states[k], int(actions[k]), next_states[k], self._flow, self._settled
                )

    # State -------------------------------------------------------------------------------------

    def state_dict(self) -> tuple[Arrays, Meta]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        experience, experience_meta = self.experience.state_dict()
        monitor, monitor_meta = self.monitor.state_dict()
        arrays = nested("experience", experience) | nested("monitor", monitor)
        skill, skill_meta = self.skill.state_dict()
        arrays |= nested("skill", skill)
        arrays["tried"] = self.tried.copy()
        meta: Meta = {
            "experience": experience_meta,
            "monitor": monitor_meta,
            "skill": skill_meta,
            "episodes": self._episodes,
        }
        if self._corrected is not None:
            arrays |= nested("block", self._corrected.block.contents())
        if self._learners is not None:
            learned, meta["learners"] = self._learners.state_dict()
            arrays |= nested("learners", learned)
        return arrays, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It belongs to another domain, or is damaged.
        """
        saved = Saved("correction", arrays, meta)
        self.experience.load_state_dict(*saved.part("experience"))
        self.monitor.load_state_dict(*saved.part("monitor"))
        self.skill.load_state_dict(*saved.part("skill"))
        self.tried[:] = saved.array("tried", np.int64, self.tried.shape, 0, MOST)
        self._episodes = saved.whole("episodes")
        if self._corrected is not None:
            self._corrected.block.restore(part_of(arrays, "block"))
        if self._learners is not None:
            self._learners.load_state_dict(*saved.part("learners"))


def _kinds(model: AdaptedModel) -> NDArray[np.int64]:
    """Return `[A]` numbers, equal for ground actions that the correction learns of together."""
    numbers: dict[tuple[str | Key, ...], int] = {}
    return np.array(
        [
            numbers.setdefault((action.schema, *(view.key for view in views)), len(numbers))
            for action, views in zip(model.actions, model.views, strict=True)
        ],
        dtype=np.int64,
    )


def _newest_of_each(actions: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Return where the newest steps of each action are, in order of time; -1 is no action."""
    known = np.flatnonzero(actions >= 0)
    if not len(known):
        return known
    newest = [known[actions[known] == action][-count:] for action in np.unique(actions[known])]
    return np.sort(np.concatenate(newest))
