"""Trials on the disk: what is written is read again, and half a trial is none."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from serp.errors import RunError
from serp.runs.comparison.measures import measure
from serp.runs.comparison.plan import EPISODE_COLUMNS, EVALUATION_COLUMNS, Trial
from serp.runs.comparison.trial import Measured
from serp.runs.comparison.trial_files import is_complete, read_trial, trial_folder, write_trial
from tests.serp.runs.comparison.contest import measured

TRIAL = Trial("serp", "walk", 3)
SETTINGS = {"arbiter": {"slack": float("inf")}}
METADATA = {"settings": SETTINGS}


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Measured:
    return measured(tmp_path_factory.mktemp("task"))


def test_what_is_written_is_read_again(tmp_path: Path, found: Measured) -> None:
    write_trial(tmp_path, TRIAL, found, METADATA)
    record = read_trial(tmp_path, TRIAL)
    assert record.trial == TRIAL
    assert list(record.episodes) == [*EPISODE_COLUMNS, "info.slips"]
    assert list(record.evaluations) == list(EVALUATION_COLUMNS)
    rows = [(*row, *counts) for row, counts in found.log.rows]
    for k, name in enumerate(record.episodes):
        assert record.episodes[name].tolist() == [row[k] for row in rows]
    for k, name in enumerate(record.evaluations):
        assert record.evaluations[name].tolist() == [row[k] for row in found.evaluations]
    kinds = {name: record.episodes[name].dtype.kind for name in ("terminated", "length", "outcome")}
    assert kinds == {"terminated": "b", "length": "i", "outcome": "U"}
    assert record.metadata["seconds"] == found.seconds
    text = (trial_folder(tmp_path, TRIAL) / "trial.json").read_text()
    json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


def test_a_trial_is_complete_with_its_last_file_and_replaces_half_a_trial(
    tmp_path: Path, found: Measured
) -> None:
    place = trial_folder(tmp_path, TRIAL)
    place.mkdir(parents=True)
    (place / "episodes.csv").write_text("half a li")
    (place / "left over").write_text("")
    assert not is_complete(tmp_path, TRIAL)
    write_trial(tmp_path, TRIAL, found, METADATA)
    names = ["episodes.csv", "evaluations.csv", "trial.json"]
    assert sorted(path.name for path in place.iterdir()) == names
    assert is_complete(tmp_path, TRIAL)
    (place / "trial.json").unlink()
    assert not is_complete(tmp_path, TRIAL)


def test_a_trial_of_an_earlier_version_lacks_what_was_not_counted(
    tmp_path: Path, found: Measured
) -> None:
    write_trial(tmp_path, TRIAL, found, METADATA)
    for name in ("episodes.csv", "evaluations.csv"):
        path = trial_folder(tmp_path, TRIAL) / name
        lines = [line.split(",") for line in path.read_text().splitlines()]
        at = lines[0].index("unsafe_observed")
        path.write_text("".join(",".join(line[:at] + line[at + 1 :]) + "\n" for line in lines))
    record = read_trial(tmp_path, TRIAL)
    values = measure(record, 100, None)
    assert values["unsafe"] == sum(row.unsafe for row, _ in found.log.rows)
    assert np.isnan(values["unsafe_observed"])


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("trial.json", "{", "trial.json is damaged"),
        ("trial.json", "[]", "trial.json is damaged"),
        ("trial.json", "{}", "trial.json is damaged: counters is not a list"),
        ("episodes.csv", None, "episodes.csv"),
        ("episodes.csv", "episode\n1\n", "episodes.csv"),
        ("evaluations.csv", ",".join(EVALUATION_COLUMNS) + "\n1,learner,1,good,2,1,,0,0\n",
         "evaluations.csv:2: return is 'good'"),
        ("evaluations.csv", ",".join(EVALUATION_COLUMNS) + "\n1,learner,1,1.0,2,x,,0,0\n",
         "evaluations.csv:2: terminated is 'x'"),
    ],
)  # fmt: skip
def test_what_is_damaged_is_named(
    tmp_path: Path, found: Measured, file: str, content: str | None, message: str
) -> None:
    write_trial(tmp_path, TRIAL, found, METADATA)
    place = trial_folder(tmp_path, TRIAL)
    (place / file).unlink()
    if content is not None:
        (place / file).write_text(content)
    with pytest.raises(RunError, match=message):
        read_trial(tmp_path, TRIAL)


def test_names_that_no_file_can_have_are_told_apart_and_stay_inside(tmp_path: Path) -> None:
    names = [
        "serp", "serp:learner.members=1", "serp:learner.members=2", "a/b", "a_b", "..", ".", "../x",
        "ä", "ö", "CON:", "x" * 300, "x" * 301, "a b", ".hidden", "learner.hidden=[8,8]",
    ]  # fmt: skip
    for trials in (
        [Trial(name, "walk", 0) for name in names],
        [Trial("serp", name, 0) for name in names],
    ):
        places = [trial_folder(tmp_path, trial) for trial in trials]
        assert len(set(places)) == len(names)
        for place in places:
            relative = place.relative_to(tmp_path)
            assert len(relative.parts) == 4 and ".." not in relative.parts
            place.mkdir(parents=True)
