"""Learning curves, which are drawn here alone."""

import numpy as np
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
    without = render(learning_curve({**metrics, "rho": metrics["rho"] * np.nan}, "A run"), "svg")
    assert ["ρ".encode() in each for each in (svg, without)] == [len(metrics["rho"]) > 0, False]
