"""Whatever a text holds, a terminal shows it and does nothing else."""

import contextlib
import io
import re
import unicodedata
from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st

from serp._util.terminal import open_console, visible
from serp.runs.comparison.pool import progress
from serp.runs.progress import Progress
from serp.runs.run_config import Budget
from serp.ui.output import print_table
from serp.ui.root import say
from tests.serp.runs.test_progress import Terminal

HOSTILE = "a\x1b]0;owned\x07b\x9b2Jc\u202ed\u2066e\r\x7f\u2028\U000e0041[red]f[/red]"
SHOWN = r"a\x1b]0;owned\x07b\x9b2Jc\u202ed\u2066e\r\x7f\u2028\U000e0041[red]f[/red]"
HIDDEN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2028\u2066-\u2069\U000e0041]")


@given(st.text())
def test_nothing_hidden_is_left_and_what_is_shown_is_left_alone(text):
    shown = visible(text)
    assert not [
        c for c in shown
        if c not in "\n\t" and unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp")
    ]  # fmt: skip
    assert visible(shown) == shown
    kept = [c for c in text if unicodedata.category(c)[0] in "LMNPS" or c in " \n\t"]
    assert [c for c in shown if c in kept] or not kept


def without_codes(text):
    """What a terminal shows, without rich's own styles and movements."""
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]|\r", "", text)


def test_no_way_out_passes_control_characters_or_markup_on(capsys):
    terminal = Terminal()
    console = open_console(terminal, force_terminal=True, width=200)
    console.print(HOSTILE)
    with contextlib.redirect_stdout(terminal):
        print_table(("", HOSTILE), [("", HOSTILE)])
    lines = io.StringIO()
    for stream in (terminal, lines):
        Progress(SimpleNamespace(env_steps=0), Budget(), "", stream=stream).note(HOSTILE)
    say(HOSTILE, head="Error: ")
    with progress("comparing", quiet=False) as line:
        line(HOSTILE)
    error = capsys.readouterr().err
    assert error.count(SHOWN) == 2
    for written in (terminal.getvalue(), lines.getvalue(), error):
        assert not HIDDEN.search(without_codes(written))
    assert without_codes(terminal.getvalue()).count(SHOWN) >= 4
    assert SHOWN in lines.getvalue()
