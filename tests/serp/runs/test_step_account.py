"""The account of a recorded step is that of the decision that was made."""

import csv
from pathlib import Path

import numpy as np
import pytest

from serp.agent.decision import Reason
from serp.errors import RunError
from serp.runs.run_model import RunModel
from serp.runs.step_account import (
    account_of_step,
    clock,
    most_telling,
    what_came,
    what_would_differ,
    who_acted,
)
from tests.serp.runs.runs import train
from tests.serp.sample_tasks import corridor

MOVES = {"left": -1.0, "right": 1.0, "wait": 0.0}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunModel:
    folder = tmp_path_factory.mktemp("review")
    train(corridor(folder), folder / "run", "paper", episodes=12)
    return RunModel(folder / "run")


def test_the_account_has_what_was_decided_and_logged(
    run: RunModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("serp.runs.step_account.agreeing_planner", lambda *_: None)  # it takes long
    recording = run.recording()
    with open(run.path / "decisions.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(recording)
    reasons = set()
    for number, row in enumerate(rows):
        made = account_of_step(run, recording, number)
        shown, decision = made.as_dict(), made.step.decision
        for name in ("proposed_by", "proposed", "executed", "executed_by", "reason"):
            assert row[name] == shown[name]
        assert (int(row["episode"]), float(row["rho"])) == (shown["episode"], shown["rho"])
        taken, forecast = made.account.taken, recording.step(number).decision.forecast
        assert taken is not None and taken.name == shown["executed"]
        assert [each.best_return for each in made.account.alternatives] == forecast.value.tolist()
        amounts = [cause.amount or 0.0 for cause in taken.causes if cause.what == "reward"]
        assert sum(amounts) == pytest.approx(taken.reward or 0.0)
        assert taken.reward is None or taken.reward == float(row["predicted_reward"])
        recorded = recording.step(number)
        if made.domain_reward is not None:
            assert (made.domain_reward, made.unsafe) == (recorded.domain_reward, recorded.unsafe)
            parts = [cause.amount or 0.0 for cause in made.observed if cause.what == "reward"]
            assert sum(parts) == pytest.approx(made.domain_reward)
            assert ("unsafe" in {cause.what for cause in made.observed}) == made.unsafe
        if made.predictions:
            (x,) = made.predictions
            moved = MOVES.get(taken.name) if taken.applicable else None
            assert x.predicted == (None if moved is None else x.before + moved)
            assert made.domain_reward is not None
            assert x.predicted is None or (x.error == 0.0) == (x.predicted == x.observed)
        lines = " ".join([*who_acted(made), *what_came(made)])
        if made.predictions and made.domain_reward is not None:
            assert ("than the file says" in lines) == (
                shown["reward"] != pytest.approx(made.domain_reward, rel=0.01)
            )
        assert taken.name in lines
        if decision.reason is Reason.UNSAFE:
            assert f"proposed {made.proposed}" in lines and "event pit" in lines
        reasons.add(decision.reason)
    assert {Reason.PLANNER_TURN, Reason.ACCEPTED, Reason.UNSAFE} <= reasons


def test_what_would_have_had_to_differ_is_right(run: RunModel) -> None:
    recording = run.recording()
    step, because = most_telling(recording)
    assert because == "the last refused proposal that was applicable"
    made = account_of_step(run, recording, step)
    assert (
        made.step.decision.vetoed
        and made.other_vetoes is not None
        and made.other_choices is not None
    )
    (flip,) = made.other_vetoes.changes
    state = recording.step(step).state
    ground = run.model.action_index(made.proposed)
    nearer = flip.becomes + float(np.sign(state[0] - flip.becomes))  # x is a whole number
    for value, refused in ((flip.becomes, False), (nearer, True)):
        outcome = run.model.step(np.array([value]), ground)
        assert (outcome.unsafe or not outcome.applicable) == refused
    assert abs(flip.becomes - state[0]) <= np.ptp(recording.ranges)
    assert f"{made.proposed} would not have been refused" in what_would_differ(made)[0]
    assert "Planned again with the file as written" in what_would_differ(made)[-1]


def test_a_recording_of_another_domain_is_refused(run: RunModel, tmp_path: Path) -> None:
    header = run.path / "recording" / "recording.json"
    text = header.read_text()
    try:
        header.write_text(text.replace('"x"', '"y"'))
        with pytest.raises(RunError, match="does not fit the domain"):
            run.recording()
    finally:
        header.write_text(text)


def test_times_are_read_as_on_a_clock() -> None:
    times = {0.0: "0:00", 12.46: "0:12.46", 192.5: "3:12.5", 3792.0: "1:03:12"}
    assert {time: clock(time) for time in times} == times
