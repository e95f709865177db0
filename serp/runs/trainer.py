"""The training loop, Algorithm 1 of the paper: decide, act, store, learn, increase ρ."""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

from numpy.typing import NDArray

from serp._util.files import Closing
from serp._util.saved_state import Saved
from serp.agent.agent import Agent
from serp.agent.step_record import OnStep, StepRecord
from serp.errors import LearningFailure, SettingsError, TaskError
from serp.model.transition_model import StateError
from serp.runs.rollout import Rollout, RolloutEnv, rollout_envs, training_seed
from serp.runs.run_log import Bookkeeping
from serp.runs.summary import WINDOW
from serp.runs.tables import MetricsRow
from serp.settings import Settings
from serp.tasks.environment import BoundTask
from serp.tasks.task import Judge

OnEpisode = Callable[[MetricsRow], None]
"""Called with the row of the metrics of every episode, after the episode."""


class Callbacks:
    """Calls the functions of the user until one of them fails, see `failure`.

    That does not interrupt the episode, because a run is saved between episodes only.
    """

    def __init__(self, on_step: OnStep | None = None, on_episode: OnEpisode | None = None) -> None:
        for name, function in (("on_step", on_step), ("on_episode", on_episode)):
            if function is not None and not callable(function):
                raise SettingsError(f"{name} must be a function of one argument, not {function!r}")
        self.failure: Exception | None = None
        self.step, self.episode = partial(self._call, on_step), partial(self._call, on_episode)

    def _call(self, function: Callable[[Any], None] | None, record: Any) -> None:
        if function is not None and self.failure is None:
            try:
                function(record)
            except Exception as error:
                self.failure = error


_TOGETHER = 100
"""Env steps for each of several environments after which no episode begins until all have ended.
More of them keep more environments busy, fewer make a run end nearer to its budget."""


class Trainer(Bookkeeping, Closing):
    """Trains an agent on a task, in one environment or in several that are stepped together.

    Every episode begins with `env.reset(seed=...)`, its seed derived from the run's seed and the
    number of the episode. An episode therefore depends only on the agent and that number, and a run
    can be continued exactly from where no episode is running, in any environment that uses its
    seed. An environment whose state survives `reset` (a game clock) has `state_dict()` and
    `load_state_dict(state)` with JSON values.

    Attributes:
        under_way: Number of the current env step, from 1.
        recent: Returns of the last `WINDOW` episodes.
        on_step: If set, called with every env step, after learning from it.
    """

    def __init__(
        self, task: BoundTask, settings: Settings, seed: int, *, baseline: bool = False
    ) -> None:
        super().__init__()
        self.task, self.settings, self.seed = task, settings, seed
        self.judge = Judge(task, settings)
        try:
            self.agent = Agent(task, settings, seed, baseline=baseline)
        except MemoryError as error:
            raise SettingsError(
                "learner: the networks and the replay buffer do not fit into memory; make "
                f"`hidden`, `members` or `buffer_size` smaller ({error})"
            ) from None
        self.under_way = 1
        self.recent: deque[float] = deque(maxlen=WINDOW)
        self.on_step: OnStep | None = None
        self._pretrained = settings.training.random_steps == 0
        self._open = contextlib.ExitStack()
        self.environments = self._open.enter_context(rollout_envs(task, settings.training.num_envs))

    def close(self) -> None:
        """Close the environments that the trainer has made; that of the task stays open."""
        self._open.close()

    def run(self) -> Iterator[MetricsRow]:
        """Train until no episode is running; yield the rows of the metrics as episodes end.

        Every environment begins an episode. Where one ends the next one begins, until `_TOGETHER`
        env steps were made for each environment; a single environment makes one episode. At first
        there are at most one more environments than complete episodes: what is wrong in a file, one
        robot finds out, and not all at once. What happens depends on nothing else, so that a run
        which is interrupted can be continued from the end exactly. Errors are those of `Rollout`
        and of the learner.
        """
        running = self.environments[: self.episode + 1]
        enough = self.env_steps + (_TOGETHER * len(running) if len(running) > 1 else 0)
        self._begun = self.episode
        for env in running:
            self._begin(env)
        while running:
            try:
                ended = self._step(running)
            except (TaskError, LearningFailure, StateError) as error:
                error.add_note(
                    f"It happened in step {self.under_way - 1} of the training, episode "
                    f"{self.episode + 1}."
                )
                raise
            for env in ended:
                yield self._end_episode(env)
                if self.env_steps < enough:
                    self._begin(env)
                else:
                    running.remove(env)

    def _begin(self, env: RolloutEnv) -> None:
        seed = training_seed(self.seed, self._begun)
        env.begin(self._begun, seed, random=not self._pretrained)
        self._begun += 1

    def _step(self, running: list[RolloutEnv]) -> list[RolloutEnv]:
        """Make one env step in every environment; return those whose episode ended.

        An env step is all here: the environment executes what was decided, the agent observes it,
        it is written, the next action is decided, and the learner learns. Each is done for all
        environments before the next, so that those in other processes execute while it learns. In
        an episode that begins there is a reset in place of the execution.
        """
        agent = self.agent
        self.under_way = self.env_steps + 1
        made: list[tuple[RolloutEnv, StepRecord]] = []
        for env in running:
            agent.turn_to(env.index)
            if env.rollout is None or env.decision is None:
                env.rollout = Rollout(env.task, agent, self.judge, env.seed)
                continue
            self.under_way = self.env_steps + 1
            step = env.rollout.step(env.decision)
            agent.observe(step, env.episode)
            self.record_step(step, env.episode + 1)
            made.append((env, step))
        ended = [env for env, step in made if step.last]
        self._decide([env for env in running if env not in ended])
        for number, (env, step) in enumerate(made, self.env_steps - len(made) + 1):
            self.under_way = number
            agent.turn_to(env.index)
            agent.remember(step, None if step.last else env.decision)
            if self._pretrained:
                loss = agent.learn()
                if loss is not None:
                    env.losses.append(loss)
            if self.on_step is not None:
                self.on_step(step)
        return ended

    def _decide(self, environments: list[RolloutEnv]) -> None:
        """Decide in environments whose episode goes on, and begin to execute the decisions."""
        rollouts = {env: env.rollout for env in environments if env.rollout is not None}
        states = {env.index: rollout.state for env, rollout in rollouts.items()}
        with self.agent.prefetch(states) if len(states) > 1 else contextlib.nullcontext():
            for env, rollout in rollouts.items():
                self.agent.turn_to(env.index)
                if self._pretrained:
                    decision = self.agent.decide(rollout.state, rollout.x)
                else:
                    decision = self.agent.decide_randomly(rollout.state)
                env.execute(decision)

    def _end_episode(self, env: RolloutEnv) -> MetricsRow:
        assert env.rollout is not None
        agent, totals = self.agent, env.rollout.totals
        agent.turn_to(env.index)
        if not env.random:
            agent.strategy.end_episode(totals.return_, totals.length)
        elif not self._pretrained and self.env_steps >= self.settings.training.random_steps:
            agent.learner.pretrain(self.settings.training.random_steps)
            self._pretrained = True
        self.recent.append(totals.return_)
        return self.record_episode(totals, agent.strategy.rho, agent.learner.epsilon, env.losses)

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return the complete state while no episode is running: arrays and JSON values."""
        arrays, agent = self.agent.state_dict()
        meta: dict[str, Any] = {
            "agent": agent,
            "episode": self.episode,
            "env_steps": self.env_steps,
            "tally": self.tally.state_dict(),
            "pretrained": self._pretrained,
            "wall_time": self.wall_time,
            "environments": {
                str(env.index): env.task.environment_state() for env in self.environments
            },
        }
        return arrays, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned, or raise a RunError."""
        saved = Saved("training", arrays, meta)
        self.agent.load_state_dict(arrays, saved.part("agent")[1])
        for name in ("episode", "env_steps"):
            setattr(self, name, saved.whole(name))
        self.tally.load_state_dict(saved.part("tally")[1])
        self._pretrained = saved.truth("pretrained")
        self._wall_before, self._clock = saved.real("wall_time", 0.0), time.monotonic()
        environments = Saved("environments", {}, saved.part("environments")[1])
        for env in self.environments:
            env.task.restore_environment(environments.part(str(env.index))[1])
