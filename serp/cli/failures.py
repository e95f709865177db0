"""How a command ends: its exit status, and a message instead of a traceback."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import signal
import sys
import warnings
from collections.abc import Callable
from typing import Any, NoReturn

import click

from serp._util.terminal import visible
from serp.errors import Notice, SerpError, with_notes

DONE = 0
MISTAKE = 1
PIPE_CLOSED = 141  # 128 + SIGPIPE

_default_format = warnings.formatwarning


def stopped_by(stop: BaseException) -> int:
    """Return the status of a command that a signal stopped."""
    return 128 + int(getattr(stop, "signal", signal.SIGINT))


def exit_with(run: Callable[[], Any]) -> NoReturn:
    """Run a command, which returns its status or None for 0, and exit with it.

    A `SerpError` or an `OSError`, which the user can fix, becomes a message, followed by its notes;
    any other exception is a bug and keeps its traceback.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # what the terminal's encoding lacks is replaced
            stream.reconfigure(errors="replace")
    warnings.formatwarning = _one_line  # type: ignore[assignment]
    try:
        status = run()
        if not status and not sys.stdout.closed:  # a server closes what it has served
            sys.stdout.flush()  # a closed pipe is noticed here, not when Python ends
    except click.ClickException as error:
        with io.StringIO() as shown:
            error.show(shown)
            say(shown.getvalue().rstrip("\n"))
        status = error.exit_code
    except (click.Abort, KeyboardInterrupt) as stop:
        if isinstance(stop.__cause__, EOFError):  # click takes any for the end of what is typed
            raise stop.__cause__ from None
        say("Stopped.")
        status = stopped_by(stop)
    except (SerpError, OSError) as error:
        if _is_closed_output(error):
            _discard_output()
            sys.exit(PIPE_CLOSED)
        if os.environ.get("SERP_DEBUG", "0") not in ("", "0"):
            raise
        message = str(error) if isinstance(error, SerpError) else _described(error)
        say(with_notes(error, message), head="Error: ")
        status = MISTAKE
    _discard_output()
    sys.exit(status or DONE)


def say(text: str, head: str = "") -> None:
    """Write a line to standard error after a head in red; do nothing if it is closed."""
    with contextlib.suppress(OSError, ValueError):
        click.echo(click.style(head, fg="red", bold=True) * bool(head) + visible(text), err=True)


def _one_line(message: Warning | str, category: type[Warning], *rest: Any) -> str:
    """Format a warning: a notice in one line, any other as Python does."""
    if issubclass(category, Notice):
        return f"Note: {visible(str(message))}\n"
    return visible(_default_format(message, category, *rest))


def _described(error: OSError) -> str:
    reason = error.strerror or str(error) or type(error).__name__
    if error.errno == errno.ENOSPC:
        reason += " (free some space, then try again)"
    return f"{error.filename}: {reason}" if error.filename else reason


def _is_closed_output(error: Exception) -> bool:
    """Whether an error says that the pipe or the terminal that was written to is closed."""
    gone = isinstance(error, OSError) and error.errno == errno.EIO and error.filename is None
    return gone or isinstance(error, BrokenPipeError)


def _discard_output() -> None:
    """Discard output that cannot be written, so that Python ends quietly and with our status."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            try:
                stream.flush()
            except OSError:
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
