"""Changing a text in places."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.pddl.source import Edit, edited, indent_at, line_end, line_start

TEXTS = st.text("ab \n\r", max_size=40)


@given(TEXTS, st.data())
def test_everything_outside_the_edits_stays(text: str, data: st.DataObject) -> None:
    at = sorted(data.draw(st.lists(st.integers(0, len(text)), min_size=2, max_size=6)))
    edits = [Edit(a, b, "X" * k) for k, (a, b) in enumerate(zip(at[::2], at[1::2], strict=False))]
    expected, position = "", 0
    for edit in edits:
        expected += text[position : edit.start] + edit.text
        position = edit.end
    assert edited(text, edits) == expected + text[position:]
    assert edited(text, []) == text


def test_insertions_at_one_place_keep_their_order() -> None:
    assert edited("ab", [Edit(1, 1, "x"), Edit(1, 1, "y"), Edit(1, 2, "z")]) == "axyz"


@pytest.mark.parametrize("edits", [[Edit(0, 2, ""), Edit(1, 3, "")], [Edit(2, 9, "")]])
def test_edits_that_cannot_be_made_are_refused(edits: list[Edit]) -> None:
    with pytest.raises(ValueError, match="overlap"):
        edited("abcd", edits)


@given(TEXTS, st.data())
def test_lines_are_found(text: str, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(text)))
    start, end = line_start(text, at), line_end(text, at)
    assert start <= at
    assert "\n" not in text[start:at]
    assert start == 0 or text[start - 1] == "\n"
    assert "\n" not in text[at:end]
    indent = indent_at(text, at)
    assert not indent.strip() and text[start:].startswith(indent)
