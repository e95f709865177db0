"""The training loop, Algorithm 1 of the paper: decide, act, store, learn, increase ρ."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from serp._util.compile_time import compile_seconds, working_time
from serp._util.saved_state import Saved
from serp.control.decision import Decision
from serp.control.decision_counts import DecisionCounts
from serp.control.step_record import EpisodeTotals, OnStep, StepRecord
from serp.errors import LearningFailure, SettingsError, TaskError
from serp.model.transition_model import StateError, Vector
from serp.runs.rows import DecisionRow, MetricsRow
from serp.runs.tables import Table
from serp.settings import Settings
from serp.tasks.bound_task import BoundTask
from serp.tasks.env_checks import single
from serp.tasks.reward import Judge
from serp.training.agent import Agent
from serp.training.precompile import precompile
from serp.training.rollout import Rollout, training_seed

_MIRRORED = 256
"""Number of observations with which declared symmetries are checked."""


class Trainer:
    """Trains an agent on a task, an episode at a time.

    Every episode begins with `env.reset(seed=...)`, its seed derived from the run's seed and the
    number of the episode. An episode therefore depends only on the agent and that number, and a run
    can be continued exactly from the end of any episode in any environment that uses its seed. An
    environment whose state survives `reset` (a game clock) has `state_dict()` and
    `load_state_dict(state)` with JSON values.

    Attributes:
        judge: Judges the steps.
        decisions: Table in which decisions are logged; None for no log.
        episode, env_steps: Numbers of complete episodes and of env steps.
        under_way: Number of the current env step, from 1.
        units: Number of complete units of `arbiter.rho_unit`.
        tally: Counts over all steps.
        recent: Returns of the last 20 episodes.
        on_step: If set, called with every env step, after learning from it.
    """

    def __init__(
        self,
        task: BoundTask,
        settings: Settings,
        seed: int,
        agent: Agent | None = None,
    ) -> None:
        self.task = task
        self.settings = settings
        self.seed = seed
        self.judge = Judge(task, settings)
        self._compiled_before = -compile_seconds()
        try:
            self.agent = agent or Agent(task, settings, seed)
        except (MemoryError, RuntimeError) as error:
            # torch reports a failed allocation as RuntimeError
            if isinstance(error, RuntimeError) and "alloc" not in str(error):
                raise
            raise SettingsError(
                "learner: its networks and its replay memory do not fit into memory; make "
                f"`hidden`, `members` or `buffer_size` smaller ({error})"
            ) from None
        self.episode = 0
        self.env_steps = 0
        self.units = 0
        self.under_way = 1
        self.tally = DecisionCounts()
        self.recent: deque[float] = deque(maxlen=20)
        self.decisions: Table | None = None
        self.on_step: OnStep | None = None
        self._pretrained = settings.training.random_steps == 0
        self._wall_before, self._clock = 0.0, working_time()
        self._unit_value: Any = None
        self._unchecked = _MIRRORED

    @property
    def wall_time(self) -> float:
        """Seconds of training, without compilation and pauses between resumptions."""
        return self._wall_before + working_time() - self._clock

    @property
    def compile_seconds(self) -> float:
        """Seconds of compilation since the run began."""
        return self._compiled_before + compile_seconds()

    def prepare(self) -> None:
        """Compile the loops that the training calls; the clock of training starts afterwards."""
        precompile(self.agent)
        self._clock = working_time()

    def run_episode(self) -> MetricsRow:
        """Train for one episode, and return its row of the metrics.

        Raises:
            TaskError: The grounding failed, or contradicts a symmetry that the task declares.
            EnvironmentFailure: The environment raised or gave NaN.
            LearningFailure: A number of the learner is not finite.
            SettingsError: The environment's info has no entry for `arbiter.rho_unit`.
        """
        try:
            return self._run_episode()
        except (TaskError, LearningFailure, StateError) as error:
            error.add_note(
                f"It happened in env step {self.under_way} of the training, episode "
                f"{self.episode + 1}."
            )
            raise

    def _run_episode(self) -> MetricsRow:
        agent = self.agent
        losses: list[float] = []
        self.under_way = self.env_steps + 1
        rollout = Rollout(
            self.task,
            self._perceive,
            seed=training_seed(self.seed, self.episode),
            limit=self.settings.training.episode_steps,
            judge=self.judge,
        )
        self._notice_unit(rollout.info, reset=True)
        random_phase = not self._pretrained
        decision: Decision | None = self._decide(rollout.state, rollout.x)
        while decision is not None:
            self.under_way = self.env_steps + 1
            self._log(decision, rollout.state)
            step = rollout.step(decision)
            self._observe(step)
            self.env_steps += 1
            self.tally.count(decision)
            # The next decision comes before learning: its mask is stored with this step.
            decision = None if step.last else self._decide(step.next_state, step.next_x)
            agent.remember(step, decision)
            if not random_phase:
                loss = agent.learn()
                if loss is not None:
                    losses.append(loss)
                self._end_unit("step")
            self._notice_unit(step.info)
            if self.on_step is not None:
                self.on_step(step)
        return self._end_episode(rollout.totals, losses)

    def _perceive(
        self, raw: Any, info: Mapping[str, Any], env: gym.Env[Any, Any]
    ) -> tuple[Vector, Vector]:
        state, x = self.agent.perceive(raw, info, env)
        if self._unchecked:
            self._unchecked -= 1
            for symmetry in self.agent.symmetries:
                symmetry.check_grounding(self.task, self.task.observation(raw), state)
        return state, x

    def _decide(self, state: Vector, x: Vector) -> Decision:
        if self._pretrained:
            return self.agent.decide(state, x)
        return self.agent.decide_randomly(state)

    def _observe(self, step: StepRecord) -> None:
        """Update the agent, and notify the user when the lookahead becomes unreliable."""
        vetoes, say = self.agent.arbiter.vetoes, self.task.on_notice
        relied_on = vetoes.lookahead_reliable
        self.agent.observe(step)
        if relied_on and not vetoes.lookahead_reliable and say is not None:
            say(
                f"{vetoes.lookahead_failures} times in {self.env_steps + 1} env steps something "
                "unsafe happened that was avoidable by the domain file. From now on vetoes use "
                "only its prediction of the next step. Check the effects of its actions."
            )

    def _end_episode(self, totals: EpisodeTotals, losses: list[float]) -> MetricsRow:
        self.episode += 1
        agent = self.agent
        if self._pretrained:
            self._end_unit("episode")
            agent.strategy.end_episode(totals.return_, totals.length)
        elif self.env_steps >= self.settings.training.random_steps:
            agent.learner.pretrain()
            self._pretrained = True
        self.recent.append(totals.return_)
        return MetricsRow(
            episode=self.episode,
            env_steps=self.env_steps,
            return_=totals.return_,
            domain_return=totals.domain_return,
            length=totals.length,
            terminated=totals.terminated,
            truncated=totals.truncated,
            rho=agent.strategy.rho,
            epsilon=agent.learner.epsilon,
            loss=float(np.mean(losses)) if losses else None,
            wall_time=self.wall_time,
            **totals.decisions.numbers(),
        )

    def _notice_unit(self, info: Mapping[str, Any], *, reset: bool = False) -> None:
        """End a unit of ρ when the counter that `arbiter.rho_unit` names has changed."""
        unit = self.settings.arbiter.rho_unit
        if unit in ("step", "episode"):
            return
        if unit not in info:
            if reset:  # many environments give more entries in `step` than in `reset`
                return
            raise SettingsError(
                f"arbiter.rho_unit is `{unit}`, but the environment's info has no such entry; "
                "use " + ", ".join(["step", "episode", *sorted(map(str, info))])
            )
        value = single(info[unit])
        if not isinstance(value, str | int | float) or value != value:  # NaN is never equal
            raise SettingsError(
                f"arbiter.rho_unit: the environment's info has {value!r} under `{unit}`; a number "
                "or a text is needed"
            )
        if self._unit_value is not None and value != self._unit_value and self._pretrained:
            self._end_unit(unit)
        self._unit_value = value

    def _end_unit(self, unit: str) -> None:
        self.units += unit == self.settings.arbiter.rho_unit
        self.agent.strategy.end_unit(unit)

    def _log(self, decision: Decision, state: Vector) -> None:
        if self.decisions is None:
            return
        name = self.task.actions.name
        self.decisions.append(
            DecisionRow(
                step=self.env_steps,
                episode=self.episode + 1,
                proposed_by=decision.proposed_by,
                proposed=name(decision.proposed) if decision.proposed >= 0 else "",
                executed=name(decision.action),
                executed_by=decision.executed_by,
                reason=decision.reason,
                vetoed=decision.vetoed,
                predicted_reward=decision.predicted_reward,
                proposal_unsafe=decision.proposal_unsafe,
                unsafe=decision.unsafe,
                risk=decision.risk,
                rho=decision.rho,
                depth=decision.depth,
                bound=decision.bound,
                indifferent=decision.indifferent,
                explanation=self.agent.arbiter.explain(decision, state),
            )
        )

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return the complete state between two episodes: arrays and JSON values."""
        arrays, agent = self.agent.state_dict()
        meta: dict[str, Any] = {
            "agent": agent,
            "episode": self.episode,
            "env_steps": self.env_steps,
            "units": self.units,
            "tally": self.tally.state_dict(),
            "recent": list(self.recent),
            "pretrained": self._pretrained,
            "unit_value": self._unit_value,
            "wall_time": {"training": self.wall_time, "compilation": self.compile_seconds},
            "environment": self.task.environment_state(),
        }
        return arrays, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It belongs to a learner of another shape or to another environment.
        """
        saved = Saved("training", arrays, meta)
        self.agent.load_state_dict(arrays, saved.part("agent")[1])
        for name in ("episode", "env_steps", "units"):
            setattr(self, name, saved.whole(name))
        self.tally = DecisionCounts.from_saved(saved.part("tally")[1])
        self.recent.clear()
        self.recent.extend(saved.reals("recent", 20, -np.inf, np.inf, least=0))
        self._pretrained = saved.truth("pretrained")
        self._unit_value = saved.part("unit_value")[1]
        if not isinstance(self._unit_value, str | int | float | None):
            raise saved.wrong("unit_value is neither a number nor a text")
        seconds = Saved("times", {}, saved.part("wall_time")[1])
        self._wall_before, self._clock = seconds.real("training", 0.0), working_time()
        self._compiled_before += seconds.real("compilation", 0.0)
        self.task.restore_environment(saved.part("environment")[1])
