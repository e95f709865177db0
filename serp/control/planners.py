"""The planners `far-sight` and `lookahead`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from serp.model.transition_model import TransitionModel
from serp.planning.far_sight.planner import FarSightPlanner
from serp.planning.lookahead import Lookahead
from serp.settings import PlannerSettings

if TYPE_CHECKING:
    from serp.control.protocols import Planner


def lookahead(model: TransitionModel, settings: PlannerSettings) -> Planner:
    """Return the planner that looks some steps ahead."""
    return Lookahead(model, settings)


def far_sight(model: TransitionModel, settings: PlannerSettings) -> Planner:
    """Return the planner that sees to the end of a finite task, and far in a continuous one."""
    return FarSightPlanner(model, settings)
