from __future__ import annotations

from html import unescape

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt

from serp.comparison.markdown import (
    NOTHING,
    code,
    estimate_text,
    number,
    plain,
    spread_text,
    table,
    times_text,
)
from serp.comparison.statistics import Estimate, Times, times

READER = MarkdownIt("commonmark", {"html": False}).enable("table")
texts = st.text(st.characters(min_codepoint=1, max_codepoint=0x2FF), max_size=30)


@given(texts)
def test_any_text_is_shown_as_it_is_and_stays_in_its_cell(text):
    html = READER.render(table(["a", "b"], [[plain(text), "end"]], left=2))
    cells = html.split("<tbody>")[1].split("<td>")[1:]
    shown = [unescape(cell.split("</td>")[0]) for cell in cells]
    expected = "".join(c if c.isprintable() or c == "\xad" else "\ufffd" for c in text)
    if expected == text:  # control characters and odd blanks apart
        assert shown == [" ".join(text.split()), "end"]
    assert len(shown) == 2


@pytest.mark.parametrize("text", ["- a", "1. a", "+", "# a", "---", "===", "> a", "12)", "* a"])
def test_a_paragraph_of_plain_text_is_a_paragraph(text):
    assert READER.render(plain(text)) == f"<p>{text.replace('>', '&gt;')}</p>\n"


def test_ordinary_text_is_left_as_it_is():
    for text in ("0.97", "cartpole-no-gravity", "first 10 episodes (all)", "−5"):
        assert plain(text) == text


@given(texts)
def test_code_is_shown_letter_by_letter(text):
    text = text.replace("\r", " ").strip("\n")
    lines = [line for line in text.split("\n")]
    html = READER.render(code(text))
    assert html.startswith('<pre><code class="language-sh">')
    inner = unescape(html.split(">", 2)[2].rsplit("</code>", 1)[0])
    assert inner.split("\n")[: len(lines)] == lines


def test_numbers_have_the_digits_that_count():
    assert number(None) == number(float("nan")) == NOTHING
    assert number(12345.6) == "12,346"
    assert number(475.0) == "475"
    assert number(-0.12345) == "−0.123"
    assert number(np.inf) == "∞"


def test_estimates_share_their_decimals():
    assert estimate_text(Estimate(482.123, 471.0, 495.26)) == "482.1 [471.0, 495.3]"
    assert estimate_text(Estimate(1.5, None, None), signed=True) == "+1.50"
    assert estimate_text(Estimate(-0.001, -50.0, 50.0), signed=True) == "0.0 [−50.0, +50.0]"
    assert estimate_text(None) == estimate_text(Estimate(np.nan, None, None)) == NOTHING
    assert spread_text(480.31, 12.06) == "480.3 ± 12.1"


def test_never_is_counted():
    assert times_text(times([])) == NOTHING
    assert times_text(times([np.inf] * 3)) == "never (3 of 3)"
    assert times_text(Times(np.inf, np.inf, np.inf, 9, 10)) == "never (9 of 10)"
    assert times_text(Times(5000.0, 4000.0, np.inf, 2, 10)) == (
        "5,000 [4,000, never], never in 2 of 10"
    )
    assert times_text(times([700.0])) == "700"
    assert times_text(times([np.nan], too_few=1)) == "too few episodes"
    assert times_text(times([np.nan, 700.0], too_few=1)) == "700, too few episodes in 1"
    assert times_text(times([np.nan, np.inf], too_few=1)) == "never (1 of 1), too few episodes in 1"
