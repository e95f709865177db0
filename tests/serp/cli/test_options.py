"""Settings on the command line: `section.name=value`."""

from __future__ import annotations

import json
from typing import Any

import click
import pytest

from serp.cli.options import parse_settings
from serp.settings import resolve


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("3", 3),
        ("0.5", 0.5),
        ("-1e-3", -0.001),
        ("true", True),
        ("False", False),
        ("null", None),
        ("none", None),
        ("inf", float("inf")),
        ("[64, 64]", (64, 64)),
        ("observation", "observation"),
        ('"observation"', "observation"),
        ("a=b", "a=b"),
        ("[64", "[64"),
        ("", ""),
    ],
)
def test_values_are_json_where_they_can_be(text: str, value: Any) -> None:
    parsed = parse_settings([f"learner.hidden={text}"])["learner"]["hidden"]
    assert parsed == value
    assert type(parsed) is type(value)


def test_settings_of_several_sections_come_together() -> None:
    texts = ["planner.depth=7", " learner.double = false ", "planner.discount=0.9"]
    assert parse_settings(texts) == {
        "planner": {"depth": 7, "discount": 0.9},
        "learner": {"double": False},
    }


def test_every_setting_can_be_set_to_what_it_is() -> None:
    for preset in ("default", "paper"):
        settings = resolve(preset)
        texts = [
            f"{section}.{name}={value if value == 'inf' else json.dumps(value)}"
            for section, values in settings.as_dict().items()
            for name, value in values.items()
        ]
        assert resolve("default", None, parse_settings(texts)) == settings


@pytest.mark.parametrize("text", ["planner.depth", "depth=3", ".depth=3", "planner.=3", "=", ""])
def test_settings_of_another_form_are_usage_errors(text: str) -> None:
    with pytest.raises(click.UsageError, match="section.name=value"):
        parse_settings([text])


def test_a_setting_given_twice_is_a_usage_error() -> None:
    with pytest.raises(click.UsageError, match="twice"):
        parse_settings(["planner.depth=3", "planner.depth=4"])
