"""The layout of PDDL text: indentation and blanks made regular, lines and comments kept.

Line breaks are the author's. A line that continues a form begins below the first thing that the
form holds if the author began it there, and otherwise two columns to the right of the line on which
the form begins. Comments keep their words, and beside a line their column if there is room.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from serp.pddl.reader import read_group
from serp.pddl.source import Source, newline_of

_LINE_END = re.compile(r"\r\n|\n|\r")
_TOKEN = re.compile(r"[()]|[^\s();]+")


def formatted(source: Source) -> str:
    """Return the text of a file in a regular layout; formatting it again changes nothing.

    Raises:
        DomainError: Its parentheses do not match, or it holds characters that PDDL does not have.
    """
    read_group(source)
    lines = [_TextLine.of(text) for text in _LINE_END.split(source.text)]
    _indent(lines)
    _place_comments(lines)
    texts = [line.text() for line in lines]
    single = [text for k, text in enumerate(texts) if text or (k and texts[k - 1])]
    return newline_of(source.text).join(single).strip("\r\n") + newline_of(source.text)


@dataclass
class _TextLine:
    """One line: its tokens with their columns, and its comment, which begins at a column `at`.

    `indent`, `code` and `new_at` are the line as it is to be.
    """

    tokens: list[tuple[str, int]]
    comment: str
    at: int
    indent: int = 0
    code: str = ""
    new_at: int = 0

    @classmethod
    def of(cls, text: str) -> _TextLine:
        code, mark, comment = text.partition(";")
        tokens = [(match[0], match.start()) for match in _TOKEN.finditer(code)]
        return cls(tokens, (mark + comment).rstrip(), len(code))

    def text(self) -> str:
        return self.code.ljust(self.new_at) + self.comment if self.comment else self.code


@dataclass
class _OpenForm:
    """A form that is open.

    `indent` is that of the line on which it begins; `below` are columns of things in it that lines
    may begin below: in the file → as they are to be.
    """

    indent: int
    items: int = 0
    below: dict[int, int] = field(default_factory=dict)

    def see(self, token: str, old: int, new: int, *, first: bool) -> None:
        """Take note of a word or form in it, which may be the first of its line."""
        self.items += 1
        if (self.items == 1 and token[0] in "?(") or (self.items == 2 and not first):
            self.below[old] = new


def _indent(lines: list[_TextLine]) -> None:
    """Find the indentation and the code of each line from the lines above it."""
    step = 2
    forms: list[_OpenForm] = []
    waiting: list[_TextLine] = []  # comments and blank lines, which go with what follows
    for line in lines:
        if not line.tokens:
            waiting.append(line)
            continue
        token, column = line.tokens[0]
        inside = forms[-1].indent + step if forms else 0
        if forms:
            line.indent = forms[-1].indent if token == ")" else forms[-1].below.get(column, inside)
        for above in waiting:
            above.indent = inside if token == ")" else line.indent
        waiting = []
        line.code = " " * line.indent
        for number, (token, old) in enumerate(line.tokens):
            if number and token != ")" and not line.code.endswith("("):
                line.code += " "
            if token == ")":
                forms.pop()
            elif forms:
                forms[-1].see(token, old, len(line.code), first=number == 0)
            if token == "(":
                forms.append(_OpenForm(line.indent))
            line.code += token


def _place_comments(lines: list[_TextLine]) -> None:
    """Find the columns of comments; a comment in the column of the one above continues it."""
    above: _TextLine | None = None  # has a comment that can be continued
    for line in lines:
        continues = above if above is not None and above.at == line.at else None
        if line.tokens:
            line.new_at = max(line.at, len(line.code) + 1)
        else:
            line.new_at = continues.new_at if continues is not None else line.indent
        above = line if line.comment and (line.tokens or continues) else None
