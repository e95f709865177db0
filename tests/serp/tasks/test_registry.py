"""Tasks come from installed packages; domain files from where the user works."""

import importlib
import sys
from pathlib import Path

import pytest

from serp.errors import TaskError
from serp.tasks.registry import custom_task, find_domain_file, find_task, load_task, task_entries
from tests.serp.sample_tasks import CORRIDOR

THIRD_PARTY = """
from pathlib import Path

import numpy as np

import serp
from tests.serp.sample_tasks import Corridor

DOMAIN = Path(__file__).parent / "corridor.pddl"


def task():
    return serp.Task(
        name="corridor",
        make_env=Corridor,
        domain=DOMAIN,
        ground=lambda seen: {"x": seen[0]},
        description="walk to the goal",
    )


def broken():
    raise RuntimeError("no licence")


def other():
    return {"not": "a task"}


def wrong():
    return serp.Task(make_env=Corridor, domain="nowhere.pddl", ground=dict).bind()
"""

ENTRY_POINTS = """
[serp.tasks]
corridor = third_party_lab:task
broken = third_party_lab:broken
other = third_party_lab:other
wrong = third_party_lab:wrong
absent = third_party_laboratory:task

[console_scripts]
lab = third_party_lab:task
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """An installed distribution that serp has never heard of."""
    site = tmp_path / "site"
    info = site / "third_party_lab-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: third-party-lab\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    (site / "third_party_lab.py").write_text(THIRD_PARTY)
    (site / "corridor.pddl").write_text(CORRIDOR)
    monkeypatch.syspath_prepend(str(site))
    importlib.invalidate_caches()
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    yield work
    sys.modules.pop("third_party_lab", None)


def test_tasks_are_listed_without_importing_them(package):
    entries = task_entries()
    assert {"cartpole", "corridor", "broken"} <= set(entries)
    assert "lab" not in entries
    assert "third_party_lab" not in sys.modules


def test_the_task_of_an_installed_package_is_found_by_name(package):
    for task in (load_task("corridor"), find_task("corridor")):
        assert (task.bind().name, task.description) == ("corridor", "walk to the goal")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("broken", r"task `broken` \(third_party_lab:broken\).*RuntimeError: no licence"),
        ("other", "`third_party_lab:other` returned dict, not a serp.Task"),
        ("wrong", "nowhere.pddl"),
        ("absent", r"task `absent` .*ModuleNotFoundError"),
        ("coridor", "no task `coridor`; did you mean `corridor`"),
    ],
)
def test_what_a_package_offers_wrongly_is_named(package, name, said):
    with pytest.raises(Exception, match=said) as caught:
        load_task(name)
    assert type(caught.value).__name__ in ("TaskError", "DomainError")


# Domain files -------------------------------------------------------------------------------------


def test_a_file_in_the_working_directory_comes_before_the_packages(package):
    """And one in `domains/` before one beside it."""
    (package / "domains").mkdir()
    for file, pit in (("corridor.pddl", -2), ("domains/corridor.pddl", -1)):
        (package / file).write_text(CORRIDOR.replace("(<= (x) -3)", f"(<= (x) {pit})"))
        assert find_domain_file("corridor") == Path(file)
        model = find_task("corridor").bind().model
        assert [model.step([x], "left").unsafe for x in (-1.0, 0.0)] == [True, pit == -1]


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("mine/corridor.pddl", "corridor"),
        ("anything.pddl", "corridor-variant"),
        ("corridor.pddl", "unheard-of"),
    ],
)
def test_a_file_belongs_to_the_task_named_like_it_or_its_domain(package, file, name):
    path = package / file
    path.parent.mkdir(exist_ok=True)
    path.write_text(CORRIDOR.replace("(domain corridor)", f"(domain {name})"))
    task = find_task(file)
    assert task.name == "corridor"
    assert task.load().name == name


ENVIRONMENT = "import gymnasium\nclass Own(gymnasium.Env): ...\n"


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("nowhere.py", "", "nowhere.py: there is no such file"),
        ("my_robot", "", "expected FILE.py, FILE.py:FUNCTION or MODULE:FUNCTION"),
        ("my_robot.py:walkwey", "", "did you mean `walkway`?"),
        ("my_robot.py:serp", "", "`serp` is a module, not a serp.Task"),
        ("my_other.py", "x = 1\ny = nothing\n", r"NameError: name 'nothing' .*my_other.py:2\)"),
        ("my_other.py", "x = 1\n", "holds no serp.Task"),
        ("my_other.py", ENVIRONMENT, "`serp new NAME --env my_other.py:Own` writes a task"),
        ("my_other.py:f", "def f():\n    return 1\n", "it returned int, not a serp.Task"),
        ("my_other.py:f", "def f():\n    return 1 / 0\n", r"ZeroDivisionError: .*my_other.py:2\)"),
        ("json.py", "x = 1\n", "another module is called `json`"),
    ],
)
def test_what_gives_no_task_is_said_with_its_line(robot, name, text, says):
    if text:
        Path(name.partition(":")[0]).write_text(text)
    with pytest.raises(TaskError, match=says):
        custom_task(name)
