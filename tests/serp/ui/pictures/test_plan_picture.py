"""The picture of a decision: everything in its place, nothing on top of something else."""

import itertools
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given

from serp._util.text import readable
from serp.model.domain import Domain, load_domain
from serp.planning.replanner import MonitorReplanner, Plan
from serp.ui.pictures.plan_picture import (
    DASHES,
    MAX_ROWS,
    Branch,
    lay_out,
    plan_picture,
    plan_svg,
    short,
)
from tests.generated.models import Generated, models_with_states
from tests.generated.profile import examples
from tests.generated.writer import PLANNABLE

ROOT = Path(__file__).resolve().parents[4]
CARTPOLE = ROOT / "domains" / "cartpole.pddl"
UPRIGHT = [0.01, -0.02, -0.04, -0.05]
LEANING = [0.01, -0.02, 0.21, 0.6]
SVG = "{http://www.w3.org/2000/svg}"
GRID = """
(define (domain grid)
  (:predicates (unsafe) (terminal))
  (:functions (x) (y) (reward))
  (:action north :parameters () :precondition (and (< (y) 9)) :effect (and (increase (y) 1)))
  (:action south :parameters () :precondition (and (< (y) 8)) :effect (and (decrease (y) 1)))
  (:action east :parameters () :precondition (and (< (y) 8)) :effect (and (increase (x) 1)))
  (:action west :parameters () :precondition (and (< (y) 8)) :effect (and (decrease (x) 1)))
  (:event goal :parameters () :precondition (and (= (x) 2)) :effect (and (increase (reward) 1))))
"""


def plan_in(domain: Domain, state: list[float], **options: Any) -> tuple[Plan, MonitorReplanner]:
    planner = MonitorReplanner(domain.model.replace(dt=0.02), **options)
    return planner.plan(state), planner


def cartpole(state: list[float], **options: Any) -> tuple[Plan, MonitorReplanner]:
    return plan_in(load_domain(CARTPOLE), state, **options)


def branches_of(plan: Plan, planner: MonitorReplanner, rows: int = MAX_ROWS) -> list[Branch]:
    """The branches, after a check of what holds of every layout."""
    labels = {k: action.name for k, action in enumerate(planner.model.actions)}
    pairs = [*lay_out(plan.graph, planner.settings.discount, labels, rows).behind()]
    branches = [branch for _, branch in pairs]
    # Every edge at most once, behind an edge that reaches its source, or out of the root.
    edges = Counter((b.source, b.target, b.action) for b in branches)
    assert set(edges.values()) <= {1} and all(edge in plan.graph.edges for edge in edges)
    # What follows a state is shown or counted once, and if it is not, the end says so.
    forks = Counter(b.target for b in branches if b.children)
    assert set(forks.values()) <= {1}
    for parent, branch in pairs:
        assert branch.source == parent.target
        assert bool(branch.children) == (branch.end == "fork")
        if branch.end in ("leaf", "ended"):
            assert plan.graph.out_degree(branch.target) == 0
        elif not branch.children:
            assert branch.end == "collapsed" or forks[branch.target]
    # The best path is there.
    path = sorted((b for b in branches if b.chosen), key=lambda b: b.layer)
    assert [b.label.partition(" (")[0] for b in path] == [short(s.action) for s in plan.path]
    # Bounded: beyond the limit only the best path with its siblings. No rows coincide.
    leaves = sum(not b.children for b in branches)
    assert leaves <= max(rows, 12) + 12 * plan.depth
    for layer in {b.layer for b in branches}:
        taken = sorted(b.row for b in branches if b.layer == layer)
        assert all(lower - upper >= 0.99 for upper, lower in itertools.pairwise(taken))
    return branches


def svg(plan: Plan, planner: MonitorReplanner) -> ET.Element:
    return ET.fromstring(plan_picture(plan, planner, title="a title"))


def texts(picture: ET.Element) -> list[str]:
    return [element.text or "" for element in picture.iter(f"{SVG}text")]


@pytest.mark.parametrize("rows", [1, 30, 100])
def test_a_graph_is_shown_as_far_as_there_is_room_and_equal_states_once(
    tmp_path: Path, rows: int
) -> None:
    file = tmp_path / "domain.pddl"
    file.write_text(GRID)
    plan, planner = plan_in(load_domain(file), [0.0, 0.0], depth=3 if rows == 100 else 6)
    drawn, edges = len(branches_of(plan, planner, rows)), plan.graph.number_of_edges()
    assert (drawn == edges) == (rows == 100)
    element = ET.fromstring(plan_svg(plan, planner, rows=rows))
    assert element.findtext(f"{SVG}desc") == f"{drawn} of {edges:,} edges are drawn"
    data = plan_picture(plan, planner)
    written = " ".join(texts(ET.fromstring(data)))
    assert "same state as another one here" in written and len(data) < 60_000
    assert f" of {edges:,} edges are drawn" in written


def test_another_process_gives_equal_bytes() -> None:
    script = (
        "import sys; from tests.serp.ui.pictures.test_plan_picture import *\n"
        "sys.stdout.buffer.write(plan_picture(*cartpole(LEANING)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT, env={**os.environ, "PYTHONHASHSEED": "1"}, capture_output=True, check=True,
    )  # fmt: skip
    assert done.stdout == plan_picture(*cartpole(LEANING))


def test_names_numbers_and_what_is_unsafe_are_text() -> None:
    plan, planner = cartpole(LEANING)
    picture = svg(plan, planner)
    written = texts(picture)
    assert {"a title", f"return {readable(plan.reward)}"} <= set(written)
    value = {a.name: plan.forecast.value[k] for k, a in enumerate(planner.model.actions)}
    for name in ("push-left", "push-right"):
        assert any(text.startswith(f"{name}: {readable(float(value[name]))}") for text in written)
    named = sum(text.partition(" (")[0] in value for text in written)
    assert named == plan.graph.number_of_edges() - 2
    # Colour is not the only sign of what is unsafe.
    unsafe = [d for _, _, d in plan.graph.edges(data=True) if d["unsafe"]]
    assert 0 < len(unsafe) <= dashed(picture)
    safe = svg(*cartpole(UPRIGHT, depth=2))
    assert any("(unsafe)" in text for text in written)
    assert dashed(safe) == 0 and not any("(unsafe)" in text for text in texts(safe))


def dashed(picture: ET.Element) -> int:
    paths = picture.iter(f"{SVG}path")
    return sum(path.get("stroke-dasharray") == DASHES["unsafe"] for path in paths)


@pytest.mark.filterwarnings("error")
@examples(20)
@given(models_with_states(PLANNABLE, count=1))
def test_any_decision_can_be_drawn(drawn: tuple[Generated, Any]) -> None:
    generated, (state,) = drawn
    planner = MonitorReplanner(generated.model, depth=3, discount=0.9)
    plan = planner.plan(state)
    branches_of(plan, planner)
    svg(plan, planner)
