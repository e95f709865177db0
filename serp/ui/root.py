"""`serp` itself: its help, its version and its commands, each imported when it is used."""

from __future__ import annotations

import contextlib
import errno
import functools
import io
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any, NoReturn

import click

from serp import __version__
from serp._util.did_you_mean import closest, listed
from serp._util.terminal import visible
from serp.errors import Interrupted, Notice, SerpError, with_notes
from serp.ui.output import examples

_default_format = warnings.formatwarning


def stopped_by(stop: BaseException) -> int:
    """Return the status of a command that a signal stopped."""
    return 128 + int(getattr(stop, "signal", signal.SIGINT))


def exit_with(run: Callable[[], Any]) -> NoReturn:
    """Run a command, which returns its status or None for 0, and exit with it.

    A `SerpError` or an `OSError`, which the user can fix, becomes a message, followed by its notes,
    as does a signal that stopped it; any other exception is a bug and keeps its traceback.
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
            text = shown.getvalue().rstrip("\n").replace("a valid integer range", "a whole number")
        if "unexpected extra argument" in text:
            text += "; options name what a command works on, such as --domain NAME"
        say(text)
        status = error.exit_code
    except (click.Abort, KeyboardInterrupt) as abort:
        stop = abort.__cause__ or abort  # click replaces what it was
        if isinstance(stop, EOFError):  # click takes any for the end of what is typed
            raise stop from None
        say(with_notes(stop, "Stopped."))
        status = stopped_by(stop)
    except Interrupted as stop:
        say(with_notes(stop))
        status = stopped_by(stop)
    except (SerpError, OSError) as error:
        if _is_closed_output(error):
            _discard_output()
            sys.exit(141)  # 128 + SIGPIPE
        if os.environ.get("SERP_DEBUG", "0") not in ("", "0"):
            raise
        message = str(error) if isinstance(error, SerpError) else _described(error)
        say(with_notes(error, message), head="Error: ")
        status = 1
    _discard_output()
    sys.exit(status or 0)


def say(text: str, head: str = "") -> None:
    """Write a line to standard error after a head in red; do nothing if it is closed."""
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()  # what was printed before stands before it
    with contextlib.suppress(OSError, ValueError):
        click.echo(click.style(head, fg="red", bold=True) * bool(head) + visible(text), err=True)


@contextlib.contextmanager
def working(on: str) -> Iterator[None]:
    """Say on a terminal what a command works on, where the body takes more than 2 s."""
    timer = threading.Timer(2.0, say, (f"{on} ...",))
    timer.daemon = True
    if sys.stderr.isatty():
        timer.start()
    try:
        yield
    finally:
        timer.cancel()


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


SECTIONS = {
    "Your domain file": {
        "new": "files", "check": "check", "format": "files", "lsp": "files", "plan": "plan",
        "play": "play", "test": "test", "studio": "files",
    },
    "Training": {
        "plan-and-learn": "plan_and_learn", "compare": "trials", "tune": "trials", "list": "list",
    },
    "After training": {
        "why": "trained", "report": "trained", "evaluate": "trained", "watch": "trained",
        "diagnose": "diagnosis", "repair": "diagnosis", "export": "trained",
    },
}  # fmt: skip
"""Section of the help → command, in the order of use → its module in `serp.ui.commands`."""
COMMANDS = {name: module for section in SECTIONS.values() for name, module in section.items()}
"""Command → its module."""


class LazyGroup(click.Group):
    """The commands of `COMMANDS`, each imported when it is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order in which they are of use."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a command; None where there is none of that name."""
        if cmd_name not in COMMANDS:
            return None
        module = import_module(f"serp.ui.commands.{COMMANDS[cmd_name]}")
        command: click.Command = getattr(module, cmd_name.replace("-", "_"))
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that the arguments begin with, or say which one may be meant."""
        if args[0] not in COMMANDS and not args[0].startswith("-"):
            close = closest(args[0], COMMANDS)
            known = f"did you mean `{close}`?" if close else f"there are {listed(COMMANDS, 99)}"
            raise click.UsageError(f"there is no command `{args[0]}`; {known}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write a table of commands for each section, each with the first line of its help."""
        width = max(map(len, COMMANDS))
        for head, names in SECTIONS.items():
            commands = ((name, self.get_command(ctx, name)) for name in names)
            with formatter.section(head):
                formatter.write_dl([
                    (name.ljust(width), command.get_short_help_str(limit=100))
                    for name, command in commands if command is not None
                ])  # fmt: skip

    def main(self, *arguments: Any, standalone_mode: bool = True, **options: Any) -> Any:
        """Run a command; in standalone mode errors become messages, and the process exits."""
        run = functools.partial(super().main, *arguments, standalone_mode=False, **options)
        return exit_with(run) if standalone_mode else run()


@click.group(
    cls=LazyGroup,
    epilog=examples(
        "serp plan-and-learn --domain cartpole",
        "serp plan --domain cartpole --svg decision.svg",
        "serp plan --help",
    )
    + "\n\nExit status: 0 done; 1 a file, a name or the environment is wrong, and the message says "
    "what; 2 the command line is wrong; 128 + n stopped by signal n (130: Ctrl-C). With "
    "SERP_DEBUG=1 an error shows its traceback.",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, prog_name="serp", message="%(prog)s %(version)s")
def serp() -> None:
    """From an expert's PDDL file to a safe, explained, trained policy."""
