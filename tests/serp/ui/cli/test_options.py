"""Settings on the command line: `section.name=value`."""

from __future__ import annotations

import json
from typing import Any

import click
import pytest

from serp.settings import resolve
from serp.ui.options import parse_settings


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("3", 3),
        ("-1e-3", -0.001),
        ("true", True),
        ("none", None),
        ("inf", float("inf")),
        ("[64, 64]", (64, 64)),
        ("observation", "observation"),
        ("[64", "[64"),
    ],
)
def test_values_are_json_where_they_can_be(text: str, value: Any) -> None:
    parsed = parse_settings([f"learner.hidden={text}"])["learner"]["hidden"]
    assert parsed == value
    assert type(parsed) is type(value)


def test_every_setting_can_be_set_to_what_it_is() -> None:
    settings = resolve("paper")
    texts = [
        f"{section}.{name}={value if value == 'inf' else json.dumps(value)}"
        for section, values in settings.as_dict().items()
        for name, value in values.items()
    ]
    assert resolve("default", None, parse_settings(texts)) == settings


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        *(([text], "section.name=value") for text in ("planner.depth", "depth=3", ".depth=3", "")),
        (["planner.depth=3", " planner.depth = 4"], "planner.depth is given twice"),
    ],
)
def test_what_is_no_setting_is_a_usage_error(texts: list[str], said: str) -> None:
    with pytest.raises(click.UsageError, match=said):
        parse_settings(texts)
