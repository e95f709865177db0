"""Running commands as a user does, in an empty folder."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from serp.ui.root import serp
from tests.serp.runs.runs import without_pictures

Run = Callable[..., Result]

# Falls soon and learns fast: what a run holds matters here, not how good it is.
QUICK = [
    f"--set={setting}"
    for setting in (
        "arbiter.rho=1",
        "guide.strategy=mixture",
        "planner.depth=1",
        "learner.members=1",
        "learner.epsilon_steps=0",
        "learner.epsilon_end=0.1",
    )
]

WALK = """
(define (domain walk)
  (:requirements :typing :numeric-fluents :negative-preconditions :conditional-effects)
  (:types place)
  (:predicates (at ?p - place) (road ?a - place ?b - place) (mined ?p - place) (unsafe))
  (:functions (walked) (reward))
  (:action go
    :parameters (?a - place ?b - place)
    :precondition (and (at ?a) (road ?a ?b))
    :effect (and (not (at ?a)) (at ?b) (increase (walked) 1) (decrease (reward) 1)
                 (when (mined ?b) (and (unsafe)))))
  (:action rest
    :parameters ()
    :precondition (and (> (walked) 0))
    :effect (and (assign (walked) 0) (increase (reward) 3))))
"""
WALK_PROBLEM = """
(define (problem village) (:domain walk)
  (:objects home shop field - place)
  (:init (at home) (road home shop) (road shop home) (road home field) (mined field)
         (= (walked) 0))
  (:goal (and)))
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, empty."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def run(folder: Path) -> Iterator[Run]:
    """Run a command line in the working directory."""

    def invoke(*arguments: str, expect: int = 0) -> Result:
        result = CliRunner().invoke(serp, arguments)
        assert result.exit_code == expect, result.output
        assert "Traceback" not in result.output
        return result

    with without_pictures():
        yield invoke


@pytest.fixture
def walk(folder: Path) -> Path:
    """A domain with its problem beside it."""
    file = folder / "walk.pddl"
    file.write_text(WALK)
    (folder / "walk-problem.pddl").write_text(WALK_PROBLEM)
    return file


@without_pictures()
def train(out: Path, *arguments: str) -> Path:
    """Train into a folder."""
    command = ["plan-and-learn", f"--out={out}", "--quiet", *arguments]
    result = CliRunner().invoke(serp, command)
    assert result.exit_code == 0, result.output
    return out


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run of cart-pole."""
    out = tmp_path_factory.mktemp("runs") / "trained"
    return train(out, "--domain=cartpole", "--episodes=4", *QUICK)
