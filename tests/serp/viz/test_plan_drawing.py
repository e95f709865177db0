"""The picture of a decision."""

from __future__ import annotations

import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import matplotlib
import pytest
from hypothesis import given

from serp.model.loading import load_domain
from serp.planning.replanner import MonitorReplanner, Plan
from serp.viz.plan_drawing import draw_plan, svg_bytes
from tests.generated.models import Generated, models_with_states
from tests.generated.profile import examples
from tests.generated.writer import PLANNABLE
from tests.serp.viz.test_plan_layout import CARTPOLE, FIVE, GRID, load, plan_in

ROOT = Path(__file__).resolve().parents[3]
UPRIGHT = [0.01, -0.02, -0.04, -0.05]
LEANING = [0.01, -0.02, 0.21, 0.6]
FALLING = [0.01, -0.02, 0.25, 1.6]
SVG = "{http://www.w3.org/2000/svg}"


def cartpole(state: list[float], **options: Any) -> tuple[Plan, MonitorReplanner]:
    return plan_in(load_domain(CARTPOLE), state, **options)


def svg(plan: Plan, planner: MonitorReplanner, title: str = "a title") -> ET.Element:
    return ET.fromstring(svg_bytes(draw_plan(plan, planner, title=title)))


def texts(picture: ET.Element) -> list[str]:
    return [element.text or "" for element in picture.iter(f"{SVG}text")]


def dashed(picture: ET.Element) -> int:
    paths = picture.iter(f"{SVG}path")
    return sum("stroke-dasharray" in path.get("style", "") for path in paths)


def test_another_process_gives_equal_bytes() -> None:
    script = (
        "import sys; from tests.serp.viz.test_plan_drawing import *\n"
        "sys.stdout.buffer.write(svg_bytes(draw_plan(*cartpole(LEANING))))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT, env={**os.environ, "PYTHONHASHSEED": "1"}, capture_output=True, check=True,
    )  # fmt: skip
    assert done.stdout == svg_bytes(draw_plan(*cartpole(LEANING)))


def test_names_and_numbers_are_text() -> None:
    plan, planner = cartpole(LEANING)
    written = texts(svg(plan, planner))
    assert "a title" in written
    assert any("pole-angle = 0.21" in text for text in written)
    assert f"return {plan.reward:.3g}" in written
    value = {a.name: plan.forecast.value[k] for k, a in enumerate(planner.model.actions)}
    for name in ("push-left", "push-right"):
        assert f"{name}: {value[name]:.3g}" in written
    assert written.count("push-left") + written.count("push-right") == (
        plan.graph.number_of_edges() - 2
    )


def test_unsafe_edges_are_dashed_and_explained() -> None:
    """So that colour is not the only sign."""
    plan, planner = cartpole(LEANING)
    unsafe = [d for _, _, d in plan.graph.edges(data=True) if d["unsafe"]]
    picture = svg(plan, planner)
    assert unsafe
    assert dashed(picture) >= len(unsafe)
    assert "unsafe" in texts(picture)
    safe = svg(*cartpole(UPRIGHT, depth=2))
    assert dashed(safe) == 0
    assert "unsafe" not in texts(safe)


def test_a_decision_without_a_way_out_says_so() -> None:
    written = " ".join(texts(svg(*cartpole(FALLING))))
    assert "Every path leads to something unsafe" in written


def test_a_large_graph_says_what_is_left_out(tmp_path: Path) -> None:
    plan, planner = plan_in(load(FIVE, tmp_path), [1.0, 2.0, 0.5, 0.1, 1.0], depth=6)
    data = svg_bytes(draw_plan(plan, planner))
    written = " ".join(texts(ET.fromstring(data)))
    assert f" of {plan.graph.number_of_edges():,} edges" in written
    assert "goes on, not drawn" in written
    assert len(data) < 500_000


def test_equal_states_are_explained(tmp_path: Path) -> None:
    written = texts(svg(*plan_in(load(GRID, tmp_path), [0.0, 0.0], depth=3)))
    assert "the same state as another here" in written


def test_what_is_not_applicable_is_named(tmp_path: Path) -> None:
    text = GRID.replace(":parameters () :precondition (and) :effect (and (increase (y) 1))",
                        ":parameters () :precondition (and (> (y) 9)) :effect (and)")  # fmt: skip
    written = texts(svg(*plan_in(load(text, tmp_path), [0.0, 0.0], depth=2)))
    assert "Not applicable here: north" in written


def test_a_state_without_applicable_actions_can_be_drawn(tmp_path: Path) -> None:
    text = GRID.replace(":precondition (and) :effect (and (in", ":precondition (and (> (y) 9)) "
                        ":effect (and (in").replace(":precondition (and) :effect (and (de",
                        ":precondition (and (> (y) 9)) :effect (and (de")  # fmt: skip
    plan, planner = plan_in(load(text, tmp_path), [0.0, 0.0])
    assert plan.name is None
    assert "No action is applicable." in texts(svg(plan, planner))


def test_indifference_is_said(tmp_path: Path) -> None:
    plan, planner = plan_in(load(GRID, tmp_path), [-9.0, 0.0], depth=2)
    assert plan.indifferent
    assert "All first actions promise the same" in " ".join(texts(svg(plan, planner)))


def test_the_picture_depends_on_no_global_state(tmp_path: Path) -> None:
    plan, planner = cartpole(UPRIGHT, depth=2)
    before = svg_bytes(draw_plan(plan, planner))
    with matplotlib.rc_context({"font.size": 30, "svg.fonttype": "path", "lines.linewidth": 9}):
        assert svg_bytes(draw_plan(plan, planner)) == before


@pytest.mark.filterwarnings("error")
@examples(10)
@given(models_with_states(PLANNABLE, count=1))
def test_any_decision_can_be_drawn(drawn: tuple[Generated, Any]) -> None:
    generated, (state,) = drawn
    planner = MonitorReplanner(generated.model, depth=3, discount=0.9)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("serp.model.program.MAX_NATIVE_SIZE", 0)  # compiling takes seconds
        plan = planner.plan(state)
    svg(plan, planner)
