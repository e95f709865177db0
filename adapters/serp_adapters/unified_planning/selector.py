"""Our planner as an engine of unified-planning, for the operation mode `ActionSelector`.

Releases of unified-planning up to 1.3 do not have this mode. There the class is used by itself; it
has the methods of the mode. It is registered like `serp_adapters.unified_planning.engine`.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any
from warnings import warn

from unified_planning.engines import Engine
from unified_planning.exceptions import UPUsageError
from unified_planning.model import FNode, Problem
from unified_planning.plans import ActionInstance

from serp.errors import SerpError
from serp.planning.far_sight import FarSightPlanner
from serp.settings import PlannerSettings
from serp_adapters.unified_planning.conversion import ConvertedProblem
from serp_adapters.unified_planning.engine import OwnEngine

if find_spec("unified_planning.engines.mixins.action_selector") is not None:
    from unified_planning.engines.mixins.action_selector import ActionSelectorMixin
else:

    class ActionSelectorMixin:  # type: ignore[no-redef]
        """What unified-planning's class of this name does from the release after 1.3 on."""

        def __init__(self, problem: Problem) -> None:
            engine: Any = self
            if engine.skip_checks or engine.supports(problem.kind):
                return
            text = f"We cannot establish whether {engine.name} is able to handle this problem!"
            if engine.error_on_failed_checks:
                raise UPUsageError(text)
            warn(text, stacklevel=3)

        def get_action(self) -> ActionInstance:
            """Return the next action."""
            return self._get_action()  # type: ignore[attr-defined]

        def update(self, observation: Mapping[FNode, FNode]) -> None:
            """Tell that the action was executed, and which values were observed then."""
            self._update(observation)  # type: ignore[attr-defined]


class SErPSelector(OwnEngine, ActionSelectorMixin):  # type: ignore[misc]
    """Chooses one action after another, by what is observed.

    An observation tells the values of some fluents after the chosen action; the others are as the
    problem predicts. So an action that failed is noticed where its effects are observed.

    Args:
        problem: The problem.
        error_on_failed_checks: Whether a problem that is not supported is an error, or a warning.
    """

    named = "serp-selector"

    def __init__(self, problem: Problem, error_on_failed_checks: bool = True) -> None:
        Engine.__init__(self)
        self.error_on_failed_checks = error_on_failed_checks
        ActionSelectorMixin.__init__(self, problem)
        self._converted = ConvertedProblem(problem)
        model = self._converted.model
        if model.initial_state is None:
            raise SerpError("the initial value of a numeric fluent is not known")
        self._state = model.initial_state
        self._planner = FarSightPlanner(model, PlannerSettings())
        self._chosen = -1

    def _get_action(self) -> ActionInstance:
        self._chosen = self._planner.forecast(self._state).choice
        if self._chosen < 0:
            raise SerpError("no action is applicable")
        return self._converted.instance(self._chosen)

    def _update(self, observation: Mapping[FNode, FNode]) -> None:
        if self._chosen >= 0:
            self._state = self._converted.model.step(self._state, self._chosen).state
            self._chosen = -1
        self._state = self._converted.observed(self._state, observation)
