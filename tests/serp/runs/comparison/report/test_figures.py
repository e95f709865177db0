from __future__ import annotations

import numpy as np
import pytest

from serp._util.figures import render
from serp.runs.comparison.charts import estimates_chart, line_styles, pictures, variants_chart
from serp.runs.comparison.measures import Results, variant_rows
from serp.runs.comparison.statistics import interquartile_mean
from tests.serp.runs.comparison.made_up import metadata, record, records, trial


def made(found, **more):
    return Results(found, metadata(found, **more))


def with_variants():
    return records() + [
        trial(name, seed, level, variant="wrong", planner=20.0 if name == "mrp" else None)
        for name, level in (("serp", 70.0), ("mrp", 20.0))
        for seed in range(3)
    ]


def names(found, **more):
    return [picture.name for picture in pictures(made(found, **more))]


def test_there_is_a_picture_for_everything_that_was_measured():
    assert names(records()) == ["training", "learner", "estimates"]
    assert names(with_variants())[-1] == "variants"
    assert names([]) == []


def test_curves_show_every_algorithm_with_its_band():
    found = records()
    training = pictures(made(found))[0]
    (axes,) = training.figure.axes
    assert "mean of 20 episodes" in axes.get_ylabel()
    lines = {line.get_label(): line for line in axes.get_lines()}
    assert set(lines) == {"serp", "mrp", "dqn", "threshold", "_name", "_seed"}
    assert len(axes.collections) == 3
    assert lines["serp"].get_xdata()[-1] == 600
    ours = [r.episodes["return"][-20:].mean() for r in found if r.trial.algorithm == "serp"]
    assert lines["serp"].get_ydata()[-1] == pytest.approx(interquartile_mean(np.array(ours)))
    # Each is named at the height of its end, and no name lies on another.
    heights = {text.get_text(): text.get_position()[1] for text in axes.texts}
    assert set(heights) == {"serp", "mrp", "dqn", "threshold"}
    assert sorted(heights, key=heights.get) == sorted(
        heights, key=lambda n: lines[n].get_ydata()[-1]
    )
    assert np.diff(sorted(heights.values())).min() > 0.05


def test_the_learners_picture_shows_the_planner_alone():
    learner = next(p for p in pictures(made(records())) if p.name == "learner")
    lines = {line.get_label(): line for line in learner.figure.axes[0].get_lines()}
    assert "mrp" not in lines
    assert lines["planner alone"].get_ydata()[0] == pytest.approx(50, abs=2)


@pytest.mark.parametrize("seeds", [2, 5])
def test_a_figure_of_few_seeds_says_so(seeds):
    for picture in pictures(made(records(range(seeds)))):
        assert ("Few seeds (2)" in picture.figure.get_supxlabel()) == (seeds < 5)


def test_a_chart_of_estimates_has_a_point_for_each_known_value():
    chart = estimates_chart(made(records()))
    counts = [len(axes.containers) for axes in chart.axes]
    assert counts == [3, 2, 2]  # the planner has no learner, nobody was evaluated with vetoes


def test_variants_stand_over_the_worth_of_their_planner():
    results = made(with_variants())
    final, area = variants_chart(results).axes
    for axes, name in ((final, "final"), (area, "area")):
        points = [container.lines[0].get_xydata()[0] for container in axes.containers]
        expected = [(row.planner.value, getattr(row, name).value) for row in variant_rows(results)]
        assert np.allclose(points, expected)
        assert "dqn, no planner" in axes.get_legend_handles_labels()[1]


def test_one_seed_one_episode_and_any_name_are_drawn():
    for found in ([record([1.0])], [record([])], records(seeds=[0])):
        for picture in pictures(made(found)):
            picture.figure.draw_without_rendering()
    found = [trial("$a_b$ <x>", seed, 3.0) for seed in range(2)]
    assert b"<x>" not in render(pictures(made(found))[0].figure, "svg")


def test_every_algorithm_has_a_style_of_its_own():
    styles = line_styles([f"algorithm {i}" for i in range(28)])
    assert len({(style.colour, str(style.dash)) for style in styles.values()}) == 28
