"""Settings on the command line: `section.name=value`."""

from __future__ import annotations

import json

import click
import pytest

from serp.settings import resolve
from serp.ui.options import parse_settings


def test_every_setting_can_be_set_to_what_it_is() -> None:
    settings = resolve("paper")
    texts = [
        f"{section}.{name}={value if value == 'inf' else json.dumps(value)}"
        for section, values in settings.as_dict().items()
        for name, value in values.items()
    ]
    assert resolve("default", None, parse_settings(texts)) == settings
    given = parse_settings(["planner.name=none", "learner.hidden=[64", "arbiter.r_min=-1e-3"])
    assert given == {
        "planner": {"name": None}, "learner": {"hidden": "[64"}, "arbiter": {"r_min": -0.001},
    }  # fmt: skip


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
