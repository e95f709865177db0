"""The algorithms that can be compared, external ones of other libraries included."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib.metadata import EntryPoint
from typing import Any, Final, Literal, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from serp._util.plugins import find, first_line, loading, offered
from serp.agent.registry import find_strategy, strategy_names
from serp.errors import SettingsError
from serp.settings import Changes, Settings, resolve
from serp.tasks.task import Source, Task

GROUP: Final = "serp.algorithms"
"""Entry-point group of external algorithms: functions of type `MakeExternalAlgorithm`."""


class ExternalAlgorithm(Protocol):
    """A learner of another library, with its environment.

    Attributes:
        characteristics: Name → text, for the table of what differs.
    """

    characteristics: Mapping[str, str]

    def learn(self, env_steps: int) -> None:
        """Train for this number of env steps."""

    def act(self, inputs: NDArray[np.float32]) -> NDArray[np.int64]:
        """Return the greedy actions `[B]` for inputs `[B, F]`."""


MakeExternalAlgorithm = Callable[[gym.Env[Any, Any], str, int], ExternalAlgorithm]
"""(environment with flat observations and discrete actions, name of the task, seed) → algorithm."""

Kind = Literal["guided", "baseline", "planner", "external"]

SERP: Final = "serp"
PLANNER: Final = "mrp"
"""The algorithm that is only the planner."""
DQN: Final = "dqn"
"""The algorithm that is only the learner: the baseline."""


@dataclass(frozen=True)
class Algorithm:
    """One algorithm.

    Attributes:
        name: Its name.
        description: One line.
        kind: `guided`: planner, learner and vetoes. `baseline`: serp's learner without planner and
            veto. `planner`: the planner without a learner. `external`: of another library.
        preset: Preset of its settings.
        changes: Its changes to the preset.
        make_external: Makes an external algorithm; None for others.
    """

    name: str
    description: str
    kind: Kind
    preset: str = "default"
    changes: Changes = field(default_factory=dict)
    make_external: MakeExternalAlgorithm | None = None

    def changed(self, name: str, changes: Changes) -> Algorithm:
        """Return the algorithm with some settings changed, under a new name."""
        if self.kind == "external":
            raise SettingsError(f"`{self.name}` has no settings that serp could change")
        return replace(self, name=name, changes=merged(self.changes, changes))

    def settings(self, task: Task, changes: Changes) -> Settings:
        """Return its settings on a task; its own changes override those of the user."""
        settings = resolve(self.preset, task.settings, merged(changes, self.changes))
        if settings.training.num_envs > 1:
            raise SettingsError(
                f"training.num_envs is {settings.training.num_envs}, but a comparison steps one "
                "environment in each trial; leave it out: trials run at the same time"
            )
        return settings

    @property
    def uses_model(self) -> bool:
        """Whether its results depend on the domain file."""
        return self.kind in ("guided", "planner")


_NO_GUIDE: Final[Changes] = {
    "guide": {"strategy": "mixture"},  # whose planner does not influence the learner
}
_BASELINE: Final[Changes] = {**_NO_GUIDE, "adaptation": {"mode": "off"}}
"""A baseline uses no model, so none adapts."""

_OWN: Final = (
    Algorithm("serp", "preset default", "guided"),
    Algorithm(
        "serp-paper", "preset paper: Algorithm 1 and section 4 to the letter", "guided", "paper"
    ),
    Algorithm(
        "mrp",
        "the planner alone (monitor-replanning)",
        "planner",
        changes={
            "arbiter": {
                "rho": 0.0,
                "rho_increment": 0.0,
            },
            "learner": {"updates_per_step": 0.0, "members": 1},
            "training": {"random_steps": 0},
            **_NO_GUIDE,
        },
    ),
    Algorithm(
        "dqn",
        "the learner of preset default alone, more exploration: no planner, no veto",
        "baseline",
        changes={**_BASELINE, "learner": {"epsilon_start": 1.0}},
    ),
    Algorithm(
        "dqn-paper",
        "the learner of preset paper alone: no planner, no veto",
        "baseline",
        "paper",
        changes=_BASELINE,
    ),
)

OWN: Final[Mapping[str, Algorithm]] = {algorithm.name: algorithm for algorithm in _OWN}
"""The algorithms of this library, by name."""


def algorithm_entries() -> dict[str, EntryPoint]:
    """Return the installed external algorithms by name, without importing them."""
    return offered(GROUP)


def find_algorithm(name: str) -> Algorithm:
    """Return the algorithm of a name."""
    if name in OWN:
        return OWN[name]
    entry = find(algorithm_entries(), name, "algorithm", SettingsError, known=OWN)
    with loading(entry, "algorithm", SettingsError):
        make = entry.load()
    return Algorithm(name, first_line(make) or name, "external", make_external=make)


def merged(first: Changes, second: Changes) -> Changes:
    """Return both; where they differ, the second applies."""
    return {
        section: {**first.get(section, {}), **second.get(section, {})}
        for section in {**first, **second}
    }


REWARDS: Final[Mapping[Source, str]] = {
    "domain": "rewards of the domain file",
    "environment": "reward of the environment",
    "sum": "reward of the environment plus those of the domain file",
}
_NOT_OF_TRAINING: Final = (
    "env_steps",
    "checkpoint_seconds",
    "tensorboard",
)
"""Settings that a comparison does not read."""


def characteristics_of(algorithm: Algorithm, settings: Settings, source: Source) -> dict[str, str]:
    """Return the characteristics of one of serp's algorithms: name → text."""
    learns, plans = algorithm.kind != "planner", algorithm.kind != "baseline"
    acting = {"planner": "planner", "baseline": "learner"}
    return {
        "learner": f"DQN, preset {algorithm.preset}" if learns else "none",
        "learned from": REWARDS[source] if learns else "none",
        "planner": settings.planner.name if plans else "none",
        "who acts": acting.get(algorithm.kind, settings.guide.strategy),
        "vetoes": "by the domain file" if plans else "none",
    }


def settings_in_use(algorithm: Algorithm, settings: Settings) -> dict[str, dict[str, Any]] | None:
    """Return section → setting → JSON value of what an algorithm reads; None if it is external."""
    if algorithm.kind == "external":
        return None
    said = settings.as_dict()
    for name in _NOT_OF_TRAINING:
        del said["training"][name]
    if algorithm.kind == "baseline":
        return {name: said[name] for name in ("learner", "training")}
    if algorithm.kind == "planner":
        return {name: said[name] for name in ("planner", "adaptation")}
    own = find_strategy(settings.guide.strategy).reads
    for strategy in map(find_strategy, strategy_names()):
        for setting in set(strategy.reads).difference(own):
            section, _, name = setting.partition(".")
            said[section].pop(name, None)
    return said
