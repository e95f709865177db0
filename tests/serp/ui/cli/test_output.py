"""JSON that other programs read."""

from __future__ import annotations

import json

import pytest

from serp.ui.output import print_json


def test_json_has_no_infinity(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"a": float("inf"), "b": [float("nan"), 1.5], "ρ": "ρ"})

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    read = json.loads(capsys.readouterr().out, parse_constant=refuse)
    assert read == {"a": None, "b": [None, 1.5], "ρ": "ρ"}
