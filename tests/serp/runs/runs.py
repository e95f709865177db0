"""Runs of the corridor on the disk, and what they leave behind."""

import csv
import json
from pathlib import Path

from serp.runs.checkpoint import CHECKPOINT, load
from serp.runs.recording import RECORDING
from serp.runs.train import plan_and_learn

EPISODES = 12
CHANGES = {
    "paper": {"training": {"random_steps": 25}, "arbiter": {"rho_increment": 0.05}},
    "default": {"arbiter": {"r_min": -1.0}, "learner": {"updates_per_step": 0.7}},
}


def train(task, out, preset="default", **options):
    return plan_and_learn(
        task, preset=preset, settings=CHANGES[preset], seed=3, out=out, quiet=True, **options
    )


def resume(task, out, **options):
    """Continue with nothing but the folder: settings, seed and domain are the run's own."""
    return plan_and_learn(task, out=out, resume=True, quiet=True, **options)


def rows(folder, table):
    """A table of a run, but for the time it took."""
    with open(Path(folder) / f"{table}.csv", newline="") as file:
        return [{**row, "wall_time": ""} for row in csv.DictReader(file)]


def everything(folder):
    """Whatever a run has left behind, but for the time it took."""
    arrays, meta = load(folder / CHECKPOINT)
    del meta["wall_time"], meta["tables"]  # whose digests are of times, too
    return (
        rows(folder, "metrics"),
        (folder / "decisions.csv").read_bytes(),
        {file.name: file.read_bytes() for file in sorted((folder / RECORDING).iterdir())},
        {name: (a.dtype, a.shape, a.tobytes()) for name, a in sorted(arrays.items())},
        json.dumps(meta, sort_keys=True),
    )


def half(file):
    """Cut a file in the middle."""
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2])
