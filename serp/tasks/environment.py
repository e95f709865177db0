"""The environment of a task: made, checked, stepped, and its observations grounded."""

from __future__ import annotations

import contextlib
import inspect
import json
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from serp._util.did_you_mean import listed
from serp._util.files import Closing
from serp._util.numbers import real
from serp._util.plugins import raised
from serp.errors import EnvironmentFailure, RunError, TaskError
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.tasks import wrapper_state
from serp.tasks.action_map import ActionMap
from serp.tasks.grounding import Grounding
from serp.tasks.spaces import ActionSpace, Observations, reset_answer, step_answer

if TYPE_CHECKING:
    from serp.tasks.task import Task


class BoundTask(Closing):
    """A task with an environment, its loaded domain and its resolved actions; a context manager.

    Attributes:
        action_space, observations: What the environment takes and gives.
        rewarded_by: The source of the reward that the task declares.
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
        task, dt = self.task, real(self.task.dt)
        functions = [
            isinstance(given, Mapping) and all(map(callable, given.values()))
            for given in (task.planners, task.learners)
        ]
        for right, name, allowed in (
            (isinstance(task.name, str | None), "name", "a text"),
            (callable(task.ground), "ground", "a function of an observation"),
            (callable(task.make_env), "make_env", "a function: lambda: gymnasium.make(...)"),
            (functions[0], "planners", "a mapping {name: function}"),
            (functions[1], "learners", "a mapping {name: function}"),
            (task.reward in (None, "domain", "environment"), "reward", "'domain' or 'environment'"),
            (dt is not None and dt > 0, "dt (the control period)", "a number > 0"),
        ):
            if not right:
                value = getattr(task, name.split()[0])
                raise TaskError(f"task {self.name}: {name} must be {allowed}, not {value!r}")

    def _check_environment(self) -> None:
        task = self.task
        try:
            self.action_space = ActionSpace(getattr(self.env, "action_space", None))
            self.observations = Observations(getattr(self.env, "observation_space", None))
        except ValueError as error:
            raise TaskError(f"task {self.name}: {error}") from None
        self.observation_size = self.observations.size
        sample = self._tried_grounding()
        if isinstance(sample, Mapping):  # observed fluents are not constant, even if in :init
            self.domain = self.domain.observed(map(str, sample))
            self.model = self.domain.model.replace(dt=self.model.dt)
        try:
            self.actions = ActionMap(self.model, self.action_space.size, self._numbered_actions())
        except TaskError as error:
            raise TaskError(f"task {self.name}, {self.domain.source.name}: {error}") from None
        self.rewarded_by = task.reward or ("domain" if self.model.rewarding else "environment")
        if self.rewarded_by == "domain" and not self.model.rewarding:
            raise TaskError(
                f"task {self.name}: the domain says nothing about reward; write `(increase "
                "(reward) ...)` in an action or event, or set reward='environment'"
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
                numbered[name] = self.action_space.number(action)
            except ValueError as error:
                raise TaskError(f"actions: `{name}` is mapped to {action!r}: {error}") from None
        return numbered

    def _tried_grounding(self) -> Any:
        """Return what the grounding gives on a sample, or on a reset if it takes more; or None."""
        if self.grounding.takes:
            return self._grounded(*self.reset(seed=0), self.env)
        return next(self.grounding.on_samples(self.observations.space, 8), None)

    def _make_env(self, render_mode: str | None) -> gym.Env[Any, Any]:
        if render_mode is not None and self.task.world is not None:
            raise TaskError(
                f"task {self.name}: a world made from a file has no pictures; `serp why` shows "
                "its steps"
            )
        if render_mode is not None and not takes(self.task.make_env, "render_mode"):
            raise TaskError(
                f"task {self.name}: make_env takes no render_mode, so nothing can be drawn; let it "
                "take one and pass it on, as `lambda **options: gymnasium.make(..., **options)` "
                "does"
            )
        try:
            env = self.task.make_env(**({"render_mode": render_mode} if render_mode else {}))
        except Exception as error:
            raise EnvironmentFailure(
                f"task {self.name}: make_env failed: {raised(error)}"
            ) from error
        if not isinstance(env, gym.Env):
            raise TaskError(
                f"task {self.name}: make_env returned {type(env).__name__}, not a gymnasium.Env"
            )
        return env

    @property
    def time_limited(self) -> bool:
        """Whether Gymnasium's `TimeLimit`, or what has its attribute, ends long episodes."""
        return self.env.has_wrapper_attr("_max_episode_steps")

    def observation(self, raw: Any) -> NDArray[np.float64]:
        """Return an observation as a flat float64 vector, or raise an EnvironmentFailure."""
        try:
            return self.observations.read(raw)
        except ValueError as error:
            raise EnvironmentFailure(f"task {self.name}: the observation: {error}") from None

    def ground(
        self, raw: Any, info: Mapping[str, Any] | None = None, env: gym.Env[Any, Any] | None = None
    ) -> Vector:
        """Return the state `[F]` of an observation, given info and environment if they are needed.

        Raises:
            TaskError: The grounding failed, or does not give the value of every fluent.
        """
        grounded = self._grounded(raw, info, env)
        try:
            return self.state(grounded)
        except (StateError, TypeError, ValueError) as error:
            raise TaskError(f"task {self.name}: grounding of {raw}: {error}") from None

    def state(self, given: Any) -> Vector:
        """Return the state `[F]` that a mapping from every fluent, or an array, gives, checked."""
        if isinstance(given, Mapping):
            return self.model.state(given)
        return np.array(self.model.check_state(given))

    def perceived(self, raw: Any, info: Mapping[str, Any]) -> tuple[Vector, Vector]:
        """Return the flat observation and the state of what the environment has just returned."""
        return self.observation(raw), self.ground(raw, info, self.env)

    def _grounded(
        self, raw: Any, info: Mapping[str, Any] | None, env: gym.Env[Any, Any] | None
    ) -> Any:
        try:
            return self.grounding(raw, info, env)
        except TaskError as error:
            raise TaskError(f"task {self.name}: {error}") from None
        except Exception as error:
            keys = f"; info has {listed(info or ()) or 'no keys'}" * isinstance(error, KeyError)
            raise TaskError(
                f"task {self.name}: the grounding failed on {raw}: {raised(error)}{keys}"
            ) from error

    def reset(self, seed: int | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment; return observation and info, or raise an EnvironmentFailure."""
        with self._calling("reset"):
            for what, before in (
                ("action_space", self.action_space.space),
                ("observation_space", self.observations.space),
            ):
                now = getattr(self.env, what)
                if now is not before and now != before:
                    raise EnvironmentFailure(
                        f"the environment's {what} was {before} and now is {now}; spaces must "
                        "not change, so make one environment for each"
                    )
            return reset_answer(self.env.reset(seed=seed))

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Execute an action 0 ... E-1; return observation, reward, terminated, truncated, info.

        Raises:
            EnvironmentFailure: The environment raised, or did not return these.
        """
        try:  # in place of the context, which takes as long as all the rest
            return step_answer(self.env.step(self.action_space.action(action)))
        except BaseException as error:
            with self._calling(f"step with action {self.actions.name(action)}"):
                raise error

    @contextlib.contextmanager
    def _calling(self, what: str) -> Iterator[None]:
        """Raise EnvironmentFailure for whatever a call of the environment raises."""
        try:
            yield
        except EnvironmentFailure as error:
            raise EnvironmentFailure(f"task {self.name}: {what} failed: {error}") from None
        except (Exception, SystemExit) as error:  # some exit when their window is closed
            said = raised(error)
            if "values to unpack (expected 5" in said:  # by a wrapper of Gymnasium
                said += "; it must return observation, reward, terminated, truncated, info"
            raise EnvironmentFailure(f"task {self.name}: {what} failed: {said}") from error

    def close(self) -> None:
        """Close the environment."""
        with self._calling("closing the environment"):
            self.env.close()

    def environment_state(self) -> dict[str, Any]:
        """Return what the layers of the environment keep across episodes, as JSON values."""
        try:
            saved = wrapper_state.save(self.env)
            json.dumps(saved)
        except Exception as error:
            raise EnvironmentFailure(
                f"task {self.name}: the environment's state_dict() failed, or does not consist of "
                f"JSON values: {raised(error)}"
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
                f"{raised(error)}; continue with the original environment"
            ) from error


def takes(function: Callable[..., Any], name: str) -> bool:
    """Return whether a function accepts a keyword argument, by its signature."""
    try:
        accepts = inspect.signature(function).parameters
    except ValueError:  # some callables written in C have no signature
        return True
    return name in accepts or any(p.kind is inspect.Parameter.VAR_KEYWORD for p in accepts.values())
