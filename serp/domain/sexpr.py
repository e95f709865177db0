"""Reading PDDL text into nested lists that know their places."""

from __future__ import annotations

import re
from dataclasses import dataclass

from serp.domain.source import DomainError, Place, Source

_TOKEN = re.compile(r"[ \t\r\n\f\v]+|;[^\r\n]*|(?P<mark>[()])|(?P<word>[^\s();]+)")
_MAX_NESTING = 100


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


def read_group(source: Source) -> Group:
    """Read the single parenthesised list that a PDDL file consists of.

    Raises:
        DomainError: The text is empty, a parenthesis is missing or left over, or the nesting is
            deeper than 100.
    """
    open_groups: list[tuple[int, list[Node]]] = []
    top: Group | None = None
    position = 0
    text = source.text
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            raise DomainError(
                f"character U+{ord(text[position]):04X} is not an ordinary space",
                source.place(position, position + 1),
                "replace it with a space",
            )
        place = source.place(match.start(), match.end())
        position = match.end()
        if match["mark"] is None and match["word"] is None:
            continue
        if top is not None:
            raise DomainError(
                "text after the end of the definition",
                place,
                "a file holds one `(define ...)`; look for one `)` too many before this place",
            )
        if match["mark"] == "(":
            open_groups.append((place.start, []))
            if len(open_groups) > _MAX_NESTING:
                raise DomainError(f"nested deeper than {_MAX_NESTING} parentheses", place)
        elif match["mark"] == ")":
            if not open_groups:
                raise DomainError("`)` without a `(` before it", place)
            start, items = open_groups.pop()
            group = Group(tuple(items), source.place(start, place.end))
            if open_groups:
                open_groups[-1][1].append(group)
            else:
                top = group
        elif not open_groups:
            raise DomainError(
                "text outside of parentheses", place, "a PDDL file begins with `(define`"
            )
        else:
            open_groups[-1][1].append(Word(match["word"].lower(), place))
    if open_groups:
        start = open_groups[-1][0]
        raise DomainError(
            "this `(` is never closed", source.place(start, start + 1), "add the missing `)`"
        )
    if top is None:
        raise DomainError(
            "the file holds no PDDL definition",
            source.place(0, 0),
            "a PDDL file begins with `(define`",
        )
    return top
