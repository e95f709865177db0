import numpy as np
import pytest

from serp.runs.tables import METRICS_COLUMNS, MetricsRow, Table, read_metrics


@pytest.fixture
def make_rows():
    """Number of episodes → rows of a run that learns: made up, and consistent with themselves."""

    def make(count):
        rng = np.random.default_rng(0)
        env_steps, rows = 0, []
        for episode in range(1, count + 1):
            rho = min(1.0, 0.02 * episode)
            length = int(np.clip(rng.normal(160 + 340 * min(1, episode / 60), 40), 10, 500))
            env_steps += length
            explored, vetoes = int(0.1 * length * rho), int(rng.poisson(3) * rho)
            learned = int(0.8 * length * rho)
            whole = length >= 500
            row = MetricsRow(
                episode, env_steps, float(length), 0.9 * length, length, not whole, whole, rho,
                0.1, length - learned - explored, learned, explored, 0, vetoes, vetoes // 2, 0,
                0, 0, 0, length // 2, length // 8, length // 4, 3 * (length - length // 2),
                length // 8,
                None if episode == 1 else 1 / episode, env_steps / 2000,
            )  # fmt: skip
            rows.append(row)
        return rows

    return make


@pytest.fixture
def make_metrics(tmp_path, make_rows):
    """Number of episodes → their columns, as they are read."""

    def make(count):
        with Table(tmp_path / f"made-up-{count}.csv", METRICS_COLUMNS) as table:
            for row in make_rows(count):
                table.append(row)
        return read_metrics(tmp_path / f"made-up-{count}.csv")

    return make
