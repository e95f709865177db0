"""The geometry of pictures: everything in its place, nothing on top of something else."""

from __future__ import annotations

import itertools
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given

from serp.model.loading import Domain, load_domain
from serp.planning.replanner import MonitorReplanner, Plan
from serp.viz.plan_layout import MAX_EDGES, MAX_FAN, Branch, PlanLayout, lay_out, short
from tests.generated.models import Generated, models_with_states
from tests.generated.profile import examples
from tests.generated.writer import PLANNABLE

CARTPOLE = Path(__file__).resolve().parents[3] / "domains" / "cartpole.pddl"

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
GRID = """
(define (domain grid)
  (:predicates (unsafe) (terminal))
  (:functions (x) (y) (reward))
  (:action north :parameters () :precondition (and) :effect (and (increase (y) 1)))
  (:action south :parameters () :precondition (and) :effect (and (decrease (y) 1)))
  (:action east :parameters () :precondition (and) :effect (and (increase (x) 1)))
  (:action west :parameters () :precondition (and) :effect (and (decrease (x) 1)))
  (:event goal :parameters () :precondition (and (= (x) 2)) :effect (and (increase (reward) 1))))
"""


def load(text: str, folder: Path) -> Domain:
    file = folder / "domain.pddl"
    file.write_text(text)
    return load_domain(file)


def plan_in(domain: Domain, state: list[float], **options: Any) -> tuple[Plan, MonitorReplanner]:
    planner = MonitorReplanner(domain.model.replace(dt=0.02), **options)
    return planner.plan(state), planner


def laid_out(plan: Plan, planner: MonitorReplanner) -> PlanLayout:
    labels = {k: action.name for k, action in enumerate(planner.model.actions)}
    return lay_out(plan.graph, planner.settings.discount**planner.settings.repeat, labels)


def check(layout: PlanLayout, plan: Plan) -> None:
    """What holds of every layout."""
    # Every edge at most once, behind an edge that reaches its source, or out of the root.
    edges = Counter((b.source, b.target, b.action) for b in layout.branches)
    assert set(edges.values()) <= {1}
    assert all(edge in plan.graph.edges for edge in edges)
    for branch in layout.branches:
        assert branch.source == (branch.parent.target if branch.parent else 0)
        assert branch.parent is None or branch in branch.parent.children
        assert bool(branch.children) == (branch.end == "fork")
        assert 0.0 <= branch.promise <= 1.0
    # What follows a state is shown once, and if it is not shown here, the end says so.
    forks = Counter(b.target for b in layout.branches if b.children)
    assert set(forks.values()) <= {1}
    for branch in layout.branches:
        if plan.graph.out_degree(branch.target):
            assert branch.end in ("fork", "elsewhere", "collapsed")
            assert branch.end != "elsewhere" or forks[branch.target]
    # The best path is there.
    assert [b.label for b in sorted(layout.branches, key=lambda b: b.layer) if b.chosen] == [
        short(step.action) for step in plan.path
    ]
    # Bounded: beyond the limit only the best path.
    assert len(layout.branches) <= MAX_EDGES + plan.depth * MAX_FAN
    assert no_overlap(layout)


def no_overlap(layout: PlanLayout) -> bool:
    """Whether no two lines of a column coincide, and no line runs through a label."""
    columns: dict[float, list[Branch]] = {}
    for branch in layout.branches:
        columns.setdefault(branch.x, []).append(branch)
    for column in columns.values():
        column.sort(key=lambda branch: branch.y)
        for upper, lower in itertools.pairwise(column):
            least = layout.size / 72 if lower.label else 0.05
            if lower.y - upper.y < least:
                return False
    return True


def test_cart_pole_five_deep_is_shown_whole_with_every_name() -> None:
    plan, planner = plan_in(load_domain(CARTPOLE), [0.01, -0.02, -0.04, -0.05], depth=5)
    layout = laid_out(plan, planner)
    check(layout, plan)
    assert len(layout.branches) == plan.graph.number_of_edges() == 62
    assert all(branch.label for branch in layout.branches)


def test_five_actions_three_deep_are_shown_whole_with_every_name(tmp_path: Path) -> None:
    plan, planner = plan_in(load(FIVE, tmp_path), [1.0, 2.0, 0.5, 0.1, 1.0], depth=3)
    layout = laid_out(plan, planner)
    check(layout, plan)
    assert len(layout.branches) == plan.graph.number_of_edges() > 100
    assert all(branch.label for branch in layout.branches)


def test_what_follows_equal_states_is_shown_once(tmp_path: Path) -> None:
    plan, planner = plan_in(load(GRID, tmp_path), [0.0, 0.0], depth=3)
    layout = laid_out(plan, planner)
    check(layout, plan)
    assert len(layout.branches) == plan.graph.number_of_edges()
    assert any(branch.end == "elsewhere" for branch in layout.branches)


@pytest.mark.parametrize("depth", [6, 8])
def test_a_large_graph_is_shown_in_part(depth: int, tmp_path: Path) -> None:
    plan, planner = plan_in(load(FIVE, tmp_path), [1.0, 2.0, 0.5, 0.1, 1.0], depth=depth)
    assert plan.graph.number_of_edges() > 2_000
    layout = laid_out(plan, planner)
    check(layout, plan)
    assert any(branch.end == "collapsed" for branch in layout.branches)
    assert layout.height < 30


def test_unsafe_actions_promise_nothing(tmp_path: Path) -> None:
    plan, planner = plan_in(load(FIVE, tmp_path), [1.0, 2.0, 0.5, 0.1, 1.0], depth=2)
    kicks = [b for b in laid_out(plan, planner).branches if b.label.startswith("kick")]
    assert all(branch.unsafe and branch.promise == 0.0 for branch in kicks)
    assert kicks


def test_the_first_of_the_best_promises_most(tmp_path: Path) -> None:
    plan, planner = plan_in(load(GRID, tmp_path), [0.0, 0.0], depth=3)
    for branch in laid_out(plan, planner).branches:
        assert not branch.chosen or branch.promise == 1.0
        assert not branch.chosen or branch.total == pytest.approx(plan.reward)


@examples(30)
@given(models_with_states(PLANNABLE, count=1))
def test_any_graph_can_be_laid_out(drawn: tuple[Generated, Any]) -> None:
    generated, (state,) = drawn
    planner = MonitorReplanner(generated.model, depth=3, discount=0.9)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("serp.model.program.MAX_NATIVE_SIZE", 0)  # compiling takes seconds
        plan = planner.plan(state)
    check(laid_out(plan, planner), plan)
