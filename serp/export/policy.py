"""Export of a run's trained policy to a folder that a robot without serp decides by."""

from __future__ import annotations

import contextlib
import hashlib
import io
import itertools
import json
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Any, Final, cast

import numpy as np

from serp import __version__
from serp._util.files import cannot_write, write_together
from serp._util.json_files import json_text
from serp.control.strategies.evidence import Evidence
from serp.control.strategies.strategy import Strategy
from serp.control.veto import VetoPolicy
from serp.controller.folder import ARRAYS, FORMAT, MANIFEST, NETWORK, POLICY
from serp.errors import RunError
from serp.export.model_data import Arrays, model_data
from serp.export.planner_data import planner_data
from serp.learning.dqn import DQN
from serp.tasks.bound_task import BoundTask
from serp.training.agent import Agent
from serp.training.evaluation import Episode, play
from serp.training.run import Run, load_run

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
    package = Path(__file__).parent.parent / PACKAGE
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
