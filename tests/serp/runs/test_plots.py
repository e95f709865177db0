from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from serp._util.figures import render
from serp.runs.learning_curve import learning_curve
from serp.runs.summary import moving_interval, moving_mean


def test_curves_show_the_metrics(make_metrics):
    metrics = make_metrics(50)
    upper, lower = learning_curve(metrics, "cartpole").axes
    episode, mean = upper.get_lines()
    (band,) = upper.collections
    low, high = moving_interval(metrics["return"])
    assert {low.min(), high.max()} <= set(band.get_paths()[0].vertices[:, 1])
    assert (low <= moving_mean(metrics["return"])).all() and (low >= metrics["return"].min()).all()
    assert (episode.get_xdata() == metrics["env_steps"]).all()
    assert (episode.get_ydata() == metrics["return"]).all()
    assert (mean.get_ydata() == moving_mean(metrics["return"])).all()
    rho, *_ = lower.get_lines()
    assert (rho.get_ydata() == metrics["rho"]).all()
    assert upper.get_title(loc="left") == "cartpole"
    written = [text.get_text() for axes in (upper, lower) for text in axes.texts]
    assert {"planner", "learner", "exploration"} < set(written)
    assert "mean of the last 20 episodes" in " ".join(written)


@pytest.mark.parametrize("episodes", [2, 50, 1500])
def test_shares_fill_the_panel_and_agree_with_the_metrics(make_metrics, episodes):
    metrics = make_metrics(episodes)
    metrics["learner_steps"] = metrics["length"] // 4  # the same in every stretch
    metrics["exploration_steps"] = metrics["length"] // 2
    metrics["planner_steps"] = metrics["length"] - metrics["length"] // 4 - metrics["length"] // 2
    lower = learning_curve(metrics, "x").axes[1]
    planner, learner, exploration = (area.get_paths()[0].vertices for area in lower.collections)
    assert planner[:, 1].min() == 0
    assert planner[:, 1].max() == pytest.approx(0.25, abs=0.02)
    assert learner[:, 1].max() == pytest.approx(0.5, abs=0.02)
    assert exploration[:, 1].max() == pytest.approx(1)
    assert planner[:, 0].max() == metrics["env_steps"][-1]
    assert planner[:, 0].min() == 0


@pytest.mark.parametrize("episodes", [0, 1, 6000])
def test_the_shortest_and_the_longest_runs_have_a_picture_too(make_metrics, episodes):
    metrics = make_metrics(episodes)
    metrics["rho"][:3] = np.nan  # a gap
    assert 0 < len(render(learning_curve(metrics, "x"), "svg")) < 2_000_000


_DRAW_TWICE = """
import sys, matplotlib
import numpy as np
from serp._util.figures import render
from serp.runs.learning_curve import learning_curve
from serp.runs.tables import METRICS_COLUMNS
before = matplotlib.rcParams.copy()  # not dict(): that asks for a backend
metrics = {name: np.ones(3, int) for name in METRICS_COLUMNS}
plain = [render(learning_curve(metrics, "a $b_c$"), kind) for kind in ("png", "svg")]
assert "matplotlib.pyplot" not in sys.modules
assert matplotlib.rcParams.copy() == before
style = {"font.size": 30, "lines.linewidth": 9, "savefig.dpi": 7, "text.usetex": True}
with matplotlib.rc_context(style):
    styled = [render(learning_curve(metrics, "a $b_c$"), kind) for kind in ("png", "svg")]
assert plain == styled
assert b"<dc:date>" not in plain[1]
"""


def test_equal_metrics_give_equal_bytes_whatever_the_users_style_which_is_left_alone():
    subprocess.run([sys.executable, "-c", _DRAW_TWICE], check=True)
