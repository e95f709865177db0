"""Pieces of Markdown: tables, and text that is shown as it is, whatever it holds."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from serp._util.terminal import visible


def plain(text: object) -> str:
    """Return text that Markdown shows as it stands, in one cell of a table too.

    Control and format characters, which have no picture, become escapes.
    """
    line = visible(" ".join(str(text).split()))
    line = re.sub(r"([\\`*_\[\]<>|#&~$!])", r"\\\1", line)
    # What would begin a list or underline a heading.
    return re.sub(r"^(\d*)([-+.)](?= |$)|[-=]+$)", r"\1\\\2", line)


def table(head: Sequence[str], rows: Iterable[Sequence[str]], *, left: int = 1) -> str:
    """Return a table of finished Markdown cells: `left` columns of texts, the rest numbers."""
    marks = ["---"] * left + ["---:"] * (len(head) - left)
    lines = [head, marks, *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def code(text: str, language: str = "sh") -> str:
    """Return a block of text that is shown letter by letter, but for what `visible` escapes."""
    text = visible(text)
    longest = max((len(run) for run in re.findall(r"`+", text)), default=0)
    fence = "`" * max(3, longest + 1)
    return f"{fence}{language}\n{text}\n{fence}"
