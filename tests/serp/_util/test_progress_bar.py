"""The bar stands on a terminal only, and is worth no failure."""

from __future__ import annotations

import io
import sys

import pytest

from serp._util.progress_bar import bar


class Terminal(io.StringIO):
    """Keeps what is written; goes away when it is told to."""

    gone = False

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        if self.gone:
            raise BrokenPipeError
        return super().write(text)


def count(*, quiet: bool = False, gone: bool = False) -> None:
    with bar("corridor, policy serp", 3, quiet=quiet) as advance:
        for _ in range(3):
            if gone:
                sys.stderr.gone = True  # type: ignore[attr-defined]
            advance()


def test_on_a_terminal_every_piece_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    count()
    shown = terminal.getvalue()
    assert "corridor, policy serp" in shown
    assert all(f"{k}/3" in shown for k in range(4))


@pytest.mark.parametrize("where", ["quiet", "a file", "nowhere"])
def test_elsewhere_nothing_is_shown(where: str, monkeypatch: pytest.MonkeyPatch) -> None:
    stream = {"quiet": Terminal(), "a file": io.StringIO(), "nowhere": None}[where]
    monkeypatch.setattr(sys, "stderr", stream)
    count(quiet=where == "quiet")
    assert stream is None or stream.getvalue() == ""


def test_a_terminal_that_goes_away_ends_the_bar_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    count(gone=True)
