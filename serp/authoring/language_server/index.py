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

    def _declared(self, section: Group) -> Iterator[Occurrence]:
        inside, items = section.place.opening, section.items[1:]
        match section.head:
            case ":types":
                yield from _typed(items, NameKind.TYPE, inside)
            case ":constants" | ":objects":
                yield from _typed(items, NameKind.OBJECT, inside)
            case ":predicates" | ":functions" as declares:
                kind = NameKind.FUNCTION if declares == ":functions" else NameKind.PREDICATE
                for item in items:
                    word = item.items[0] if isinstance(item, Group) and item.items else None
                    if isinstance(item, Group) and isinstance(word, Word) and is_name(word):
                        yield _occurrence(word, kind, Use.DECLARED, item.place, inside)
                        yield from _typed(item.items[1:], NameKind.VARIABLE, item.place)
            case ":action" | ":process" | ":event" as schema:
                if items and isinstance(items[0], Word):
                    kind = NameKind(schema[1:])
                    yield _occurrence(items[0], kind, Use.DECLARED, items[0].place, inside)

    def _used(self, section: Group) -> Iterator[Occurrence]:
        inside = section.place.opening
        if section.head in (":init", ":goal", ":metric"):
            for item in section.items[1:]:
                use = Use.INITIAL if section.head == ":init" else Use.READ
                yield from self._names(item, use, item.place, inside)
        elif section.head in (":action", ":process", ":event"):
            for key, value in zip(section.items[2:], section.items[3:], strict=False):
                field = key.text if isinstance(key, Word) and isinstance(value, Group) else ""
                if field == ":parameters" and isinstance(value, Group):
                    yield from _typed(value.items, NameKind.VARIABLE, inside)
                elif field in (":precondition", ":effect"):
                    use = Use.CHANGED if field == ":effect" else Use.READ
                    yield from self._names(value, use, value.place, inside)

    def _names(self, node: Node, use: Use, form: Place, inside: Place) -> Iterator[Occurrence]:
        """Yield the names in a condition, an effect, a number or a fact.

        `use` is what happens to the fluents in it, `form` the fact that the node is in.
        """
        if isinstance(node, Word):
            kind = NameKind.OBJECT if node.text in self._objects else None
            if node.text.startswith("?"):
                kind = NameKind.VARIABLE
            elif self._fluents.get(node.text) is NameKind.FUNCTION:  # without parentheses
                kind = kind or NameKind.FUNCTION
            if kind is not None:
                yield _occurrence(node, kind, Use.READ, node.place, inside)
            return
        head, items = node.head, node.items[1:]
        first = items[0] if items and isinstance(items[0], Group) else None
        if head in self._fluents and isinstance(node.items[0], Word):
            yield _occurrence(node.items[0], self._fluents[head], use, form, inside)
            items, use = tuple(item for item in items if isinstance(item, Word)), Use.READ
        elif head in ("forall", "exists") and first is not None:
            yield from _typed(first.items, NameKind.VARIABLE, inside)
            items = items[1:]
        elif head == "when" and items:
            yield from self._names(items[0], Use.READ, form, inside)
            items = items[1:]
        elif head in _CHANGES and first is not None:
            yield from self._names(first, use, form, inside)
            items, use = items[1:], Use.READ
        for item in items:
            yield from self._names(item, use, form, inside)


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
