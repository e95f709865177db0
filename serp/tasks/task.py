"""The declaration of a task: environment, domain, grounding, actions, and who gives the rewards."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import gymnasium as gym
from numpy.typing import NDArray

from serp.errors import SettingsError, TaskError
from serp.model.domain import Domain, load_domain
from serp.model.transition_model import StateError, Vector
from serp.tasks.environment import BoundTask

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

    Without settings nothing is learned from the steps: the reward is the environment's.

    Raises:
        SettingsError: The domain's rewards are to be learned from, but it gives none.
    """

    def __init__(self, task: BoundTask, settings: Settings | None = None) -> None:
        own: Source = "environment"
        self.source = own if settings is None else reward_source(task.rewarded_by, settings)
        self._model = task.model
        if self.source != "environment" and not task.model.rewarding:
            raise SettingsError(
                f"training.reward is {self.source}, but the domain of task {task.name} gives no "
                "reward; write `(increase (reward) ...)` in an action or event, or "
                "set training.reward=environment"
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
        learners: Further learners by name, for the setting `learner.name`: a function with the
            arguments of `serp.learning.dqn.DQN`, which returns a learner.
        draw: Draws a state, for `serp studio`: fluent → value, and returned an `svg` element as
            text. Colours may be the page's, such as `var(--ink)`, which is light in the dark.
        counters: Counters of the environment's info, per episode, that a comparison adds up.
        description: One line for `serp list`.
        code: `FILE.py:FUNCTION` where `--task` named that, the file in full; a run records it.
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
    learners: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    draw: Draw | None = None
    counters: Sequence[str] = ()
    description: str = ""
    code: str = ""

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
        """Return the task with its files loaded: the same on another machine, and after an edit."""
        return dataclasses.replace(self, domain=self.load(), problem=None)

    def bind(self, *, render_mode: str | None = None) -> BoundTask:
        """Make an environment and check that it fits domain, grounding and actions.

        Raises:
            DomainError: The domain is wrong.
            TaskError: Environment, domain, grounding and actions do not fit together.
        """
        return BoundTask(self, render_mode=render_mode)
