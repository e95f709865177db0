"""From an expert's PDDL file to a safe, explained, trained policy.

The names below are the public interface; they are imported when first used, so that `import serp`
itself costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOMES = {
    "ActionMap": "serp.actions",
    "Arbiter": "serp.arbiter",
    "ArbiterSettings": "serp.arbiter",
    "Comparison": "serp.comparison.study",
    "DQN": "serp.learning",
    "DQNSettings": "serp.learning",
    "Domain": "serp.domain.loading",
    "DomainError": "serp.domain.source",
    "GuideSettings": "serp.strategies.settings",
    "Lookahead": "serp.planning.lookahead",
    "MonitorReplanner": "serp.planning.replanner",
    "Outcome": "serp.domain.model",
    "Plan": "serp.planning.replanner",
    "PlannerSettings": "serp.planning.settings",
    "Run": "serp.run",
    "SerpError": "serp.errors",
    "Settings": "serp.settings",
    "StateError": "serp.domain.model",
    "Symmetry": "serp.symmetry",
    "Task": "serp.task",
    "TransitionModel": "serp.domain.model",
    "compare": "serp.comparison.study",
    "load_domain": "serp.domain.loading",
    "load_run": "serp.run",
    "plan_and_learn": "serp.run",
}

__all__ = [*sorted(_HOMES), "__version__"]

if TYPE_CHECKING:
    from serp.actions import ActionMap as ActionMap
    from serp.arbiter import Arbiter as Arbiter
    from serp.arbiter import ArbiterSettings as ArbiterSettings
    from serp.comparison.study import Comparison as Comparison
    from serp.comparison.study import compare as compare
    from serp.domain.loading import Domain as Domain
    from serp.domain.loading import load_domain as load_domain
    from serp.domain.model import Outcome as Outcome
    from serp.domain.model import StateError as StateError
    from serp.domain.model import TransitionModel as TransitionModel
    from serp.domain.source import DomainError as DomainError
    from serp.errors import SerpError as SerpError
    from serp.learning import DQN as DQN
    from serp.learning import DQNSettings as DQNSettings
    from serp.planning.lookahead import Lookahead as Lookahead
    from serp.planning.replanner import MonitorReplanner as MonitorReplanner
    from serp.planning.replanner import Plan as Plan
    from serp.planning.settings import PlannerSettings as PlannerSettings
    from serp.run import Run as Run
    from serp.run import load_run as load_run
    from serp.run import plan_and_learn as plan_and_learn
    from serp.settings import Settings as Settings
    from serp.strategies.settings import GuideSettings as GuideSettings
    from serp.symmetry import Symmetry as Symmetry
    from serp.task import Task as Task


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module `serp` has no attribute `{name}`")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
