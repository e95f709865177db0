"""Reading PDDL text into nested lists that know their places."""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass

from serp.pddl.source import DomainError, Place, Recovery, Source, line_end, line_start

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


class Balance:
    """The parentheses of a file as it is read, token by token."""

    def __init__(self, *open_forms: Place) -> None:
        self.open: list[Place] = [*open_forms]
        self._last: list[Place] = []  # the two tokens before this one, the nearer one first
        self._line = 0
        self._closing: Place | None = None
        # A form that the layout says should have ended, and the token behind which.
        self._suspect: tuple[Place, Place] | None = None
        self._bare: Place | None = None  # a word that begins a form, without a `(` before it

    def see(self, token: str, place: Place) -> None:
        """Take note of the next token: `(`, `)` or a word."""
        line = place.line
        if line != self._line:
            self._see_line(token, place, line)
            self._line = line
        if token[0] == ":":
            self._see_keyword(token, place)
        elif token == "(":
            self.open.append(place)
        elif token == ")":
            self.open.pop()
            self._closing = place
        elif token in _HEADS and self._bare is None and self._last[:1] != self.open[-1:]:
            self._bare = place
        self._last = [place, *self._last[:1]]

    def _see_line(self, token: str, place: Place, line: int) -> None:
        """Find a form that the layout says should have ended before this line."""
        if self._suspect is None and len(self.open) > 1:
            form = self.open[-1]
            shown = form.source_line
            indent = len(shown) - len(shown.lstrip()) + 1
            column = place.column
            if form.line < line and (column < indent or (column == indent and token != ")")):
                self._suspect = (form, self._last[0])

    def _see_keyword(self, word: str, place: Place) -> None:
        # `((:action` and `(:effect` are other slips, which the parser names.
        opened = self._last[:1] == self.open[-1:]
        if word in SECTIONS and opened and self._last[-1:] != self.open[-2:-1]:
            depth, wanted, before = len(self.open) - 1, 1, self._last[-1]
            shown = f"`({word}`"
        elif word in _FIELDS and not opened:
            depth, wanted, before = len(self.open), 2, self._last[0]
            shown = f"`{word}`"
        else:
            return
        if depth > wanted:
            where = f"{shown} begins in line {place.line}"
            raise self._missing(self.open[wanted:depth], before, where)
        if depth == wanted - 1 and self._closing is not None:
            raise self.too_many(f"{shown} in line {place.line} follows")
        self._suspect = self._bare = None

    def at_end(self) -> DomainError:
        """Return what is wrong where the file ends and a form is open."""
        return self._missing(self.open, self._last[0], "the file ends")

    def too_many(self, why: str) -> DomainError:
        """Return what is wrong where a form has ended although more of it follows."""
        if self._bare is not None:
            word = self._bare.text
            return _unbalanced(f"a `(` is missing before `{word}`", self._bare, f"({word}")
        return _unbalanced(f"this `)` is one too many: {why}", self._closing, "")

    def _missing(self, still: list[Place], before: Place, where: str) -> DomainError:
        form, before = self._suspect or (still[-1], before)
        colon, head, name = _OPENING.match(form.source.text, form.start).groups()  # type: ignore[union-attr]
        shown = f"({colon}{head}{(name or '') if colon else ''}"
        count = len(still)
        return _unbalanced(
            f"{'a' if count == 1 else count} `)` {'is' if count == 1 else 'are'} missing: "
            f"`{' '.join(shown.split())}` of line {form.line} has not ended where {where}",
            before.source.place(before.end, before.end),
            ")" * count,
        )


def _unbalanced(problem: str, place: Place | None, write: str | None = None) -> DomainError:
    return DomainError(problem, place, write=write, code="unbalanced-parentheses")


_BLANK = re.compile(r"(?:[ \t\r\n\f\v]+|;[^\r\n]*)*")
_TOKEN = re.compile(r"[](){}[]|[^](){}\s;[]+")
_BRACKETS = {"{": "(", "[": "(", "}": ")", "]": ")"}
_SECTION_AHEAD = re.compile(rf"\(\s*(?:{'|'.join(sorted(SECTIONS))})(?![^\s();])", re.IGNORECASE)
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
    reader = _Reader(source)
    while True:
        try:
            return reader.read()
        except DomainError as error:
            if source.recovery is None or not reader.resume(error):
                raise


@functools.lru_cache(maxsize=8)  # an editor asks several times of one text
def read_what_can_be(source: Source) -> tuple[Group, ...]:
    """Return the lists in the definition of a file that may be wrong, as far as it can be read."""
    try:
        top = read_group(Source(source.name, source.text, recovery=Recovery()))
    except DomainError:
        return ()
    return tuple(item for item in top.items if isinstance(item, Group))


class _Reader:
    """Reads a file token by token."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._position = 0
        self._before, self._begin = 0, 0  # where the last two tokens begin
        self._tried = 0  # reading goes on with sections that begin behind this place
        self._open: list[list[Node]] = []
        self._balance = Balance()
        self._top: Group | None = None

    def read(self) -> Group:
        text = self._source.text
        while (begin := _BLANK.match(text, self._position).end()) < len(text):  # type: ignore[union-attr]
            self._before, self._begin, self._position = self._begin, begin, begin
            match = _TOKEN.match(text, begin)
            if match is None:
                with self._source.recovering():
                    raise DomainError(
                        f"character U+{ord(text[begin]):04X} is not an ordinary space",
                        self._source.place(begin, begin + 1),
                        "replace it with a space",
                        write=" ",
                        code="stray-text",
                    )
                self._position += 1
                continue
            place = Place(self._source, begin, match.end())
            if comment := _FOREIGN_COMMENT.match(match[0]):
                with self._source.recovering():
                    raise DomainError(
                        f"`{comment[0]}` does not begin a comment in PDDL",
                        self._source.place(begin, begin + len(comment[0])),
                        "comments begin with `;`",
                        write=";",
                        code="stray-text",
                    )
                self._position = line_end(text, begin)
                continue
            self._position = match.end()
            token = _BRACKETS.get(match[0], match[0])
            if token != match[0]:
                with self._source.recovering():
                    raise DomainError(
                        "the parentheses of PDDL are round", place, write=token, code="stray-text"
                    )
            self._take(token, place)
        if self._open:
            raise self._balance.at_end()
        if self._top is None:
            raise DomainError(
                "the file holds no PDDL definition",
                self._source.place(0, 0),
                "a PDDL file begins with `(define`",
                code="stray-text",
            )
        return self._top

    def _take(self, token: str, place: Place) -> None:
        max_nesting = 100
        if self._top is not None:
            raise _after_the_end(self._balance, place)
        if not self._open and token != "(":
            if token == ")":
                raise _unbalanced("`)` without a `(` before it", place)
            raise DomainError(
                "text outside of parentheses",
                place,
                "a PDDL file begins with `(define`",
                code="stray-text",
            )
        word = token.lower()
        begin = self._balance.open[-1].start if self._balance.open else place.start
        self._balance.see(word, place)
        if token == "(":
            self._open.append([])
            if len(self._open) > max_nesting:
                raise _unbalanced(f"nested deeper than {max_nesting} parentheses", place)
        elif token == ")":
            group = Group(tuple(self._open.pop()), self._source.place(begin, place.end))
            if self._open:
                self._open[-1].append(group)
            else:
                self._top = group
        else:
            self._open[-1].append(Word(word, place))

    def resume(self, error: DomainError) -> bool:
        """Keep an error and go on with the next section; say whether that is possible."""
        recovery, text = self._source.recovery, self._source.text
        sections = self._open[0] if self._open else [*self._top.items] if self._top else None
        if recovery is None or sections is None:
            return False
        recovery.take(error)
        complete = len(self._open) == 1 and self._position >= len(text)
        if error.code == "unbalanced-parentheses" or self._top is not None:
            stray = 0
            while len(sections) - stray > 2 and not _is_section(sections[-1 - stray]):
                stray += 1
            whole = len(sections) - stray
            if whole > 2 and len(self._open) < 2 and not complete:  # it ended too early
                recovery.torn[sections[whole - 1].place] = stray > 0
            del sections[whole + 1 :]  # of what follows it, the first tells enough
        last = max((node.place.end for node in sections), default=0)
        begin = self._balance.open[0].start if self._balance.open else self._top_start()
        resumed = len(text)
        ended = not text[self._position :].strip()
        ahead = len(text) if ended else max(self._before, self._tried)
        for match in _SECTION_AHEAD.finditer(text, ahead):
            if ";" not in text[line_start(text, match.start()) : match.start()]:
                resumed = match.start()
                break
        recovery.give_up(text[last:resumed])
        self._position = resumed
        self._before = self._begin = self._tried = resumed + 1  # a section is tried once
        define = self._source.place(begin, begin + 1)
        self._open, self._balance, self._top = [sections], Balance(define), None
        if resumed == len(text):  # the rest is lost: the file ends here
            self._open = []
            self._top = Group(tuple(sections), self._source.place(begin, len(text)))
        return True

    def _top_start(self) -> int:
        return self._top.place.start if self._top is not None else 0


def _is_section(node: Node) -> bool:
    return isinstance(node, Group) and node.head in SECTIONS


def _after_the_end(balance: Balance, place: Place) -> DomainError:
    if keyword := _KEYWORD_AHEAD.match(place.source.text, place.start):
        return balance.too_many(f"`{keyword[0]}` in line {place.line} follows")
    return DomainError(
        "text after the end of the definition",
        place,
        "a file holds one `(define ...)`; look for one `)` too many before this place",
        code="stray-text",
    )
