"""A run on the disk: what it holds, what it is read back as, and what is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.wrappers import NormalizeObservation, TimeLimit

from serp.errors import RunError, SerpError, SettingsError, TaskError
from serp.model.domain import load_domain
from serp.runs.diagnosis.diagnosis import read_recorded
from serp.runs.folder import RunFolder
from serp.runs.run import Run, load_run, read_run_metadata
from serp.runs.train import plan_and_learn
from serp.settings import resolve
from serp.tasks.task import Task
from tests.serp.runs.runs import everything, resume, train, without_pictures
from tests.serp.sample_tasks import Corridor, corridor, corridor_file


class Plain(Corridor):
    """Nothing outlives its reset, so nothing of it has to be saved."""

    def reset(self, **options: Any) -> Any:
        self.clock = 0
        self.weather = np.random.default_rng(5)
        return super().reset(**options)


def test_an_evaluation_sees_what_the_learner_learned_to_see(tmp_path: Path) -> None:
    """The grounding undoes the normalisation with nothing but `info`."""
    counts: list[float] = []

    class Seen(NormalizeObservation):  # type: ignore[type-arg]
        def reset(self, **options: Any) -> Any:
            counts.append(self.obs_rms.count)
            return super().reset(**options)

    def task(wrapper: Any) -> Task:
        return corridor(
            tmp_path,
            lambda: wrapper(TimeLimit(Plain(), 9)),
            ground=lambda seen: {"x": round(float(seen[0]), 1)},
        )

    run = train(task(NormalizeObservation), tmp_path / "run", episodes=6)
    load_run(run.path, task(Seen)).evaluate(episodes=1)
    steps = run.metrics["env_steps"][-1]
    assert counts == [pytest.approx(steps + 6, abs=1)]  # each reset counts as well


def test_a_run_of_a_domain_beyond_the_usual_limit_goes_on_within_its_own(tmp_path: Path) -> None:
    domain = load_domain(corridor_file(tmp_path), max_ground_schemas=9)
    train(corridor(tmp_path, domain=domain), tmp_path / "run", episodes=2)
    resume(corridor(tmp_path), tmp_path / "run", episodes=3)
    assert read_run_metadata(RunFolder.open(tmp_path / "run")).max_ground_schemas == 9
    assert read_recorded(tmp_path / "run").domain.max_ground_schemas == 9


def test_a_run_is_an_option_that_ends_where_its_file_does(tmp_path: Path) -> None:
    """It decides as the run does, and what it did before changes nothing."""
    task = corridor(tmp_path, lambda: Corridor(start=10))
    run = train(task, tmp_path / "run", episodes=8)
    option = run.option(steps=6)
    lengths, controls, ended = [], [], False
    for seed in [*range(6), *range(6)]:
        env = Corridor(start=10)
        observation, _ = env.reset(seed=seed)
        running, length = option(observation), 0
        control = next(running)
        try:
            while True:
                assert control == 10 + run.decide(observation).action
                controls.append(control)
                observation, *_ = env.step(control)
                length += 1
                control = running.send(observation)
        except StopIteration:
            over = observation[0] <= -3 or observation[0] >= 4
            assert over or length == 6
            ended = ended or (bool(over) and length < 6)
        lengths.append(length)
    assert ended
    assert lengths[:6] == lengths[6:]
    assert controls[: sum(lengths[:6])] == controls[sum(lengths[:6]) :]
    told = corridor(tmp_path, Plain, ground=lambda seen, info: {"x": seen[0]})
    with pytest.raises(RunError, match="takes info; an option gets observations only"):
        train(told, tmp_path / "told", episodes=1).option(steps=2)


# What is refused ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "settings", "kind", "said"),
    [
        ({"actions": {"left": 0}}, {}, TaskError, "no environment action"),
        ({}, {"arbiter": {"roh": 1.0}}, SettingsError, "did you mean `rho`"),
        ({}, {"learner": {"buffer_size": 10**13}}, SettingsError, "do not fit into memory"),
        ({}, {"learner": {"hidden": [10**9]}}, SettingsError, "do not fit into memory"),
    ],
)
def test_what_cannot_be_trained_leaves_no_folder(
    tmp_path: Path, changes: Any, settings: Any, kind: type[Exception], said: str
) -> None:
    with pytest.raises(kind, match=said):
        plan_and_learn(
            corridor(tmp_path, **changes), settings=settings, out=tmp_path / "run", quiet=True
        )
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"episodes": 0}, "budget.episodes must be greater than or equal to 1, not 0"),
        ({"out": 3}, "out must be the name of a folder, not 3"),
        ({"resume": True}, "name the run's folder"),
        ({"task": 3}, "a task is a serp.Task, a name or a domain file, not 3"),
    ],
)
def test_options_that_make_no_sense_are_refused(
    tmp_path: Path, options: dict[str, Any], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SerpError, match=said):
        plan_and_learn(**{"task": corridor(tmp_path), "quiet": True, **options})
    assert not (tmp_path / "runs").exists()


def test_a_run_needs_its_own_task(tmp_path: Path) -> None:
    train(corridor(tmp_path), tmp_path / "run", episodes=1)
    with pytest.raises(TaskError, match="no task `corridor`"):
        load_run(tmp_path / "run")
    with pytest.raises(RunError, match="a run of task corridor, not of maze"):
        resume(corridor(tmp_path, name="maze"), tmp_path / "run")


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("domain.pddl", "(reward) 5", "(reward) 6"),
        ("config.json", '"seed": ', '"seed": 1'),
        ("domain-problem.pddl", "", "(define (problem p) (:domain corridor))"),
    ],
)
def test_a_run_whose_own_files_were_changed_is_not_continued(
    tmp_path: Path, name: str, old: str, new: str
) -> None:
    file = tmp_path / "run" / name
    train(corridor(tmp_path), file.parent, episodes=2)
    before = file.read_text(encoding="utf-8") if old else ""
    assert old in before
    file.write_text(before.replace(old, new), encoding="utf-8")
    said = f"{name} of the run was changed since it began"
    with pytest.raises(RunError, match=said):
        resume(corridor(tmp_path), file.parent, episodes=3)
    with pytest.raises(RunError, match=said):
        _ = load_run(file.parent, corridor(tmp_path)).agent


def metadata_run(folder: Path, **changes: Any) -> RunFolder:
    config: dict[str, Any] = {
        "task": "corridor",
        "seed": 2**80,
        "reward": "domain",
        "control_period": 0.1,
        "max_ground_schemas": 50_000,
        "budget": {"episodes": None, "env_steps": 30},
        "settings": resolve("default", None, {"training": {"random_steps": 1}}).as_dict(),
    }
    with RunFolder.create(
        folder / "metadata_run", {**config, **changes}, [("d.pddl", "(define)")]
    ) as made:
        return made


@pytest.mark.parametrize(
    "changes",
    [
        {"seed": 1.5},
        {"control_period": 0},
        {"max_ground_schemas": 0},
        {"budget": {"episodes": 1.5, "env_steps": None}},
        {"budget": None},
        {"settings": {"planner": 3}},
    ],
)
def test_metadata_that_does_not_fit_is_refused(tmp_path: Path, changes: dict[str, Any]) -> None:
    with pytest.raises(RunError, match=r"config\.json was changed or damaged: .+restore it"):
        read_run_metadata(metadata_run(tmp_path, **changes))


PLANNERS: dict[str, Any] = {
    "rightwards": lambda state: "right",
    "up-and-away": lambda state: "up",
    "blind": lambda state: state["y"],
}


@without_pictures()
def train_with(folder: Path, out: Path, planner: str, episodes: int) -> Run:
    return plan_and_learn(
        corridor(folder, planners=PLANNERS),
        settings={"planner": {"name": planner, "depth": 2}},
        episodes=episodes,
        seed=3,
        out=out,
        quiet=True,
    )


def test_a_run_with_a_planner_of_its_own_resumes_as_if_uninterrupted(tmp_path: Path) -> None:
    run = train_with(tmp_path, tmp_path / "whole", "rightwards", 6)
    assert run.evaluate("planner", episodes=1, quiet=True).returns
    train_with(tmp_path, tmp_path / "half", "rightwards", 3)
    resume(corridor(tmp_path, planners=PLANNERS), tmp_path / "half", episodes=6)
    assert everything(tmp_path / "half") == everything(tmp_path / "whole")


@pytest.mark.parametrize(
    ("planner", "failure", "message"),
    [
        ("up-and-away", TaskError, "planner `up-and-away` advises 'up': unknown action `up`"),
        ("blind", TaskError, "planner `blind`: KeyError: 'y'"),
        ("rightward", SettingsError, "no planner `rightward`; did you mean `rightwards`"),
    ],
)
def test_a_planner_that_cannot_be_used_is_refused(
    tmp_path: Path, planner: str, failure: type[SerpError], message: str
) -> None:
    with pytest.raises(failure, match=message):
        train_with(tmp_path, tmp_path / "run", planner, 2)
