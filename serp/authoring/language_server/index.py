"""Where the names of a domain and its problem are declared, read and changed.

The index is made of the lists and words of the files, so that it has everything that can be read
of a file that is being written.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

from serp.pddl import syntax as x
from serp.pddl.reader import Group, Node, Word, read_what_can_be
from serp.pddl.scope import is_name
from serp.pddl.source import Place, Source

_CHANGES = frozenset(change.value for change in x.Change)
_QUANTIFIERS = ("forall", "exists")


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


class Use(Enum):
    """What happens to a name in a place."""

    DECLARED = "declared"
    READ = "read"
    CHANGED = "changed"
    INITIAL = "initial"


FLUENTS = (NameKind.PREDICATE, NameKind.FUNCTION)
_SCHEMAS = {":action": NameKind.ACTION, ":process": NameKind.PROCESS, ":event": NameKind.EVENT}


@dataclass(frozen=True)
class Occurrence:
    """A name in a place.

    Attributes:
        name: In lower case.
        kind: What it names.
        use: What happens to it there.
        place: The word.
        form: The form that the word begins; the word itself where it begins none.
        inside: Head of the section that it is in, such as `(:action go`.
        type: Its type, where it is declared with one.
    """

    name: str
    kind: NameKind
    use: Use
    place: Place
    form: Place
    inside: Place
    type: str = ""

    @property
    def key(self) -> tuple[object, ...]:
        """Equal for occurrences of the same thing; a variable is known in its section only."""
        own = (self.inside.source.name, self.inside.start)
        return (self.name, "fluent" if self.kind in FLUENTS else self.kind,
                own if self.kind is NameKind.VARIABLE else ())  # fmt: skip


class Index:
    """The occurrences of all names in files that belong together."""

    def __init__(self, *sources: Source) -> None:
        self.sources = sources
        self.sections = [section for source in sources for section in read_what_can_be(source)]
        self.occurrences = [o for section in self.sections for o in self._declared(section)]
        self._fluents = {o.name: o.kind for o in self.declared(*FLUENTS)}
        self._objects = {o.name for o in self.declared(NameKind.OBJECT)}
        for section in self.sections:
            self.occurrences += self._used(section)

    def at(self, source: Source, position: int) -> Occurrence | None:
        """Return the name at a position of a file, or right before it."""
        for occurrence in self.occurrences:
            place = occurrence.place
            if place.source.name == source.name and place.start <= position <= place.end:
                return occurrence
        return None

    def same(self, occurrence: Occurrence) -> list[Occurrence]:
        """Return all occurrences of what one names, in the order of the files."""
        order = {source.name: number for number, source in enumerate(self.sources)}
        same = [other for other in self.occurrences if other.key == occurrence.key]
        return sorted(same, key=lambda o: (order[o.place.source.name], o.place.start))

    def declaration(self, occurrence: Occurrence) -> Occurrence | None:
        """Return where the thing is declared; None where it is not."""
        return next((o for o in self.same(occurrence) if o.use is Use.DECLARED), None)

    def declared(self, *kinds: NameKind) -> list[Occurrence]:
        """Return the declarations of some kinds."""
        return [o for o in self.occurrences if o.use is Use.DECLARED and o.kind in kinds]

    # Declarations --------------------------------------------------------------------------------

    def _declared(self, section: Group) -> Iterator[Occurrence]:
        inside = section.place.opening
        items = section.items[1:]
        match section.head:
            case ":types":
                yield from _typed(items, NameKind.TYPE, inside)
            case ":constants" | ":objects":
                yield from _typed(items, NameKind.OBJECT, inside)
            case ":predicates" | ":functions":
                functions = section.head == ":functions"
                kind = NameKind.FUNCTION if functions else NameKind.PREDICATE
                for item in items:
                    word = item.items[0] if isinstance(item, Group) and item.items else item
                    if isinstance(word, Word) and is_name(word) and item is not word:
                        yield _occurrence(word, kind, Use.DECLARED, item.place, inside)
                        assert isinstance(item, Group)
                        yield from _typed(item.items[1:], NameKind.VARIABLE, item.place)
            case ":action" | ":process" | ":event":
                if items and isinstance(items[0], Word):
                    kind = _SCHEMAS[section.head]
                    yield _occurrence(items[0], kind, Use.DECLARED, items[0].place, inside)

    # Uses ----------------------------------------------------------------------------------------

    def _used(self, section: Group) -> Iterator[Occurrence]:
        inside = section.place.opening
        if section.head in _SCHEMAS:
            for key, value in zip(section.items[2:], section.items[3:], strict=False):
                if isinstance(key, Word) and isinstance(value, Group):
                    if key.text == ":parameters":
                        yield from _typed(value.items, NameKind.VARIABLE, inside)
                    elif key.text in (":precondition", ":effect"):
                        yield from self._form(value, inside, effect=key.text == ":effect")
        elif section.head == ":init":
            for item in section.items[1:]:
                yield from self._fact(item, inside)
        elif section.head in (":goal", ":metric"):
            for item in section.items[1:]:
                yield from self._form(item, inside, effect=False)

    def _fact(self, node: Node, inside: Place) -> Iterator[Occurrence]:
        if isinstance(node, Group) and node.head in ("=", "not") and len(node.items) > 1:
            fact = node.items[1]
            if isinstance(fact, Group):
                yield from self._atom(fact, Use.INITIAL, inside, node.place)
        elif isinstance(node, Group):
            yield from self._atom(node, Use.INITIAL, inside, node.place)

    def _form(self, node: Node, inside: Place, *, effect: bool) -> Iterator[Occurrence]:
        """Yield the names in a condition, an effect or a number."""
        if isinstance(node, Word):
            yield from self._word(node, inside)
            return
        head, items = node.head, node.items[1:]
        if head in _QUANTIFIERS and items and isinstance(items[0], Group):
            yield from _typed(items[0].items, NameKind.VARIABLE, inside)
            items = items[1:]
        elif effect and head in _CHANGES and items and isinstance(items[0], Group):
            yield from self._atom(items[0], Use.CHANGED, inside, node.place)
            items, effect = items[1:], False
        elif head == "when" and items:
            yield from self._form(items[0], inside, effect=False)
            items = items[1:]
        elif head in self._fluents:
            use = Use.CHANGED if effect else Use.READ
            yield from self._atom(node, use, inside, node.place)
            return
        for item in items:
            yield from self._form(item, inside, effect=effect)

    def _atom(self, node: Group, use: Use, inside: Place, form: Place) -> Iterator[Occurrence]:
        word = node.items[0] if node.items else None
        if isinstance(word, Word):
            kind = self._fluents.get(word.text)
            if kind is not None:
                yield _occurrence(word, kind, use, form, inside)
        for item in node.items[1:]:
            if isinstance(item, Word):
                yield from self._word(item, inside)

    def _word(self, word: Word, inside: Place) -> Iterator[Occurrence]:
        kind: NameKind | None = None
        if word.text.startswith("?"):
            kind = NameKind.VARIABLE
        elif word.text in self._objects:
            kind = NameKind.OBJECT
        elif self._fluents.get(word.text) is NameKind.FUNCTION:  # without parentheses
            kind = NameKind.FUNCTION
        if kind is not None:
            yield _occurrence(word, kind, Use.READ, word.place, inside)


def _typed(items: Sequence[Node], kind: NameKind, inside: Place) -> Iterator[Occurrence]:
    """Yield the names in a typed list, and the types after its dashes."""
    waiting: list[Word] = []
    after_dash = False
    for item in items:
        if isinstance(item, Word) and item.text == "-":
            after_dash = True
        elif after_dash or isinstance(item, Group):  # a type, or `(either a b)`
            types = item.items[1:] if isinstance(item, Group) else (item,)
            for name in waiting:
                yield Occurrence(name.text, kind, Use.DECLARED, name.place, name.place, inside,
                                 item.place.text)  # fmt: skip
            for word in types:
                if isinstance(word, Word):
                    yield _occurrence(word, NameKind.TYPE, Use.READ, word.place, inside)
            waiting, after_dash = [], False
        else:
            waiting.append(item)
    for name in waiting:
        yield _occurrence(name, kind, Use.DECLARED, name.place, inside)


def _occurrence(word: Word, kind: NameKind, use: Use, form: Place, inside: Place) -> Occurrence:
    return Occurrence(word.text, kind, use, word.place, form, inside)
