"""Keys of the terminal that stand for commands of `serp play`."""

from __future__ import annotations

import contextlib
import os
import select
import sys
from collections.abc import Sequence
from typing import Any, Final

import click

RESERVED: Final = "?purshq:"
"""Keys of the commands themselves."""
_AUTOMATIC: Final = "123456789abcdefgijklmnotvwxyz"
_NAMED: Final = {
    "up": ("\x1b[A", "\x1bOA", "\xe0H"),
    "down": ("\x1b[B", "\x1bOB", "\xe0P"),
    "right": ("\x1b[C", "\x1bOC", "\xe0M"),
    "left": ("\x1b[D", "\x1bOD", "\xe0K"),
    "space": (" ",),
}
"""Name of a key → what terminals, and Windows, send for it."""
_SENT: Final = {sent: name for name, several in _NAMED.items() for sent in several}


def action_keys(actions: Sequence[str], given: str | None) -> dict[str, str]:
    """Return key → action: those that are given as `key=action,...`, else one after the other.

    Where there are more actions than keys, the last ones have none.

    Raises:
        BadParameter: A key or an action does not exist, or a key is taken.
    """
    if given is None:
        return dict(zip(_AUTOMATIC, actions, strict=False))
    keys: dict[str, str] = {}
    for text in given.split(","):
        key, equals, action = (part.strip() for part in text.partition("="))
        known = len(key) == 1 or key in _NAMED
        if not equals or not known or key in RESERVED or key in keys or action not in actions:
            raise click.BadParameter(
                f"`{text}`: expected key=action, such as a={actions[0]} or left={actions[0]}; keys "
                f"are characters but {' '.join(RESERVED)}, and {', '.join(_NAMED)}; actions are "
                + ", ".join(actions),
                param_hint="--keys",
            )
        keys[key] = action
    return keys


class Keyboard:
    """The keys of the terminal that standard input is; a context manager.

    While it is open, keys come at once and without an echo; none that is pressed meanwhile is lost.
    """

    def __enter__(self) -> Keyboard:
        """Let keys come at once."""
        self._before: list[Any] | None = None
        with contextlib.suppress(ImportError):  # Windows: click asks its console
            import termios
            import tty

            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin, termios.TCSADRAIN)
        return self

    def __exit__(self, *error: object) -> None:
        """Leave the terminal as it was."""
        if self._before is not None:
            import termios

            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def key(self) -> str:
        """Wait for a key; return its character or name, `enter` for the return key.

        Raises:
            KeyboardInterrupt: It was Ctrl-C.
            EOFError: It was Ctrl-D, or the terminal is gone.
        """
        sent = click.getchar() if self._before is None else self._sent()
        if sent in ("\r", "\n"):
            return "enter"
        return _SENT.get(sent, sent)

    def line(self, prompt: str) -> str:
        """Return a whole line, which the terminal lets its user edit."""
        self.__exit__()
        try:
            return input(prompt)
        finally:
            self.__enter__()

    def _sent(self) -> str:
        terminal = sys.stdin.fileno()
        sent = os.read(terminal, 1)
        if sent in (b"", b"\x04"):
            raise EOFError
        while sent[:1] == b"\x1b" and len(sent) < 3 and select.select([terminal], [], [], 0.05)[0]:
            sent += os.read(terminal, 1)
        while len(sent) < 4:
            try:
                return sent.decode()
            except UnicodeDecodeError:  # one of several bytes
                sent += os.read(terminal, 1)
        return sent.decode(errors="replace")
