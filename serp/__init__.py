"""From an expert's PDDL file to a safe, explained, trained policy.

The names below are the public interface; they are imported when first used, so that `import serp`
itself costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOMES = {
    "ActionMap": "serp.planning.action_map",
    "Arbiter": "serp.control.arbiter",
    "AdaptationSettings": "serp.settings",
    "ArbiterSettings": "serp.settings",
    "Comparison": "serp.compare.study",
    "DQN": "serp.learning.dqn",
    "LearnerSettings": "serp.settings",
    "Domain": "serp.model.loading",
    "DomainError": "serp.pddl.source",
    "GuideSettings": "serp.settings",
    "Lookahead": "serp.planning.lookahead",
    "MonitorReplanner": "serp.planning.replanner",
    "Outcome": "serp.model.transition_model",
    "Plan": "serp.planning.replanner",
    "PlannerSettings": "serp.settings",
    "Run": "serp.training.run",
    "SerpError": "serp.errors",
    "Settings": "serp.settings",
    "StateError": "serp.model.transition_model",
    "Symmetry": "serp.tasks.task_symmetry",
    "Task": "serp.tasks.task",
    "TrainingSettings": "serp.settings",
    "TransitionModel": "serp.model.transition_model",
    "compare": "serp.compare.study",
    "load_domain": "serp.model.loading",
    "load_run": "serp.training.run",
    "plan_and_learn": "serp.training.run",
}

__all__ = [*sorted(_HOMES), "__version__"]

if TYPE_CHECKING:
    from serp.compare.study import Comparison as Comparison
    from serp.compare.study import compare as compare
    from serp.control.arbiter import Arbiter as Arbiter
    from serp.errors import SerpError as SerpError
    from serp.learning.dqn import DQN as DQN
    from serp.model.loading import Domain as Domain
    from serp.model.loading import load_domain as load_domain
    from serp.model.transition_model import Outcome as Outcome
    from serp.model.transition_model import StateError as StateError
    from serp.model.transition_model import TransitionModel as TransitionModel
    from serp.pddl.source import DomainError as DomainError
    from serp.planning.action_map import ActionMap as ActionMap
    from serp.planning.lookahead import Lookahead as Lookahead
    from serp.planning.replanner import MonitorReplanner as MonitorReplanner
    from serp.planning.replanner import Plan as Plan
    from serp.settings import AdaptationSettings as AdaptationSettings
    from serp.settings import ArbiterSettings as ArbiterSettings
    from serp.settings import GuideSettings as GuideSettings
    from serp.settings import LearnerSettings as LearnerSettings
    from serp.settings import PlannerSettings as PlannerSettings
    from serp.settings import Settings as Settings
    from serp.settings import TrainingSettings as TrainingSettings
    from serp.tasks.task import Task as Task
    from serp.tasks.task_symmetry import Symmetry as Symmetry
    from serp.training.run import Run as Run
    from serp.training.run import load_run as load_run
    from serp.training.run import plan_and_learn as plan_and_learn


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module `serp` has no attribute `{name}`")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
