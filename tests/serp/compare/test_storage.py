"""Trials on the disk: what is written is read again, and half a trial is none."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from serp.compare.records import EPISODE_COLUMNS, EVALUATION_COLUMNS, Trial
from serp.compare.storage import (
    digest,
    is_complete,
    read_about,
    read_trial,
    trial_folder,
    write_trial,
)
from serp.errors import RunError
from tests.serp.compare.contest import measured

TRIAL = Trial("serp", "walk", 3)
ABOUT = {"env_steps": 130, "settings": {"arbiter": {"slack": float("inf")}}, "seconds": {"t": 1.5}}


def written(tmp_path: Path, trial: Trial = TRIAL) -> Path:
    write_trial(tmp_path, trial, measured(tmp_path), ABOUT, ("slips",))
    return trial_folder(tmp_path, trial)


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    found = measured(tmp_path)
    write_trial(tmp_path, TRIAL, found, ABOUT, ("slips",))
    record = read_trial(tmp_path, TRIAL)
    assert record.trial == TRIAL
    assert list(record.episodes) == [*EPISODE_COLUMNS, "info.slips"]
    assert list(record.evaluations) == list(EVALUATION_COLUMNS)
    rows = [(*row, *counts) for row, counts in found.log.rows]
    for k, name in enumerate(record.episodes):
        assert record.episodes[name].tolist() == [row[k] for row in rows]
    for k, name in enumerate(record.evaluations):
        assert record.evaluations[name].tolist() == [row[k] for row in found.evaluations]
    assert record.episodes["terminated"].dtype == np.bool_
    assert record.episodes["length"].dtype == np.int64
    assert record.episodes["outcome"].dtype.kind == "U"
    assert (record.about["env_steps"], record.about["seconds"]) == (130, {"t": 1.5})
    text = (trial_folder(tmp_path, TRIAL) / "trial.json").read_text()
    json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


def test_a_trial_without_an_episode_is_one_too(tmp_path: Path) -> None:
    found = measured(tmp_path)
    found.log.rows.clear()
    found.evaluations.clear()
    write_trial(tmp_path, TRIAL, found, ABOUT, ())
    record = read_trial(tmp_path, TRIAL)
    assert {len(values) for values in record.episodes.values()} == {0}
    assert {len(values) for values in record.evaluations.values()} == {0}
    assert record.episodes["env_steps"].dtype == np.int64


def test_it_is_complete_only_when_its_last_file_is_there(tmp_path: Path) -> None:
    place = written(tmp_path)
    assert is_complete(tmp_path, TRIAL)
    assert not is_complete(tmp_path, TRIAL._replace(seed=4))
    (place / "trial.json").unlink()
    assert not is_complete(tmp_path, TRIAL)


def test_what_an_interrupted_one_left_is_cleared_away(tmp_path: Path) -> None:
    place = trial_folder(tmp_path, TRIAL)
    place.mkdir(parents=True)
    (place / "episodes.csv").write_text("half a li")
    (place / "left over").write_text("")
    written(tmp_path)
    assert sorted(p.name for p in place.iterdir()) == [
        "episodes.csv", "evaluations.csv", "trial.json",
    ]  # fmt: skip
    assert len(read_trial(tmp_path, TRIAL).episodes["episode"]) > 0


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("trial.json", "{", "trial.json is damaged"),
        ("trial.json", "[]", "trial.json is damaged"),
        ("episodes.csv", None, "episodes.csv"),
        ("episodes.csv", "episode\n1\n", "episodes.csv"),
        ("evaluations.csv", ",".join(EVALUATION_COLUMNS) + "\n1,learner,1,good,2,1,,0\n",
         "evaluations.csv:2: return is 'good'"),
        ("evaluations.csv", ",".join(EVALUATION_COLUMNS) + "\n1,learner,1,1.0,2,x,,0\n",
         "evaluations.csv:2: terminated is 'x'"),
    ],
)  # fmt: skip
def test_what_is_damaged_is_named(
    tmp_path: Path, file: str, content: str | None, message: str
) -> None:
    place = written(tmp_path)
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
            assert len(relative.parts) == 4
            assert ".." not in relative.parts
            place.mkdir(parents=True)
    assert len(list((tmp_path / "trials").glob("*/*/*"))) == 2 * len(names)


def test_a_digest_tells_apart_and_nothing_else(tmp_path: Path) -> None:
    values: list[dict[str, Any]] = [
        {"a": 1}, {"a": 2}, {"a": "1"}, {"a": 1.5}, {"b": 1}, {"a": [1]}, {"a": None},
        {"a": {"b": 1}}, {"a": True},
    ]  # fmt: skip
    digests = [digest(value) for value in values]
    for (k, one), (n, other) in itertools.combinations(enumerate(digests), 2):
        assert one != other, (values[k], values[n])
    assert digest({"a": 1, "b": (2, 3)}) == digest({"b": [2, 3], "a": 1})


def test_what_a_trial_says_of_itself_can_be_read_alone(tmp_path: Path) -> None:
    place = written(tmp_path)
    (place / "episodes.csv").unlink()
    about = read_about(tmp_path, TRIAL)
    assert (about["algorithm"], about["variant"], about["seed"]) == TRIAL
