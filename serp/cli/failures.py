"""How a command ends: its exit status, and a message instead of a traceback."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
import warnings
from collections.abc import Callable
from typing import Any, NoReturn

import click

from serp.errors import Notice, SerpError

DONE = 0
MISTAKE = 1
USAGE = 2
INTERRUPTED = 130  # 128 + SIGINT, as shells have it
PIPE_CLOSED = 141  # 128 + SIGPIPE


_as_ever = warnings.formatwarning


def exit_with(run: Callable[[], Any]) -> NoReturn:
    """Run a command and exit with its status.

    Args:
        run: Returns the status, or None for 0; may raise. A `SerpError` or an `OSError` is the
            user's to mend and becomes a message, followed by its notes; any other exception is a
            bug and keeps its traceback.
    """
    _write_whatever_comes()
    warnings.formatwarning = _one_line  # type: ignore[assignment]
    try:
        status = run()
        sys.stdout.flush()  # a reader that went away is noticed here, not when Python ends
    except click.ClickException as error:
        error.show()
        status = error.exit_code
    except (click.Abort, KeyboardInterrupt) as error:
        if isinstance(error.__cause__, EOFError):  # click takes any for the end of what is typed
            raise error.__cause__ from None
        say("Stopped.")
        status = INTERRUPTED
    except BrokenPipeError:
        _drop_output()
        status = PIPE_CLOSED
    except (SerpError, OSError) as error:
        if os.environ.get("SERP_DEBUG", "0") not in ("", "0"):
            raise
        message = str(error) if isinstance(error, SerpError) else _described(error)
        notes: list[str] = getattr(error, "__notes__", [])
        say(click.style("Error: ", fg="red", bold=True) + "\n".join([message, *notes]))
        status = MISTAKE
    sys.exit(status or DONE)


def say(text: str) -> None:
    """Write a line to standard error; no matter if nobody can read it."""
    with contextlib.suppress(OSError, ValueError):
        click.echo(text, err=True)


def _one_line(message: Warning | str, category: type[Warning], *rest: Any) -> str:
    """Format a warning: a notice in one line, any other as ever."""
    if issubclass(category, Notice):
        return f"Note: {message}\n"
    return _as_ever(message, category, *rest)


def _described(error: OSError) -> str:
    reason = error.strerror or str(error) or type(error).__name__
    if error.errno == errno.ENOSPC:
        reason += " (free some space, then try again)"
    return f"{error.filename}: {reason}" if error.filename else reason


def _write_whatever_comes() -> None:
    """Let output be replaced where the terminal's encoding has no such character."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def _drop_output() -> None:
    """Send what is still held for standard output nowhere, so that Python's end is quiet."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
