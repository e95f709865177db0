from __future__ import annotations

import csv
import io
import json
import math

import pytest

from serp.runs.comparison.export import comparison_json, episodes_csv, evaluations_csv, measures_csv
from serp.runs.comparison.measures import Results
from serp.runs.comparison.plan import EPISODE_COLUMNS
from tests.serp.runs.comparison.made_up import metadata, record, records, trial


def rows(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_measures_read_back_exactly():
    found = records(seeds=(0, 1))
    results = Results(found, metadata(found))
    read = rows(measures_csv(results))
    assert len(read) == len(found)
    for row, (one, values) in zip(read, results.measured.items(), strict=True):
        assert (row["algorithm"], row["variant"], int(row["seed"])) == one
        for measure in results.table:
            value, cell = values[measure.name], row[measure.name]
            assert math.isnan(value) if cell == "" else float(cell) == value


def test_episodes_of_all_trials_are_merged_and_read_back_exactly():
    odd = 'a "quoted", name\nof two lines'
    found = [
        record([0.1, 1e-17], info={"hits": [1, 2]}),
        record([1 / 3], trial=(odd, "base", 1), outcomes=["<goal>"]),
    ]
    read = rows(episodes_csv(found))
    assert list(read[0]) == ["algorithm", "variant", "seed", *EPISODE_COLUMNS, "info.hits"]
    assert [float(row["return"]) for row in read] == [0.1, 1e-17, 1 / 3]
    assert [row["info.hits"] for row in read] == ["1.0", "2.0", ""]
    assert (read[2]["algorithm"], read[2]["outcome"]) == (odd, "<goal>")
    assert {row["terminated"] for row in read} == {"1"}
    found = records(seeds=(0, 1))
    assert len(rows(evaluations_csv(found))) == sum(len(r.evaluations["return"]) for r in found)
    assert evaluations_csv([]).count("\n") == 1


def strict(text):
    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    return json.loads(text, parse_constant=refuse)


def test_json_is_strict_and_says_never():
    found = [*records(), trial("serp", 0, 5.0, variant="wrong"),
             trial("serp", 0, 5.0, variant="short", episodes=19)]  # fmt: skip
    results = Results(found, metadata(found))
    content = strict(comparison_json(results))
    short = content["statistics"]["short"]["serp"]["threshold_env_steps"]
    assert (short["never"], short["median"]) == (0, None)
    assert "Few seeds (1 to 4)" in content["caution"]
    assert content["statistics"]["base"]["dqn"]["threshold_env_steps"]["never"] == 4
    area = content["statistics"]["base"]["serp"]["training_area"]
    assert area["iqm"]["low"] <= area["iqm"]["value"] <= area["iqm"]["high"]
    assert area["mean"] == pytest.approx(90, abs=10)
    assert [row["variant"] for row in content["model_variants"]["rows"]] == [
        "base",
        "wrong",
        "short",
    ]
    assert {d["algorithm"] for d in content["differences"]} == {"mrp", "dqn"}


def test_json_of_no_trial_at_all_is_json():
    content = strict(comparison_json(Results([], metadata(records()))))
    assert len(content["missing"]) == len(records())
