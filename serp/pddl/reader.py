"""Reading PDDL text into nested lists that know their places."""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from serp.pddl.source import DomainError, Place, Recovery, Source

SECTIONS = frozenset(
    (
        *(":requirements", ":types", ":constants", ":predicates", ":functions"),
        *(":action", ":process", ":event", ":durative-action", ":derived"),
        *(":domain", ":objects", ":init", ":goal", ":metric"),
    )
)
_FIELDS = frozenset((":parameters", ":vars", ":precondition", ":effect"))
_HEADS = frozenset(("increase", "decrease", "assign", "scale-up", "scale-down", "when"))
_OPENING = re.compile(r"[({[][ \t]*(:?)([^\s()]*)(\s+[^\s()]+)?")
_TOKEN = re.compile(
    r"[()]|(?:[^](){}\s;[#/]|/(?!/)|#t(?![a-z]))[^](){}\s;[?]*"
    r"|(;)[^\r\n]*|(//|#)[^\r\n]*|([^ \t\r\n\f\v])",
    re.IGNORECASE,
)
"""A parenthesis or a word; or a comment, one of another language, or anything else."""
_BRACKETS = {"{": "(", "[": "(", "}": ")", "]": ")"}
_KEYWORD_AHEAD = re.compile(r"\(\s*:[^\s();]+")


class Word(NamedTuple):
    """A name, variable, keyword, operator or number, in lower case (PDDL knows no case)."""

    text: str
    place: Place


class Group(NamedTuple):
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

    Where the source has a `recovery`, a section with a slip in its parentheses is left out.
    """
    tokens = [*_tokens(source)]
    if not tokens:
        raise DomainError(
            "the file holds no PDDL definition",
            source.place(0, 0),
            "a PDDL file must begin with `(define`",
            code="stray-text",
        )
    define = tokens[0]
    if define.text == ")":
        raise _unbalanced("`)` without a `(` before it", define.place)
    if define.text != "(":
        raise DomainError(
            "there is text outside of parentheses",
            define.place,
            "a PDDL file must begin with `(define`",
            code="stray-text",
        )
    begins = (
        k
        for k in range(1, len(tokens) - 1)
        if tokens[k + 1].text in SECTIONS and tokens[k].text == "(" != tokens[k - 1].text
    )
    items: list[Node] = []
    for begin, end in itertools.pairwise((1, *begins, len(tokens))):
        part = _SectionReader(define.place, tokens[begin:end], tokens[end : end + 2])
        try:
            part.read()
        except DomainError as error:
            if source.recovery is None:
                raise
            part.give_up(error, source.recovery)
        items += part.items
    return Group(tuple(items), source.place(define.place.start, tokens[-1].place.end))


@functools.lru_cache(maxsize=8)  # an editor asks several times of one text
def read_what_can_be(source: Source) -> tuple[Group, ...]:
    """Return the lists in the definition of a file that may be wrong, as far as it can be read."""
    try:
        top = read_group(Source(source.name, source.text, recovery=Recovery()))
    except DomainError:
        return ()
    return tuple(item for item in top.items if isinstance(item, Group))


def _tokens(source: Source) -> Iterator[Word]:
    """Yield parentheses and words."""
    for match in _TOKEN.finditer(source.text):
        kind = match.lastindex
        if kind is None:
            yield Word(match[0].lower(), Place(source, *match.span()))
        elif kind == 2:
            with source.recovering():
                raise DomainError(
                    f"`{match[2]}` does not begin a comment in PDDL",
                    source.place(*match.span(2)),
                    "comments must begin with `;`",
                    write=";",
                    code="stray-text",
                )
        elif kind == 3:
            place, bracket = source.place(*match.span()), _BRACKETS.get(match[3])
            problem = f"character U+{ord(match[3]):04X} is not an ordinary space"
            with source.recovering():
                raise DomainError(
                    "PDDL uses round parentheses" if bracket else problem,
                    place,
                    "" if bracket else "replace it with a space",
                    write=bracket or " ",
                    code="stray-text",
                )
            if bracket:
                yield Word(bracket, place)


class _Traces(NamedTuple):
    """What tells where a slip in the parentheses is."""

    before: Place  # the token before the one where the slip shows
    suspect: tuple[Place, Place] | None  # what should have ended, and behind what
    bare: Place | None  # a word that begins a form, without a `(` before it
    closing: Place | None  # the last `)`


class _SectionReader:
    """Reads a section, or what stands before the first one, up to the next one.

    `define` is the parenthesis that begins the file; `ahead` the first two tokens of the next
    section, none at the end of the file; `items` the forms that are complete.
    """

    def __init__(self, define: Place, tokens: Sequence[Word], ahead: Sequence[Word]) -> None:
        self.items: list[Node] = []
        self._define, self._tokens, self._ahead = define, tokens, ahead
        self._open = [define]

    def read(self) -> None:
        """Read all forms; parentheses have to match."""
        max_nesting = 100
        opened, groups = self._open, [self.items]
        for token in self._tokens:
            if not opened:
                raise self._after_the_end(token)
            text, place = token
            if text == "(":
                opened.append(place)
                groups.append([])
                if len(opened) > max_nesting:
                    raise _unbalanced(f"nested deeper than {max_nesting} parentheses", place)
            elif text == ")":
                whole = Place(place.source, opened.pop().start, place.end)
                items = tuple(groups.pop())
                if groups:
                    groups[-1].append(Group(items, whole))
            else:
                if text in _FIELDS and groups[-1]:
                    self._check_field(token)
                groups[-1].append(token)
        if not self._ahead:
            if opened:
                raise self._missing(opened, "the file ends")
        elif len(opened) != 1:
            shown, line = f"`({self._ahead[1].text}`", self._ahead[1].place.line
            if opened:
                raise self._missing(opened[1:], f"{shown} begins in line {line}")
            raise self._too_many(f"{shown} in line {line} follows")

    def _check_field(self, token: Word) -> None:
        """Check that a word such as `:effect` stands in a section, not in a form of it."""
        if len(self._open) > 2:
            where = f"`{token.text}` begins in line {token.place.line}"
            raise self._missing(self._open[2:], where, token)
        if len(self._open) == 1 and self._traces(token).closing:
            raise self._too_many(f"`{token.text}` in line {token.place.line} follows", token)

    def _traces(self, end: Word | None) -> _Traces:
        """Look back on what was read up to a token; None: on all."""
        opened, before = [self._define], self._define
        suspect: tuple[Place, Place] | None = None
        bare = closing = None
        for token in self._tokens:
            if not opened:
                break
            (text, place), form = token, opened[-1]
            if suspect is None and form.line < place.line != before.line and len(opened) > 1:
                shown = form.source_line
                indent = len(shown) - len(shown.lstrip()) + 1
                if place.column < indent or (place.column == indent and text != ")"):
                    suspect = form, before
            if token is end:
                break
            if text == "(":
                opened.append(place)
            elif text == ")":
                opened.pop()
                closing = place
            elif text in _FIELDS and before is not form:
                suspect = bare = None
            elif text in _HEADS and before is not form:
                bare = bare or place
            before = place
        return _Traces(before, suspect, bare, closing)

    def _after_the_end(self, token: Word) -> DomainError:
        place = token.place
        if keyword := _KEYWORD_AHEAD.match(place.source.text, place.start):
            return self._too_many(f"`{keyword[0]}` in line {place.line} follows", token)
        return DomainError(
            "there is text after the end of the definition",
            place,
            "a file may hold only one `(define ...)`; look for one `)` too many before this place",
            code="stray-text",
        )

    def _too_many(self, why: str, end: Word | None = None) -> DomainError:
        """Return what is wrong where a form has ended although more of it follows."""
        traces = self._traces(end)
        if traces.bare is not None:
            word = traces.bare.text
            return _unbalanced(f"a `(` is missing before `{word}`", traces.bare, f"({word}")
        return _unbalanced(f"this `)` is one too many: {why}", traces.closing, "")

    def _missing(self, still: Sequence[Place], where: str, end: Word | None = None) -> DomainError:
        """Return what is wrong where forms are still open."""
        traces = self._traces(end)
        form, before = traces.suspect or (still[-1], traces.before)
        colon, head, name = _OPENING.match(form.source.text, form.start).groups()  # type: ignore[union-attr]
        shown = f"({colon}{head}{(name or '') if colon else ''}"
        count = len(still)
        return _unbalanced(
            f"{'a' if count == 1 else count} `)` {'is' if count == 1 else 'are'} missing: "
            f"`{' '.join(shown.split())}` of line {form.line} is still open where {where}",
            before.source.place(before.end, before.end),
            ")" * count,
        )

    def give_up(self, error: DomainError, recovery: Recovery) -> None:
        """Take an error: of what follows a section that ended too early, the first tells enough."""
        recovery.take(error)
        section = self.items[0] if self.items else None
        if error.code == "unbalanced-parentheses" or not self._open:
            if isinstance(section, Group) and len(self._open) < 2:
                recovery.torn[section.place] = len(self.items) > 1
            del self.items[2 if isinstance(section, Group) else 3 :]
        read = self.items[-1].place.end if self.items else 0
        recovery.give_up(" ".join(t.text for t in self._tokens if t.place.start >= read))


def _unbalanced(problem: str, place: Place | None, write: str | None = None) -> DomainError:
    return DomainError(problem, place, write=write, code="unbalanced-parentheses")
