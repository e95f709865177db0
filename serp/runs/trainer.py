"""The training loop, Algorithm 1 of the paper: decide, act, store, learn, increase ρ."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Any, Protocol, TypedDict

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from serp._util.compilation import compile_seconds, working_time
from serp._util.files import Closing
from serp._util.saved_state import Saved
from serp.agent.agent import Agent
from serp.agent.decision import Decision
from serp.agent.step_record import DecisionCounts, OnStep, StepRecord
from serp.errors import LearningFailure, SettingsError, TaskError
from serp.model.transition_model import StateError, Vector
from serp.runs.precompile import precompile
from serp.runs.recording import Recorder
from serp.runs.rollout import Lane, Perceive, Rollout, lanes_of, training_seed
from serp.runs.tables import MetricsRow, Table, decision_row, metrics_row
from serp.settings import Section, Settings
from serp.tasks.remote_task import RemoteTask
from serp.tasks.task import BoundTask, Judge

Limit = Annotated[int, Field(ge=1)] | None


class Counted(Protocol):
    """An object with counts of episodes, env steps and units, such as a `Trainer`."""

    episode: int
    env_steps: int
    units: int


class Budget(Section):
    """Limits of a training, counted from the run's beginning; it ends when it reaches one."""

    episodes: Limit = None
    """Number of complete episodes; None for no limit."""
    env_steps: Limit = None
    """Number of env steps; the episode that reaches it is finished. None for no limit."""
    units: Limit = None
    """Number of complete units of `arbiter.rho_unit`, such as games; None for no limit."""

    @classmethod
    def from_dict(cls, values: Any) -> Budget:
        """Return the budget that `as_dict` wrote.

        Raises:
            SettingsError: It is not a budget.
        """
        if not isinstance(values, Mapping):
            raise SettingsError(f"{values!r} is not a budget")
        return cls(**values)

    @property
    def limits(self) -> dict[str, int]:
        """The limits that there are, by name."""
        return {name: limit for name, limit in self if limit is not None}

    @staticmethod
    def counts(counted: Counted) -> dict[str, int]:
        """Return the counts by the names of their limits."""
        return {
            "episodes": counted.episode,
            "env_steps": counted.env_steps,
            "units": counted.units,
        }

    def spent_by(self, counted: Counted) -> bool:
        """Return whether a limit is reached."""
        counts = self.counts(counted)
        return any(counts[name] >= limit for name, limit in self.limits.items())


OnEpisode = Callable[[MetricsRow], None]
"""Called with the row of the metrics of every episode, after the episode."""


class TrainingCallbacks(TypedDict, total=False):
    """Functions that a training calls; their results are ignored.

    Attributes:
        on_step: Called with every env step, after learning from it.
        on_episode: Called with the metrics of every episode. A resumed run calls it for the new
            episodes only.
    """

    on_step: OnStep
    on_episode: OnEpisode


class Callbacks:
    """Calls the functions of the user until one of them fails.

    A failure does not interrupt the episode, because a run is saved between episodes only.

    Attributes:
        failure: What a function raised; no function is called after that.
    """

    def __init__(self, functions: TrainingCallbacks) -> None:
        for name, function in functions.items():
            if name not in TrainingCallbacks.__annotations__:
                raise TypeError(f"plan_and_learn() got an unexpected keyword argument {name!r}")
            if function is not None and not callable(function):
                raise SettingsError(f"{name} must be a function of one argument, not {function!r}")
        self._on_step = functions.get("on_step")
        self._on_episode = functions.get("on_episode")
        self.failure: Exception | None = None

    def step(self, record: StepRecord) -> None:
        """Call `on_step`."""
        if self._on_step is not None:
            self._call(self._on_step, record)

    def episode(self, row: MetricsRow) -> None:
        """Call `on_episode`."""
        if self._on_episode is not None:
            self._call(self._on_episode, row)

    def _call(self, function: Callable[[Any], None], record: Any) -> None:
        if self.failure is None:
            try:
                function(record)
            except Exception as error:
                self.failure = error


_MIRRORED = 256
"""Number of observations with which declared symmetries are checked."""
_TOGETHER = 100
"""Env steps for each of several environments after which no episode begins until all have ended.
More of them keep more environments busy, fewer make a run end nearer to its budget."""


class Trainer(Closing):
    """Trains an agent on a task, in one environment or in several that are stepped together.

    Every episode begins with `env.reset(seed=...)`, its seed derived from the run's seed and the
    number of the episode. An episode therefore depends only on the agent and that number, and a run
    can be continued exactly from where no episode is running, in any environment that uses its
    seed. An environment whose state survives `reset` (a game clock) has `state_dict()` and
    `load_state_dict(state)` with JSON values.

    Attributes:
        lanes: The environments.
        judge: Judges the steps.
        decisions: Table in which decisions are logged; None for no log.
        recorder: Where steps are recorded; None for nowhere.
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
        self.recorder: Recorder | None = None
        self.on_step: OnStep | None = None
        self._pretrained = settings.training.random_steps == 0
        self._wall_before, self._clock = 0.0, working_time()
        self._unchecked = _MIRRORED
        self._open = contextlib.ExitStack()
        lanes = lanes_of(task, settings.training.num_envs)
        self.lanes = self._open.enter_context(lanes)

    def close(self) -> None:
        """Close the environments that the trainer has made; that of the task stays open."""
        self._open.close()

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
        """Train for one episode with one environment, and return its row of the metrics.

        Errors are those of `run`.
        """
        (row,) = self.run()
        return row

    def run(self) -> Iterator[MetricsRow]:
        """Train until no episode is running; yield the rows of the metrics as episodes end.

        Every environment begins an episode. Where one ends the next one begins, until `_TOGETHER`
        env steps were made for each environment; a single environment makes one episode. At first
        there are at most one more environments than complete episodes: what is wrong in a file, one
        robot finds out, and not all at once. What happens depends on nothing else, so that a run
        which is interrupted can be continued from the end exactly.

        Raises:
            TaskError: The grounding failed, or contradicts a symmetry that the task declares.
            EnvironmentFailure: An environment raised or gave NaN.
            LearningFailure: A number of the learner is not finite.
            SettingsError: The environment's info has no entry for `arbiter.rho_unit`.
        """
        try:
            yield from self._run()
        except (TaskError, LearningFailure, StateError) as error:
            error.add_note(
                f"It happened in env step {self.under_way} of the training, episode "
                f"{self.episode + 1}."
            )
            raise

    def _run(self) -> Iterator[MetricsRow]:
        running = list(self.lanes)[: self.episode + 1]
        enough = self.env_steps + (_TOGETHER * len(running) if len(running) > 1 else 0)
        self._begun = self.episode
        for lane in running:
            self._begin(lane)
        while running:
            self.under_way = self.env_steps + 1
            before = self.env_steps
            steps = [(lane, self._advance(lane)) for lane in running]
            self._decide_next([lane for lane, step in steps if step is None or not step.last])
            made = [(lane, step) for lane, step in steps if step is not None]
            for number, (lane, step) in enumerate(made, before + 1):
                self.under_way = number
                self._learn(lane, step)
            for lane, step in made:
                if not step.last:
                    continue
                yield self._end_episode(lane)
                if self.env_steps < enough:
                    self._begin(lane)
                else:
                    running.remove(lane)

    def _begin(self, lane: Lane) -> None:
        seed = training_seed(self.seed, self._begun)
        lane.begin(self._begun, seed, random=not self._pretrained)
        self._begun += 1

    def _advance(self, lane: Lane) -> StepRecord | None:
        """Make the step that was decided on, and return it; None after a reset."""
        self.agent.turn_to(lane.number)
        if lane.rollout is None or lane.decision is None:
            lane.rollout = Rollout(
                lane.task,
                self._perceive_of(lane.task),
                seed=lane.seed,
                limit=self.settings.training.episode_steps,
                judge=self.judge,
            )
            self.agent.arbiter.begin_episode()
            self._notice_unit(lane, lane.rollout.info, reset=True)
            return None
        self.under_way = self.env_steps + 1
        step = lane.rollout.step(lane.decision)
        self.agent.observe(step, lane.episode)
        self.env_steps += 1
        if self.recorder is not None:
            self.recorder.append(lane.episode + 1, step)
        self.tally.count(step.decision)
        return step

    def _perceive_of(self, task: BoundTask | RemoteTask) -> Perceive:
        def perceive(raw: Any, info: Mapping[str, Any], env: Any) -> tuple[Vector, Vector]:
            if isinstance(task, RemoteTask):
                observation, state = task.perceived
            else:
                observation, state = task.observation(raw), task.ground(raw, info, env)
            if self._unchecked:
                self._unchecked -= 1
                for symmetry in self.agent.symmetries:
                    symmetry.check_grounding(self.task, observation, state)
            return self.agent.take_in(observation, state)

        return perceive

    def _decide_next(self, lanes: list[Lane]) -> None:
        """Decide in environments whose episode goes on, and begin to execute the decisions.

        Environments in other processes execute them while the learner learns.
        """
        rollouts = [lane.rollout for lane in lanes if lane.rollout is not None]
        states = {lane.number: r.state for lane, r in zip(lanes, rollouts, strict=True)}
        with self.agent.arbiter.prefetch(states):
            for k, (lane, rollout) in enumerate(zip(lanes, rollouts, strict=True)):
                self.agent.turn_to(lane.number)
                if self._pretrained:
                    decision = self.agent.decide(rollout.state, rollout.x)
                else:
                    decision = self.agent.decide_randomly(rollout.state)
                self._log(decision, rollout.state, lane.episode, self.env_steps + k)
                lane.execute(decision)

    def _learn(self, lane: Lane, step: StepRecord) -> None:
        """Store a step, with the mask of the decision that follows it, and learn."""
        self.agent.turn_to(lane.number)
        self.agent.remember(step, None if step.last else lane.decision)
        if self._pretrained:
            loss = self.agent.learn()
            if loss is not None:
                lane.losses.append(loss)
            self._end_unit("step")
        self._notice_unit(lane, step.info)
        if self.on_step is not None:
            self.on_step(step)

    def _end_episode(self, lane: Lane) -> MetricsRow:
        assert lane.rollout is not None
        self.episode += 1
        agent, totals, losses = self.agent, lane.rollout.totals, lane.losses
        agent.turn_to(lane.number)
        if not lane.random:
            self._end_unit("episode")
            agent.strategy.end_episode(totals.return_, totals.length)
        elif not self._pretrained and self.env_steps >= self.settings.training.random_steps:
            agent.learner.pretrain()
            self._pretrained = True
        self.recent.append(totals.return_)
        return metrics_row(
            totals,
            episode=self.episode,
            env_steps=self.env_steps,
            rho=agent.strategy.rho,
            epsilon=agent.learner.epsilon,
            losses=losses,
            wall_time=self.wall_time,
        )

    def _notice_unit(self, lane: Lane, info: Mapping[str, Any], *, reset: bool = False) -> None:
        """End a unit of ρ when the counter that `arbiter.rho_unit` names has changed."""
        unit = self.settings.arbiter.rho_unit
        if lane.unit_ended(unit, info, reset=reset) and self._pretrained:
            self._end_unit(unit)

    def _end_unit(self, unit: str) -> None:
        self.units += unit == self.settings.arbiter.rho_unit
        self.agent.strategy.end_unit(unit)

    def _log(self, decision: Decision, state: Vector, episode: int, env_step: int) -> None:
        if self.decisions is not None:
            row = decision_row(
                decision, self.agent.arbiter, state, step=env_step, episode=episode + 1
            )
            self.decisions.append(row)

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return the complete state while no episode is running: arrays and JSON values."""
        arrays, agent = self.agent.state_dict()
        meta: dict[str, Any] = {
            "agent": agent,
            "episode": self.episode,
            "env_steps": self.env_steps,
            "units": self.units,
            "tally": self.tally.state_dict(),
            "recent": list(self.recent),
            "pretrained": self._pretrained,
            "wall_time": {"training": self.wall_time, "compilation": self.compile_seconds},
            "lanes": {str(lane.number): lane.state_dict() for lane in self.lanes},
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
        seconds = Saved("times", {}, saved.part("wall_time")[1])
        self._wall_before, self._clock = seconds.real("training", 0.0), working_time()
        self._compiled_before += seconds.real("compilation", 0.0)
        lanes = Saved("environments", {}, saved.part("lanes")[1])
        for lane in self.lanes:
            lane.load_state_dict(lanes.part(str(lane.number))[1])
