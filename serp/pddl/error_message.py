"""The text of an error in a file: what is wrong, the line with carets below it, what to write."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

_LONG_QUOTE: Final = re.compile(r"`([^`]{160,})`")


class Excerpt(NamedTuple):
    """A line of a file, or what of a long one is around a column.

    Attributes:
        line: Number of the line, from 1.
        text: What is shown of it.
        caret: Position in the text, from 0, of what is wrong.
    """

    line: int
    text: str
    caret: int

    @classmethod
    def of(cls, line: int, text: str, column: int) -> Excerpt:
        """Return the excerpt of a line around a column, from 1."""
        most, at = 160, column - 1  # characters that a message shows
        if len(text) <= most:
            return cls(line, _visible(text), at)
        begin = max(0, min(at - most // 2, len(text) - most))
        end = begin + most
        before, after = ("... " if begin else ""), (" ..." if end < len(text) else "")
        shown = before + _visible(text[begin:end]) + after
        return cls(line, shown, at - begin + len(before))


def error_message(
    problem: str, excerpt: Excerpt | None, width: int, advice: str, corrected_line: str
) -> str:
    """Return the text of an error.

    Args:
        problem: Its first line, with the place.
        excerpt: The line of the place; None where there is none.
        width: Number of characters that are wrong.
        advice: What to do about it; may be empty.
        corrected_line: The line as it was meant; may be empty.
    """
    lines = [problem]
    if excerpt is not None:
        margin = f"{excerpt.line:>5} | "
        blank = " " * (len(margin) - 2) + "| "
        carets = "^" * max(1, min(width, len(excerpt.text) - excerpt.caret))
        lines += [margin + excerpt.text, blank + " " * excerpt.caret + carets]
    if advice:
        lines.append(f"  {advice}")
    if excerpt is not None and corrected_line:
        lines += ["  write", f"{excerpt.line:>5} | {corrected_line}"]
    return "\n".join(lines)


def printable(text: str) -> str:
    """Return a message without tabs and control characters, and without quotes of great length."""
    return _LONG_QUOTE.sub(lambda match: f"`{match[1][:80]} ... {match[1][-20:]}`", _visible(text))


def _visible(text: str) -> str:
    """Replace tabs and control characters, which would move the caret or drive the terminal."""
    return text if text.isprintable() else "".join(c if c.isprintable() else " " for c in text)
