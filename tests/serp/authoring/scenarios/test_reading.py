"""Scenario files: what they can say, and where what is wrong is."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.authoring.scenarios import syntax as s
from serp.authoring.scenarios.reading import read_scenarios
from serp.model.domain import Domain
from serp.pddl.source import DomainError, Source
from tests.worlds import text

DOMAIN = Domain.parse(Source("lamp.pddl", text("lamp")), observed=True)


def read(text):
    return read_scenarios(Source("lamp.scenarios", text), DOMAIN, DOMAIN.model)


def test_a_situation_begins_with_another_one_and_changes_it():
    first, second = read(
        "; comment\nscenario A warm hall ; comment\n  (lit hall)\n  (heat) = 2.5\n  allows wait\n\n"
        "scenario the same without light\n  like a warm hall\n  not (lit hall)\n  allows wait\n"
    )
    assert first.title == "A warm hall"
    assert first.given == {"lit hall": 1.0, "heat": 2.5}
    assert second.given == {"lit hall": 0.0, "heat": 2.5}


@given(st.decimals(-1000, 1000, places=3), st.integers(0, 3))
def test_about_a_number_are_those_that_round_to_it(number, places):
    written = f"{number:.{places}f}"
    bounds = s.Bounds.about(written, None)
    half = 0.5 * 10.0**-places
    assert float(written) in bounds
    assert float(written) + 0.99 * half in bounds
    assert float(written) - 1.01 * half not in bounds
    assert s.Bounds.about(written, 2.0).most == float(written) + 2.0


@pytest.mark.parametrize(
    ("line", "column", "problem"),
    [
        ("(heatt) = 1", 3, "there is no `(heatt)`\n.*\n.*\n  did you mean `heat`?"),
        ("(heat) 1", 10, "expected `=`, found `1`"),
        ("heat = 1", 3, "expectation begins with `heat`\n.*\n.*\n.*: `(heat) = 1`"),
        ("(lit hall) = 1", 3, "true or false\n.*\n.*\n  write\n.*(lit hall)"),
        ("not (heat)", 3, "is a number"),
        ("(unsafe)", 3, "every step resets it"),
        ("like another", 3, "there is no scenario `another` above"),
        ("like step 3 of", 17, "expected the folder of a run"),
        ("chooses wat", 11, "there is no action `wat`\n.*\n.*\n  did you mean `wait`?"),
        ("refuses wait as unsafe", 11, "write `because` before a reason"),
        ("refuses wait because dull", 24, "not a reason"),
        ("value of wait is 3", 20, "expected `about`, `at least` or `at most`, found `3`"),
        ("after 0 steps (heat) is about 1", 9, "write 1 to 10,000 steps"),
        ("is indifferent now", 18, "does not belong to this expectation"),
    ],
)
def test_what_is_wrong_in_a_line_is_located(line, column, problem):
    with pytest.raises(DomainError, match=problem.replace("(", r"\(").replace(")", r"\)")) as told:
        read(f"scenario one\n  {line}\n  allows wait\n")
    assert (told.value.line, told.value.column) == (2, column)


def test_all_that_is_wrong_is_told_at_once_and_nothing_that_follows_from_it():
    with pytest.raises(DomainError) as told:
        read(
            "allows wait\nscenario\n  allows wit\nscenario one\n  choses wait\n"
            "scenario two\n  like one\n  (heat)\n  allows wait\nscenario three\n"
            "scenario TWO\n  allows wait\n  (heat) = 1\nscenario four\n  (heat) = 1\n  like two\n"
            "  allows wait\n"
        )
    messages = (str(told.value), *told.value.__notes__)
    wrong = {
        "1:1": "before the first scenario",
        "2:1": "has no title",
        "3:10": "no action `wit`",
        "5:3": "did you mean `chooses`",
        "8:9": "expected `=`",
        "10:1": "has no expectation",
        "11:1": "two scenarios",
        "13:3": "this line describes the situation",
        "16:3": "must be the first line",
    }
    for message, (place, problem) in zip(messages, wrong.items(), strict=True):
        assert message.startswith(f"lamp.scenarios:{place}: ") and problem in message
