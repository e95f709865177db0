"""Every number that a run says of itself follows from `decisions.csv`, wherever it is said."""

from __future__ import annotations

import csv
import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from serp.control.decision import Actor, Reason
from serp.training.plan_and_learn import plan_and_learn
from serp.training.run import Run
from tests.serp.sample_tasks import corridor

QUICK = {"planner": {"depth": 2}, "training": {"checkpoint_seconds": 9e9, "random_steps": 20}}
SETTINGS: dict[str, tuple[str, dict[str, dict[str, Any]]]] = {
    "paper": ("paper", {"arbiter": {"rho": 0.5}}),
    "default": ("default", {}),
    "planner after a veto": ("default", {"arbiter": {"after_veto": "planner", "rho": 0.7}}),
    "learner after a veto": (
        "default", {"arbiter": {"after_veto": "learner", "rho": 1.0, "r_min": 0.0},
                    "learner": {"epsilon_start": 0.0, "epsilon_end": 0.0}},
    ),
    "unmodelled refused": ("default", {"arbiter": {"unmodelled": "veto", "rho": 1.0, "r_min": -1}}),
    **{
        strategy: ("default", {"guide": {"strategy": strategy}})
        for strategy in (
            "jump-start", "argmax-q", "restrict", "imitate-then-learn", "residual", "dqfd",
        )
    },
}  # fmt: skip


def train(name: str, folder: Path) -> Run:
    preset, changes = SETTINGS[name]
    merged = {s: {**QUICK.get(s, {}), **changes.get(s, {})} for s in {**QUICK, **changes}}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("serp._util.figures.render", lambda figure, kind: b"")
        return plan_and_learn(
            corridor(folder), preset=preset, settings=merged, episodes=12, seed=1,
            out=folder / "run",
        )  # fmt: skip


def table(path: Path) -> list[dict[str, str]]:
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def counted(decisions: list[dict[str, str]]) -> dict[str, int]:
    """Count decisions in the words of the docs."""
    return {
        **{f"{a.value}_steps": sum(d["executed_by"] == a.value for d in decisions) for a in Actor},
        "vetoes": sum(d["vetoed"] == "1" for d in decisions),
        "unsafe_predicted": sum(d["proposal_unsafe"] == "1" for d in decisions),
        "unsafe_executed": sum(d["unsafe"] == "1" for d in decisions),
        "no_safe_action": sum(
            d["reason"] in (Reason.NO_SAFE_ACTION, Reason.LEAST_RISK) for d in decisions
        ),
    }


@pytest.mark.parametrize("name", SETTINGS)
def test_every_number_of_a_run_is_a_sum_over_its_decisions(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = train(name, tmp_path)
    console = capsys.readouterr().err
    decisions, metrics = table(run.path / "decisions.csv"), table(run.path / "metrics.csv")
    summary = json.loads((run.path / "summary.json").read_text())
    report = (run.path / "report.md").read_text()
    counts = counted(decisions)
    # Metrics, an episode at a time.
    for row in metrics:
        own = [d for d in decisions if d["episode"] == row["episode"]]
        assert {column: int(row[column]) for column in counts} == counted(own)
        assert len(own) == int(row["length"])
    # The summary.
    assert summary["env_steps"] == len(decisions)
    for column, count in counts.items():
        if column.endswith("_steps"):
            share = summary["shares"][column.removesuffix("_steps")]
            assert share == pytest.approx(count / len(decisions))
        else:
            assert summary[column] == count
    reasons = Counter(d["reason"] for d in decisions if d["vetoed"] == "1")
    assert summary["vetoes_by_reason"] == dict(reasons)
    # The report.
    for reason, count in reasons.items():
        escaped = reason.replace("_", r"\_")
        assert f"| {escaped} | {count:,} |" in report
    assert ("There were none." in report) == (not reasons)
    for what, column in (
        ("proposals vetoed", "vetoes"),
        ("proposals flagged unsafe or too risky", "unsafe_predicted"),
        ("executed actions flagged unsafe", "unsafe_executed"),
        ("no safe action was left to choose", "no_safe_action"),
    ):
        assert f"| {what} | {counts[column]:,} |" in report
    # Of how many episodes the means are: there were 12.
    assert "(first 10 episodes)" in report and "(last 12)" in report
    assert "mean of the last 12 episodes" in report
    # The last line of the console.
    last = console.strip().splitlines()[-1]
    assert f"step {len(decisions):,}, " in last
    assert f", {summary['steps_per_second']:,.0f} steps/s" in last
    assert summary["steps_per_second"] == len(decisions) / float(metrics[-1]["wall_time"])
    assert f"vetoes {counts['vetoes']:,}, unsafe executed {counts['unsafe_executed']:,}" in last
    # A veto is a proposal of somebody else than the planner that was not accepted.
    for d in decisions:
        refused = d["proposed_by"] != "planner" and d["reason"] != Reason.ACCEPTED.value
        assert (d["vetoed"] == "1") == refused
    if name.endswith("after a veto"):
        answered = {d["executed_by"] for d in decisions if d["vetoed"] == "1"}
        assert name.split()[0] in answered
