"""The picture of a decision: everything in its place, nothing on top of something else."""

import itertools
import xml.etree.ElementTree as ET
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.planning.replanner import MonitorReplanner
from serp.ui.pictures.plan_picture import DASHES, MAX_ROWS, lay_out, plan_svg, short
from tests.generated.models import models_with_states
from tests.generated.profile import examples
from tests.generated.writer import PLANNABLE

SVG = "{http://www.w3.org/2000/svg}"


def branches_of(plan, planner, rows=MAX_ROWS):
    """The branches, after a check of what holds of every layout."""
    pairs = [*lay_out(plan.graph, planner.settings.discount, rows).behind()]
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
    assert len(path) == len(plan.path)
    assert all(b.label.startswith(short(s.action)) for b, s in zip(path, plan.path, strict=True))
    # It begins with the chosen action, the best path is the top row.
    assert all(b.row == 1 for b in path) and (not path or pairs[0][1] is path[0])
    # Bounded: beyond the limit only the best path with its siblings. No rows coincide.
    leaves = sum(not b.children for b in branches)
    assert leaves <= max(rows, 12) + 12 * plan.forecast.depth
    for layer in {b.layer for b in branches}:
        taken = sorted(b.row for b in branches if b.layer == layer)
        assert all(lower - upper >= 0.99 for upper, lower in itertools.pairwise(taken))
    return branches


@pytest.mark.filterwarnings("error")
@examples(20)
@given(models_with_states(PLANNABLE, count=1), st.sampled_from([1, 10]))
def test_any_decision_can_be_drawn(drawn, rows):
    generated, (state,) = drawn
    planner = MonitorReplanner(generated.model, depth=3, discount=0.9)
    plan = planner.plan(state)
    branches_of(plan, planner, rows)
    branches, edges = branches_of(plan, planner), plan.graph.number_of_edges()
    picture = ET.fromstring(plan_svg(plan, planner))
    assert f"{len(branches)} of {edges:,} edges" in f"{picture.findtext(f'{SVG}desc')}"
    written = [element.text or "" for element in picture.iter(f"{SVG}text")]
    assert not plan.path or any(plan.path[0].action in text for text in written)
    # Colour is not the only sign of what is unsafe.
    drawn = [edge for edge in branches if edge.harm == "unsafe"]
    assert all(edge.label.endswith("(unsafe)") for edge in drawn)
    dashes = [path.get("stroke-dasharray") for path in picture.iter(f"{SVG}path")]
    assert dashes.count(DASHES["unsafe"]) >= len(drawn)
