"""The declaration of a task: environment, domain, grounding and the map of actions."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import gymnasium as gym
from numpy.typing import NDArray

from serp.errors import TaskError
from serp.model.loading import Domain, load_domain
from serp.model.transition_model import TransitionModel
from serp.tasks.declared_symmetry import Symmetry
from serp.tasks.worlds.options import WorldOptions

if TYPE_CHECKING:
    from serp.planning.advice import Advise
    from serp.tasks.bound_task import BoundTask

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
        symmetries: Transformations that leave the task unchanged (`serp.Symmetry`); the learner
            uses them if `learner.symmetry` is set.
        world: The options of an environment that `serp.file_task` made of the file; None for any
            other. A run with them needs no task to be opened again.
        planners: Further planners by name, for the setting `planner.name`: a function (fluent →
            value) → name of a ground action, None for no advice; or another domain file,
            or a loaded domain.
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
    symmetries: Sequence[Symmetry] = ()
    world: WorldOptions | None = None
    planners: Mapping[str, Advise | str | Path | Domain] = field(default_factory=dict)
    draw: Draw | None = None
    counters: Sequence[str] = ()
    description: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.planners, Mapping):
            raise TaskError(
                "task: planners must be a mapping {name: function or domain file}, not "
                f"{self.planners!r}"
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
        """Return the task with all of its files loaded, those of its planners, too.

        So it is the same on another machine, and after an edit. The planners' files share the limit
        on the size of the task's own domain.

        Raises:
            DomainError: A file is missing or wrong.
            TaskError: `domain` or `problem` is not the name of a file.
        """
        domain = self.load()
        limit = domain.max_ground_schemas

        def of_planner(given: Advise | str | Path | Domain) -> Advise | Domain:
            if isinstance(given, str | os.PathLike):
                return load_domain(given, observed=True, max_ground_schemas=limit)
            if isinstance(given, Domain) and given.max_ground_schemas != limit:
                return dataclasses.replace(given, max_ground_schemas=limit)
            return given

        planners = {name: of_planner(given) for name, given in self.planners.items()}
        return dataclasses.replace(self, domain=domain, problem=None, planners=planners)

    def bind(self, *, render_mode: str | None = None) -> BoundTask:
        """Make an environment and check that it fits domain, grounding and actions.

        Raises:
            DomainError: The domain is wrong.
            TaskError: Environment, domain, grounding and actions do not fit together.
        """
        from serp.tasks.bound_task import BoundTask  # it imports this module

        return BoundTask(self, render_mode=render_mode)


def declared_reward(task: Task, model: TransitionModel) -> Literal["domain", "environment"]:
    """Return the source of the reward that a task or its domain declares."""
    return task.reward or ("domain" if model.rewarding else "environment")
