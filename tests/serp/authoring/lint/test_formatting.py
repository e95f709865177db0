"""Formatting changes blanks only, once, and leaves what is shipped as it is."""

import re
from pathlib import Path
from random import Random

from hypothesis import given
from hypothesis import strategies as st

from serp.authoring.lint.formatting import formatted
from serp.pddl.source import Source
from tests.generated import FULL, examples, write_texts

ROOT = Path(__file__).parents[4]
TOKEN = re.compile(r";[^\n]*|[()]|[^\s();]+")
BLANKS = ("", " ", "  ", "\t", "\n", "\n\n\n", "\n   ", "\r\n      ", " ; remark\n", "\n;; (a\n")


def words(text):
    return [match.rstrip() for match in TOKEN.findall(text.replace("\r\n", "\n"))]


def test_what_is_shipped_stays_as_it_is():
    for path in sorted([*ROOT.glob("domains/*.pddl"), *ROOT.glob("docs/examples/**/*.pddl")]):
        assert formatted(Source.read(path)) == path.read_text()


@given(st.integers(0, 10_000), st.lists(st.sampled_from(BLANKS), min_size=1, max_size=60))
@examples(30)
def test_any_layout_becomes_a_regular_one_and_says_the_same(seed, blanks):
    domain = write_texts(Random(seed), FULL).domain
    text = ""
    for number, token in enumerate(TOKEN.findall(domain)):
        blank = blanks[number % len(blanks)]
        apart = text[-1:] in "()" or token[0] in "();"
        text += (blank if blank or apart else " ") + token + "\n" * token.startswith(";")
    once = formatted(Source("d.pddl", text))
    assert words(once) == words(text)
    assert formatted(Source("d.pddl", once)) == once
    assert not re.search(r"[ \t]+$|\n\n\n", once, re.MULTILINE)
