"""The picture of a decision: everything in its place, nothing on top of something else."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path
from typing import Any

import matplotlib
import pytest
from hypothesis import given

from serp.model.loading import Domain, load_domain
from serp.planning.replanner import MonitorReplanner, Plan
from serp.viz.plan_drawing import draw_plan, svg_bytes
from serp.viz.plan_layout import MAX_EDGES, MAX_FAN, PlanLayout, lay_out, short
from tests.generated.models import Generated, models_with_states
from tests.generated.profile import examples
from tests.generated.writer import PLANNABLE

ROOT = Path(__file__).resolve().parents[3]
CARTPOLE = ROOT / "domains" / "cartpole.pddl"
UPRIGHT = [0.01, -0.02, -0.04, -0.05]
LEANING = [0.01, -0.02, 0.21, 0.6]
FALLING = [0.01, -0.02, 0.25, 1.6]
SVG = "{http://www.w3.org/2000/svg}"
FIVE = """
(define (domain five)
  (:predicates (unsafe) (terminal))
  (:functions (a) (b) (c) (d) (e) (reward))
  (:action cover-goal :parameters () :precondition (and) :effect (and (increase (a) 1)))
  (:action side-advance :parameters () :precondition (and) :effect (and (increase (b) (a))))
  (:action frontal-contrast :parameters () :precondition (and)
    :effect (and (increase (c) (b)) (increase (b) 0.1)))
  (:action hold :parameters () :precondition (and) :effect (and (increase (d) 3)))
  (:action kick :parameters () :precondition (and) :effect (and (scale-up (e) 1.5) (unsafe)))
  (:event worth :parameters () :precondition (and)
    :effect (and (increase (reward) (- (c) (d))))))
"""
ANYWHERE = [1.0, 2.0, 0.5, 0.1, 1.0]
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


def planned(text: str, folder: Path, state: list[float], depth: int) -> tuple[Plan, Any]:
    file = folder / "domain.pddl"
    file.write_text(text)
    return plan_in(load_domain(file), state, depth=depth)


def layout_of(plan: Plan, planner: MonitorReplanner) -> PlanLayout:
    """The layout, after a check of what holds of every layout."""
    labels = {k: action.name for k, action in enumerate(planner.model.actions)}
    layout = lay_out(plan.graph, planner.settings.discount**planner.settings.repeat, labels)
    branches = layout.branches
    # Every edge at most once, behind an edge that reaches its source, or out of the root.
    edges = Counter((b.source, b.target, b.action) for b in branches)
    assert set(edges.values()) <= {1} and all(edge in plan.graph.edges for edge in edges)
    # What follows a state is shown once, and if it is not shown here, the end says so.
    forks = Counter(b.target for b in branches if b.children)
    assert set(forks.values()) <= {1}
    for branch in branches:
        assert branch.source == (branch.parent.target if branch.parent else 0)
        assert branch.parent is None or branch in branch.parent.children
        assert bool(branch.children) == (branch.end == "fork")
        if plan.graph.out_degree(branch.target):
            assert branch.end in ("fork", "elsewhere", "collapsed")
            assert branch.end != "elsewhere" or forks[branch.target]
        assert 0.0 <= branch.value <= (0.0 if branch.harm else 1.0)
    # The best path is there.
    path = sorted((b for b in branches if b.chosen), key=lambda b: b.layer)
    assert [b.label for b in path] == [short(step.action) for step in plan.path]
    # Bounded: beyond the limit only the best path. No two lines of a column coincide.
    assert len(branches) <= MAX_EDGES + plan.depth * MAX_FAN
    for layer in {b.layer for b in branches}:
        rows = sorted((b.row, bool(b.label)) for b in branches if b.layer == layer)
        for (upper, _), (lower, labelled) in itertools.pairwise(rows):
            assert lower - upper >= (0.99 if labelled else 0.49)
    return layout


def svg(plan: Plan, planner: MonitorReplanner) -> ET.Element:
    return ET.fromstring(svg_bytes(draw_plan(plan, planner, title="a title")))


def texts(picture: ET.Element) -> list[str]:
    return [element.text or "" for element in picture.iter(f"{SVG}text")]


def said(plan: Plan, planner: MonitorReplanner) -> str:
    return " ".join(texts(svg(plan, planner)))


def test_small_graphs_are_shown_whole_with_every_name(tmp_path: Path) -> None:
    for plan, planner in (cartpole(UPRIGHT, depth=5), planned(FIVE, tmp_path, ANYWHERE, 3)):
        layout = layout_of(plan, planner)
        assert len(layout.branches) == plan.graph.number_of_edges()
        assert all(branch.label for branch in layout.branches)


def test_what_follows_equal_states_is_shown_once(tmp_path: Path) -> None:
    plan, planner = planned(GRID, tmp_path, [0.0, 0.0], 3)
    layout = layout_of(plan, planner)
    assert len(layout.branches) == plan.graph.number_of_edges()
    chosen = [branch for branch in layout.branches if branch.chosen]
    assert [branch.total for branch in chosen] == pytest.approx([plan.reward] * 3)
    assert [branch.value for branch in chosen] == pytest.approx([1.0] * 3)
    assert "the same state as another here" in said(plan, planner)


def test_a_large_graph_is_shown_in_part_and_says_so(tmp_path: Path) -> None:
    plan, planner = planned(FIVE, tmp_path, ANYWHERE, 6)
    layout = layout_of(plan, planner)
    assert any(branch.end == "collapsed" for branch in layout.branches)
    data = svg_bytes(draw_plan(plan, planner))
    written = " ".join(texts(ET.fromstring(data)))
    assert f" of {plan.graph.number_of_edges():,} edges" in written
    assert "goes on, not drawn" in written and "Edges without a name" in written
    assert len(data) < 500_000


def test_another_process_gives_equal_bytes() -> None:
    script = (
        "import sys; from tests.serp.viz.test_plan_drawing import *\n"
        "sys.stdout.buffer.write(svg_bytes(draw_plan(*cartpole(LEANING))))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT, env={**os.environ, "PYTHONHASHSEED": "1"}, capture_output=True, check=True,
    )  # fmt: skip
    with matplotlib.rc_context({"font.size": 30, "svg.fonttype": "path", "lines.linewidth": 9}):
        assert done.stdout == svg_bytes(draw_plan(*cartpole(LEANING)))


def test_names_numbers_and_what_is_unsafe_are_text() -> None:
    plan, planner = cartpole(LEANING)
    picture = svg(plan, planner)
    written = texts(picture)
    assert {"a title", "unsafe", f"return {plan.reward:.3g}"} <= set(written)
    assert any("pole-angle = 0.21" in text for text in written)
    value = {a.name: plan.forecast.value[k] for k, a in enumerate(planner.model.actions)}
    for name in ("push-left", "push-right"):
        assert f"{name}: {value[name]:.3g}" in written
    named = written.count("push-left") + written.count("push-right")
    assert named == plan.graph.number_of_edges() - 2
    # Colour is not the only sign of what is unsafe.
    unsafe = [d for _, _, d in plan.graph.edges(data=True) if d["unsafe"]]
    assert 0 < len(unsafe) <= dashed(picture)
    safe = svg(*cartpole(UPRIGHT, depth=2))
    assert dashed(safe) == 0 and "unsafe" not in texts(safe)


def dashed(picture: ET.Element) -> int:
    paths = picture.iter(f"{SVG}path")
    return sum("stroke-dasharray" in path.get("style", "") for path in paths)


def test_what_is_special_about_a_decision_is_said(tmp_path: Path) -> None:
    assert "Every path leads to something unsafe" in said(*cartpole(FALLING))
    plan, planner = planned(GRID, tmp_path, [-9.0, 0.0], 2)
    assert plan.indifferent and "All first actions promise the same" in said(plan, planner)
    few = planned(GRID, tmp_path, [0.0, 8.5], 2)
    assert "Not applicable here: south, east, west" in said(*few)
    none = planned(GRID, tmp_path, [0.0, 9.0], 2)
    assert "No action is applicable." in said(*none)


@pytest.mark.filterwarnings("error")
@examples(20)
@given(models_with_states(PLANNABLE, count=1))
def test_any_decision_can_be_drawn(drawn: tuple[Generated, Any]) -> None:
    generated, (state,) = drawn
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("serp.model.program.MAX_NATIVE_SIZE", -1)  # compiling takes seconds
        planner = MonitorReplanner(generated.model, depth=3, discount=0.9)
        plan = planner.plan(state)
    layout_of(plan, planner)
    svg(plan, planner)
