"""Output to a terminal: text with control characters escaped, and a progress bar.

Names, comments, paths, reasons and messages come from untrusted files, settings and environments.
A control character in them could colour, move or hide text, or type commands; a format character
could reverse the order of letters. All text for a terminal passes `visible`.
"""

from __future__ import annotations

import contextlib
import functools
import re
import sys
import unicodedata
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any, Final, TextIO

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType
    from rich.segment import Segment
    from rich.text import Text


_HIDDEN: Final = ("Cc", "Cf", "Cs", "Zl", "Zp")  # control, format, surrogate, line separators
_ODD: Final = re.compile(r"[^\n\t\x20-\x7e\xa0-\xac\xae-\xff]")
"""Characters to check; the usual ones are excluded for speed."""


def visible(text: str) -> str:
    r"""Return a text with its control and format characters as escapes, such as `\x1b`, `\u202e`.

    Line feeds, tabs and existing escapes are kept.
    """
    return _ODD.sub(_shown, text)


def _shown(match: re.Match[str]) -> str:
    character = match.group()
    if unicodedata.category(character) not in _HIDDEN:
        return character
    return character.encode("unicode_escape").decode("ascii")


def open_console(stream: TextIO | None = None, **options: Any) -> Console:
    """Return a rich console without markup that escapes control characters.

    It writes to standard output by default, and raises BrokenPipeError if that is a closed pipe.
    """
    return _console_class()(file=stream, markup=False, highlight=False, emoji=False, **options)


@functools.cache
def _console_class() -> type[Console]:
    from rich.console import Console

    class VisibleConsole(Console):
        def render_str(self, text: str, **options: Any) -> Text:
            return super().render_str(visible(text), **options)

        def render(
            self, renderable: RenderableType, options: ConsoleOptions | None = None
        ) -> Iterable[Segment]:
            for segment in super().render(renderable, options):
                shown = segment.text if segment.control else visible(segment.text)
                yield segment._replace(text=shown)

        def on_broken_pipe(self) -> None:  # rich would end the process
            raise BrokenPipeError

    return VisibleConsole


@contextlib.contextmanager
def bar(title: str, total: int, *, quiet: bool = False) -> Iterator[Callable[[], None]]:
    """Show a progress bar on standard error, if that is a terminal, and not `quiet`.

    Yields a function to call after each of the `total` pieces of work.
    """
    if quiet or sys.stderr is None or not sys.stderr.isatty():
        yield lambda: None
        return
    from rich import progress as p

    name = p.TextColumn("{task.description}", markup=False)
    # No refresh thread: it would draw while the policy computes.
    shown = p.Progress(
        name, p.BarColumn(), p.MofNCompleteColumn(), p.TimeRemainingColumn(),
        console=open_console(sys.stderr), auto_refresh=False, transient=True,
    )  # fmt: skip
    task = shown.add_task(title, total=total)
    closed = contextlib.suppress(OSError, ValueError)  # of the terminal, must not end the work

    def advance() -> None:
        with closed:
            shown.update(task, advance=1, refresh=True)

    with closed:
        shown.start()
    try:
        yield advance
    finally:
        with closed:
            shown.stop()
