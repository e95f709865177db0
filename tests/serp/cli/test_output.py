"""Numbers and tables as people read them."""

from __future__ import annotations

import json

import pytest

from serp._util.number_format import readable
from serp._util.text import plural
from serp.cli.output import open_console, print_json, print_table


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (float("nan"), "–"),
        (0.0, "0"),
        (-0.0, "0"),
        (0.261799, "0.2618"),
        (1234.5, "1,234"),
        (1234567, "1,234,567"),
        (1e300, "1e+300"),
        (float("-inf"), "-inf"),
    ],
)
def test_numbers(value: float | None, text: str) -> None:
    assert readable(value) == text


def test_plurals() -> None:
    assert [plural(n, "step") for n in (0, 1, 1200)] == ["0 steps", "1 step", "1,200 steps"]
    assert plural(2, "process", "processes") == "2 processes"


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
