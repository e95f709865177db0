"""The account of a recorded step is that of the decision that was made."""

from types import SimpleNamespace

import numpy as np
import pytest

from serp.agent.decision import Actor, Reason
from serp.errors import RunError
from serp.runs.recording import ACTORS, REASONS
from serp.runs.run import Run
from serp.runs.step_account import (
    account_of_step,
    most_telling,
    what_came,
    what_would_differ,
    who_acted,
)
from tests.serp.runs.runs import rows, train
from tests.serp.sample_tasks import corridor

MOVES = {"left": -1.0, "right": 1.0, "wait": 0.0}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("review")
    train(corridor(folder), folder / "run", "paper", episodes=12)
    return Run(folder / "run")


def test_the_account_has_what_was_decided_and_logged(run, monkeypatch):
    monkeypatch.setattr("serp.runs.step_account.agreeing_planner", lambda *_: None)  # it takes long
    recording = run.recording()
    decisions = rows(run.path, "decisions")
    assert len(decisions) == len(recording)
    reasons = set()
    for number, row in enumerate(decisions):
        made = account_of_step(run, recording, number)
        shown, decision = made.as_dict(), made.step.decision
        for name in ("proposed_by", "proposed", "executed", "executed_by", "reason"):
            assert row[name] == shown[name]
        assert (int(row["episode"]), float(row["rho"])) == (shown["episode"], shown["rho"])
        taken, forecast = made.account.taken, recording.step(number).decision.forecast
        assert taken is not None and taken.name == shown["executed"]
        returns = [each.best_return for each in made.account.alternatives]
        np.testing.assert_array_equal(returns, forecast.value)  # NaN where nothing was planned
        assert taken.reward is None or taken.reward == float(row["predicted_reward"])
        recorded = recording.step(number)
        if made.domain_reward is not None:
            assert (made.domain_reward, made.unsafe) == (recorded.domain_reward, recorded.unsafe)
            parts = [cause.amount or 0.0 for cause in made.observed if cause.what == "reward"]
            assert sum(parts) == pytest.approx(made.domain_reward)
        if made.predictions:
            (x,) = made.predictions
            moved = MOVES.get(taken.name) if taken.applicable else None
            assert x.predicted == (None if moved is None else x.before + moved)
            assert x.predicted is None or (x.error == 0.0) == (x.predicted == x.observed)
        lines = " ".join([*who_acted(made), *what_came(made)])
        if decision.reason is Reason.UNSAFE:
            assert f"proposed {made.proposed}" in lines and "event pit" in lines
        reasons.add(decision.reason)
    assert {Reason.PLANNER_TURN, Reason.ACCEPTED, Reason.UNSAFE} <= reasons


def test_what_would_have_had_to_differ_is_right(run):
    recording = run.recording()
    step, because = most_telling(recording)
    assert because == "the last refused proposal that was applicable"
    made = account_of_step(run, recording, step)
    assert made.step.decision.vetoed
    (flip,) = made.other_vetoes.changes
    state = recording.step(step).state
    ground = run.model.action_index(made.proposed)
    nearer = flip.becomes + float(np.sign(state[0] - flip.becomes))  # x is a whole number
    for value, refused in ((flip.becomes, False), (nearer, True)):
        outcome = run.model.step(np.array([value]), ground)
        assert (outcome.unsafe or not outcome.applicable) == refused
    assert abs(flip.becomes - state[0]) <= np.ptp(recording.ranges)
    assert f"{made.proposed} would not have been refused" in what_would_differ(made)[0]


def test_a_proposal_that_was_executed_anyway_was_not_refused():
    reasons = [Reason.UNSAFE, Reason.NO_SAFE_ACTION, Reason.ACCEPTED]
    columns = {"proposed": np.array([0, 1, 1]), "action": np.ones(3), "unsafe": np.zeros(3, bool)}
    columns["reason"] = np.array([REASONS.index(reason) for reason in reasons])
    columns["proposed_by"] = np.full(3, ACTORS.index(Actor.LEARNER))
    assert most_telling(SimpleNamespace(columns=lambda *names: columns))[0] == 0


def test_a_recording_of_another_domain_is_refused(run, tmp_path):
    header = run.path / "recording" / "recording.json"
    text = header.read_text()
    try:
        header.write_text(text.replace('"x"', '"y"'))
        with pytest.raises(RunError, match="does not fit the domain"):
            run.recording()
    finally:
        header.write_text(text)
