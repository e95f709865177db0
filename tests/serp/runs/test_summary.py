from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.runs.summary import moving_mean, summarize


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
