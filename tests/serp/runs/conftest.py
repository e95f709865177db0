from __future__ import annotations

import numpy as np
import pytest

from serp.runs.reading import read_metrics
from serp.runs.rows import METRICS_COLUMNS, MetricsRow
from serp.runs.tables import Table


def _episodes(count, seed=0):
    """Rows of a run that learns: made up, and consistent with themselves."""
    rng = np.random.default_rng(seed)
    env_steps, rows = 0, []
    for episode in range(1, count + 1):
        rho = min(1.0, 0.02 * episode)
        length = int(np.clip(rng.normal(160 + 340 * min(1, episode / 60), 40), 10, 500))
        env_steps += length
        exploration = int(0.2 * length * rho * max(0, 1 - episode / 50))
        vetoes = int(rng.poisson(3) * rho)
        learner = max(0, int(length * rho) - exploration - vetoes)
        rows.append(
            MetricsRow(
                episode=episode,
                env_steps=env_steps,
                return_=float(length),
                domain_return=0.9 * length,
                length=length,
                terminated=length < 500,
                truncated=length >= 500,
                rho=rho,
                epsilon=0.1,
                planner_steps=length - learner - exploration,
                learner_steps=learner,
                exploration_steps=exploration,
                fallback_steps=0,
                vetoes=vetoes,
                unsafe_predicted=vetoes // 2,
                unsafe_executed=0,
                no_safe_action=0,
                loss=None if episode == 1 else 1 / episode,
                wall_time=env_steps / 2000,
            )
        )
    return rows


@pytest.fixture
def make_rows():
    """Number of episodes → their rows."""
    return _episodes


@pytest.fixture
def make_metrics(tmp_path):
    """Number of episodes → their columns, as they are read."""

    def make(count):
        path = tmp_path / f"made-up-{count}.csv"
        path.unlink(missing_ok=True)
        with Table(path, METRICS_COLUMNS) as table:
            for row in _episodes(count):
                table.append(row)
        return read_metrics(path)

    return make
