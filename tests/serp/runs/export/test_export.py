"""An exported policy decides as the run's does, without serp; damaged folders are refused."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import serp
from serp.agent.decision import Decision
from serp.errors import RunError
from serp.planning.edges import Bound
from serp.planning.lookahead import Lookahead
from serp.runs.controller import Controller, ControllerDecision, ControllerError
from serp.runs.controller.adaptation import Adaptation
from serp.runs.controller.folder import read_folder
from serp.runs.controller.lookahead import PathSearch, SearchLimits
from serp.runs.controller.reading import Arrays, Entry
from serp.runs.controller.rows.lookahead import LayerSearch
from serp.runs.controller.rows.step import AdaptedRows, FileRows
from serp.runs.controller.step import AdaptedStep, FileStep
from serp.runs.evaluation import play
from serp.runs.policy_export import planner_data
from serp.runs.run import Run
from serp_adapters.cartpole import task as cartpole
from tests.serp.runs.runs import without_pictures

STEPS = {"cartpole": 600, "soccer": 400, "cliff": 300}
INDICES = ("others", "schemas", "kinds", "regression0.codes", "inert", "choice")
"""Arrays of positions."""
AHEAD = {
    "arbiter": {"veto_horizon": "lookahead"},
    "adaptation": {"mode": "full"},
}
"""The learner leads, the model is adapted, and the vetoes look ahead."""


@without_pictures()
def trained(*arguments: Any, **options: Any) -> Run:
    return serp.plan_and_learn(*arguments, quiet=True, **options)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., tuple[Run, Path]]:
    """A short run of a task and preset, and its exported policy."""
    known: dict[tuple[str, str], tuple[Run, Path]] = {}

    def make(task: str, preset: str) -> tuple[Run, Path]:
        if (task, preset) not in known:
            folder = tmp_path_factory.mktemp("exported")
            settings = AHEAD if preset.endswith("ahead") else None
            run = trained(
                task, preset=preset.removesuffix(" ahead"), settings=settings,
                env_steps=STEPS[task], out=folder / "run",
            )  # fmt: skip
            known[task, preset] = run, serp.export_policy(run, folder / "policy")
        return known[task, preset]

    return make


Made = Callable[..., tuple[Run, Path]]


def is_same(mine: ControllerDecision, of_run: Decision) -> bool:
    return mine[:1] + mine[2:7] == (
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


@pytest.mark.parametrize(
    ("task", "max_nodes"), [("soccer", 3), ("soccer", 40), ("soccer", 10_000), ("cliff", 10_000)]
)
def test_both_searches_are_those_of_serp_also_where_a_budget_ends_them(
    task: str, max_nodes: int, made: Made
) -> None:
    """With a residual, counted outcomes of both kinds, and states far from the data."""
    run, policy = made(task, "default")
    contents, model = read_folder(policy), run.agent.arbiter.model
    settings = run.agent.settings.planner.replace(depth=3, max_nodes=max_nodes)
    compiled = Lookahead(model, settings)
    data, _ = planner_data(compiled, model, settings)
    entry, theta = Entry(contents.policy), contents.arrays["written"].tolist()
    limits = SearchLimits.of(Entry(data), len(model.actions))
    learned = Adaptation(
        entry["adaptation"], Arrays(contents.arrays), len(model.fluents), len(model.actions)
    )
    single = PathSearch(limits, AdaptedStep(entry, learned, FileStep(entry, theta)).step)
    layers = LayerSearch(limits, AdaptedRows(entry, learned, FileRows(entry, theta)).step)
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


def test_a_decision_tells_states_that_were_not_solved(made: Made) -> None:
    controller = Controller(made("cliff", "default")[1])
    states = read_folder(made("cliff", "default")[1]).arrays["solved.states"]
    observation = np.zeros(48)
    assert not any(controller.decide(observation, state=s).outside for s in states[:9])
    assert controller.decide(observation, state=states[0] + 0.5).outside
    cartpole = Controller(made("cartpole", "paper ahead")[1])
    assert not cartpole.decide([0.0] * 4, state=[0.0] * 4).outside  # nothing was solved


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
        (lambda f: rewrite(f, lambda d: d.pop("planner")), "policy.json: planner is missing"),
        (lambda f: rewrite(f, lambda d: d["programs"]["actions"].pop()),
         "programs.actions is .*: it must have 2 entries"),
        (lambda f: rewrite(f, lambda d: d["programs"]["drift"].insert(0, ["call", "exit"])),
         "no statement 'call'"),
        (lambda f: rewrite(f, lambda d: d["programs"]["drift"].insert(
            0, ["set", ["var", "__import__"], 1.0])), "no variable '__import__'"),
        (lambda f: rewrite(f, lambda d: d["programs"]["drift"].insert(
            0, ["set", ["at", "out", 99], 1.0])), "out has no entry 99"),
        (lambda f: rewrite(f, lambda d: d["programs"]["drift"].insert(
            0, ["set", ["at", "theta", 0], 1.0])), "cannot be changed"),
        (lambda f: rewrite(f, lambda d: d["planner"].update(discount=10**400)),
         "planner.discount is .*: it must be a finite number"),
        (lambda f: rewrite(f, lambda d: d["actions"]["groups"].pop()),
         "actions.groups is .*: it must have 2 entries"),
    ],
)  # fmt: skip
def test_a_wrong_folder_is_refused(
    change: Callable[[Path], Any], message: str, made: Made, tmp_path: Path
) -> None:
    with pytest.raises(ControllerError, match=message):
        Controller(damaged(change, made("cartpole", "paper ahead")[1], tmp_path))


def positions_in(value: Any, place: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield the places of all whole numbers of a policy outside of its programs, and of its lists.

    Each comes with the list or object that it is in, and its key there.
    """
    for key, each in value.items() if isinstance(value, dict) else enumerate(value):
        name = f"{place}[{key}]" if isinstance(value, list) else f"{place}.{key}".lstrip(".")
        if type(each) is int or isinstance(each, list):
            yield name, value, key
        if isinstance(each, (dict, list)) and key != "programs":
            yield from positions_in(each, name)


@given(data=st.data())
@settings(max_examples=50, deadline=None, derandomize=True)
@pytest.mark.parametrize("task", ["soccer", "cliff"])
def test_any_wrong_position_or_shape_is_refused_by_its_name(
    task: str, made: Made, data: st.DataObject
) -> None:
    good = read_folder(made(task, "default")[1])
    policy, arrays = json.loads(json.dumps(good.policy)), dict(good.arrays)
    if data.draw(st.booleans()):
        name, holder, key = data.draw(st.sampled_from(list(positions_in(policy))))
        wrong = [None, -1, 0.5, "0", {"0": 0}]
        if isinstance(holder, list):
            wrong.append(1_000)
        if isinstance(holder[key], list):
            wrong.append([*holder[key], -1])
        holder[key] = data.draw(st.sampled_from(wrong))
        # null stands for no regression and no table
        assume(holder[key] is not None or key not in ("regression", "table"))
        file = "policy.json"
    else:
        name = data.draw(st.sampled_from(sorted(arrays)))
        array, file = arrays[name], "arrays.npz"
        kinds = ["missing", "flat", "longer", "text"] + ["position"] * name.endswith(INDICES)
        kind = data.draw(st.sampled_from(kinds))
        if kind == "missing":
            del arrays[name]
        elif kind == "position":
            assume(array.size)
            array = array.copy()
            wrong = [-2, 1_000_000, *([0.5] if array.dtype == np.float64 else [])]
            place = data.draw(st.integers(0, array.size - 1))
            array.flat[place] = data.draw(st.sampled_from(wrong))
            arrays[name] = array
        elif kind == "longer":
            more = [array, array[:1], array[:1]]
            arrays[name] = np.concatenate(more) if array.size else array[None]
        else:
            arrays[name] = array[None] if kind == "flat" else array.astype(str)
    contents = good._replace(policy=policy, arrays=arrays)
    read = mock.patch("serp.runs.controller.controller.read_folder", lambda _: contents)
    with read, pytest.raises(ControllerError, match=file):
        Controller("policy")


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
        other = trained(cartpole(), settings=settings, episodes=1, out=tmp_path / "run")
        serp.export_policy(other, tmp_path / "policy")
