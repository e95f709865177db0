"""`serp repair`."""

import difflib
import hashlib
import json
import shutil
from pathlib import Path

import pytest

from serp.runs.checkpoint import NEWEST, load, save
from serp.runs.comparison.algorithms import OWN
from tests.serp.ui.cli.conftest import Run, train

EMPTY = Path(__file__).parents[4] / "domains" / "cartpole-empty.pddl"
PLANNER_ALONE = [
    f"--set={section}.{name}={value if isinstance(value, str) else json.dumps(value)}"
    for section, values in OWN["mrp"].changes.items()
    for name, value in values.items()
]
ADAPTED = ["--set=adaptation.mode=residual"]


@pytest.fixture(scope="module")
def ignorant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with a file that says nothing of how cart and pole move, adapted on the way."""
    out = tmp_path_factory.mktemp("ignorant") / "run"
    return train(out, f"--domain={EMPTY}", *PLANNER_ALONE, "--episodes=2", *ADAPTED)


def test_the_file_is_right_and_what_is_shown_is_what_is_written(run: Run, ignorant: Path) -> None:
    before = {path.name: path.read_bytes() for path in ignorant.iterdir() if path.is_file()}
    shown = run("repair", str(ignorant))
    assert "-o FILE.pddl writes" in shown.stderr
    assert not list(Path().iterdir())
    written = run("repair", str(ignorant), "-o", "known.pddl")
    assert "the repaired file is known.pddl" in written.stderr
    text = Path("known.pddl").read_text(encoding="utf-8")
    old, new = EMPTY.read_text(encoding="utf-8").splitlines(), text.splitlines()
    shown_lines, lines = shown.stdout.splitlines(), written.stdout.splitlines()
    assert lines == list(
        difflib.unified_diff(old, new, "cartpole-empty.pddl", "known.pddl", n=2, lineterm="")
    )
    assert shown_lines[2:] == lines[2:]
    assert "+      (increase (pole-angle) (* #t (pole-velocity)))))" in lines
    run("check", "known.pddl")
    own = run("repair", str(ignorant), "-o", str(ignorant / "domain.pddl"), "--force", expect=1)
    assert "belongs to the run" in own.stderr
    assert {path.name: path.read_bytes() for path in ignorant.iterdir() if path.is_file()} == before


@pytest.fixture
def racing(run: Run, ignorant: Path) -> Path:
    """The same run, as if the domain had a problem file."""
    shutil.copytree(ignorant, "racing")
    problem = "(define (problem race) (:domain cartpole-empty) (:init))\n"
    Path("racing/problem.pddl").write_text(problem, encoding="utf-8")
    about = json.loads(Path("racing/config.json").read_text(encoding="utf-8"))
    about["domain_files"]["problem.pddl"] = "race.pddl"
    Path("racing/config.json").write_text(json.dumps(about), encoding="utf-8")
    arrays, meta = load(Path("racing") / NEWEST)
    meta["made_of"]["problem.pddl"] = hashlib.sha256(problem.encode()).hexdigest()
    save(Path("racing") / NEWEST, arrays, meta)
    return Path("racing")


def test_the_problem_goes_with_the_file(run: Run, racing: Path) -> None:
    problem = (racing / "problem.pddl").read_text(encoding="utf-8")
    result = run("repair", str(racing), "-o", "new.pddl")
    assert "Its problem file is copied to new-problem.pddl" in result.stderr
    assert Path("new-problem.pddl").read_text(encoding="utf-8") == problem
    Path("new.pddl").unlink()
    again = run("repair", str(racing), "-o", "new.pddl")  # the same is there already
    assert "problem" not in again.stderr and Path("new.pddl").exists()


@pytest.mark.parametrize(
    ("source", "name", "said"),
    [
        ("ignorant", "new.pddl", "new.pddl exists"),
        ("racing", "new-problem.pddl", "new-problem.pddl exists"),
        ("ignorant", "new-problem.pddl", "would be taken for the problem of new.pddl"),
    ],
)
def test_nothing_is_replaced_unasked(
    run: Run, ignorant: Path, racing: Path, source: str, name: str, said: str
) -> None:
    folder = str(ignorant if source == "ignorant" else racing)
    Path(name).write_text("mine", encoding="utf-8")
    refused = run("repair", folder, "-o", "new.pddl", expect=1)
    assert said in refused.stderr and "--force" in refused.stderr and not refused.stdout
    assert Path(name).read_text(encoding="utf-8") == "mine"
    run("repair", folder, "-o", "new.pddl", "--force")
    taken = source == "racing" or name == "new.pddl"
    assert (Path(name).read_text(encoding="utf-8") != "mine") == taken
