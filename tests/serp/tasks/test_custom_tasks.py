"""Tasks that are not installed: a file, or a function of a module."""

from __future__ import annotations

from pathlib import Path

import pytest

from serp.errors import TaskError
from serp.tasks.registry import custom_task
from serp.tasks.task import Task
from tests.serp.sample_tasks import ROBOT


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
        ("my_robot", "", "expected FILE.py, FILE.py:FUNCTION or MODULE:FUNCTION"),
        ("my_robot.py:walkwey", "", "did you mean `walkway`?"),
        ("my_robot.py:serp", "", "`serp` is a module, not a serp.Task"),
        ("my_other.py", "x = 1\ny = nothing\n", r"my_other.py:2: NameError: name 'nothing'"),
        ("my_other.py", "x = 1\n", "holds no serp.Task"),
        ("my_other.py:f", "def f():\n    return 1\n", "it returned int, not a serp.Task"),
        ("my_other.py:f", "def f():\n    return 1 / 0\n", "my_other.py:2: ZeroDivisionError"),
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
