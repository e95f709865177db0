"""`serp repair`."""

import difflib
import json
from pathlib import Path

import pytest

from serp.runs.comparison.algorithms import OWN
from tests.serp.ui.cli.conftest import train
from tests.worlds import DOMAINS

EMPTY = DOMAINS / "cartpole-empty.pddl"
PLANNER_ALONE = [
    f"--set={section}.{name}={value if isinstance(value, str) else json.dumps(value)}"
    for section, values in OWN["mrp"].changes.items()
    for name, value in values.items()
]
ADAPTED = ["--set=adaptation.mode=residual"]


@pytest.fixture(scope="module")
def ignorant(tmp_path_factory):
    """A run with a file that says nothing of how cart and pole move, adapted on the way."""
    out = tmp_path_factory.mktemp("ignorant") / "run"
    return train(out, f"--domain={EMPTY}", *PLANNER_ALONE, "--episodes=2", *ADAPTED)


def test_the_file_is_right_and_what_is_shown_is_what_is_written(run, ignorant):
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


@pytest.mark.parametrize(
    ("name", "said"),
    [("new.pddl", "new.pddl exists"), ("new-problem.pddl", "new-problem.pddl exists")],
)
def test_nothing_is_replaced_unasked(run, ignorant, name, said):
    Path(name).write_text("mine", encoding="utf-8")
    refused = run("repair", str(ignorant), "-o", "new.pddl", expect=1)
    assert said in refused.stderr and "--force" in refused.stderr and not refused.stdout
    assert Path(name).read_text(encoding="utf-8") == "mine"
    run("repair", str(ignorant), "-o", "new.pddl", "--force")
    assert (Path(name).read_text(encoding="utf-8") != "mine") == (name == "new.pddl")
