"""An exported policy decides as the run's does, without serp; damaged folders are refused."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import serp
from serp.control.decision import Decision
from serp.controller import Controller, ControllerDecision, ControllerError
from serp.controller.folder import read_folder
from serp.controller.lookahead import PathSearch, SearchLimits
from serp.controller.rows_lookahead import LayerSearch
from serp.controller.rows_step import AdaptedRows, FileRows
from serp.controller.step import AdaptedStep, FileStep
from serp.errors import RunError
from serp.export.planner_data import planner_data
from serp.planning.limits import Bound
from serp.planning.lookahead import Lookahead
from serp.training.evaluation import play
from serp.training.run import Run
from serp_adapters.cartpole import task as cartpole

STEPS = {"cartpole": 600, "soccer": 400, "cliff": 300}
AHEAD = {
    "arbiter": {"veto_horizon": "lookahead"},
    "adaptation": {"mode": "full"},
    "planner": {"repeat": 2},
}
"""The learner leads, the model is adapted, and the vetoes look ahead."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., tuple[Run, Path]]:
    """A short run of a task and preset, and its exported policy."""
    known: dict[tuple[str, str], tuple[Run, Path]] = {}

    def make(task: str, preset: str) -> tuple[Run, Path]:
        if (task, preset) not in known:
            folder = tmp_path_factory.mktemp("exported")
            settings = AHEAD if preset.endswith("ahead") else None
            run = serp.plan_and_learn(
                task, preset=preset.removesuffix(" ahead"), settings=settings, quiet=True,
                env_steps=STEPS[task], out=folder / "run",
            )  # fmt: skip
            known[task, preset] = run, serp.export_policy(run, folder / "policy")
        return known[task, preset]

    return make


Made = Callable[..., tuple[Run, Path]]


def is_same(mine: ControllerDecision, of_run: Decision) -> bool:
    return mine[:1] + mine[2:] == (
        of_run.action, str(of_run.reason), str(of_run.executed_by), of_run.proposed,
        str(of_run.proposed_by), of_run.vetoed,
    )  # fmt: skip


def test_ten_thousand_observations_of_cartpole_are_decided_as_by_the_run(made: Made) -> None:
    run, policy = made("cartpole", "paper ahead")
    controller, agent = Controller(policy, ground=lambda observation: observation), run.agent
    rng = np.random.default_rng(0)
    reasons = set()
    for observation in rng.normal(size=(10_000, 4)) * (1.0, 0.5, 0.05, 0.5):
        expected = agent.decide_greedily(observation, np.tile(observation, 2))
        found = controller.decide(observation)
        assert is_same(found, expected), (observation, found, expected)
        reasons.add(found.reason)
    unavoidable = "proposal predicted to make an unsafe step unavoidable"
    assert reasons > {"proposal accepted", unavoidable}


@pytest.mark.parametrize(
    ("task", "preset", "count"),
    [("cartpole", "default", 100), ("soccer", "paper", 200), ("soccer", "default", 10),
     ("cliff", "default", 200)],
)  # fmt: skip
def test_what_a_run_plays_is_decided_alike(task: str, preset: str, count: int, made: Made) -> None:
    run, policy = made(task, preset)
    controller = Controller(policy)
    with run.environment() as bound:
        for episode in play(run.agent, bound, episodes=count, seed=5):
            for step in episode.steps:
                observation = bound.observation(step.observation)
                found = controller.decide(observation, state=step.state)
                assert is_same(found, step.decision), (step.state, found, step.decision)
                count -= 1
                if count == 0:
                    return


@pytest.mark.parametrize("max_nodes", [3, 40, 10_000])
def test_both_searches_are_those_of_serp_also_where_a_budget_ends_them(
    max_nodes: int, made: Made
) -> None:
    """With a residual, counted outcomes, and states far from the data."""
    run, policy = made("soccer", "default")
    contents, model = read_folder(policy), run.agent.arbiter.model
    settings = run.agent.settings.planner.replace(depth=3, max_nodes=max_nodes)
    compiled = Lookahead(model, settings)
    data, _ = planner_data(compiled, model, settings)
    limits, theta = SearchLimits.of(data, len(model.actions)), contents.arrays["written"].tolist()
    single = PathSearch(limits, AdaptedStep(contents, FileStep(contents, theta)).step)
    layers = LayerSearch(limits, AdaptedRows(contents, FileRows(contents, theta)).step)
    states = contents.arrays["grounding.state"]
    for state in [*states[::8], *(states[::8] * 1.5)]:
        of_serp = compiled.forecast(state)
        for search in (single, layers):
            found = search.forecast(state.tolist())
            assert found is not None and found.complete == (of_serp.bound is not Bound.NODES)
            for name in ("choice", "value", "path_risk", "safe_steps", "reward", "flags"):
                np.testing.assert_array_equal(getattr(found, name), getattr(of_serp, name))


def test_the_folder_needs_numpy_and_onnxruntime_alone(made: Made) -> None:
    _, policy = made("cartpole", "paper ahead")
    code = (
        "import sys; from controller import Controller; c = Controller('.');"
        "d = c.decide([0.0, 0.0, 0.05, 0.1], state=[0.0, 0.0, 0.05, 0.1]); print(d.name);"
        "sys.exit(bool({'serp', 'numba', 'torch', 'onnx', 'gymnasium'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", f"import sys; sys.path.insert(0, '.'); {code}"],
        cwd=policy, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout.strip()) == (0, "push-right"), done.stderr


def test_equal_runs_are_exported_to_equal_folders(made: Made, tmp_path: Path) -> None:
    run, policy = made("cartpole", "paper ahead")
    again = serp.export_policy(run, tmp_path / "again")
    files = sorted(file.relative_to(policy) for file in policy.rglob("*") if file.is_file())
    assert {Path("manifest.json"), Path("learner.onnx"), Path("controller/__init__.py")} < {*files}
    for file in files:
        assert (policy / file).read_bytes() == (again / file).read_bytes()


def test_a_grounding_is_checked_by_recorded_pairs(made: Made) -> None:
    controller = Controller(made("cartpole", "paper ahead")[1])
    assert controller.check_grounding(lambda observation: observation) > 1
    names = controller.fluents
    as_mapping = controller.check_grounding(
        lambda observation: dict(zip(names, observation, strict=True))
    )
    assert as_mapping > 1
    with pytest.raises(ControllerError, match="pair 0: `cart-velocity` is"):
        controller.check_grounding(lambda observation: observation * (1, -1, 1, 1))
    with pytest.raises(ControllerError, match="every fluent"):
        controller.check_grounding(lambda observation: {"pole-angle": 0.0})


def damaged(change: Callable[[Path], Any], good: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "policy"
    shutil.copytree(good, folder)
    change(folder)
    return folder


def rewrite(folder: Path, change: Callable[[Any], Any]) -> None:
    """Change the policy, and its digest with it."""
    import hashlib

    policy, manifest = folder / "policy.json", folder / "manifest.json"
    data = json.loads(policy.read_text())
    change(data)
    policy.write_text(json.dumps(data))
    about = json.loads(manifest.read_text())
    about["files"]["policy.json"] = hashlib.sha256(policy.read_bytes()).hexdigest()
    manifest.write_text(json.dumps(about))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: shutil.rmtree(f), "is not a folder"),
        (lambda f: (f / "manifest.json").unlink(), "manifest.json is missing"),
        (lambda f: (f / "manifest.json").write_text("{"), "manifest.json is not JSON"),
        (lambda f: (f / "manifest.json").write_text('{"format": 9}'), "has format 9"),
        (lambda f: (f / "learner.onnx").unlink(), "learner.onnx is missing"),
        (lambda f: (f / "learner.onnx").write_bytes(b"other"), "learner.onnx was changed"),
        (lambda f: (f / "arrays.npz").write_bytes((f / "arrays.npz").read_bytes()[:-9]),
         "arrays.npz was changed or truncated"),
        (lambda f: rewrite(f, lambda d: d.pop("planner")), "does not hold what"),
        (lambda f: rewrite(f, lambda d: d["programs"]["actions"].pop()), "lacks actions"),
        (lambda f: rewrite(f, lambda d: d["programs"]["drift"].insert(0, ["call", "exit"])),
         "no statement 'call'"),
        (lambda f: rewrite(f, lambda d: d["programs"]["drift"].insert(
            0, ["set", ["var", "__import__"], 1.0])), "no variable '__import__'"),
        (lambda f: rewrite(f, lambda d: d["programs"]["drift"].insert(
            0, ["set", ["at", "out", 99], 1.0])), "out has no entry 99"),
        (lambda f: rewrite(f, lambda d: d["programs"]["drift"].insert(
            0, ["set", ["at", "theta", 0], 1.0])), "cannot be changed"),
        (lambda f: rewrite(f, lambda d: d["actions"]["groups"].pop()), "actions .* damaged"),
    ],
)  # fmt: skip
def test_a_wrong_folder_is_refused(
    change: Callable[[Path], Any], message: str, made: Made, tmp_path: Path
) -> None:
    with pytest.raises(ControllerError, match=message):
        Controller(damaged(change, made("cartpole", "paper ahead")[1], tmp_path))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "give `state=`"),
        ({"state": [0.0] * 4}, "the learner sees the observation"),
        ({"state": [0.0] * 3, "observation": [0.0] * 4}, "a state has 4 numbers"),
        ({"state": [0.0] * 4, "observation": [0.0] * 5}, "an observation has 4 numbers"),
        ({"state": [np.nan] * 4, "observation": [0.0] * 4}, "NaN"),
    ],
)
def test_a_wrong_input_is_refused(given: dict[str, Any], message: str, made: Made) -> None:
    with pytest.raises(ControllerError, match=message):
        Controller(made("cartpole", "paper ahead")[1]).decide(**given)


def test_what_cannot_be_exported_is_refused(made: Made, tmp_path: Path) -> None:
    run, policy = made("cartpole", "paper ahead")
    with pytest.raises(RunError, match="not empty"):
        serp.export_policy(run, policy)
    with pytest.raises(RunError, match="lookahead\\+far-sight"):
        settings = {"planner": {"name": "lookahead+far-sight"}, "learner": {"learning_starts": 1}}
        other = serp.plan_and_learn(
            cartpole(), settings=settings, episodes=1, out=tmp_path / "run", quiet=True
        )
        serp.export_policy(other, tmp_path / "policy")
