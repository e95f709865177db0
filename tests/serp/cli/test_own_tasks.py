"""`--task`: tasks that are not installed."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from serp.errors import TaskError
from serp.tasks.custom_tasks import custom_task
from serp.tasks.task import Task
from tests.serp.cli.conftest import QUICK, Run
from tests.serp.sample_tasks import CORRIDOR

ROBOT = """
import serp
from tests.serp.sample_tasks import Corridor


def ground(seen):
    return {"x": seen[0]}


def walkway() -> serp.Task:
    return serp.Task(
        name="walkway", make_env=Corridor, domain="corridor.pddl", ground=ground
    )
"""


@pytest.fixture
def robot(folder: Path) -> Iterator[Path]:
    """A file with a task in the working directory."""
    path, modules = list(sys.path), set(sys.modules)
    (folder / "corridor.pddl").write_text(CORRIDOR)
    file = folder / "my_robot.py"
    file.write_text(ROBOT)
    yield file
    sys.path[:] = path
    for name in set(sys.modules) - modules:
        if name.startswith("my_"):
            del sys.modules[name]


@pytest.mark.parametrize("name", ["my_robot.py", "my_robot.py:walkway", "my_robot:walkway"])
def test_each_form_names_the_task(robot: Path, name: str) -> None:
    task = custom_task(name)
    assert isinstance(task, Task)
    assert task.name == "walkway"


def test_a_task_itself_can_be_named(robot: Path) -> None:
    Path("my_two.py").write_text(ROBOT + "\nfirst = walkway()\n")
    assert custom_task("my_two:first").name == "walkway"
    with pytest.raises(TaskError, match="which task.*--task my_two.py:walkway.*:first"):
        custom_task("my_two.py")


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("nowhere.py", "", "nowhere.py: there is no such file"),
        ("nowhere:task", "", "there is no module `nowhere`, neither installed nor in "),
        ("my_robot", "", "expected FILE.py, FILE.py:FUNCTION or MODULE:FUNCTION"),
        ("my_robot:", "", "expected FILE.py"),
        ("my_robot.py:walkwey", "", "did you mean `walkway`?"),
        ("my_robot.py:serp", "", "`serp` is a module, not a serp.Task"),
        ("my_other.py", "x = 1\ny = nothing\n", r"my_other.py:2: NameError: name 'nothing'"),
        ("my_other.py", "import absent_package\n", "my_other.py:1: ModuleNotFoundError"),
        ("my_other.py", "x = 1\ny = (\n", r"my_other.py:2:5: '\(' was never closed"),
        ("my_other.py", "x = 1\n", "holds no serp.Task"),
        ("my_other.py:f", "def f():\n    return 1\n", "it returned int, not a serp.Task"),
        ("my_other.py:f", "def f():\n    return 1 / 0\n", "my_other.py:2: ZeroDivisionError"),
        ("my_other.py:f", "def f(x):\n    return x\n", "TypeError: f\\(\\) missing 1 required"),
        ("json.py", "x = 1\n", "another module is called `json`"),
    ],
)
def test_what_gives_no_task_is_said_with_its_line(
    robot: Path, name: str, text: str, says: str
) -> None:
    if text:
        Path(name.partition(":")[0]).write_text(text)
    with pytest.raises(TaskError, match=says):
        custom_task(name)


def test_a_task_of_ones_own_is_planned_checked_trained_and_measured(run: Run, robot: Path) -> None:
    assert "walkway" not in run("list").stdout
    assert "Chosen:" in run("plan", "--task=my_robot.py", "--observe", "--depth=1").stdout
    assert "fit together" in run("check", "--task=my_robot.py").stdout
    run("plan-and-learn", "--task=my_robot.py", "--episodes=1", "--out=runs/one", *QUICK)
    told = run("evaluate", "runs/one", "--episodes=1", expect=1).stderr
    assert "there is no task `walkway`" in told
    assert "--task FILE.py:FUNCTION" in told
    measured = run("evaluate", "runs/one", "--episodes=1", "--task=my_robot:walkway").stdout
    assert "return" in measured


def test_a_training_that_its_environment_stops_says_where_and_how_it_goes_on(
    run: Run, robot: Path
) -> None:
    broken = ROBOT.replace(
        "make_env=Corridor",
        "make_env=Broken",
    ).replace(
        "def ground",
        "class Broken(Corridor):\n    def reset(self, **_):\n        1 / 0\n\n\ndef ground",
    )
    Path("my_broken.py").write_text(broken)
    told = run("plan-and-learn", "--task=my_broken.py", "--out=runs/one", *QUICK, expect=1).stderr
    assert "reset failed: ZeroDivisionError: division by zero (" in told
    assert "my_broken.py:8)" in told.replace("\n", "")
    assert "serp plan-and-learn --resume runs/one\n" in told
    assert "add --task my_broken.py to the command" in told


def test_beside_a_task_the_domain_is_another_file_for_it(run: Run, robot: Path) -> None:
    Path("other.pddl").write_text(CORRIDOR.replace("(domain corridor)", "(domain other)"))
    shown = run("plan", "--task=my_robot.py", "--domain=other.pddl", "--depth=1", "--observe")
    assert "other, observed" in shown.stdout
    told = run(
        "plan-and-learn", "--task=my_robot.py", "--domain=cartpole", "--episodes=1", expect=1
    )
    assert "--domain cartpole: beside --task it is a domain file" in told.stderr
    run("plan", expect=2)
