"""The results of a run: a summary and a curve."""

from __future__ import annotations

import os

from serp.runs.folder import RunFolder
from serp.runs.results import write_results

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
