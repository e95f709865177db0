from __future__ import annotations

import subprocess
import sys

import matplotlib
import numpy as np
import pytest

from serp._util.figures import render
from serp.runs.plots import learning_curve
from serp.runs.summary import moving_mean


def test_curves_show_the_metrics(make_metrics):
    metrics = make_metrics(50)
    upper, lower = learning_curve(metrics, "cartpole").axes
    episode, mean = upper.get_lines()
    assert (episode.get_xdata() == metrics["env_steps"]).all()
    assert (episode.get_ydata() == metrics["return"]).all()
    assert (mean.get_ydata() == moving_mean(metrics["return"])).all()
    assert mean.get_linewidth() > 2 * episode.get_linewidth()
    (rho,) = lower.get_lines()
    assert (rho.get_ydata() == metrics["rho"]).all()
    assert upper.get_title(loc="left") == "cartpole"
    assert upper.get_ylabel() and lower.get_ylabel() and lower.get_xlabel() == "environment steps"
    legend = [text.get_text() for axes in (upper, lower) for text in axes.get_legend().get_texts()]
    assert {"one episode", "mean of 20 episodes", "planner", "learner", "exploration"} < set(legend)


@pytest.mark.parametrize("episodes", [2, 50, 1500])
def test_shares_fill_the_panel_and_agree_with_the_metrics(make_metrics, episodes):
    metrics = make_metrics(episodes)
    metrics["learner_steps"] = metrics["length"] // 4  # the same in every stretch
    metrics["exploration_steps"] = metrics["length"] // 2
    metrics["planner_steps"] = metrics["length"] - metrics["length"] // 4 - metrics["length"] // 2
    lower = learning_curve(metrics).axes[1]
    planner, learner, exploration = (area.get_paths()[0].vertices for area in lower.collections)
    assert planner[:, 1].min() == 0
    assert planner[:, 1].max() == pytest.approx(0.25, abs=0.02)
    assert learner[:, 1].max() == pytest.approx(0.5, abs=0.02)
    assert exploration[:, 1].max() == pytest.approx(1)
    assert planner[:, 0].max() == metrics["env_steps"][-1]
    assert planner[:, 0].min() == 0


@pytest.mark.parametrize("episodes", [0, 1])
def test_the_shortest_runs_have_a_picture_too(make_metrics, episodes):
    assert render(learning_curve(make_metrics(episodes)), "png").startswith(b"\x89PNG")


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_equal_metrics_give_equal_bytes_whatever_the_users_style(make_metrics, kind):
    first = render(learning_curve(make_metrics(30), "a $b_c$"), kind)
    style = {"font.size": 30, "lines.linewidth": 9, "savefig.dpi": 7, "text.usetex": True}
    with matplotlib.rc_context(style):
        second = render(learning_curve(make_metrics(30), "a $b_c$"), kind)
    assert first == second
    assert b"<dc:date>" not in first


def test_missing_rho_leaves_a_gap_instead_of_failing(make_metrics):
    metrics = make_metrics(5)
    metrics["rho"][:] = np.nan
    assert render(learning_curve(metrics), "svg").startswith(b"<?xml")


def test_a_long_run_makes_no_huge_svg(make_metrics):
    assert len(render(learning_curve(make_metrics(6000)), "svg")) < 2_000_000


def test_global_state_of_matplotlib_is_left_alone():
    code = (
        "import sys, matplotlib\n"
        "before = matplotlib.rcParams.copy()\n"  # not dict(): that asks for a backend
        "import numpy as np\n"
        "from serp._util.figures import render\n"
        "from serp.runs.plots import learning_curve\n"
        "from serp.runs.rows import METRICS_COLUMNS\n"
        "m = {name: np.ones(3, int) for name in METRICS_COLUMNS}\n"
        "render(learning_curve(m), 'png')\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
        "assert matplotlib.rcParams.copy() == before\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
