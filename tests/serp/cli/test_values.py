"""`section.name=value` and `fluent=value`."""

from __future__ import annotations

from typing import Any

import click
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.cli.options import parse_settings
from serp.cli.state import parse_state
from serp.errors import SerpError
from serp.settings import resolve
from tests.generated.profile import examples

KNOWN = {"x": True, "at robot1 kitchen": False}


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
            f"{section}.{name}={'inf' if value == 'inf' else click.unstyle(_json(value))}"
            for section, values in settings.as_dict().items()
            for name, value in values.items()
        ]
        assert resolve("default", None, parse_settings(texts)) == settings


def _json(value: Any) -> str:
    import json

    return json.dumps(value)


@pytest.mark.parametrize("text", ["planner.depth", "depth=3", ".depth=3", "planner.=3", "=", ""])
def test_settings_of_another_form_are_usage_errors(text: str) -> None:
    with pytest.raises(click.UsageError, match="section.name=value"):
        parse_settings([text])


def test_a_setting_given_twice_is_a_usage_error() -> None:
    with pytest.raises(click.UsageError, match="twice"):
        parse_settings(["planner.depth=3", "planner.depth=4"])


def test_fluents_are_named_as_pddl_has_them() -> None:
    texts = ["X=1.5,( at  Robot1 kitchen )=true"]
    assert parse_state(texts, KNOWN) == {"x": 1.5, "at robot1 kitchen": 1.0}


@pytest.mark.parametrize(("text", "value"), [("true", 1), ("False", 0), ("1", 1), ("0", 0)])
def test_predicates_are_true_or_false(text: str, value: float) -> None:
    assert parse_state([f"at robot1 kitchen={text}"], KNOWN) == {"at robot1 kitchen": value}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("y=1", "unknown fluent `y`"),
        ("at robot1 kitche=1", "did you mean `at robot1 kitchen`?"),
        ("x=fast", "`x` is a finite number, not `fast`"),
        ("x=nan", "`x` is a finite number, not `nan`"),
        ("x=true", "`x` is a finite number, not `true`"),
        ("at robot1 kitchen=2", "`at robot1 kitchen` is true or false, not `2`"),
        ("x=1,x=2", "`x` is given twice"),
        ("road a b=true", "`road a b` is fixed by the problem file"),
    ],
)
def test_wrong_fluents_are_named(text: str, message: str) -> None:
    with pytest.raises(SerpError) as error:
        parse_state([text], KNOWN, static=["road a b"])
    assert message in str(error.value)


def test_a_state_of_another_form_is_a_usage_error() -> None:
    with pytest.raises(click.UsageError, match="fluent=value"):
        parse_state(["x"], KNOWN)


@examples(200)
@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_number_survives(value: float) -> None:
    assert parse_state([f"x={value!r}"], KNOWN) == {"x": value}
