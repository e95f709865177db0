"""Where a parenthesis is missing or one too many, judged by the layout of a file.

The count of parentheses says only that something is wrong, far behind the slip. Two things tell
where: sections such as `(:action` and fields such as `:effect` belong at a fixed depth, and a line
that begins no farther right than a form of an earlier line shows that this form was meant to end.
"""

from __future__ import annotations

import re

from serp.pddl.source import DomainError, Place

SECTIONS = frozenset(
    (
        *(":requirements", ":types", ":constants", ":predicates", ":functions"),
        *(":action", ":process", ":event", ":durative-action", ":derived"),
        *(":domain", ":objects", ":init", ":goal", ":metric"),
    )
)
_FIELDS = frozenset((":parameters", ":precondition", ":effect"))
_HEADS = frozenset(("increase", "decrease", "assign", "scale-up", "scale-down", "when"))
_OPENING = re.compile(r"\([ \t]*(:?)([^\s()]*)(\s+[^\s()]+)?")


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
            return DomainError(
                f"a `(` is missing before `{word}`",
                self._bare,
                write=f"({word}",
                code="unbalanced-parentheses",
            )
        return DomainError(
            f"this `)` is one too many: {why}",
            self._closing,
            write="",
            code="unbalanced-parentheses",
        )

    def _missing(self, still: list[Place], before: Place, where: str) -> DomainError:
        form, before = self._suspect or (still[-1], before)
        colon, head, name = _OPENING.match(form.source.text, form.start).groups()  # type: ignore[union-attr]
        shown = f"({colon}{head}{(name or '') if colon else ''}"
        count = len(still)
        return DomainError(
            f"{'a' if count == 1 else count} `)` {'is' if count == 1 else 'are'} missing: "
            f"`{' '.join(shown.split())}` of line {form.line} has not ended where {where}",
            before.source.place(before.end, before.end),
            write=")" * count,
            code="unbalanced-parentheses",
        )
