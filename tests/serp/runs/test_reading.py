from __future__ import annotations

import math

import numpy as np
import pytest

from serp.errors import RunError
from serp.runs.reading import count_decisions, read_metrics
from serp.runs.rows import DECISIONS_COLUMNS, METRICS_COLUMNS, MetricsRow
from serp.runs.tables import Table

ROW = MetricsRow(
    1, 23, 1 / 3, -0.0, 23, True, False, 0.01, None, 20, 1, 1, 1, 1, 1, 0, 0, None, 0.25
)


def write(path, rows):
    with Table(path, METRICS_COLUMNS) as table:
        for row in rows:
            table.append(row)


def test_columns_are_those_that_the_run_folder_promises():
    assert ",".join(METRICS_COLUMNS) == (
        "episode,env_steps,return,domain_return,length,terminated,truncated,rho,epsilon,"
        "planner_steps,learner_steps,exploration_steps,fallback_steps,vetoes,unsafe_predicted,"
        "unsafe_executed,no_safe_action,loss,wall_time"
    )
    assert ",".join(DECISIONS_COLUMNS) == (
        "step,episode,proposed_by,proposed,executed,executed_by,reason,vetoed,predicted_reward,"
        "proposal_unsafe,unsafe,risk,rho,explanation"
    )


def test_metrics_come_back_exactly_with_their_types(tmp_path):
    write(tmp_path / "m", [ROW, ROW._replace(episode=2, loss=0.1 + 0.2, terminated=False)])
    metrics = read_metrics(tmp_path / "m")
    assert tuple(metrics) == METRICS_COLUMNS
    assert metrics["episode"].dtype == np.int64
    assert metrics["terminated"].dtype == bool
    assert metrics["terminated"].tolist() == [True, False]
    assert metrics["return"].tolist() == [1 / 3, 1 / 3]
    assert math.copysign(1, metrics["domain_return"][0]) == -1
    assert np.isnan(metrics["epsilon"]).all()
    assert np.isnan(metrics["loss"][0]) and metrics["loss"][1] == 0.1 + 0.2


def test_wherever_the_file_is_cut_all_whole_rows_are_read_whatever_the_line_ends(tmp_path):
    write(tmp_path / "m", [ROW._replace(episode=e) for e in range(1, 4)])
    whole = (tmp_path / "m").read_bytes()
    header = whole.index(b"\n") + 1
    for length in range(header, len(whole)):
        (tmp_path / "m").write_bytes(whole[:length])
        expected = whole[:length].count(b"\n") - 1
        metrics = read_metrics(tmp_path / "m")
        assert metrics["episode"].tolist() == [1, 2, 3][:expected]
        assert metrics["episode"].dtype == np.int64 and metrics["rho"].dtype == np.float64
    (tmp_path / "m").write_bytes(whole.replace(b"\n", b"\r\n"))
    assert read_metrics(tmp_path / "m")["episode"].tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"\n2,", b"\ntwo,", r"m:3: episode is 'two'; it must be a whole number"),
        (b"\n2,", b"\n,", r"m:3: episode is ''; it must be a whole number"),
        (b"\n2,", b"\n99999999999999999999,", r"m:3: episode is .* fit into 64 bits"),
        (b"\n2,", b"\n2,2,", r"m:3: 20 cells where the header has 19"),
        (b"\n2,", b"\n\n2,", r"m:3: 0 cells where the header has 19"),
        (b"\n2,23,", b'\n2,"23,', r"m:3: unexpected end of data"),
        (b"\n2,23,", b"\n2,\xff,", r"m:3: not UTF-8"),
        (b",1,0,0.01,", b",yes,0,0.01,", r"m:2: terminated is 'yes'; it must be 0 or 1"),
        (b",0,0.01,", b",0,0.0.1,", r"m:2: rho is '0\.0\.1'; it must be a number"),
        (b"episode,", b"epsiode,", r"m:1: the columns are not episode, env_steps"),
    ],
)
def test_malformed_rows_are_named_by_file_and_line(tmp_path, old, new, message):
    path = tmp_path / "m"
    write(path, [ROW, ROW._replace(episode=2), ROW._replace(episode=3)])
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new, 1))
    with pytest.raises(RunError, match=message):
        read_metrics(path)


def test_files_that_are_no_tables_are_run_errors(tmp_path):
    with pytest.raises(RunError, match=r"cannot read .*: No such file"):
        read_metrics(tmp_path / "m")
    (tmp_path / "m").write_bytes(b"")
    with pytest.raises(RunError, match="is empty"):
        read_metrics(tmp_path / "m")
    (tmp_path / "m").write_bytes(b"\x89PNG\r")
    with pytest.raises(RunError, match="m:1: not UTF-8"):
        read_metrics(tmp_path / "m")


def test_a_decision_that_was_changed_by_hand_is_named(tmp_path):
    row = dict.fromkeys(DECISIONS_COLUMNS, 0) | {"reason": "proposal accepted", "vetoed": "no"}
    with Table(tmp_path / "d", DECISIONS_COLUMNS) as table:
        table.append(tuple(row.values()))
    with pytest.raises(RunError, match=r"d:2: vetoed is 'no'; it must be 0 or 1"):
        count_decisions(tmp_path / "d")
