"""The results of a run: a summary and a curve."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.runs.summary import moving_mean
from tests.serp.runs.runs import train
from tests.serp.sample_tasks import corridor


@given(st.lists(st.integers(-1000, 1000), max_size=60))
def test_moving_mean_is_the_mean_of_what_was_there(values):
    expected = [np.mean(values[max(0, i - 19) : i + 1]) for i in range(len(values))]
    assert moving_mean(np.array(values)) == pytest.approx(expected)


def test_numbers_are_those_of_the_metrics(tmp_path):
    run = train(corridor(tmp_path), tmp_path / "run", episodes=30)
    metrics, summary, returns = run.metrics, run.summary, run.metrics["return"]
    assert summary["episodes"] == 30 and summary["env_steps"] == metrics["length"].sum()
    assert summary["return"]["first_10"] == pytest.approx(returns[:10].mean())
    assert summary["return"]["last_20"] == pytest.approx(returns[-20:].mean())
    windows = np.lib.stride_tricks.sliding_window_view(returns, 20).mean(axis=1)
    assert summary["return"]["best_20"] == pytest.approx(windows.max())
    best_end = metrics["env_steps"][19 + windows.argmax()]
    assert summary["return"]["best_20_at_env_step"] == best_end
    assert summary["domain_return"]["mean"] == pytest.approx(metrics["domain_return"].mean())
    assert summary["terminations"] + summary["truncations"] == 30
    assert summary["final_rho"] == metrics["rho"][-1]
