"""The planner of an agent as JSON values and arrays: settings, solved states, cells."""

from __future__ import annotations

from typing import Any

import numpy as np

from serp.errors import RunError
from serp.export.model_data import Arrays
from serp.model.transition_model import TransitionModel
from serp.planning.far_sight.planner import FarSightPlanner
from serp.planning.limits import edge_budget, lookahead_nodes
from serp.planning.lookahead import Lookahead
from serp.settings import PlannerSettings


def planner_data(
    planner: object, model: TransitionModel, settings: PlannerSettings
) -> tuple[dict[str, Any], Arrays]:
    """Return what `serp.controller.planner` reads.

    Raises:
        RunError: The planner is not one that the controller has.
    """
    actions, fluents = len(model.actions), len(model.fluents)
    data: dict[str, Any] = {
        "depth": settings.depth,
        "repeat": settings.repeat,
        "discount": settings.discount,
        "accepted_risk": settings.accepted_risk,
        "max_nodes": lookahead_nodes(settings, actions, fluents),
        "max_edges": edge_budget(fluents),
        "solved": False,
        "cells": False,
        "favoured": False,
    }
    arrays: Arrays = {}
    if type(planner) is FarSightPlanner:
        data |= _far_sight(planner, arrays)
    elif type(planner) is not Lookahead or planner.settings != settings:
        raise RunError(
            f"the run's planner is `{settings.name}`; the planners that can be exported are "
            "far-sight and lookahead. Train with one of these: --set planner.name=lookahead"
        )
    return data, arrays


def _far_sight(planner: FarSightPlanner, arrays: Arrays) -> dict[str, bool]:
    """Add the solved states and the cells to the arrays; return which are there."""
    if planner.cells.explores:
        raise RunError(
            "the run's planner still explores: it values what is unknown by hope, which the "
            "controller does not. Train longer, or export a run with --set planner.name=lookahead"
        )
    solved = planner.graph.table()
    if len(solved["states"]):
        arrays |= {f"solved.{name}": array for name, array in solved.items()}
    cells = planner.cells.values.state_dict()
    if len(cells["value"]):
        arrays |= {f"cells.{name}": np.array(array) for name, array in cells.items()}
    return {
        "solved": bool(len(solved["states"])),
        "cells": bool(len(cells["value"])),
        "favoured": planner.favours_cells,
    }
