"""The comment that an expert wrote at a place of a file.

A comment belongs to what begins on its line; further lines of comment that begin in the same column
continue it. Without one, the comment lines right above belong to the place, unless one of them has
a rule (`; -----`): they are the head of a section then. A blank line ends what belongs together.
"""

from __future__ import annotations

import re
from typing import Final

from serp.pddl.source import Place, Source

_RULE: Final = re.compile(r"^[;\s]*[-=~*_#+]{3,}|[-=~*_#+]{3,}\s*$")
"""Marks of a line that is drawn through a file."""
_SILENCE: Final = re.compile(r"\bserp:[ \t]*ignore(-file)?(\[[^\]]*\])?")
"""What is said to `serp check`, not to people."""


def comment_of(place: Place) -> str:
    """Return the comment of a place in one line, without its semicolons; empty where none is."""
    source, line = place.source, place.line
    begins_it = not source.line_text(line)[: place.column - 1].strip()
    return _beside(source, line) or (_above(source, line) if begins_it else "")


def _beside(source: Source, line: int) -> str:
    """Return the comment after the text of a line, and what continues it below."""
    code, mark, text = source.line_text(line).partition(";")
    if not mark or not code.strip():
        return ""
    texts, column = [text], len(code)
    for below in range(line + 1, len(source.line_starts) + 1):
        blank, mark, text = source.line_text(below).partition(";")
        if not mark or blank.strip() or len(blank) != column:
            break
        texts.append(text)
    return _joined(texts)


def _above(source: Source, line: int) -> str:
    """Return the lines of comment that end right above a line; empty for the head of a section."""
    texts: list[str] = []
    columns: list[int] = []
    above = line - 1
    while above >= 1:
        code, mark, text = source.line_text(above).partition(";")
        if not mark or code.strip():
            if mark and all(column == len(code) for column in columns):
                return ""  # they continue the comment beside that line
            break
        texts.insert(0, text)
        columns.append(len(code))
        above -= 1
    if any(_RULE.search(text) for text in texts):
        return ""
    return _joined(texts)


def _joined(texts: list[str]) -> str:
    said = (_SILENCE.sub("", text).lstrip(";").split() for text in texts)
    return " ".join(map(" ".join, said)).strip()
