"""Algorithm 1 of the paper: act as the arbiter decides, remember, learn, let ρ grow."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._util.compile_time import compile_seconds, working_time
from serp._util.saved_state import Saved
from serp.control.arbiter import Decision
from serp.control.decision_counts import DecisionCounts
from serp.errors import LearningFailure, SettingsError, TaskError
from serp.model.transition_model import StateError, Vector
from serp.planning.action_map import ActionForecast
from serp.runs.rows import DecisionRow, MetricsRow
from serp.runs.tables import Table
from serp.settings import Settings
from serp.tasks.bound_task import BoundTask
from serp.tasks.env_checks import single
from serp.tasks.reward import Judge
from serp.training.agent import Agent
from serp.training.precompile import rehearse

_EPISODES = 1  # spawn key of the environment's seeds
_MIRRORED = 256
"""With so many observations the symmetries that a task declares are checked."""


def episode_seed(seed: int, episode: int) -> int:
    """Return the environment's seed for an episode, from 0, of a training."""
    sequence = np.random.SeedSequence(entropy=seed, spawn_key=(_EPISODES, episode))
    return int(sequence.generate_state(1)[0])


class Transition(NamedTuple):
    """One env step of a training.

    Attributes:
        decision: What was done, who did it and why.
        reward: What is learned from; see `serp.tasks.reward`.
        env_reward: The environment's reward.
        terminated: Whether the environment ended the episode here.
        truncated: Whether the episode was cut off here.
        info: What the environment says besides.
    """

    decision: Decision
    reward: float
    env_reward: float
    terminated: bool
    truncated: bool
    info: dict[str, Any]


@dataclass
class _Episode:
    """Counters of the episode that is running; they become its row of the metrics."""

    return_: float = 0.0
    domain_return: float = 0.0
    length: int = 0
    terminated: bool = False
    truncated: bool = False
    tally: DecisionCounts = field(default_factory=DecisionCounts)
    losses: list[float] = field(default_factory=list)

    def count(self, decision: Decision, env_reward: float, domain_reward: float) -> None:
        self.length += 1
        self.return_ += env_reward
        self.domain_return += domain_reward
        self.tally.count(decision)

    def row(
        self, episode: int, env_steps: int, rho: float, epsilon: float, wall: float
    ) -> MetricsRow:
        return MetricsRow(
            episode=episode,
            env_steps=env_steps,
            return_=self.return_,
            domain_return=self.domain_return,
            length=self.length,
            terminated=self.terminated,
            truncated=self.truncated,
            rho=rho,
            epsilon=epsilon,
            loss=float(np.mean(self.losses)) if self.losses else None,
            wall_time=wall,
            **self.tally.numbers(),
        )


class Trainer:
    """Trains an agent on a task, an episode at a time.

    Every episode begins with `env.reset(seed=...)`, its seed derived from the run's seed and the
    number of the episode. What an episode is like therefore depends on the agent and that number
    alone, and a run can be continued exactly from the end of any episode in any environment that
    honours its seed. An environment whose state outlives `reset` (a game clock) offers
    `state_dict()` and `load_state_dict(state)` with JSON values.

    Args:
        task: The task.
        settings: All settings.
        seed: Seed of everything random.
        decisions: Where decisions are logged; None logs none.
        agent: Who is trained; by default a new `Agent`.

    Attributes:
        judge: Says what a step was worth.
        decisions: The same, to be set before the first episode.
        episode, env_steps: How many there were.
        under_way: Number of the env step that is being made, from 1.
        units: How many units of `arbiter.rho_unit` have ended.
        tally: What is counted of all steps.
        on_step: Called with every env step that was made and learned from, where it is set.
    """

    def __init__(
        self,
        task: BoundTask,
        settings: Settings,
        seed: int,
        decisions: Table | None = None,
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
            if isinstance(error, RuntimeError) and "alloc" not in str(error):  # torch says it so
                raise
            raise SettingsError(
                "learner: its networks and its memory do not fit into the machine's; make "
                f"`hidden`, `members` or `buffer_size` smaller ({error})"
            ) from None
        self.episode = 0
        self.env_steps = 0
        self.units = 0
        self.under_way = 1
        self.tally = DecisionCounts()
        self.recent: deque[float] = deque(maxlen=20)
        self.decisions = decisions
        self.on_step: Callable[[Transition], None] | None = None
        self._pretrained = settings.training.random_steps == 0
        self._wall_before, self._clock = 0.0, working_time()
        self._unit_value: Any = None
        self._unchecked = _MIRRORED
        self._names = [task.actions.name(a) for a in range(task.actions.size)]

    @property
    def wall_time(self) -> float:
        """Seconds of training, compilation and pauses between resumptions left out."""
        return self._wall_before + working_time() - self._clock

    @property
    def compile_seconds(self) -> float:
        """Seconds of compilation since the run began."""
        return self._compiled_before + compile_seconds()

    def prepare(self) -> None:
        """Compile what the training will call; the time of training begins afterwards."""
        rehearse(self.agent)
        self._clock = working_time()

    def run_episode(self) -> MetricsRow:
        """Train for one episode.

        Returns:
            Its row of the metrics.

        Raises:
            TaskError: The grounding failed, or contradicts a symmetry that the task declares.
            EnvironmentFailure: The environment raised or gave NaN.
            LearningFailure: A number of the learner is not finite.
            SettingsError: The environment has no such unit as `arbiter.rho_unit`.
        """
        try:
            return self._run_episode()
        except (TaskError, LearningFailure, StateError) as error:
            error.add_note(
                f"That was in env step {self.under_way} of the training, episode "
                f"{self.episode + 1}."
            )
            raise

    def _run_episode(self) -> MetricsRow:
        agent, task, strategy = self.agent, self.task, self.agent.arbiter.strategy
        episode = _Episode()
        self.under_way = self.env_steps + 1
        raw, info = task.reset(seed=episode_seed(self.seed, self.episode))
        self._notice_unit(info, reset=True)
        state, x = self._perceive(raw)
        random_phase = not self._pretrained
        decision = self._decide(state, x, random_phase=random_phase)
        while True:
            self.under_way = self.env_steps + 1
            self._log(decision, state)
            raw, env_reward, terminated, truncated, info = task.step(decision.action)
            next_state, next_x = self._perceive(raw)
            ground = int(decision.forecast.ground[decision.action])
            judged = self.judge(state, ground, next_state, env_reward)
            reward, domain_reward, failed = judged
            episode.count(decision, env_reward, domain_reward)
            limit = self.settings.training.episode_steps
            truncated = truncated or (episode.length >= limit and not terminated)
            self._observe(decision, unsafe=failed, last=terminated or truncated)
            agent.observe(state, ground, next_state, judged, terminated, truncated)
            self.env_steps += 1
            self.tally.count(decision)
            # The next decision is made before learning: its mask belongs to this transition.
            following: Decision | None = None
            ahead: ActionForecast | None = None
            allowed: NDArray[np.bool_] | None = None
            if terminated:
                pass
            elif truncated:
                ahead = agent.arbiter.forecast(next_state)
                allowed = strategy.allowed(ahead, agent.arbiter.admissible(ahead))
            else:
                following = self._decide(next_state, next_x, random_phase=random_phase)
                ahead = following.forecast
                allowed = strategy.allowed(ahead, following.admissible)
            agent.learner.remember(
                x, decision.action, reward, next_x, terminated, truncated, allowed, failed,
                strategy.guidance(decision.forecast, decision.action, ahead),
            )  # fmt: skip
            if not random_phase:
                agent.learner.margin_weight = strategy.margin_weight
                loss = agent.learner.learn()
                if loss is not None:
                    episode.losses.append(loss)
                self._end_unit("step")
            self._notice_unit(info)
            if self.on_step is not None:
                self.on_step(Transition(decision, reward, env_reward, terminated, truncated, info))
            if following is None:
                episode.terminated, episode.truncated = terminated, truncated
                return self._end_episode(episode)
            state, x, decision = next_state, next_x, following

    def _perceive(self, raw: Any) -> tuple[Vector, Vector]:
        state, x = self.agent.perceive(raw)
        if self._unchecked:
            self._unchecked -= 1
            for symmetry in self.agent.symmetries:
                symmetry.check_grounding(self.task, self.task.observation(raw), state)
        return state, x

    def _decide(self, state: Vector, x: Vector, *, random_phase: bool) -> Decision:
        if random_phase:
            return self.agent.decide_randomly(state)
        return self.agent.decide(state, x)

    def _end_episode(self, episode: _Episode) -> MetricsRow:
        self.episode += 1
        agent = self.agent
        if self._pretrained:
            self._end_unit("episode")
            agent.arbiter.strategy.end_episode(episode.return_, episode.length)
        elif self.env_steps >= self.settings.training.random_steps:
            agent.learner.pretrain()
            self._pretrained = True
        self.recent.append(episode.return_)
        return episode.row(
            self.episode, self.env_steps, agent.arbiter.rho, agent.learner.epsilon, self.wall_time
        )

    def _observe(self, decision: Decision, *, unsafe: bool, last: bool) -> None:
        """Tell the arbiter what came of a decision, and the user what the arbiter makes of it."""
        arbiter, say = self.agent.arbiter, self.task.on_notice
        believed, broken = arbiter.promises.believed, arbiter.promises.broken
        arbiter.observe(decision, unsafe=unsafe, last=last)
        if arbiter.promises.broken > broken:
            self.agent.correction.reset_visits()
        if believed and not arbiter.promises.believed and say is not None:
            say(
                f"{arbiter.promises.broken} times in {self.env_steps + 1} env steps something "
                "unsafe happened that the domain file said could be kept away. From here on it is "
                "believed for the next step only: does it say rightly what the actions do?"
            )

    def _notice_unit(self, info: Mapping[str, Any], *, reset: bool = False) -> None:
        """Let ρ grow when the counter that its unit names has changed."""
        unit = self.settings.arbiter.rho_unit
        if unit in ("step", "episode"):
            return
        if unit not in info:
            if reset:  # many environments say more in `step` than in `reset`
                return
            raise SettingsError(
                f"arbiter.rho_unit is `{unit}`, but the environment's info has no such entry; "
                "use " + ", ".join(["step", "episode", *sorted(map(str, info))])
            )
        value = single(info[unit])
        if not isinstance(value, str | int | float) or value != value:  # NaN changes all the time
            raise SettingsError(
                f"arbiter.rho_unit: the environment's info has {value!r} under `{unit}`; a number "
                "or a text is needed"
            )
        if self._unit_value is not None and value != self._unit_value and self._pretrained:
            self._end_unit(unit)
        self._unit_value = value

    def _end_unit(self, unit: str) -> None:
        self.units += unit == self.settings.arbiter.rho_unit
        self.agent.arbiter.strategy.end_unit(unit)

    def _log(self, decision: Decision, state: Vector) -> None:
        if self.decisions is None:
            return
        explanation = self.agent.arbiter.explain(decision, state)
        names = self._names
        self.decisions.append(
            DecisionRow(
                step=self.env_steps,
                episode=self.episode + 1,
                proposed_by=decision.proposed_by,
                proposed=names[decision.proposed] if decision.proposed >= 0 else "",
                executed=names[decision.action],
                executed_by=decision.executed_by,
                reason=decision.reason,
                vetoed=decision.vetoed,
                predicted_reward=decision.predicted_reward,
                proposal_unsafe=decision.proposal_unsafe,
                unsafe=decision.unsafe,
                risk=decision.risk,
                rho=decision.rho,
                explanation=explanation,
            )
        )

    # State, between episodes ------------------------------------------------------------------

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return everything that the rest of the run depends on: arrays and JSON values."""
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
