"""Learning curves, which are drawn here alone."""

import pytest

from serp._util.figures import render
from serp.runs.learning_curve import learning_curve
from serp.runs.tables import read_metrics
from tests.serp.runs.runs import train
from tests.serp.sample_tasks import corridor


@pytest.mark.parametrize("env_steps", [1, 300])
def test_the_curve_of_a_run_with_and_without_episodes_is_drawn(tmp_path, env_steps):
    run = train(corridor(tmp_path), tmp_path / "run", env_steps=env_steps)
    metrics = read_metrics(run.path / "metrics.csv")
    png, svg, again = (render(learning_curve(metrics, "A run"), k) for k in ("png", "svg", "svg"))
    assert png.startswith(b"\x89PNG")
    assert svg == again and b"</svg>" in svg
