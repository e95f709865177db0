"""Markdown shows any text as it is, where it belongs."""

from __future__ import annotations

from html import unescape

from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt

from serp._util.terminal import visible
from serp._util.text import code, markdown_text, table

READER = MarkdownIt("commonmark", {"html": False}).enable("table")
texts = st.text(st.characters(min_codepoint=1, max_codepoint=0x2FF), max_size=30)


@given(texts)
def test_any_text_is_shown_as_it_is_and_stays_in_its_cell(text):
    html = READER.render(table(["a", "b"], [[markdown_text(text), "end"]], left=2))
    cells = html.split("<tbody>")[1].split("<td>")[1:]
    shown = [unescape(cell.split("</td>")[0]) for cell in cells]
    assert shown == [visible(" ".join(text.split())), "end"]


def test_plain_text_is_a_paragraph_and_ordinary_text_is_left_as_it_is():
    for text in ("- a", "1. a", "+", "# a", "---", "===", "> a", "12)", "* a"):
        assert READER.render(markdown_text(text)) == f"<p>{text.replace('>', '&gt;')}</p>\n"
    for text in ("0.97", "cartpole-no-gravity", "first 10 episodes (all)", "−5"):
        assert markdown_text(text) == text


@given(texts)
def test_code_is_shown_letter_by_letter(text):
    text = text.strip("\n")
    lines = visible(text).split("\n")
    html = READER.render(code(text))
    assert html.startswith('<pre><code class="language-sh">')
    inner = unescape(html.split(">", 2)[2].rsplit("</code>", 1)[0])
    assert inner.split("\n")[: len(lines)] == lines
