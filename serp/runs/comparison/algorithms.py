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
from serp.agent.registry import STRATEGIES, find_strategy
from serp.errors import SettingsError
from serp.planning.plan_follower import Advise
from serp.settings import Changes, Settings, assigned, resolve
from serp.tasks.registry import custom_function
from serp.tasks.task import Task

GROUP: Final = "serp.algorithms"
"""Entry-point group of external algorithms: functions of type `MakeExternalAlgorithm`."""


class ExternalAlgorithm(Protocol):
    """A learner of another library, with its environment.

    One that has `first_update`, the env steps until its first update, is refused with less budget.
    One that has `masked = True`, as has what makes it, is called `act(inputs, masks)`: `[B, E]` the
    actions that it may choose. In training, `ExternalEnv.action_masks` returns them.
    """

    def learn(self, env_steps: int) -> None:
        """Train for this number of env steps."""

    def act(self, inputs: NDArray[np.float32]) -> NDArray[np.int64]:
        """Return the greedy actions `[B]` for inputs `[B, F]`."""


MakeExternalAlgorithm = Callable[[gym.Env[Any, Any], str, int], ExternalAlgorithm]
"""(environment with flat observations and discrete actions, name of the task, seed) → algorithm."""

PLANNER: Final = "mrp"
DQN: Final = "dqn"
BASELINE: Final = "baseline="
"""Begins the name of an algorithm that is a controller of the user's."""


@dataclass(frozen=True)
class Algorithm:
    """One algorithm, with the preset of its settings and its changes to that.

    `guided`: planner, learner and vetoes. `baseline`: serp's learner without planner and veto.
    `planner`: the planner without a learner. `external`: of another library.
    """

    name: str
    description: str
    kind: Literal["guided", "baseline", "planner", "external"]
    preset: str = "default"
    changes: Changes = field(default_factory=dict)
    domain: str = ""  # name of its domain file; empty for the task's own
    make_external: MakeExternalAlgorithm | None = None
    advise: Advise | None = None  # a controller of the user's, in place of the planner

    def changed(self, name: str, changes: Changes) -> Algorithm:
        """Return the algorithm with some settings changed, under a new name."""
        if self.kind == "external":
            raise SettingsError(f"`{self.name}` has no settings that serp could change")
        both = {
            section: {**self.changes.get(section, {}), **changes.get(section, {})}
            for section in {**self.changes, **changes}
        }
        return replace(self, name=name, changes=both)

    def settings(self, task: Task, changes: Changes) -> Settings:
        """Return its settings on a task; its own changes override those of the user.

        A trial steps one environment, because trials run at the same time.
        """
        settings = resolve(self.preset, task.settings, changes).replace(self.changes)
        return settings.replace({"training": {"num_envs": 1}})


def _baseline(name: str, description: str, preset: str) -> Algorithm:
    """Return a learner alone: its strategy has no influence on it, and it uses no model."""
    changes: Changes = {"guide": {"strategy": "mixture"}, "adaptation": {"mode": "off"}}
    return Algorithm(name, f"{description}; no planner, no vetoes", "baseline", preset, changes)


OWN: Final[Mapping[str, Algorithm]] = {
    algorithm.name: algorithm
    for algorithm in (
        Algorithm("serp", "preset default", "guided"),
        Algorithm("serp-paper", "preset paper", "guided", "paper"),
        Algorithm(
            PLANNER,
            "the planner alone (monitor-replanning)",
            "planner",
            changes={
                "arbiter": {"rho": 0.0, "rho_increment": 0.0},
                "learner": {"updates_per_step": 0.0, "members": 1},
                "training": {"random_steps": 0},
                "guide": {"strategy": "mixture"},
            },
        ),
        _baseline(DQN, "only the learner of preset `default`, with more exploration", "default"),
        _baseline("dqn-paper", "only the learner of preset `paper`", "paper"),
    )
}
"""The algorithms of this library, by name."""


def given(name: str) -> str:
    """Return what an algorithm is given beside observations and rewards."""
    if name.startswith(BASELINE):
        return "your controller, domain file"
    base = name.partition(":")[0].partition("@")[0]
    kind = OWN[base].kind if base in OWN else "guided" if base in offered(STRATEGIES) else ""
    if base in algorithm_entries() and getattr(find_algorithm(base).make_external, "masked", False):
        return "the actions that the domain file allows"
    return {"guided": "domain file, the planner's steps", "planner": "domain file"}.get(kind, "–")


def algorithm_entries() -> dict[str, EntryPoint]:
    """Return the installed external algorithms by name, without importing them."""
    return offered(GROUP)


def find_algorithm(name: str) -> Algorithm:
    """Return the algorithm of a name, or raise a SettingsError or a TaskError.

    `serp:learner.members=1` is `serp` with a setting changed; several changes are separated by
    semicolons. `serp@cartpole-reversed` is `serp` with another domain file.
    `baseline=FILE.py:FUNCTION` is a controller of the user's, a function as in `Task.planners`.
    """
    if name.startswith(BASELINE):
        advise = custom_function(name.removeprefix(BASELINE), f"--{name}")
        own: Changes = {"planner": {"name": name}}
        alone = OWN[PLANNER].changed(name, own)
        return replace(alone, description=first_line(advise) or "your controller", advise=advise)
    known, colon, text = name.partition(":")
    base, at, domain = known.partition("@")
    if base in OWN:
        algorithm = OWN[base]
    elif base in offered(STRATEGIES):
        by: Changes = {"guide": {"strategy": base}}
        algorithm = Algorithm(base, first_line(find_strategy(base)), "guided", changes=by)
    else:
        more, every = [*OWN, *offered(STRATEGIES)], "\n  `serp list` names all."
        entries = algorithm_entries()
        entry = find(entries, base, "algorithm", SettingsError, known=more, advice=every)
        with loading(entry, "algorithm", SettingsError):
            make = entry.load()
        algorithm = Algorithm(base, first_line(make) or base, "external", make_external=make)
    if at:
        if not domain or algorithm.kind not in ("guided", "planner"):
            raise SettingsError(f"`{name}`: NAME@FILE needs a file, and an algorithm that uses it")
        algorithm = replace(algorithm, name=name, domain=domain)
    return algorithm.changed(name, assigned(text.split(";"))) if colon else algorithm
