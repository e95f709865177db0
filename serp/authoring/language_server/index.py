"""What the names of a domain and its problem mean, and where they are read and changed.

The index is made of the lists and words of the files, so that it has everything that can be read
of a file that is being written.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from enum import Enum
from typing import NamedTuple

from serp.pddl import syntax as x
from serp.pddl.parser import SCHEMA_SECTIONS
from serp.pddl.reader import Group, Node, Word, read_what_can_be
from serp.pddl.scope import is_name
from serp.pddl.source import Place, Source

_CHANGES = frozenset(change.value for change in x.Change)
_WORD = re.compile(r"[^\s();]+")


class NameKind(Enum):
    """What a name names."""

    PREDICATE = "predicate"
    FUNCTION = "function"
    TYPE = "type"
    OBJECT = "object"
    ACTION = "action"
    PROCESS = "process"
    EVENT = "event"
    VARIABLE = "variable"


FLUENTS = (NameKind.PREDICATE, NameKind.FUNCTION)


class DeclaredName(NamedTuple):
    """Where a name, in lower case, is declared, with its type if it has one.

    `place` is the word; `form` the form that it begins or names, else the word itself.
    """

    name: str
    kind: NameKind
    place: Place
    form: Place
    type: str = ""


class Use(NamedTuple):
    """A fluent in a place: what happens to it (`initial`, `changed` or `read`), in which section.

    `place` is the whole fact of an initial value.
    """

    what: str
    section: Place
    place: Place


class Index:
    """The names in files that belong together."""

    def __init__(self, *sources: Source) -> None:
        self.sources = sources
        self._sections = [section for source in sources for section in read_what_can_be(source)]
        self.declared = [name for section in self._sections for name in _declared(section)]

    def declaration(self, word: Place) -> DeclaredName | None:
        """Return where what a word names is declared; None where it is not."""
        name, source = word.text.lower(), word.source
        if name.startswith("?"):  # where it first is in its section
            for section in self._sections:
                place = section.place
                if place.source.name == source.name and place.start <= word.start < place.end:
                    first = next((w for w, _ in _uses(section, "") if w.text == name), None)
                    if first is not None:
                        return DeclaredName(name, NameKind.VARIABLE, first.place, first.place)
        same = [declared for declared in self.declared if declared.name == name]
        opens = source.text[: word.start].endswith("(")
        fitting = (declared for declared in same if (declared.kind in FLUENTS) == opens)
        return next(fitting, next(iter(same), None))

    def uses(self, fluent: str) -> Iterator[Use]:
        """Yield where a fluent is read and changed, in the order of the files."""
        for section in self._sections:
            items, forms = section.items, list[tuple[Node, str]]()
            if section.head in (":init", ":goal", ":metric"):
                what = "initial" if section.head == ":init" else "read"
                forms = [(item, what) for item in items[1:]]
            elif section.head in SCHEMA_SECTIONS:
                fields = {":precondition": "read", ":effect": "changed"}
                forms = [(value, fields[key.text]) for key, value in itertools.pairwise(items)
                         if isinstance(key, Word) and key.text in fields]  # fmt: skip
            for form, what in forms:
                for word, use in _uses(form, what):
                    if word.text == fluent:
                        place = form.place if use == "initial" else word.place
                        yield Use(use, section.place.opening, place)


def word_at(source: Source, position: int) -> Place | None:
    """Return the word at a position of a file, or right before it; None in a comment."""
    line = source.place(position, position).line
    start = source.line_starts[line - 1]
    for match in _WORD.finditer(source.line_text(line).partition(";")[0]):
        if start + match.start() <= position <= start + match.end():
            return source.place(start + match.start(), start + match.end())
    return None


def _declared(section: Group) -> Iterator[DeclaredName]:
    items = section.items[1:]
    match section.head:
        case ":types":
            yield from _typed(items, NameKind.TYPE)
        case ":constants" | ":objects":
            yield from _typed(items, NameKind.OBJECT)
        case ":predicates" | ":functions" as declares:
            kind = NameKind.FUNCTION if declares == ":functions" else NameKind.PREDICATE
            for item in items:
                word = item.items[0] if isinstance(item, Group) and item.items else None
                if isinstance(word, Word) and is_name(word):
                    yield DeclaredName(word.text, kind, word.place, item.place)
        case ":action" | ":process" | ":event" as schema:
            if items and isinstance(items[0], Word):
                name = items[0]
                kind = NameKind(schema[1:])
                yield DeclaredName(name.text, kind, name.place, section.place.opening)


def _typed(items: Sequence[Node], kind: NameKind) -> Iterator[DeclaredName]:
    """Yield the names in a typed list."""
    waiting: list[Word] = []
    after_dash = False
    for item in [*items, None]:
        if isinstance(item, Word) and item.text == "-":
            after_dash = True
        elif isinstance(item, Word) and not after_dash:
            waiting.append(item)
        else:  # a type, `(either a b)`, or the end
            of_type = item.place.text if item is not None else ""
            for name in waiting:
                yield DeclaredName(name.text, kind, name.place, name.place, of_type)
            waiting, after_dash = [], False


def _uses(node: Node, what: str) -> Iterator[tuple[Word, str]]:
    """Yield the words of a form, and what happens to the fluent that each may name."""
    if isinstance(node, Word):
        yield node, what
        return
    items, others = node.items, what
    if node.head == "when" and len(items) > 1:
        yield from _uses(items[1], "read")
        items = items[2:]
    elif node.head in _CHANGES and len(items) > 1:
        yield from _uses(items[1], what)
        items, others = items[2:], "read"
    for item in items:
        yield from _uses(item, others)
