"""The state to plan from: as it is typed, and as it is observed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import serp
from serp.errors import SerpError
from serp.model.domain import Domain
from serp.ui.asked import parse_state
from tests.serp.sample_tasks import CORRIDOR
from tests.serp.ui.cli.conftest import Run

MILD = CORRIDOR.replace("(unsafe) (terminal)", "(terminal)")
KNOWN = """
(define (domain known)
  (:constants robot1 kitchen)
  (:predicates (at ?who ?where))
  (:functions (x))
  (:action go :effect (and (at robot1 kitchen) (increase (x) 1))))
"""


def planned(run: Run, folder: Path, text: str) -> Any:
    (folder / "my_corridor.py").write_text(
        "from pathlib import Path\nfrom tests.serp.sample_tasks import corridor\n"
        "def task(): return corridor(Path('.'))\n"
    )
    (folder / "own.pddl").write_text(text)
    arguments = ("--task=my_corridor:task", "--set=planner.name=lookahead", "--depth=1", "--json")
    return json.loads(run("plan", *arguments, "--domain=own.pddl").stdout)


def test_where_the_planner_is_indifferent_the_next_state_is_tried(run: Run, folder: Path) -> None:
    """Far from goal and pit nothing differs; the walk goes left until the pit is near."""
    shown = planned(run, folder, MILD)
    assert not shown["indifferent"] and " without a choice" in shown["state_from"]
    stuck = CORRIDOR.replace(":precondition (and)", ":precondition (and (> (x) 99))")
    assert planned(run, folder, stuck)["state_from"] == "observed after a reset with seed 0"


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Domain:
    file = tmp_path_factory.mktemp("known") / "known.pddl"
    file.write_text(KNOWN)
    return serp.load_domain(file)


def test_fluents_are_named_as_pddl_has_them(known: Domain) -> None:
    state = parse_state(["X=1.5,( at  Robot1 kitchen )=true"], known)
    assert state == {"x": 1.5, "at robot1 kitchen": 1.0}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("at robot1 kitche=1", "did you mean `at robot1 kitchen`?"),
        ("x=nan", "`x` is a finite number, not `nan`"),
        ("at robot1 kitchen=2", "`at robot1 kitchen` is true or false, not `2`"),
        ("x=1,x=2", "`x` is given twice"),
    ],
)
def test_wrong_fluents_are_named(known: Domain, text: str, message: str) -> None:
    with pytest.raises(SerpError) as error:
        parse_state([text], known)
    assert message in str(error.value)
