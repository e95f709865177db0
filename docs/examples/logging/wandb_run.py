"""Log a training to Weights & Biases: pip install wandb, then run this script.

WANDB_MODE=offline logs to the folder `wandb/` without an account.
"""

from __future__ import annotations

from typing import Any

import wandb

import serp

EVERY = 100
"""Env steps between two points of the numbers of single steps."""

with wandb.init(project="serp", name="cartpole") as log:
    # The metrics of an episode are plotted over env steps, not over calls of `log`.
    log.define_metric("env_steps")
    log.define_metric("episode/*", step_metric="env_steps")
    log.define_metric("step/*", step_metric="env_steps")
    steps = 0

    def on_step(step: Any) -> None:
        """Log a step now and then: its reward, and who acted."""
        global steps
        steps += 1
        if steps % EVERY == 0:
            decision = step.decision
            planner = float(decision.executed_by == "planner")
            numbers = {"reward": step.reward, "planner": planner, "rho": decision.rho}
            log.log({"env_steps": steps} | {f"step/{k}": v for k, v in numbers.items()})

    def on_episode(row: Any) -> None:
        """Log the columns of metrics.csv."""
        columns = {f"episode/{name.rstrip('_')}": n for name, n in row._asdict().items()}
        log.log(columns | {"env_steps": row.env_steps})

    run = serp.plan_and_learn(
        "cartpole", env_steps=1000, out="runs/wandb", on_step=on_step, on_episode=on_episode
    )
    log.config.update(run.config["settings"])
    log.summary.update(run.summary["return"])
    log.save(str(run.path / "summary.json"), base_path=str(run.path))
