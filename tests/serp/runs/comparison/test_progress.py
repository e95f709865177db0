"""What is shown of a comparison's progress."""

from __future__ import annotations

import io
import re
import sys

import pytest

from serp.runs.comparison.plan import Trial
from serp.runs.comparison.workers import Display

TRIALS = [Trial("serp", "walk", 0), Trial("dqn", "walk", 0)]


def shown(display: Display) -> None:
    with display:
        display.notice(TRIALS[0], 10)
        display.end(TRIALS[0], None)
        display.end(TRIALS[1], "[bold]cable[/] cut")
        display.say("a line")


def test_a_line_a_trial_is_shown_where_there_is_no_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter(range(0, 1000, 60))
    monkeypatch.setattr("time.monotonic", lambda: next(clock))
    display = Display(TRIALS, 1_000, quiet=False)
    with monkeypatch.context() as patch:
        patch.setattr(Display, "_show", lambda self: None)
        shown(display)
    assert capsys.readouterr().err.splitlines() == [
        "[1/2] serp on walk, seed 0, about 1 min 00 s left",
        "[2/2] dqn on walk, seed 0: failed. [bold]cable[/] cut",
        "a line",
    ]


def test_quiet_shows_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    shown(Display(TRIALS, 1_000, quiet=True))
    captured = capsys.readouterr()
    assert captured.out == captured.err == ""


def test_a_bar_is_shown_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setenv("TERM", "xterm")
    shown(Display(TRIALS, 1_000, quiet=False))
    assert re.search(r"0 of 2 trials.*━", sys.stderr.getvalue())  # type: ignore[attr-defined]
