"""The results of a run: a summary and a curve."""

import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.runs.folder import RunFolder
from serp.runs.results import write_results
from serp.runs.summary import moving_mean, summarize

CONFIG = {"domain": "cartpole", "preset": "default", "seed": 3}


def test_results_are_made_from_what_the_run_wrote(tmp_path, make_rows):
    with RunFolder.create(tmp_path / "x", CONFIG, [("d.pddl", "(define)")]) as run:
        for row in make_rows(25):
            run.metrics.append(row)
        write_results(run, {"unsafe": 7})
        summary = run.read_summary()
    assert (summary["episodes"], summary["vetoes_by_reason"]) == (25, {"unsafe": 7})
    assert (run.path / "learning-curve.png").read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in (run.path / "learning-curve.svg").read_bytes()
    assert not [name for name in os.listdir(run.path) if "aside" in name]


@given(st.lists(st.integers(-1000, 1000), max_size=60))
def test_moving_mean_is_the_mean_of_what_was_there(values):
    expected = [np.mean(values[max(0, i - 19) : i + 1]) for i in range(len(values))]
    assert moving_mean(np.array(values)) == pytest.approx(expected)


def test_numbers_are_those_of_the_metrics(make_metrics):
    metrics = make_metrics(100)
    returns = metrics["return"]
    summary = summarize(metrics, {"domain": "cartpole", "preset": "default", "seed": 3, "x": 1})
    assert summary["domain"] == "cartpole" and summary["seed"] == 3 and "x" not in summary
    assert summary["episodes"] == 100
    assert summary["env_steps"] == metrics["length"].sum()
    assert summary["steps_per_second"] == pytest.approx(2000)
    assert summary["return"]["first_10"] == pytest.approx(returns[:10].mean())
    assert summary["return"]["last_20"] == pytest.approx(returns[-20:].mean())
    windows = np.lib.stride_tricks.sliding_window_view(returns, 20).mean(axis=1)
    assert summary["return"]["best_20"] == pytest.approx(windows.max())
    best_end = metrics["env_steps"][19 + windows.argmax()]
    assert summary["return"]["best_20_at_env_step"] == best_end
    assert summary["domain_return"]["last_20"] == pytest.approx(0.9 * returns[-20:].mean())
    assert summary["terminations"] + summary["truncations"] == 100
    for name in ("vetoes", "unsafe_predicted", "unsafe_executed", "no_safe_action"):
        assert summary[name] == metrics[name].sum()
    assert summary["final_rho"] == 1.0


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
