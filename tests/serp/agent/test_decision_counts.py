"""The numbers that a run says of its decisions follow from `decisions.csv`, wherever said."""

import json
from collections import Counter

import pytest

from serp.agent.decision import Actor, Reason
from serp.runs.train import plan_and_learn
from tests.serp.runs.runs import rows
from tests.serp.sample_tasks import corridor

QUICK = {"planner": {"depth": 2}, "training": {"random_steps": 20}}
SETTINGS = {
    "default": {},
    "paper": {"arbiter": {"rho": 0.5}},
    "vetoes": {
        "arbiter": {"rho": 1.0, "r_min": 0.0},
        "guide": {"strategy": "mixture"},
        "learner": {"epsilon_steps": 0, "epsilon_end": 0.0},
    },
    "unmodelled refused": {
        "arbiter": {"unmodelled": "veto", "rho": 1.0, "r_min": -1},
        "guide": {"strategy": "mixture"},
    },
}


def counted(decisions):
    """Count decisions in the words of the docs."""
    none_safe = (Reason.NO_SAFE_ACTION, Reason.LEAST_RISK)
    return {
        **{f"{a.value}_steps": sum(d["executed_by"] == a.value for d in decisions) for a in Actor},
        "vetoes": sum(d["vetoed"] == "1" for d in decisions),
        "unsafe_predicted": sum(d["proposal_unsafe"] == "1" for d in decisions),
        "unsafe_executed": sum(d["unsafe"] == "1" for d in decisions),
        "no_safe_action": sum(d["reason"] in none_safe for d in decisions),
        "saw_all": sum(d["bound"] == "exhausted" for d in decisions),
        "by_cells": sum(d["bound"] in ("cells", "unknown") for d in decisions),
        "cut_short": sum(d["bound"] == "nodes" for d in decisions),
        "safety_alone": sum(d["bound"] == "safety" for d in decisions),
        "layers_seen": sum(int(d["depth"]) for d in decisions if d["bound"] != "exhausted"),
        "indifferent": sum(d["indifferent"] == "1" for d in decisions),
    }


@pytest.mark.parametrize("name", SETTINGS)
def test_every_number_of_a_run_is_a_sum_over_its_decisions(name, tmp_path):
    changes = SETTINGS[name]
    run = plan_and_learn(
        corridor(tmp_path), preset="paper" if name == "paper" else "default", episodes=12, seed=1,
        settings={s: {**QUICK.get(s, {}), **changes.get(s, {})} for s in {**QUICK, **changes}},
        out=tmp_path / "run", quiet=True,
    )  # fmt: skip
    decisions = rows(run.path, "decisions")
    for row in rows(run.path, "metrics"):
        own = [d for d in decisions if d["episode"] == row["episode"]]
        assert {column: int(row[column]) for column in counted(own)} == counted(own)
        assert len(own) == int(row["length"])
    summary = json.loads((run.path / "summary.json").read_text())
    assert summary["env_steps"] == len(decisions)
    planned = [d for d in decisions if d["bound"] != "safety"]
    for column, count in counted(decisions).items():
        if column.endswith("_steps"):
            share = summary["shares"][column.removesuffix("_steps")]
            assert share == pytest.approx(count / len(decisions))
        elif column in ("saw_all", "by_cells", "cut_short", "indifferent"):
            share = summary["sight"][column]
            assert share == (pytest.approx(count / len(planned)) if planned else None)
        elif column == "safety_alone":
            assert summary["sight"][column] == pytest.approx(count / len(decisions))
        elif column == "layers_seen":
            partial = sum(d["bound"] != "exhausted" for d in planned)
            depth = summary["sight"]["mean_depth"]
            assert depth == (pytest.approx(count / partial) if partial else None)
        else:
            assert summary[column] == count
    vetoed = [d for d in decisions if d["vetoed"] == "1"]
    assert summary["vetoes_by_reason"] == dict(Counter(d["reason"] for d in vetoed))
    # A veto is a proposal of somebody else than the planner that was not accepted.
    for d in decisions:
        refused = d["proposed_by"] != "planner" and d["reason"] != Reason.ACCEPTED.value
        assert (d["vetoed"] == "1") == refused
