"""What a scenario file says; see docs/reference/scenarios.md."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Final, NamedTuple

from serp._util.text import readable
from serp.agent.decision import Reason
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


REASONS: Final = {
    "unsafe": Reason.UNSAFE,
    "unsafe ahead": Reason.UNSAFE_AHEAD,
    "too risky": Reason.TOO_RISKY,
    "not applicable": Reason.NOT_APPLICABLE,
    "undefined": Reason.UNDEFINED,
    "low reward": Reason.LOW_REWARD,
}
"""What may follow `because` → the reason of a veto."""


@dataclass(frozen=True)
class Bounds:
    """The numbers that `is about`, `is at least` and `is at most` allow; both ends belong to them.

    Attributes:
        least, most: The ends.
        text: What is written.
    """

    least: float
    most: float
    text: str

    @classmethod
    def about(cls, written: str, within: float | None) -> Bounds:
        """Return the numbers within a distance, by default those that round to what is written."""
        number = Decimal(written)
        if within is None:
            exponent = number.as_tuple().exponent
            assert isinstance(exponent, int)  # the number is finite
            half = Decimal(5).scaleb(exponent - 1)
            return cls(float(number - half), float(number + half), f"about {written}")
        value, text = float(number), f"about {written} within {readable(within)}"
        return cls(value - within, value + within, text)

    def __contains__(self, value: float) -> bool:
        return self.least <= value <= self.most

    def __str__(self) -> str:
        if not self.text.startswith("about"):
            return self.text
        return f"{self.text} ({readable(self.least)} to {readable(self.most)})"


@dataclass(frozen=True)
class GivenValue:
    """`(f) = 1`, `(p)` or `not (p)`: the value of a fluent in the situation; 0 and 1 for truth."""

    fluent: str
    value: float
    place: Place


@dataclass(frozen=True)
class StepOfRun:
    """`like step 12 of RUN`, `like step 3 of episode 2 of RUN`: a situation of a run.

    Steps count as `serp why` counts them; without an episode, over the whole run.
    """

    step: int
    episode: int | None
    run: str
    place: Place


@dataclass(frozen=True)
class Chooses:
    """`chooses A or B`, `does not choose A`: the controller's action is, or is not, one of some."""

    actions: tuple[int, ...]
    negated: bool
    place: Place


@dataclass(frozen=True)
class Refuses:
    """`refuses A`, `refuses A because unsafe`: the action is vetoed."""

    action: int
    reason: str
    place: Place


@dataclass(frozen=True)
class Allows:
    """`allows A`: the action is not vetoed."""

    action: int
    place: Place


@dataclass(frozen=True)
class Indifferent:
    """`is indifferent`: all safe actions are worth the same to the planner."""

    place: Place


@dataclass(frozen=True)
class Rates:
    """`value of A is ...`, `reward of A is ...`: the best return with A first, A's reward alone."""

    what: str
    action: int
    bounds: Bounds
    place: Place


@dataclass(frozen=True)
class After:
    """`after STEPS ...`: what holds after some steps by the model.

    Attributes:
        steps: Number of steps of the controller's choice, or the ground actions to be executed.
        fluent: What is looked at: a fluent, `reward` (the sum over the steps), or the flags
            `unsafe` and `terminal` (whether any of the steps sets them).
        bounds: What a number is to be; for a predicate or a flag `at least 1` or `at most 0`.
    """

    steps: int | tuple[int, ...]
    fluent: str
    bounds: Bounds
    place: Place


Expectation = Chooses | Refuses | Allows | Indifferent | Rates | After


@dataclass(frozen=True)
class Scenario:
    """A situation, and what is expected in it.

    Attributes:
        title: What follows `scenario`.
        place: The line of the title.
        recorded: The recorded step that the situation begins with; None for the initial state.
        given: Values that differ from that, later ones over earlier ones.
        expectations: What is expected, in the order of the file.
    """

    title: str
    place: Place
    recorded: StepOfRun | None = None
    given: tuple[GivenValue, ...] = ()
    expectations: tuple[Expectation, ...] = field(default=(), repr=False)
