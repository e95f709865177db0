"""Rules: forms that SErP reads and some other PDDL tools do not.

The rules are those that unified-planning, pddl, tarski, pddl-plus-parser and VAL have in common
(processes and events apart). Breaking one is no error: SErP reads more than they do.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence

from serp.pddl.expressions import is_number
from serp.pddl.reader import Group, Node, Word, read_group
from serp.pddl.slips import PORTABLE
from serp.pddl.source import DomainWarning, Place, Source
from serp.pddl.syntax import MATH_FUNCTIONS, OPERATORS

_PLAIN_DECIMAL = re.compile(r"-?\d+(\.\d+)?\Z", re.ASCII)
_EMPTY = {":parameters": "()", ":precondition": "(and)", ":effect": "(and)"}
"""Field of a schema → its value where it says nothing."""
_SCHEMAS = (":action", ":process", ":event")


def outside_portable_subset(source: Source) -> list[DomainWarning]:
    """Return the forms in a file that some PDDL tools do not read, each with its place."""
    top = read_group(source)
    warnings = [*_everywhere(top)]
    for section in top.items[2:]:
        if isinstance(section, Group) and section.head in _SCHEMAS:
            warnings += _schema(section)
        elif isinstance(section, Group) and section.head in (":predicates", ":functions"):
            for item in section.items[1:]:
                warnings += _typed_together(item, 1)
    return warnings


def beyond_pddl(source: Source, declared: Collection[str]) -> list[DomainWarning]:
    """Return the functions in a file that the requirement `:math-functions` admits.

    `declared` are the predicates and functions of the domain, which may have the same names.
    """
    return [
        _breach(f"`{form.head}` is not PDDL; {PORTABLE[form.head]}", form.items[0].place)
        for form in _groups_in(read_group(source))
        if form.head in PORTABLE and form.head not in declared
    ]


def _breach(text: str, place: Place) -> DomainWarning:
    return DomainWarning(text, place, "not-portable")


def _groups_in(group: Group) -> Iterator[Group]:
    """Yield a list and every list in it."""
    yield group
    for item in group.items:
        if isinstance(item, Group):
            yield from _groups_in(item)


def _schema(section: Group) -> Iterator[DomainWarning]:
    name = section.items[1].place if len(section.items) > 1 else section.place
    pairs = zip(section.items[2::2], section.items[3::2], strict=False)
    values = {key.text: value for key, value in pairs if isinstance(key, Word)}
    for key, empty in _EMPTY.items():
        value = values.get(key)
        if value is None:
            yield _breach(f"`{key}` is left out; write `{key} {empty}`", name)
        elif key == ":parameters":
            yield from _typed_together(value)
        elif not isinstance(value, Group) or value.head != "and":
            yield _breach(f"`{key}` without `(and ...)` around it", value.place)


def _everywhere(top: Group) -> Iterator[DomainWarning]:
    for form in _groups_in(top):
        for word in form.items:
            if isinstance(word, Word):
                if word.place.source.text[word.place.start : word.place.end] != word.text:
                    yield _breach("capital letters; write everything in lower case", word.place)
                if is_number(word) and not _PLAIN_DECIMAL.match(word.text):
                    text = "a number that is not a plain decimal such as `0.5` or `-2`"
                    yield _breach(text, word.place)
        if form.head in OPERATORS and form.head not in MATH_FUNCTIONS and len(form.items) != 3:
            text = f"`{form.head}` with more than two operands; nest them in pairs"
            if form.head == "-" and len(form.items) == 2:
                text = "`(- x)`; write `(- 0 x)`"
            yield _breach(text, form.place)
        if form.head in ("forall", "exists") and len(form.items) > 1:
            yield from _typed_together(form.items[1])


def _typed_together(variables: Node, begin: int = 0) -> Iterator[DomainWarning]:
    """Find variables that share a type, as in `?a ?b - room`."""
    nodes: Sequence[Node] = variables.items[begin:] if isinstance(variables, Group) else ()
    words = [node.text if isinstance(node, Word) else "" for node in nodes]
    for node, following in zip(nodes, words[1:], strict=False):
        if "-" in words and node.place.text.startswith("?") and following.startswith("?"):
            text = "parameters that share a type; type each by itself, `?a - room ?b - room`"
            yield _breach(text, node.place)
            return
