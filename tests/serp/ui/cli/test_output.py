"""Tables and JSON."""

from __future__ import annotations

import json

import pytest

from serp.ui.output import open_console, print_json, print_table


def test_tables_in_a_pipe_are_neither_cut_nor_padded(capsys: pytest.CaptureFixture[str]) -> None:
    long = "word " * 100 + "end"
    print_table(open_console(), ("name", "text"), [("a", long), ("[b]", "")], right=(0,))
    lines = capsys.readouterr().out.splitlines()
    assert lines[2] == f"   a   {long}"
    assert lines[3] == " [b]"
    assert len(lines) == 4


def test_json_has_no_infinity(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"a": float("inf"), "b": [float("nan"), 1.5], "ρ": "ρ"})

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    read = json.loads(capsys.readouterr().out, parse_constant=refuse)
    assert read == {"a": None, "b": [None, 1.5], "ρ": "ρ"}
