"""Pieces of Markdown: tables, escaped text and code blocks."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from serp._util.terminal import visible


def plain(text: object) -> str:
    """Return text escaped for Markdown, on one line, so that it also fits a table cell.

    Control and format characters become visible escapes.
    """
    line = visible(" ".join(str(text).split()))
    line = re.sub(r"([\\`*_\[\]<>|#&~$!])", r"\\\1", line)
    # These would begin a list or underline a heading.
    return re.sub(r"^(\d*)([-+.)](?= |$)|[-=]+$)", r"\1\\\2", line)


def sentence(text: object) -> str:
    """Return text as `plain` does, but with names between backticks as code."""
    return re.sub(
        r"\\`(?! )((?:[\w ()?.-]|\\_)+)(?<! )\\`",
        lambda name: "`" + name[1].replace("\\_", "_") + "`",
        plain(text),
    )


def table(head: Sequence[str], rows: Iterable[Sequence[str]], *, left: int = 1) -> str:
    """Return a table of Markdown cells; the first `left` columns are text, the others numbers."""
    marks = ["---"] * left + ["---:"] * (len(head) - left)
    lines = [head, marks, *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def code(text: str, language: str = "sh") -> str:
    """Return a code block, with control and format characters escaped."""
    text = visible(text)
    longest = max((len(run) for run in re.findall(r"`+", text)), default=0)
    fence = "`" * max(3, longest + 1)
    return f"{fence}{language}\n{text}\n{fence}"
