"""From an expert's PDDL file to a safe, explained, trained policy.

The names below are the public interface. Each is imported when it is first used, so that `import
serp` itself costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0.dev0"

_HOMES = {
    "ActionMap": "serp.planning.action_map",
    "AdaptationSettings": "serp.settings",
    "Arbiter": "serp.control.arbiter",
    "ArbiterSettings": "serp.settings",
    "Comparison": "serp.comparison.compare",
    "DQN": "serp.learning.dqn",
    "Decision": "serp.control.decision",
    "Diagnosis": "serp.diagnosis.diagnosis",
    "Domain": "serp.model.loading",
    "DomainError": "serp.pddl.source",
    "EvaluationResult": "serp.training.evaluation",
    "Forecast": "serp.planning.forecast",
    "GuideSettings": "serp.settings",
    "Learner": "serp.control.protocols",
    "LearnerSettings": "serp.settings",
    "Lookahead": "serp.planning.lookahead",
    "MonitorReplanner": "serp.planning.replanner",
    "NoVeto": "serp.control.veto",
    "Outcome": "serp.model.transition_model",
    "Plan": "serp.planning.replanner",
    "Planner": "serp.control.protocols",
    "PlannerSettings": "serp.settings",
    "PlanningGraph": "serp.planning.graph",
    "Proposal": "serp.learning.dqn",
    "Repaired": "serp.diagnosis.repair.repair",
    "Run": "serp.training.run",
    "RunError": "serp.errors",
    "SerpError": "serp.errors",
    "Settings": "serp.settings",
    "SettingsError": "serp.errors",
    "Situation": "serp.control.strategies.strategy",
    "StateError": "serp.model.transition_model",
    "StepRecord": "serp.control.step_record",
    "Strategy": "serp.control.strategies.strategy",
    "Symmetry": "serp.tasks.declared_symmetry",
    "Task": "serp.tasks.task",
    "TaskError": "serp.errors",
    "TrainingSettings": "serp.settings",
    "TransitionModel": "serp.model.transition_model",
    "VetoPolicy": "serp.control.veto",
    "compare": "serp.comparison.compare",
    "diagnose": "serp.diagnosis.diagnosis",
    "load_domain": "serp.model.loading",
    "load_run": "serp.training.run",
    "load_task": "serp.tasks.registry",
    "plan_and_learn": "serp.training.plan_and_learn",
    "repair": "serp.diagnosis.repair.repair",
}

__all__ = [*sorted(_HOMES), "__version__"]

if TYPE_CHECKING:
    from serp.comparison.compare import Comparison as Comparison
    from serp.comparison.compare import compare as compare
    from serp.control.arbiter import Arbiter as Arbiter
    from serp.control.decision import Decision as Decision
    from serp.control.protocols import Learner as Learner
    from serp.control.protocols import Planner as Planner
    from serp.control.step_record import StepRecord as StepRecord
    from serp.control.strategies.strategy import Situation as Situation
    from serp.control.strategies.strategy import Strategy as Strategy
    from serp.control.veto import NoVeto as NoVeto
    from serp.control.veto import VetoPolicy as VetoPolicy
    from serp.diagnosis.diagnosis import Diagnosis as Diagnosis
    from serp.diagnosis.diagnosis import diagnose as diagnose
    from serp.diagnosis.repair.repair import Repaired as Repaired
    from serp.diagnosis.repair.repair import repair as repair
    from serp.errors import RunError as RunError
    from serp.errors import SerpError as SerpError
    from serp.errors import SettingsError as SettingsError
    from serp.errors import TaskError as TaskError
    from serp.learning.dqn import DQN as DQN
    from serp.learning.dqn import Proposal as Proposal
    from serp.model.loading import Domain as Domain
    from serp.model.loading import load_domain as load_domain
    from serp.model.transition_model import Outcome as Outcome
    from serp.model.transition_model import StateError as StateError
    from serp.model.transition_model import TransitionModel as TransitionModel
    from serp.pddl.source import DomainError as DomainError
    from serp.planning.action_map import ActionMap as ActionMap
    from serp.planning.forecast import Forecast as Forecast
    from serp.planning.graph import PlanningGraph as PlanningGraph
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
    from serp.tasks.declared_symmetry import Symmetry as Symmetry
    from serp.tasks.registry import load_task as load_task
    from serp.tasks.task import Task as Task
    from serp.training.evaluation import EvaluationResult as EvaluationResult
    from serp.training.plan_and_learn import plan_and_learn as plan_and_learn
    from serp.training.run import Run as Run
    from serp.training.run import load_run as load_run


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module `serp` has no attribute `{name}`")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
