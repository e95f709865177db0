"""The transition model of an agent, as written and as adapted, as JSON values and arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from serp.adaptation import parameter_buffer as b
from serp.adaptation.adapted_model import AdaptedModel, same_arguments
from serp.adaptation.outcomes import table_kernels as c
from serp.adaptation.residual.parameters import RegressionParameters
from serp.export.syntax_data import programs_of
from serp.model.transition_model import TransitionModel, Vector

Arrays = dict[str, NDArray[Any]]


def model_data(model: TransitionModel) -> tuple[dict[str, Any], Arrays]:
    """Return what `serp.controller.step` reads of a model."""
    adapted = model if isinstance(model, AdaptedModel) else None
    written = model if adapted is None else adapted.written
    data: dict[str, Any] = {
        "fluents": [fluent.name for fluent in model.fluents],
        "ground_actions": [action.name for action in model.actions],
        "dt": model.dt,
        "programs": programs_of(model.ground),
        "adaptation": None,
    }
    arrays: Arrays = {"written": np.array(written.theta)}
    if adapted is not None and adapted.buffer.active:
        data["adaptation"], more = _adaptation(adapted)
        arrays |= more
    return data, arrays


def _adaptation(model: AdaptedModel) -> tuple[dict[str, Any], Arrays]:
    buffer = model.buffer
    arrays: Arrays = {
        "theta": buffer.parameters.copy(),
        "others": same_arguments(model.actions),
    }
    places = {id(regression): k for k, regression in enumerate(buffer.regressions.values())}
    groups = {group.key: group for of_action in model.feature_groups for group in of_action}
    regressions = []
    for k, (roles, regression) in enumerate(buffer.regressions.items()):
        of_roles = next(group for key, group in groups.items() if key[1:] == roles)
        regressions.append(_shape(regression) | {"bits": list(of_roles.bits)})
        arrays |= _named(f"regression{k}.", _weights(regression))
    tables: list[dict[str, Any]] = []
    place_of_table: dict[object, int] = {}
    for key, shared in buffer.shared.items():
        if shared.outcomes is not None:
            place_of_table[key] = len(tables)
            data, parts = _counts(shared.outcomes)
            data["inputs"] = len(groups[key].inputs)
            arrays |= _named(f"table{len(tables)}.", parts)
            tables.append(data)
    actions = []
    for of_action in model.feature_groups:
        described = []
        for group in of_action:
            shared = buffer.shared[group.key]
            found = shared.regression
            described.append({
                "inputs": list(group.inputs),
                "targets": list(group.targets),
                "regression": None if found is None else places[id(found)],
                "head": shared.head,
                "table": place_of_table.get(group.key),
            })  # fmt: skip
        actions.append(described)
    return {
        "revised": buffer.revised,
        "flagging": bool(buffer.array[b.FLAGGING]),
        "stochastic": buffer.stochastic,
        "regressions": regressions,
        "tables": tables,
        "actions": actions,
    }, arrays


def _shape(regression: RegressionParameters) -> dict[str, Any]:
    return {
        "depth": regression.depth,
        "count": regression.count,
        "heads": regression.heads,
        "known": regression.known,
    }


def _weights(regression: RegressionParameters) -> Arrays:
    modes = slice(regression.heads, regression.heads + regression.modes)
    names = ("kinds", "linear", "amplitude", "centre", "shrink", "frequency", "phase", "inverse")
    return {"codes": regression.codes[modes].copy()} | {
        name: getattr(regression, name).copy() for name in names
    }


def _counts(table: Vector) -> tuple[dict[str, Any], Arrays]:
    """Return the outcome counts of one table, see `serp.adaptation.outcomes.table_kernels`."""
    kinds, rows, columns = (int(table[k]) for k in (c.T_KINDS, c.T_ROWS, c.T_COLUMNS))

    def part(start: int, *shape: int) -> NDArray[Any]:
        return table[int(table[start]) :][: int(np.prod(shape))].reshape(shape).copy()

    data = {
        "places": part(c.T_PLACES, columns).astype(int).tolist(),
        "context": part(c.T_CONTEXT, int(table[c.T_COUNT])).astype(int).tolist(),
        "predicates": int(table[c.T_PREDICATES]),
    }
    return data, {
        "schemas": part(c.T_SCHEMAS, kinds),
        "changes": part(c.T_CHANGES, kinds, columns),
        "ranges": part(c.T_RANGES, columns, 2),
        "counts": part(c.T_COUNTS, rows, c.KINDS)[:, :kinds],
        "totals": part(c.T_TOTALS, rows),
        "trust": part(c.T_TRUST, c.LEVELS, c.EXPERTS),
        "evidence": part(c.T_EVIDENCE, rows, c.EXPERTS),
        "paths": part(c.T_PATHS, 2),
        "codes": part(c.T_CODES, rows),
    }


def _named(prefix: str, arrays: Arrays) -> Arrays:
    return {prefix + name: array for name, array in arrays.items()}
