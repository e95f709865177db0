"""Export of a run's trained policy to a folder that a robot without serp decides by."""

from __future__ import annotations

import ast
import contextlib
import hashlib
import io
import itertools
import json
import math
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from serp import __version__
from serp._util.files import cannot_write, json_text, write_together
from serp.agent.agent import Agent
from serp.agent.evidence import Evidence
from serp.agent.strategy import Strategy
from serp.agent.veto import VetoPolicy
from serp.errors import RunError
from serp.learning.dqn import DQN
from serp.model.codegen import Part, generate_code
from serp.model.ground import GroundModel
from serp.model.learned import outcome_table as c
from serp.model.learned import parameter_buffer as b
from serp.model.learned.adapted_model import AdaptedModel, same_arguments
from serp.model.learned.residual_features import RegressionParameters
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.edges import edge_budget, lookahead_nodes
from serp.planning.far_sight import FarSightPlanner
from serp.planning.lookahead import Lookahead
from serp.runs.controller.folder import ARRAYS, FORMAT, MANIFEST, NETWORK, POLICY
from serp.runs.evaluation import Episode, play
from serp.runs.run import Run, load_run
from serp.settings import PlannerSettings
from serp.tasks.task import BoundTask

_SYMBOLS: Final[dict[type, str]] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.BitOr: "|", ast.BitAnd: "&",
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
    ast.USub: "neg", ast.Not: "not", ast.And: "and", ast.Or: "or",
}  # fmt: skip


def programs_of(ground: GroundModel) -> dict[str, Any]:
    """Return the statements of every action, of the processes, and of what comes after them."""
    return {
        "actions": [_statements(ground, "action", k) for k in range(len(ground.actions))],
        "drift": _statements(ground, "drift"),
        "settle": _statements(ground, "settle"),
    }


def _statements(ground: GroundModel, part: Part, action: int = -1) -> list[Any]:
    (function,) = ast.parse(generate_code(ground, part, action).text).body
    assert isinstance(function, ast.FunctionDef)
    return _block(function.body)


def _block(statements: list[ast.stmt]) -> list[Any]:
    return [_statement(each) for each in statements if not isinstance(each, ast.Pass)]


def _statement(statement: ast.stmt) -> list[Any]:
    match statement:
        case ast.Assign([target], value):
            return ["set", _value(target), _value(value)]
        case ast.If(test, body, []):
            return ["when", _value(test), _block(body)]
        case ast.While(test, body, []):
            return ["while", _value(test), _block(body)]
        case ast.Return(value) if value is not None:
            return ["return", _value(value)]
    raise AssertionError(ast.dump(statement))


def _value(value: ast.expr) -> Any:
    match value:
        case ast.Constant(bool() | int() | float() as number):
            return ["inf"] if number == math.inf else number
        case ast.Name(name):
            return ["var", name]
        case ast.Subscript(ast.Name(array), ast.Constant(int(position))):
            return ["at", array, position]
        case ast.BinOp(left, operator, right):
            return [_SYMBOLS[type(operator)], _value(left), _value(right)]
        case ast.Compare(left, [operator], [right]):
            return [_SYMBOLS[type(operator)], _value(left), _value(right)]
        case ast.Call(ast.Name(function), operands):
            return [function, *map(_value, operands)]
        case ast.UnaryOp(operator, operand):
            return [_SYMBOLS[type(operator)], _value(operand)]
        case ast.BoolOp(operator, values):
            return [_SYMBOLS[type(operator)], *map(_value, values)]
        case ast.IfExp(test, body, orelse):
            return ["choose", _value(test), _value(body), _value(orelse)]
    raise AssertionError(ast.dump(value))


Arrays = dict[str, NDArray[Any]]


def model_data(model: TransitionModel) -> tuple[dict[str, Any], Arrays]:
    """Return what `serp.runs.controller.step` reads of a model."""
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
    """Return the outcome counts of one table, see `serp.model.learned.outcome_table`."""
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


def planner_data(
    planner: object, model: TransitionModel, settings: PlannerSettings
) -> tuple[dict[str, Any], Arrays]:
    """Return what `serp.runs.controller.planner` reads.

    Raises:
        RunError: The planner is not one that the controller has.
    """
    actions, fluents = len(model.actions), len(model.fluents)
    data: dict[str, Any] = {
        "depth": settings.depth,
        "discount": settings.discount,
        "accepted_risk": settings.accepted_risk,
        "max_nodes": lookahead_nodes(settings, actions, fluents),
        "max_edges": edge_budget(fluents),
        "solved": False,
        "cells": False,
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
    }


PACKAGE: Final = "controller"
"""The folder of the controller's modules within an exported folder."""
_STEPS, _PAIRS = 1_000, 32
"""Steps of an episode that is played before the export, and pairs recorded of them."""


def export_policy(run: Run | str | Path, folder: str | Path) -> Path:
    """Export the trained policy of a run, the policy `serp` of `Run.evaluate`.

    An episode is played first: the planner does what is due, and pairs of observation and state are
    recorded, with which a grounding can be checked. The folder holds the learner as ONNX, model,
    planner and vetoes as data, and the package `controller` that decides by them, which
    needs NumPy and onnxruntime alone.

    Args:
        run: The run, or its folder.
        folder: The new folder; it must not exist, or be empty.

    Returns:
        The folder.

    Raises:
        RunError: The folder is not empty, or the policy is one that the controller does not have.
        MissingExtra: onnx is not installed.
        SerpError: The run or its task cannot be loaded, or the environment failed.
    """
    folder = Path(folder)
    run = run if isinstance(run, Run) else load_run(run)
    _refuse_occupied(folder)
    agent = run.agent
    network = _network(agent)
    arbiter = _arbiter(agent)
    with run.environment() as task:
        policy, arrays = _policy(agent, task)
        policy["arbiter"] = arbiter
        about = _about(run, agent, task)
    files: dict[str, bytes] = {
        POLICY: json.dumps(policy, allow_nan=False, separators=(",", ":")).encode(),
        ARRAYS: _stored(arrays),
        NETWORK: network,
    }
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    manifest = json_text({"format": FORMAT, "serp": __version__, **about, "files": digests})
    package = Path(__file__).parent / PACKAGE
    contents: dict[Path, bytes | str] = {
        folder / PACKAGE / module.relative_to(package): module.read_bytes()
        for module in sorted(package.rglob("*.py"))
    }
    contents |= {folder / name: content for name, content in files.items()}
    contents[folder / MANIFEST] = manifest
    try:
        for path in contents:
            path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error, "Nothing was made.") from error
    write_together(contents)
    return folder


def _refuse_occupied(folder: Path) -> None:
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir())):
        raise RunError(f"{folder} exists and is not empty; give the name of a new folder")


def _network(agent: Agent) -> bytes:
    learner = agent.learner
    if type(learner) is not DQN:
        raise RunError(
            f"the run's learner is `{agent.settings.learner.name}`; only `dqn` can be exported"
        )
    return learner.as_onnx()


def _arbiter(agent: Agent) -> dict[str, Any]:
    vetoes, settings = agent.arbiter.vetoes, agent.settings.arbiter
    if type(vetoes) is not VetoPolicy:
        raise RunError("the run is of a baseline, which has no vetoes; the controller always has")
    return {
        "learner_leads": _learner_leads(agent),
        "r_min": settings.r_min,
        "looks_ahead": settings.veto_horizon == "lookahead" and vetoes.lookahead_reliable,
        "allows_unmodelled": settings.unmodelled == "allow",
    }


def _learner_leads(agent: Agent) -> bool:
    """Return who proposes: the learner, or the planner unless all plans are worth the same."""
    strategy = agent.strategy
    proposes = type(strategy).propose_greedily
    if proposes is Strategy.propose_greedily:
        return True
    if proposes is Evidence.propose_greedily:
        return strategy.rho > 0.5
    raise RunError(
        f"the run's strategy is `{agent.settings.guide.strategy}`, which has a rule of its own for "
        "the trained policy; evidence, mixture and strategies that let the learner propose can be "
        "exported"
    )


def _policy(agent: Agent, task: BoundTask) -> tuple[dict[str, Any], Arrays]:
    """Return what the controller reads, but for the vetoes, after an episode was played."""
    model, actions = agent.arbiter.model, agent.arbiter.actions
    policy, arrays = model_data(model)
    pairs = []
    played = cast("Generator[Episode]", play(agent, task, episodes=1))
    with contextlib.closing(played) as episodes:  # what the planner does for it is then undone
        for step in itertools.islice(next(episodes).steps, _STEPS):
            pairs.append((task.observation(step.observation), step.state.copy()))
        policy["planner"], more = planner_data(agent.arbiter.planner, model, agent.settings.planner)
    arrays |= more
    kept = np.linspace(0, len(pairs) - 1, min(_PAIRS, len(pairs))).astype(int)
    for k, name in enumerate(("observation", "state")):
        arrays[f"grounding.{name}"] = np.array([pairs[place][k] for place in kept])
    policy["actions"] = {
        "names": [actions.name(action) for action in range(actions.size)],
        "groups": actions.groups,
    }
    policy["learner"] = {
        "inputs": agent.settings.training.inputs,
        "input": agent.learner.input_size,
        "observation": task.observation_size,
    }
    return policy, arrays


def _about(run: Run, agent: Agent, task: BoundTask) -> dict[str, Any]:
    """Return what people and programs read of a policy."""
    return {
        "task": task.name,
        "policy": f"{agent.strategy.choice}, within the vetoes",
        "control_period": agent.arbiter.model.dt,
        "fluents": [
            {"name": fluent.name, "kind": "number" if fluent.numeric else "0 or 1"}
            for fluent in task.model.fluents
        ],
        "observation": [task.observations.name(k) for k in range(task.observation_size)],
        "learner_sees": agent.settings.training.inputs,
        "actions": [task.actions.name(action) for action in range(task.actions.size)],
        "settings": agent.settings.as_dict(),
    }


def _stored(arrays: Mapping[str, Any]) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()
