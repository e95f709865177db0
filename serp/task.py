"""A task: environment + domain + grounding + the map from ground actions to environment actions."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from serp.actions import ActionMap
from serp.domain.loading import Domain, load_domain
from serp.domain.model import StateError, TransitionModel, Vector
from serp.errors import EnvironmentFailure, RunError, TaskError

Grounded = Mapping[str, float | bool] | NDArray[Any]
Overrides = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, kw_only=True)
class Task:
    """Everything that serp needs to know about a task.

    Attributes:
        make_env: Returns a new Gymnasium environment with discrete actions; called with
            `render_mode=...` where a picture is wanted.
        domain: The domain file, or a loaded domain.
        ground: Observation → the value of every fluent, as a mapping (fluent name → number or
            truth value) or as an array in the order of `domain.model.fluents`.
        name: Name of the task; the domain's by default.
        problem: The problem file; by default `<name>-problem.pddl` beside the domain file.
        actions: Name of a ground action (or of a schema, for all its instances) → environment
            action. None: the n-th ground action is environment action n.
        dt: Control period in the time unit of the domain's rates, seconds by custom.
        reward: Whose reward the learner learns from: the `domain`'s R(s'), read off observed
            transitions, or the `environment`'s. None: the domain's where it says anything about
            reward.
        settings: Preset name → section → setting → value: what this task changes in the presets.
            The key `*` stands for every preset.
        description: One line for `serp list`.
    """

    make_env: Callable[..., gym.Env[Any, Any]]
    domain: str | Path | Domain
    ground: Callable[[Any], Grounded]
    name: str | None = None
    problem: str | Path | None = None
    actions: Mapping[str, int] | None = None
    dt: float = 1.0
    reward: Literal["domain", "environment"] | None = None
    settings: Mapping[str, Overrides] = field(default_factory=dict)
    description: str = ""

    def load(self) -> Domain:
        """Return the domain, loading it where a file was given.

        Raises:
            DomainError: The files are missing or wrong.
        """
        if isinstance(self.domain, Domain):
            return self.domain
        return load_domain(self.domain, self.problem)

    def bind(self, *, render_mode: str | None = None) -> BoundTask:
        """Make an environment and check that everything fits together.

        Raises:
            DomainError: The domain is wrong.
            TaskError: Environment, domain, grounding and actions do not fit together.
        """
        return BoundTask(self, render_mode=render_mode)


class BoundTask:
    """A task with an environment made, its domain loaded and its actions resolved.

    Attributes:
        task: The task.
        name: Its name.
        domain: The loaded domain.
        model: Its transition model, over the task's control period.
        env: The environment.
        actions: The map of actions.
        rewarded_by: `domain` or `environment`.
    """

    def __init__(self, task: Task, *, render_mode: str | None = None) -> None:
        self.task = task
        self.domain = task.load()
        self.name = task.name or self.domain.name
        if task.reward not in (None, "domain", "environment"):
            raise TaskError(
                f"task {self.name}: reward must be 'domain' or 'environment', not {task.reward!r}"
            )
        try:
            self.model: TransitionModel = self.domain.model.replace(dt=task.dt)
        except StateError as error:
            raise TaskError(f"task {self.name}: {error}") from None
        self.env = self._make_env(render_mode)
        space = getattr(self.env, "action_space", None)
        if not isinstance(space, spaces.Discrete):
            raise TaskError(
                f"task {self.name}: serp needs discrete actions, this environment has {space}; "
                "offer a few (macro-)actions through a wrapper"
            )
        self._first_action = int(space.start)
        self.actions = ActionMap(self.model, int(space.n), task.actions)
        self.observation_size = self._size_of(getattr(self.env, "observation_space", None))
        self._flatten_by_space = not isinstance(self.env.observation_space, spaces.Box)
        self.rewarded_by = task.reward or ("domain" if self.model.rewarding else "environment")
        if self.rewarded_by == "domain" and not self.model.rewarding:
            raise TaskError(
                f"task {self.name}: the domain says nothing about reward; let an action or event "
                "`(increase (reward) ...)`, or set reward='environment'"
            )

    def _make_env(self, render_mode: str | None) -> gym.Env[Any, Any]:
        if not callable(self.task.make_env):
            raise TaskError(
                f"task {self.name}: make_env must be a function that returns an environment, "
                f"not {self.task.make_env!r}"
            )
        if render_mode is not None and not _takes(self.task.make_env, "render_mode"):
            raise TaskError(f"task {self.name}: make_env takes no render_mode, so it cannot render")
        try:
            env = self.task.make_env(**({"render_mode": render_mode} if render_mode else {}))
        except Exception as error:
            raise EnvironmentFailure(
                f"task {self.name}: making the environment failed: {_short(error)}"
            ) from error
        if not isinstance(env, gym.Env):
            raise TaskError(f"task {self.name}: make_env returned {type(env).__name__}, no gym.Env")
        return env

    def _size_of(self, space: Any) -> int:
        try:
            flat = spaces.flatten_space(space)
        except NotImplementedError:
            flat = None
        if not isinstance(flat, spaces.Box):
            raise TaskError(
                f"task {self.name}: observations of {space} cannot be flattened to a vector"
            )
        return int(flat.shape[0])

    # The way of data through a step ------------------------------------------------------------

    def observation(self, raw: Any) -> NDArray[np.float64]:
        """Return an observation as a flat float64 vector.

        Raises:
            EnvironmentFailure: It is no member of the space, of another size than that, or holds
                NaN.
        """
        try:
            if self._flatten_by_space:
                flat = spaces.flatten(self.env.observation_space, raw)
            else:
                flat = raw
            vector = np.array(flat, dtype=np.float64).reshape(-1)  # environments reuse buffers
        except Exception as error:
            raise EnvironmentFailure(
                f"task {self.name}: an observation {raw!r} that does not fit "
                f"{self.env.observation_space}: {_short(error)}"
            ) from error
        if vector.shape[0] != self.observation_size:
            raise EnvironmentFailure(
                f"task {self.name}: an observation of {vector.shape[0]} numbers, the space "
                f"promises {self.observation_size}"
            )
        if not np.isfinite(vector).all():
            raise EnvironmentFailure(f"task {self.name}: observation with NaN or infinity: {raw}")
        return vector

    def ground(self, raw: Any) -> Vector:
        """Return the state `[F]` of an observation as the environment gave it.

        Raises:
            TaskError: The grounding raised, forgot a fluent, or gave NaN.
        """
        try:
            grounded = self.task.ground(raw)
        except Exception as error:
            raise TaskError(
                f"task {self.name}: the grounding failed on {raw}: {_short(error)}"
            ) from error
        try:
            if isinstance(grounded, Mapping):
                return self.model.state(grounded)
            return np.array(self.model.check_state(grounded))
        except (StateError, TypeError, ValueError) as error:
            raise TaskError(f"task {self.name}: grounding of {raw}: {error}") from None

    def reset(self, seed: int | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment.

        Raises:
            EnvironmentFailure: It raised, or returned something else than observation and info.
        """
        try:
            raw, info = self.env.reset(seed=seed)
            return raw, dict(info)
        except Exception as error:
            raise EnvironmentFailure(f"task {self.name}: reset failed: {_short(error)}") from error

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Carry out an environment action 0 ... E-1.

        Returns:
            Observation, the environment's reward, terminated, truncated, info.

        Raises:
            EnvironmentFailure: The environment raised, returned something else than five values,
                or gave a reward that is no number.
        """
        try:
            raw, reward, terminated, truncated, info = self.env.step(self._first_action + action)
            number = float(reward)
            ended, cut = bool(terminated), bool(truncated)
            info = dict(info)
        except Exception as error:
            raise EnvironmentFailure(
                f"task {self.name}: step with action {self.actions.name(action)} failed: "
                f"{_short(error)}"
            ) from error
        if number - number != 0.0:
            raise EnvironmentFailure(f"task {self.name}: the environment's reward is {number}")
        return raw, number, ended, cut, info

    def close(self) -> None:
        """Close the environment.

        Raises:
            EnvironmentFailure: It raised.
        """
        try:
            self.env.close()
        except Exception as error:
            raise EnvironmentFailure(
                f"task {self.name}: closing the environment failed: {_short(error)}"
            ) from error

    # What outlives a reset ---------------------------------------------------------------------

    def environment_state(self) -> list[Any]:
        """Return what the environment and its wrappers carry from one episode to the next.

        An entry for every layer, from the outermost wrapper to the environment, that offers
        `state_dict()` and `load_state_dict(state)`.

        Raises:
            EnvironmentFailure: A layer raised, or its state is not made of JSON values.
        """
        try:
            states = [layer.state_dict() for layer in self._stateful_layers()]
            json.dumps(states)
        except Exception as error:
            raise EnvironmentFailure(
                f"task {self.name}: the environment's state_dict() failed, or is not made of JSON "
                f"values: {_short(error)}"
            ) from error
        return states

    def restore_environment(self, states: Sequence[Any]) -> None:
        """Restore what `environment_state` returned.

        Raises:
            RunError: This environment cannot take it over.
        """
        layers = self._stateful_layers()
        if len(layers) != len(states):
            raise RunError(
                f"task {self.name}: the saved environment has {len(states)} layers with a state, "
                f"this one {len(layers)}; continue with the environment it was saved with"
            )
        try:
            for layer, state in zip(layers, states, strict=True):
                layer.load_state_dict(state)
        except Exception as error:
            raise RunError(
                f"task {self.name}: the environment cannot take over its saved state: "
                f"{_short(error)}"
            ) from error

    def _stateful_layers(self) -> list[Any]:
        layers: list[Any] = [self.env]
        while isinstance(layers[-1], gym.Wrapper):
            layers.append(layers[-1].env)
        # A wrapper passes unknown attributes on, so what counts is what its own class offers.
        names = ("state_dict", "load_state_dict")
        return [layer for layer in layers if all(hasattr(type(layer), name) for name in names)]


def _takes(function: Callable[..., Any], name: str) -> bool:
    """Whether a function takes a keyword argument, as far as it says."""
    try:
        accepts = inspect.signature(function).parameters
    except ValueError:  # some callables that are written in C
        return True
    return name in accepts or any(p.kind is inspect.Parameter.VAR_KEYWORD for p in accepts.values())


def _short(error: Exception) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
