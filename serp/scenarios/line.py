"""A line of a scenario file as words with places, read from left to right."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Final, NamedTuple

from serp.pddl.source import DomainError, Place, Source

SUFFIX: Final = ".scenarios"
"""Ending of the name of a scenario file."""
_TOKEN = re.compile(r"[(),=]|[^\s(),=]+")
_NUMBER = re.compile(r"[-−+]?(\d+\.?\d*|\.\d+)(e[-+]?\d{1,3})?\Z")


class Token(NamedTuple):
    """A word of a line, in lower case, and its place."""

    text: str
    place: Place


class Line:
    """A line that is not empty.

    Args:
        source: The file.
        start: Where the line begins.
        text: The line without its comment.

    Attributes:
        tokens: Its words.
        place: The place of all of them.
    """

    def __init__(self, source: Source, start: int, text: str) -> None:
        self.tokens = [
            Token(match[0].lower(), source.place(start + match.start(), start + match.end()))
            for match in _TOKEN.finditer(text)
        ]
        begin = start + len(text) - len(text.lstrip())
        self.place = source.place(begin, start + len(text))
        self._end = source.place(start + len(text), start + len(text))
        self._at = 0

    def _number(self) -> tuple[float, str]:
        text = self._peek()
        if not _NUMBER.match(text):
            if not text:
                raise self._missing("a number", "")
            raise DomainError(f"`{text}` is not a number", self.tokens[self._at].place)
        self._at += 1
        written = text.replace("−", "-")
        if not math.isfinite(float(written)):
            raise DomainError(f"`{text}` is too large", self.tokens[self._at - 1].place)
        return float(written), written

    def _whole(self, example: str) -> int:
        text = self._peek()
        if not text.isdecimal() or len(text) > 12:
            raise self._missing("a whole number", example)
        self._at += 1
        return int(text)

    def _peek(self) -> str:
        return self.tokens[self._at].text if self._at < len(self.tokens) else ""

    def _skip(self, word: str) -> bool:
        if self._peek() != word:
            return False
        self._at += 1
        return True

    def _expect(self, word: str, example: str) -> None:
        if not self._skip(word):
            raise self._missing(f"`{word}`", example)

    def _begins(self, words: Sequence[str]) -> bool:
        if [token.text for token in self.tokens[: len(words)]] != list(words):
            return False
        self._at = len(words)
        return True

    def _missing(self, what: str, example: str, advice: str = "") -> DomainError:
        found = self.tokens[self._at] if self._at < len(self.tokens) else None
        shown = "the line ends" if found is None else f"found `{self._text(found)}`"
        return DomainError(
            f"expected {what}, {shown}",
            self._end if found is None else found.place,
            advice or (f"for example `{example}`" if example else ""),
        )

    def _rest(self, at: int) -> str:
        """Return the text from a token to the end of the line, as written."""
        if at >= len(self.tokens):
            return ""
        return self.place.source.text[self.tokens[at].place.start : self.place.end].strip()

    @staticmethod
    def _text(token: Token) -> str:
        return token.place.source.text[token.place.start : token.place.end]
