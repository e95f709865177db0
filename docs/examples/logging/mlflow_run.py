"""Log a training to MLflow: pip install mlflow, then run this script and `mlflow ui`.

By default everything goes into the file `mlflow.db` of the working directory; MLFLOW_TRACKING_URI
names a server.
"""

from __future__ import annotations

import os
from typing import Any

import mlflow

import serp

os.environ.setdefault("MLFLOW_TRACKING_URI", "sqlite:///mlflow.db")
mlflow.set_experiment("serp")

with mlflow.start_run(run_name="cartpole"):

    def on_episode(row: Any) -> None:
        """Log the columns of metrics.csv; what an episode lacks is left out."""
        numbers = {
            f"episode/{name.rstrip('_')}": float(number)
            for name, number in row._asdict().items()
            if number is not None
        }
        # Asynchronous, so that the training does not wait for the database.
        mlflow.log_metrics(numbers, step=row.env_steps, synchronous=False)

    run = serp.plan_and_learn("cartpole", env_steps=1000, out="runs/mlflow", on_episode=on_episode)
    mlflow.log_params(
        {
            f"{section}.{name}": value
            for section, values in run.config["settings"].items()
            for name, value in values.items()
        }
    )
    mlflow.flush_async_logging()
    mlflow.log_artifact(str(run.path / "summary.json"))
