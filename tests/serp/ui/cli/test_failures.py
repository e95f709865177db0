"""Exit statuses and messages."""

from __future__ import annotations

import errno
from collections.abc import Callable
from typing import Any

import click
import pytest

from serp.errors import RunError
from serp.ui.root import exit_with


def raising(error: BaseException) -> Callable[[], Any]:
    def run() -> None:
        raise error

    return run


def noted(error: Exception, note: str) -> Exception:
    error.add_note(note)
    return error


@pytest.mark.parametrize(
    ("error", "status", "message"),
    [
        (noted(RunError("no such run"), "Continue with"), 1, "Error: no such run\nContinue with\n"),
        (FileNotFoundError(2, "No such file", "x.svg"), 1, "Error: x.svg: No such file\n"),
        (OSError(errno.ENOSPC, "No space left"), 1,
         "Error: No space left (free some space, then try again)\n"),
        (click.UsageError("what?"), 2, "Error: what?\n"),
        (KeyboardInterrupt(), 130, "Stopped.\n"),
        (BrokenPipeError(errno.EPIPE, "Broken pipe"), 141, ""),
    ],
)  # fmt: skip
def test_what_the_user_can_mend_is_a_message(
    error: BaseException, status: int, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        exit_with(raising(error))
    assert end.value.code == status
    assert capfd.readouterr() == ("", message)


def test_a_bug_keeps_its_traceback() -> None:
    with pytest.raises(ZeroDivisionError):
        exit_with(raising(ZeroDivisionError()))


def test_an_unexpected_end_of_a_file_is_no_wish_to_stop() -> None:
    """`click` takes any EOFError for Ctrl-D at a prompt; a truncated file raises it, too."""
    aborted = click.Abort()
    aborted.__cause__ = EOFError("ran out of input")
    with pytest.raises(EOFError, match="ran out of input"):
        exit_with(raising(aborted))
