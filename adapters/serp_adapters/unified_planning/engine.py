"""Our planner as an engine of unified-planning, for the operation mode `OneshotPlanner`.

It is registered with one line::

    get_environment().factory.add_engine(
        "serp", "serp_adapters.unified_planning.engine", "SErPEngine"
    )
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from typing import Any, ClassVar, Final

from unified_planning.engines import (
    Credits,
    Engine,
    LogMessage,
    PlanGenerationResult,
    PlanGenerationResultStatus,
    SequentialPlanValidator,
)
from unified_planning.engines.mixins import OneshotPlannerMixin
from unified_planning.engines.mixins.oneshot_planner import OptimalityGuarantee
from unified_planning.engines.results import LogLevel
from unified_planning.model import Problem, ProblemKind
from unified_planning.plans import SequentialPlan

from serp.pddl.source import DomainError
from serp_adapters.unified_planning.conversion import ConvertedProblem
from serp_adapters.unified_planning.search import find_plan

_FEATURES: Final = {
    "set_problem_class": ["ACTION_BASED"],
    "set_problem_type": ["SIMPLE_NUMERIC_PLANNING", "GENERAL_NUMERIC_PLANNING"],
    "set_numbers": ["BOUNDED_TYPES"],
    "set_typing": ["FLAT_TYPING", "HIERARCHICAL_TYPING"],
    "set_fluents_type": ["INT_FLUENTS", "REAL_FLUENTS", "OBJECT_FLUENTS"],
    "set_constraints_kind": ["STATE_INVARIANTS"],
    "set_conditions_kind": [
        "NEGATIVE_CONDITIONS",
        "DISJUNCTIVE_CONDITIONS",
        "EQUALITIES",
        "EXISTENTIAL_CONDITIONS",
        "UNIVERSAL_CONDITIONS",
    ],
    "set_effects_kind": [
        "CONDITIONAL_EFFECTS",
        "INCREASE_EFFECTS",
        "DECREASE_EFFECTS",
        "FORALL_EFFECTS",
        "STATIC_FLUENTS_IN_BOOLEAN_ASSIGNMENTS",
        "STATIC_FLUENTS_IN_NUMERIC_ASSIGNMENTS",
        "STATIC_FLUENTS_IN_OBJECT_ASSIGNMENTS",
        "FLUENTS_IN_BOOLEAN_ASSIGNMENTS",
        "FLUENTS_IN_NUMERIC_ASSIGNMENTS",
        "FLUENTS_IN_OBJECT_ASSIGNMENTS",
    ],
    "set_quality_metrics": ["ACTIONS_COST", "PLAN_LENGTH", "FINAL_VALUE"],
    "set_actions_cost_kind": [
        "STATIC_FLUENTS_IN_ACTIONS_COST",
        "FLUENTS_IN_ACTIONS_COST",
        "INT_NUMBERS_IN_ACTIONS_COST",
        "REAL_NUMBERS_IN_ACTIONS_COST",
    ],
}
_CREDITS: Final = Credits(
    "SErP",
    "the SErP authors",
    "",
    "https://doi.org/10.1007/978-3-030-98682-7_9",
    "MIT",
    "Closed planning graphs and best-first width search on compiled PDDL models.",
    "SErP (Sample Efficient robot Policies) plans on a closed graph of all reachable states where "
    "that is small, else in the neighbourhood of a plan that a best-first width search finds.",
)


class OwnEngine(Engine):  # type: ignore[misc]
    """What all engines of ours tell unified-planning of themselves.

    Attributes:
        named: The name of the engine.
    """

    named: ClassVar[str]

    @property
    def name(self) -> str:
        """The name of the engine."""
        return self.named

    @staticmethod
    def supported_kind() -> ProblemKind:
        """Return the kind of problems that is supported."""
        kind = ProblemKind(version=2)
        for method, features in _FEATURES.items():
            for feature in features:
                getattr(kind, method)(feature)
        return kind

    @staticmethod
    def supports(problem_kind: ProblemKind) -> bool:
        """Return whether problems of a kind are supported."""
        return bool(problem_kind <= OwnEngine.supported_kind())

    @staticmethod
    def get_credits(**kwargs: object) -> Credits:
        """Return who wrote the engine."""
        return _CREDITS


class SErPEngine(OwnEngine, OneshotPlannerMixin):  # type: ignore[misc]
    """Plans to the goal of a classical or numeric problem.

    Plans are checked by unified-planning's own validator, which computes exactly. A problem is
    called unsolvable only if everything that can be reached was seen, with exact numbers.
    """

    named = "serp"

    def __init__(self, **params: object) -> None:
        Engine.__init__(self)
        OneshotPlannerMixin.__init__(self)
        if params:
            raise TypeError(f"the engine `serp` has no parameters, found {', '.join(params)}")

    @staticmethod
    def satisfies(optimality_guarantee: OptimalityGuarantee) -> bool:
        """Return whether plans have a guarantee."""
        return bool(optimality_guarantee == OptimalityGuarantee.SATISFICING)

    def _solve(
        self,
        problem: Problem,
        heuristic: Callable[[Any], float | None] | None = None,
        timeout: float | None = None,
        output_stream: Any = None,
    ) -> PlanGenerationResult:
        for what, given in (("heuristic", heuristic), ("output_stream", output_stream)):
            if given is not None:
                warnings.warn(f"the engine `serp` does not use `{what}`", UserWarning, stacklevel=2)
        deadline = math.inf if timeout is None else time.monotonic() + timeout
        status = PlanGenerationResultStatus
        try:
            converted = ConvertedProblem(problem)
        except DomainError as error:
            return self._result(status.UNSUPPORTED_PROBLEM, None, str(error))
        state = converted.model.initial_state
        if state is None:
            text = "the initial value of a numeric fluent is not known"
            return self._result(status.UNSUPPORTED_PROBLEM, None, text)
        found = find_plan(converted.model, state, deadline)
        if found.plan is None:
            if found.late:
                return self._result(status.TIMEOUT, None)
            proven = status.UNSOLVABLE_PROVEN if found.proven else status.UNSOLVABLE_INCOMPLETELY
            return self._result(proven, None)
        plan = SequentialPlan([converted.instance(k) for k in found.plan], problem.environment)
        if not SequentialPlanValidator().validate(problem, plan):
            text = "the plan that was found does not hold with exact numbers"
            return self._result(status.UNSOLVABLE_INCOMPLETELY, None, text)
        return self._result(status.SOLVED_SATISFICING, plan)

    def _result(
        self, status: PlanGenerationResultStatus, plan: SequentialPlan | None, text: str = ""
    ) -> PlanGenerationResult:
        messages = [LogMessage(LogLevel.INFO, text)] if text else []
        return PlanGenerationResult(status, plan, self.name, log_messages=messages)
