"""Reading PDDL text into nested lists that know their places."""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from serp.pddl.source import DomainError, Place, Recovery, Source, line_end

SECTIONS = frozenset(
    (
        *(":requirements", ":types", ":constants", ":predicates", ":functions"),
        *(":action", ":process", ":event", ":durative-action", ":derived"),
        *(":domain", ":objects", ":init", ":goal", ":metric"),
    )
)
_FIELDS = frozenset((":parameters", ":precondition", ":effect"))
_HEADS = frozenset(("increase", "decrease", "assign", "scale-up", "scale-down", "when"))
_OPENING = re.compile(r"[({[][ \t]*(:?)([^\s()]*)(\s+[^\s()]+)?")
_BLANK = re.compile(r"(?:[ \t\r\n\f\v]+|;[^\r\n]*)*")
_TOKEN = re.compile(r"[](){}[]|[^](){}\s;[]+")
_BRACKETS = {"{": "(", "[": "(", "}": ")", "]": ")"}
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
    """Read the single parenthesised list that a PDDL file consists of.

    Where the source has a `recovery`, a section with a slip in its parentheses is left out.
    """
    tokens = [*_tokens(source)]
    if not tokens:
        raise DomainError(
            "the file holds no PDDL definition",
            source.place(0, 0),
            "a PDDL file begins with `(define`",
            code="stray-text",
        )
    define = tokens[0]
    if define.text == ")":
        raise _unbalanced("`)` without a `(` before it", define.place)
    if define.text != "(":
        raise DomainError(
            "text outside of parentheses",
            define.place,
            "a PDDL file begins with `(define`",
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
    text, position = source.text, 0
    while (begin := _BLANK.match(text, position).end()) < len(text):  # type: ignore[union-attr]
        match = _TOKEN.match(text, begin)
        if match is None:
            with source.recovering():
                raise DomainError(
                    f"character U+{ord(text[begin]):04X} is not an ordinary space",
                    source.place(begin, begin + 1),
                    "replace it with a space",
                    write=" ",
                    code="stray-text",
                )
            position = begin + 1
            continue
        if comment := _FOREIGN_COMMENT.match(match[0]):
            with source.recovering():
                raise DomainError(
                    f"`{comment[0]}` does not begin a comment in PDDL",
                    source.place(begin, begin + len(comment[0])),
                    "comments begin with `;`",
                    write=";",
                    code="stray-text",
                )
            position = line_end(text, begin)
            continue
        position = match.end()
        token, place = _BRACKETS.get(match[0], match[0]), source.place(begin, position)
        if token != match[0]:
            with source.recovering():
                raise DomainError(
                    "the parentheses of PDDL are round", place, write=token, code="stray-text"
                )
        yield Word(token.lower(), place)


class _SectionReader:
    """Reads a section, or what stands before the first one, up to the next one.

    Args:
        define: The parenthesis that begins the file.
        tokens: Those of the part.
        ahead: The first two of the next section; none at the end of the file.

    Attributes:
        items: The forms that are complete.
    """

    def __init__(self, define: Place, tokens: Sequence[Word], ahead: Sequence[Word]) -> None:
        self.items: list[Node] = []
        self._tokens, self._ahead = tokens, ahead
        self._open = [define]
        self._groups = [self.items]
        self._before = define
        self._line = 0
        self._closing: Place | None = None
        # A form that the layout says should have ended, and the token behind which.
        self._suspect: tuple[Place, Place] | None = None
        self._bare: Place | None = None  # a word that begins a form, without a `(` before it

    def read(self) -> None:
        """Read all forms; parentheses have to match."""
        for token in self._tokens:
            if not self._open:
                raise self._after_the_end(token.place)
            self._see_line(token)
            self._take(token)
            self._before = token.place
        if not self._ahead:
            if self._open:
                raise self._missing(self._open, "the file ends")
        elif len(self._open) != 1:
            shown, line = f"`({self._ahead[1].text}`", self._ahead[1].place.line
            if self._open:
                raise self._missing(self._open[1:], f"{shown} begins in line {line}")
            raise self._too_many(f"{shown} in line {line} follows")

    def _take(self, token: Word) -> None:
        max_nesting = 100
        place, opened = token.place, self._before is self._open[-1]
        if token.text == "(":
            self._open.append(place)
            self._groups.append([])
            if len(self._open) > max_nesting:
                raise _unbalanced(f"nested deeper than {max_nesting} parentheses", place)
        elif token.text == ")":
            self._closing = place
            whole = place.source.place(self._open.pop().start, place.end)
            items = self._groups.pop()
            if self._groups:
                self._groups[-1].append(Group(tuple(items), whole))
        else:
            if token.text in _FIELDS and not opened:
                self._see_field(token)
            elif token.text in _HEADS and self._bare is None and not opened:
                self._bare = place
            self._groups[-1].append(token)

    def _see_line(self, token: Word) -> None:
        """Find a form that the layout says should have ended before a line that begins here."""
        place, line = token.place, token.place.line
        if line != self._line and self._suspect is None and len(self._open) > 1:
            form = self._open[-1]
            shown = form.source_line
            indent = len(shown) - len(shown.lstrip()) + 1
            column = place.column
            if form.line < line and (column < indent or (column == indent and token.text != ")")):
                self._suspect = (form, self._before)
        self._line = line

    def _see_field(self, token: Word) -> None:
        """Check that a word such as `:effect` stands in a section, not in a form of it."""
        shown, line = f"`{token.text}`", token.place.line
        if len(self._open) > 2:
            raise self._missing(self._open[2:], f"{shown} begins in line {line}")
        if len(self._open) == 1 and self._closing is not None:
            raise self._too_many(f"{shown} in line {line} follows")
        self._suspect = self._bare = None

    def _after_the_end(self, place: Place) -> DomainError:
        if keyword := _KEYWORD_AHEAD.match(place.source.text, place.start):
            return self._too_many(f"`{keyword[0]}` in line {place.line} follows")
        return DomainError(
            "text after the end of the definition",
            place,
            "a file holds one `(define ...)`; look for one `)` too many before this place",
            code="stray-text",
        )

    def _too_many(self, why: str) -> DomainError:
        """Return what is wrong where a form has ended although more of it follows."""
        if self._bare is not None:
            word = self._bare.text
            return _unbalanced(f"a `(` is missing before `{word}`", self._bare, f"({word}")
        return _unbalanced(f"this `)` is one too many: {why}", self._closing, "")

    def _missing(self, still: Sequence[Place], where: str) -> DomainError:
        """Return what is wrong where forms are still open."""
        form, before = self._suspect or (still[-1], self._before)
        colon, head, name = _OPENING.match(form.source.text, form.start).groups()  # type: ignore[union-attr]
        shown = f"({colon}{head}{(name or '') if colon else ''}"
        count = len(still)
        return _unbalanced(
            f"{'a' if count == 1 else count} `)` {'is' if count == 1 else 'are'} missing: "
            f"`{' '.join(shown.split())}` of line {form.line} has not ended where {where}",
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
