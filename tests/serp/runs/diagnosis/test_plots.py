from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from serp.model.learned.regression_data import predictions
from serp.model.transition_model import TransitionModel
from serp.runs.diagnosis.diagnosis import Diagnosis, make_diagnosis
from serp.runs.diagnosis.findings import Findings
from serp.runs.diagnosis.plots import PANELS, draw_diagnosis, panels_of, picture
from tests.serp.model.learned.rolls import DOMAINS, from_text, on_ice
from tests.serp.runs.diagnosis.made_up import (
    found,
    missing,
    parameter,
    predictions_with,
    recorded,
    states_of,
    taken,
)


def pictured(model: TransitionModel, truth: Findings) -> Diagnosis:
    states, actions = states_of(model, 300)
    after = predictions_with(model, truth, states, actions)
    column = next(f.index for f in model.fluents if f.name == "lit r1")
    after[::7, column] = 1.0 - after[::7, column]  # a predicate that does not always do so
    return make_diagnosis(recorded(model, states, actions, after), truth)


def all_wrong(model: TransitionModel) -> Findings:
    return found(
        parameter(model, 0, 2.5), missing(model, "battery ?r", {("warmth",): 0.2}),
        missing(model, "warmth", {(): 0.1}, schema=""),
        missing(model, "place ?r", {(): 0.1}, schema=""),
        missing(model, "battery ?r", {(): 0.1}, schema=""),
    )  # fmt: skip


def titles(figure: Figure) -> list[str]:
    return [axes.get_title(loc="left") for axes in figure.axes]


def test_the_most_costly_pairs_are_drawn_and_no_more_than_can_be_read(
    model: TransitionModel,
) -> None:
    diagnosis = pictured(model, all_wrong(model))
    assert sum(row.cost > 0 for row in diagnosis.fits) > PANELS
    drawn = [f"{row.action}: {row.fluent}" for row in diagnosis.fits[:PANELS]]
    assert titles(draw_diagnosis(diagnosis)) == drawn


def test_a_point_has_the_size_of_its_steps(model: TransitionModel) -> None:
    diagnosis = pictured(model, found(parameter(model, 0, 2.5)))
    figure = draw_diagnosis(diagnosis)
    by_title = dict(zip(titles(figure), figure.axes, strict=True))
    by_file, estimated = by_title["drive r1: place r1"].collections
    points = np.asarray(estimated.get_offsets())
    np.testing.assert_allclose(points[:, 0], points[:, 1])
    points = np.asarray(by_file.get_offsets())
    np.testing.assert_allclose(points[:, 0] + 1.0, points[:, 1])
    switched = by_title["light r1: lit r1"].collections[0]
    assert len(np.asarray(switched.get_offsets())) <= 4
    assert max(switched.get_sizes()) > 3 * min(switched.get_sizes())


def test_a_right_file_is_drawn_by_what_moves(model: TransitionModel) -> None:
    states, actions = states_of(model, 100)
    after = predictions(model, states, actions)
    diagnosis = make_diagnosis(recorded(model, states, actions, after), found())
    moving = panels_of(diagnosis)
    assert moving and all(row.change > 0 for row in moving)
    assert len(titles(draw_diagnosis(diagnosis))) == len(moving)
    still = make_diagnosis(recorded(model, states, actions, states), found())
    assert picture(still, "png").startswith(b"\x89PNG")


def test_rewards_and_ends_have_panels_and_equal_bytes() -> None:
    domain = from_text((DOMAINS / "cliff.pddl").read_text(encoding="utf-8"))
    diagnosis = make_diagnosis(taken(domain, on_ice(domain, 0, steps=300)), found())
    assert picture(diagnosis, "svg") == picture(diagnosis, "svg")
    drawn = " ".join(titles(draw_diagnosis(diagnosis)))
    assert "reward" in drawn and "terminal" in drawn
