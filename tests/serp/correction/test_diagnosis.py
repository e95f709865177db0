from __future__ import annotations

import json
import math

import numpy as np
import pytest

from serp.correction.applied import predictions_with
from serp.correction.diagnosis import Diagnosis, make_diagnosis
from serp.correction.findings import Findings
from serp.correction.sample import predictions
from serp.domain.model import TransitionModel
from serp.runs.json_files import finite
from tests.serp.correction.truth import (
    fitted,
    found,
    literal,
    missing,
    recorded,
    states_of,
)


def diagnosed(model: TransitionModel, truth: Findings, told: Findings) -> Diagnosis:
    """The diagnosis that tells something of a world of which something else may be true."""
    states, actions = states_of(model, 400)
    after = predictions_with(model, truth, states, actions)
    estimated = predictions_with(model, told, states, actions)
    findings = fitted(told, model, states, actions, after, estimated)
    return make_diagnosis(recorded(model, states, actions, after), findings)


def test_errors_are_shares_of_the_change(model: TransitionModel) -> None:
    truth = found(literal(model, 0, 2.5, cost=0.01), literal(model, 3, 0.1, schema="cool"))
    diagnosis = diagnosed(model, truth, truth)
    sample = diagnosis.sample
    error = sample.next_states - predictions(model, sample.states, sample.actions)
    change = sample.next_states - sample.states
    off = np.sqrt(((error / sample.scale) ** 2).sum() / ((change / sample.scale) ** 2).sum())
    assert diagnosis.off == pytest.approx(off)
    assert 0.1 < diagnosis.off < 1.0
    assert diagnosis.off_found == pytest.approx(0.0, abs=1e-12)
    assert [row.cost for row in diagnosis.fits] == sorted(
        (row.cost for row in diagnosis.fits), reverse=True
    )
    first = diagnosis.fits[0]
    rows = sample.actions == model.action_index(first.action)
    column = [f.name for f in model.fluents].index(first.fluent)
    assert first.change == pytest.approx(np.sqrt(np.mean(change[rows, column] ** 2)))


def test_what_hardly_matters_is_told_apart(model: TransitionModel) -> None:
    truth = found(literal(model, 0, 2.5))
    error = diagnosed(model, truth, truth).error
    told = found(
        literal(model, 0, 2.5, cost=0.9 * error),
        missing(model, "battery ?r", {(): 1e-3}, cost=1e-4 * error),
    )
    diagnosis = diagnosed(model, truth, told)
    assert len(diagnosis.told) == 2
    (matters,) = diagnosis.matter
    assert diagnosis.share(matters) == pytest.approx(0.9)


def test_a_right_file_leaves_nothing_to_tell(model: TransitionModel) -> None:
    diagnosis = diagnosed(model, found(), found())
    assert diagnosis.off == diagnosis.off_found == 0.0
    assert diagnosis.told == diagnosis.matter == ()


def test_a_small_part_of_next_to_no_error_does_not_matter(model: TransitionModel) -> None:
    """However large a share of what little error there is."""
    nearly = found(literal(model, 0, 1.5 * (1 + 1e-5), error=1e-8))
    error = diagnosed(model, nearly, nearly).error
    told = found(literal(model, 0, 1.5 * (1 + 1e-5), error=1e-8, cost=error))
    diagnosis = diagnosed(model, nearly, told)
    assert diagnosis.share(diagnosis.told[0]) == 1.0
    assert diagnosis.matter == ()


def test_where_nothing_moves_nothing_is_said(model: TransitionModel) -> None:
    states, actions = states_of(model, 30)
    findings = fitted(found(), model, states, actions, states, states)
    diagnosis = make_diagnosis(recorded(model, states, actions, states), findings)
    assert math.isnan(diagnosis.off)
    assert diagnosis.matter == ()


def test_everything_is_in_the_json(model: TransitionModel) -> None:
    truth = found(
        literal(model, 0, 2.5), missing(model, "battery ?r", {("warmth",): 0.2}, cost=0.5)
    )
    shown = json.loads(json.dumps(finite(diagnosed(model, truth, truth).as_dict())))
    assert shown["steps"] == 400
    kinds = [f["kind"] for remark in shown["remarks"] for f in remark["findings"]]
    assert sorted(kinds) == ["literal", "missing"]
    pairs = len(model.actions) * len(model.fluents)
    assert len(shown["fits"]) == len(shown["monitor"]) == pairs
    worst = next(row for row in shown["monitor"] if row["worst"])["worst"][0]
    assert set(worst["state"]) == {f.name for f in model.fluents}


def test_the_table_has_a_row_for_each_action_and_fluent(model: TransitionModel) -> None:
    truth = found(literal(model, 0, 2.5))
    diagnosis = diagnosed(model, truth, truth)
    head, *rows = diagnosis.table()
    assert len(rows) == len(model.actions) * len(model.fluents)
    assert {len(row) for row in rows} == {len(head)}
    assert len({(row[0], row[1]) for row in rows}) == len(rows)
    cells = [dict(zip(head, row, strict=True)) for row in rows]
    for row in cells:  # the experience holds the whole run
        assert row["steps"] == row["run_steps"]
        assert row["rmse_written"] == pytest.approx(row["run_written_rmse"], abs=1e-12)
