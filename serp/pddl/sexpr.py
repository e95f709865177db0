"""Reading PDDL text into nested lists that know their places."""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass

from serp.pddl.balance import Balance
from serp.pddl.source import DomainError, Place, Source

_BLANK = re.compile(r"(?:[ \t\r\n\f\v]+|;[^\r\n]*)*")
_TOKEN = re.compile(r"[()]|[^\s();]+")
_MAX_NESTING = 100
_FOREIGN_COMMENT = re.compile(r"//|#(?!t(?![a-z]))", re.IGNORECASE)
_KEYWORD_AHEAD = re.compile(r"\(\s*:[^\s();]+")


@dataclass(frozen=True, slots=True)
class Word:
    """A name, variable, keyword, operator or number, in lower case (PDDL knows no case)."""

    text: str
    place: Place


@dataclass(frozen=True, slots=True)
class Group:
    """A parenthesised list."""

    items: tuple[Node, ...]
    place: Place

    @property
    def head(self) -> str:
        """The first word, or the empty string where there is none."""
        return self.items[0].text if self.items and isinstance(self.items[0], Word) else ""


Node = Word | Group


@functools.lru_cache(maxsize=4)  # a file is looked at several times: parsed, then checked
def read_group(source: Source) -> Group:
    """Read the single parenthesised list that a PDDL file consists of."""
    open_groups: list[list[Node]] = []
    balance = Balance()
    top: Group | None = None
    position = 0
    text = source.text
    while (position := _BLANK.match(text, position).end()) < len(text):  # type: ignore[union-attr]
        match = _TOKEN.match(text, position)
        if match is None:
            raise DomainError(
                f"character U+{ord(text[position]):04X} is not an ordinary space",
                source.place(position, position + 1),
                "replace it with a space",
            )
        token = match[0]
        place = Place(source, position, match.end())
        position = match.end()
        if comment := _FOREIGN_COMMENT.match(token):
            raise DomainError(
                f"`{comment[0]}` does not begin a comment in PDDL",
                source.place(place.start, place.start + len(comment[0])),
                "comments begin with `;`",
                write=";",
            )
        if top is not None:
            raise _after_the_end(balance, place)
        if not open_groups and token != "(":
            if token == ")":
                raise DomainError("`)` without a `(` before it", place)
            raise DomainError(
                "text outside of parentheses", place, "a PDDL file begins with `(define`"
            )
        word = token.lower()
        begin = balance.open[-1].start if balance.open else place.start
        balance.see(word, place)
        if token == "(":
            open_groups.append([])
            if len(open_groups) > _MAX_NESTING:
                raise DomainError(f"nested deeper than {_MAX_NESTING} parentheses", place)
        elif token == ")":
            group = Group(tuple(open_groups.pop()), source.place(begin, place.end))
            if open_groups:
                open_groups[-1].append(group)
            else:
                top = group
        else:
            open_groups[-1].append(Word(word, place))
    if open_groups:
        raise balance.at_end()
    if top is None:
        raise DomainError(
            "the file holds no PDDL definition",
            source.place(0, 0),
            "a PDDL file begins with `(define`",
        )
    return top


def _after_the_end(balance: Balance, place: Place) -> DomainError:
    if keyword := _KEYWORD_AHEAD.match(place.source.text, place.start):
        return balance.too_many(f"`{keyword[0]}` in line {place.line} follows")
    return DomainError(
        "text after the end of the definition",
        place,
        "a file holds one `(define ...)`; look for one `)` too many before this place",
    )
