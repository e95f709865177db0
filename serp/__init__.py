"""From an expert's PDDL file to a safe, explained, trained policy.

The names below are the public interface. Each is imported when it is first used, so that `import
serp` itself costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0.dev0"

_HOMES = {
    "Arbiter": "serp.agent.arbiter",
    "Domain": "serp.model.domain",
    "DomainError": "serp.pddl.source",
    "GuardedEnv": "serp.runs.guarded_env",
    "Lookahead": "serp.planning.lookahead",
    "MonitorReplanner": "serp.planning.replanner",
    "PlanFollower": "serp.planning.plan_follower",
    "Policy": "serp.runs.policy",
    "Proposal": "serp.learning.dqn",
    "Recording": "serp.runs.recording",
    "Run": "serp.runs.run",
    "RunError": "serp.errors",
    "SerpError": "serp.errors",
    "Settings": "serp.settings",
    "SettingsError": "serp.errors",
    "Strategy": "serp.agent.strategy",
    "Task": "serp.tasks.task",
    "TaskError": "serp.errors",
    "TransitionModel": "serp.model.transition_model",
    "compare": "serp.runs.comparison.compare",
    "diagnose": "serp.runs.diagnosis.diagnosis",
    "export_policy": "serp.runs.policy",
    "file_task": "serp.tasks.file_world",
    "load_domain": "serp.model.domain",
    "load_run": "serp.runs.run",
    "load_task": "serp.tasks.registry",
    "plan_and_learn": "serp.runs.train",
    "repair": "serp.runs.diagnosis.repair",
    "tune": "serp.runs.tuning",
}
"""Public name → the module that defines it."""

__all__ = [*sorted(_HOMES), "__version__"]

if TYPE_CHECKING:
    from serp.agent.arbiter import Arbiter as Arbiter
    from serp.agent.strategy import Strategy as Strategy
    from serp.errors import RunError as RunError
    from serp.errors import SerpError as SerpError
    from serp.errors import SettingsError as SettingsError
    from serp.errors import TaskError as TaskError
    from serp.learning.dqn import Proposal as Proposal
    from serp.model.domain import Domain as Domain
    from serp.model.domain import load_domain as load_domain
    from serp.model.transition_model import TransitionModel as TransitionModel
    from serp.pddl.source import DomainError as DomainError
    from serp.planning.lookahead import Lookahead as Lookahead
    from serp.planning.plan_follower import PlanFollower as PlanFollower
    from serp.planning.replanner import MonitorReplanner as MonitorReplanner
    from serp.runs.comparison.compare import compare as compare
    from serp.runs.diagnosis.diagnosis import diagnose as diagnose
    from serp.runs.diagnosis.repair import repair as repair
    from serp.runs.guarded_env import GuardedEnv as GuardedEnv
    from serp.runs.policy import Policy as Policy
    from serp.runs.policy import export_policy as export_policy
    from serp.runs.recording import Recording as Recording
    from serp.runs.run import Run as Run
    from serp.runs.run import load_run as load_run
    from serp.runs.train import plan_and_learn as plan_and_learn
    from serp.runs.tuning import tune as tune
    from serp.settings import Settings as Settings
    from serp.tasks.file_world import file_task as file_task
    from serp.tasks.registry import load_task as load_task
    from serp.tasks.task import Task as Task


def __getattr__(name: str) -> Any:
    if name == "_core":
        return _compiled()
    if name not in _HOMES:
        raise AttributeError(f"module `serp` has no attribute `{name}`")
    return getattr(import_module(_HOMES[name]), name)


def _compiled() -> Any:
    """Return the compiled part, or raise a SerpError that says how to build it."""
    try:
        return import_module("serp._core")
    except ImportError as error:
        from serp.errors import SerpError

        missing = isinstance(error, ModuleNotFoundError)
        what = "is not built" if missing else f"cannot be loaded ({error})"
        raise SerpError(
            f"the compiled part of serp {what}; run `pip install -e .` in the checkout"
        ) from None


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
