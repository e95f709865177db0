"""The declaration of a task: environment, domain, grounding and the map of actions."""

from __future__ import annotations

import contextlib
import dataclasses
import inspect
import json
import os
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from serp._util.files import Closing
from serp._util.numbers import real
from serp.errors import EnvironmentFailure, RunError, SettingsError, TaskError
from serp.model.domain import Domain, load_domain
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.tasks import wrapper_state
from serp.tasks.environment import ActionSpace, Observations, reset_answer, step_answer
from serp.tasks.grounding import Grounding

if TYPE_CHECKING:
    from serp.planning.plan_follower import Advise
    from serp.settings import Settings
    from serp.tasks.file_world import WorldOptions


Source = Literal["domain", "environment", "sum"]


class Judged(NamedTuple):
    """The rewards and the safety of an observed step; see `serp.agent.step_record.StepRecord`."""

    reward: float
    domain_reward: float
    unsafe: bool


class Judge:
    """Judges the observed steps of a task; the setting `training.reward` chooses the reward.

    Args:
        task: The task.
        settings: All settings; None where nothing is learned from the steps: the reward is then the
            environment's.

    Raises:
        SettingsError: The domain's rewards are to be learned from, but it gives none.
    """

    def __init__(self, task: BoundTask, settings: Settings | None = None) -> None:
        self.source: Source = "environment"
        if settings is not None:
            self.source = reward_source(task.rewarded_by, settings)
        self._model = task.model
        if self.source != "environment" and not task.model.rewarding:
            raise SettingsError(
                f"training: reward is {self.source}, but the domain of task {task.name} says "
                "nothing about reward; let an action or event `(increase (reward) ...)`, or set "
                "training.reward=environment"
            )

    def __call__(self, state: Vector, ground: int, next_state: Vector, env_reward: float) -> Judged:
        """Judge an observed step by a ground action, -1 if the model does not know it.

        Raises:
            StateError: The domain's reward is learned from, and the file cannot judge this step.
        """
        try:
            judged = self._model.judge(state, ground, next_state)
        except StateError:
            if self.source != "environment":
                raise
            return Judged(env_reward, 0.0, False)
        reward = {
            "environment": env_reward,
            "domain": judged.reward,
            "sum": judged.reward + env_reward,
        }[self.source]
        return Judged(reward, judged.reward, judged.unsafe)


def reward_source(declared: Literal["domain", "environment"], settings: Settings) -> Source:
    """Return the source of the reward that is learned from, given the one that a task declares."""
    choice = settings.training.reward
    return declared if choice == "task" else choice


def describe_source(source: Source, *, in_file: bool, world: bool = False) -> str:
    """Return the end of a sentence that begins with "the learner learns from".

    `in_file` says whether the domain file gives rewards, `world` whether it is the environment.
    """
    if source == "domain":
        return "the rewards of the domain file"
    if source == "sum":
        return "the environment's reward plus those of the domain file"
    if not in_file:
        return "the environment's reward; the domain file gives none"
    if world:
        return "the rewards of the domain file, for what really happened"
    return (
        "the environment's reward; the planner plans with those of the domain file "
        "(training.reward=sum or domain: the learner learns from these, too)"
    )


Draw = Callable[[Mapping[str, float | bool]], str]
"""Fluent → value, and returned: a picture of that state as text, an `svg` element."""
Grounded = Mapping[str, float | bool] | NDArray[Any]
Overrides = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, kw_only=True)
class Task:
    """The declaration of a task.

    Attributes:
        make_env: Returns a new Gymnasium environment with discrete actions (`Discrete`,
            `MultiDiscrete` or `MultiBinary`); called with `render_mode=...` if pictures are needed.
        domain: The domain file, or a loaded domain.
        ground: Observation → the value of every fluent, as a mapping (fluent name → number or
            truth value) or as an array in the order of `domain.observed().model.fluents`. Every
            name in the mapping is a fluent, even if the problem's `:init` states it and no effect
            changes it. Parameters called `info` and `env` get what the environment returned beside
            the observation, and the environment.
        name: Name of the task; the domain's by default.
        problem: The problem file; by default `<name>-problem.pddl` beside the domain file.
        actions: Name of a ground action (or of a schema, for all its instances) → environment
            action, counted from 0; of a `MultiDiscrete` space its number or a tuple. None: the n-th
            ground action is environment action n.
        dt: Control period in the time unit of the domain's rates, usually seconds.
        reward: The source of the reward that the learner learns from: the `domain`'s R(s') of
            observed transitions, or the `environment`'s. None: the domain's if it gives rewards.
            The setting `training.reward` overrides it.
        settings: Preset name → section → setting → value: the task's changes to the presets. The
            key `*` stands for every preset.
        world: The options of an environment that `serp.file_task` made of the file; None for any
            other. A run with them needs no task to be opened again.
        planners: Further planners by name, for the setting `planner.name`: a function (fluent →
            value) → name of a ground action, None for no advice.
        draw: Draws a state, for `serp studio`: fluent → value, and returned an `svg` element as
            text. Colours may be the page's, such as `var(--ink)`, which is light in the dark.
        counters: Counters of the environment's info, per episode, that a comparison adds up.
        description: One line for `serp list`.
    """

    make_env: Callable[..., gym.Env[Any, Any]]
    domain: str | Path | Domain
    ground: Callable[..., Grounded]
    name: str | None = None
    problem: str | Path | None = None
    actions: Mapping[str, int | Sequence[int]] | None = None
    dt: float = 1.0
    reward: Literal["domain", "environment"] | None = None
    settings: Mapping[str, Overrides] = field(default_factory=dict)
    world: WorldOptions | None = None
    planners: Mapping[str, Advise] = field(default_factory=dict)
    draw: Draw | None = None
    counters: Sequence[str] = ()
    description: str = ""

    def __post_init__(self) -> None:
        planners = self.planners
        if not isinstance(planners, Mapping) or not all(map(callable, planners.values())):
            raise TaskError(
                f"task: planners must be a mapping {{name: function}}, not {planners!r}"
            )

    @property
    def closed(self) -> bool:
        """Whether the environment keeps to states that can be reached from the problem's `:init`.

        The model then has nothing else; so it is smaller, and no other state can be grounded.
        """
        return self.world is not None

    def load(self) -> Domain:
        """Return the domain, loading it if a file was given.

        Raises:
            DomainError: A file is missing or wrong.
            TaskError: `domain` or `problem` is not the name of a file.
        """
        if isinstance(self.domain, Domain):
            return self.domain.closed() if self.closed else self.domain.observed()
        for what, file in (("domain", self.domain), ("problem", self.problem)):
            if not isinstance(file, str | os.PathLike | None) or (
                what == "domain" and file is None
            ):
                raise TaskError(f"task: {what} must be a file or a loaded domain, not {file!r}")
        return load_domain(self.domain, self.problem, observed=not self.closed)

    def loaded(self) -> Task:
        """Return the task with its files loaded: the same on another machine, and after an edit.

        Raises:
            DomainError: A file is missing or wrong.
            TaskError: `domain` or `problem` is not the name of a file.
        """
        return dataclasses.replace(self, domain=self.load(), problem=None)

    def bind(self, *, render_mode: str | None = None) -> BoundTask:
        """Make an environment and check that it fits domain, grounding and actions.

        Raises:
            DomainError: The domain is wrong.
            TaskError: Environment, domain, grounding and actions do not fit together.
        """
        return BoundTask(self, render_mode=render_mode)


def declared_reward(task: Task, model: TransitionModel) -> Literal["domain", "environment"]:
    """Return the source of the reward that a task or its domain declares."""
    return task.reward or ("domain" if model.rewarding else "environment")


class BoundTask(Closing):
    """A task with an environment, its loaded domain and its resolved actions.

    As a context manager it closes its environment at the end.

    Attributes:
        task: The task with its files loaded.
        grounding: Its function.
        rewarded_by: The source of the reward that it declares.
        on_notice: If set, called with each line that the user should read.
    """

    def __init__(self, task: Task, *, render_mode: str | None = None) -> None:
        self.task = task = task.loaded()
        self.domain = task.load()
        self.name = str(task.name or self.domain.name)
        self._check_fields()
        try:
            self.grounding = Grounding(task.ground)
        except TaskError as error:
            raise TaskError(f"task {self.name}: {error}") from None
        self.model: TransitionModel = self.domain.model.replace(dt=float(task.dt))
        self.env = self._make_env(render_mode)
        try:
            self._check_environment()
        except BaseException:
            with contextlib.suppress(Exception):  # the first error is the one to report
                self.env.close()
            raise
        self.on_notice: Callable[[str], None] | None = None

    def _check_fields(self) -> None:
        task = self.task
        dt = real(task.dt)
        for right, name, allowed in (
            (isinstance(task.name, str | None), "name", "a text"),
            (callable(task.ground), "ground", "a function of an observation"),
            (callable(task.make_env), "make_env", "a function that returns an environment"),
            (task.reward in (None, "domain", "environment"), "reward", "'domain' or 'environment'"),
            (dt is not None and dt > 0, "dt (the control period)", "a number > 0"),
        ):
            if not right:
                value = getattr(task, name.split()[0])
                raise TaskError(f"task {self.name}: {name} must be {allowed}, not {value!r}")

    def _check_environment(self) -> None:
        task = self.task
        try:
            self._action_space = ActionSpace(getattr(self.env, "action_space", None))
            self.observations = Observations(getattr(self.env, "observation_space", None))
        except ValueError as error:
            raise TaskError(f"task {self.name}: {error}") from None
        self.observation_size = self.observations.size
        sample = self._tried_grounding()
        if isinstance(sample, Mapping):  # observed fluents are not constant, even if in :init
            self.domain = self.domain.observed(map(str, sample))
            self.model = self.domain.model.replace(dt=self.model.dt)
        from serp.tasks.action_map import ActionMap

        try:
            self.actions = ActionMap(self.model, self._action_space.size, self._numbered_actions())
        except TaskError as error:
            raise TaskError(f"task {self.name}, {self.domain.source.name}: {error}") from None
        self.rewarded_by = declared_reward(task, self.model)
        if self.rewarded_by == "domain" and not self.model.rewarding:
            raise TaskError(
                f"task {self.name}: the domain says nothing about reward; let an action or event "
                "`(increase (reward) ...)`, or set reward='environment'"
            )
        try:
            if isinstance(sample, Mapping):
                self.model.check_names(sample)
            elif sample is not None:
                self.model.check_shape(sample)
        except StateError as error:
            raise TaskError(
                f"task {self.name}: the grounding does not fit {self.domain.source.name}: {error}"
            ) from None

    def _numbered_actions(self) -> Any:
        """Return the task's `actions` with numbers in place of combinations."""
        named = self.task.actions
        if not isinstance(named, Mapping):
            return named
        numbered = {}
        for name, action in named.items():
            try:
                numbered[name] = self._action_space.number(action)
            except ValueError as error:
                raise TaskError(f"actions: `{name}` is mapped to {action!r}: {error}") from None
        return numbered

    def _tried_grounding(self) -> Any:
        """Return what the grounding gives on a sampled observation; None if it fails on them all.

        Of info and of states of the environment there are no samples: one that takes these is tried
        on a reset.
        """
        if self.grounding.takes:
            return self._grounded(*self.reset(seed=0), self.env)
        return next(self.grounding.on_samples(self.observations.space, 8), None)

    def _make_env(self, render_mode: str | None) -> gym.Env[Any, Any]:
        if render_mode is not None and self.task.world is not None:
            raise TaskError(
                f"task {self.name}: a world made of a file has no pictures; `serp why` shows "
                "its steps"
            )
        if render_mode is not None and not _takes(self.task.make_env, "render_mode"):
            raise TaskError(
                f"task {self.name}: make_env takes no render_mode, so nothing can be drawn; let it "
                "take one and pass it on, as `lambda **options: gymnasium.make(..., **options)` "
                "does"
            )
        try:
            env = self.task.make_env(**({"render_mode": render_mode} if render_mode else {}))
        except Exception as error:
            raise EnvironmentFailure(
                f"task {self.name}: making the environment failed: {_short(error)}"
            ) from error
        if not isinstance(env, gym.Env):
            raise TaskError(
                f"task {self.name}: make_env returned {type(env).__name__}, not a gymnasium.Env"
            )
        return env

    # Steps -------------------------------------------------------------------------------------

    def observation(self, raw: Any) -> NDArray[np.float64]:
        """Return an observation as a flat float64 vector, or raise an EnvironmentFailure."""
        try:
            return self.observations.read(raw)
        except ValueError as error:
            raise EnvironmentFailure(f"task {self.name}: the observation: {error}") from None

    def ground(
        self,
        raw: Any,
        info: Mapping[str, Any] | None = None,
        env: gym.Env[Any, Any] | None = None,
    ) -> Vector:
        """Return the state `[F]` of an observation.

        Args:
            raw: The observation.
            info: What the environment returned beside it; needed if the grounding takes it.
            env: The environment, which has just returned it; needed if the grounding takes it.

        Raises:
            TaskError: The grounding failed, or does not give the value of every fluent.
        """
        grounded = self._grounded(raw, info, env)
        try:
            if isinstance(grounded, Mapping):
                return self.model.state(grounded)
            return np.array(self.model.check_state(grounded))
        except (StateError, TypeError, ValueError) as error:
            raise TaskError(f"task {self.name}: grounding of {raw}: {error}") from None

    def perceived(self, raw: Any, info: Mapping[str, Any]) -> tuple[Vector, Vector]:
        """Return the flat observation and the state of what the environment has just returned."""
        return self.observation(raw), self.ground(raw, info, self.env)

    def _grounded(
        self, raw: Any, info: Mapping[str, Any] | None, env: gym.Env[Any, Any] | None
    ) -> Any:
        missing = self.grounding.missing(info, env)
        if missing:
            raise TaskError(
                f"task {self.name}: the grounding takes `{missing}` beside the observation; give "
                "it, too"
            )
        try:
            return self.grounding(raw, info, env)
        except Exception as error:
            raise TaskError(
                f"task {self.name}: the grounding failed on {raw}: {_short(error)}"
            ) from error

    def reset(self, seed: int | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment; return observation and info, or raise an EnvironmentFailure."""
        with self._calling("reset"):
            return reset_answer(self.env.reset(seed=seed))

    def environment_action(self, action: int) -> Any:
        """Return what the environment's `step` takes for an environment action 0 ... E-1."""
        return self._action_space.action(action)

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Execute an environment action 0 ... E-1.

        Returns:
            Observation, the environment's reward, terminated, truncated, info.

        Raises:
            EnvironmentFailure: The environment raised, or did not return these.
        """
        with self._calling(f"step with action {self.actions.name(action)}"):
            return step_answer(self.env.step(self.environment_action(action)))

    @contextlib.contextmanager
    def _calling(self, what: str) -> Iterator[None]:
        """Raise EnvironmentFailure for whatever a call of the environment raises."""
        try:
            yield
        except EnvironmentFailure as error:
            raise EnvironmentFailure(f"task {self.name}: {what} failed: {error}") from None
        except (Exception, SystemExit) as error:  # some exit when their window is closed
            raise EnvironmentFailure(f"task {self.name}: {what} failed: {_short(error)}") from error

    def close(self) -> None:
        """Close the environment."""
        with self._calling("closing the environment"):
            self.env.close()

    # State across episodes ---------------------------------------------------------------------

    @property
    def has_statistics(self) -> bool:
        """Whether a layer of the environment keeps running statistics."""
        return wrapper_state.has_statistics(self.env)

    def environment_state(self) -> dict[str, Any]:
        """Return what the layers of the environment keep across episodes, as JSON values."""
        try:
            saved = wrapper_state.save(self.env)
            json.dumps(saved)
        except Exception as error:
            raise EnvironmentFailure(
                f"task {self.name}: the environment's state_dict() failed, or does not consist of "
                f"JSON values: {_short(error)}"
            ) from error
        return saved

    def restore_environment(
        self, saved: Mapping[str, Any], *, statistics_only: bool = False
    ) -> None:
        """Restore what `environment_state` returned, or only the running statistics in it."""
        try:
            wrapper_state.restore(self.env, saved, statistics_only=statistics_only)
        except Exception as error:
            raise RunError(
                f"task {self.name}: the environment cannot restore its saved state: "
                f"{_short(error)}; continue with the environment it was saved with"
            ) from error


def _takes(function: Callable[..., Any], name: str) -> bool:
    """Return whether a function accepts a keyword argument, by its signature."""
    try:
        accepts = inspect.signature(function).parameters
    except ValueError:  # some callables written in C have no signature
        return True
    return name in accepts or any(p.kind is inspect.Parameter.VAR_KEYWORD for p in accepts.values())


def _short(error: BaseException) -> str:
    """Return the message of an error in user code, and the line that raised it."""
    message = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename != __file__]
    return f"{message} ({frames[-1].filename}:{frames[-1].lineno})" if frames else message
