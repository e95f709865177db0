"""Rules: forms that serp reads and some other PDDL tools do not.

The rules are those that unified-planning, pddl, tarski, pddl-plus-parser and VAL have in common
(processes and events apart). Breaking one is not an error: serp reads more than they do.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence

from serp.lint.subject import SCHEMAS, values_of
from serp.pddl.expressions import is_number
from serp.pddl.sexpr import Group, Node, Word, read_group
from serp.pddl.slips import PORTABLE
from serp.pddl.source import DomainWarning, Place, Source
from serp.pddl.syntax import MATH_FUNCTIONS, OPERATORS

_PLAIN_DECIMAL = re.compile(r"-?\d+(\.\d+)?\Z", re.ASCII)
_KEYS = (":parameters", ":precondition", ":effect")


def outside_portable_subset(source: Source) -> list[DomainWarning]:
    """Return the forms in a file that some PDDL tools do not read, one finding per rule."""
    return _findings(_breaches(read_group(source)))


def beyond_pddl(source: Source, declared: Collection[str]) -> list[DomainWarning]:
    """Return the functions in a file that the requirement `:math-functions` admits.

    `declared` are the predicates and functions of the domain, which may have the same names.
    """
    return _findings(_math(read_group(source), declared))


def _findings(breaches: Iterable[tuple[str, Place]]) -> list[DomainWarning]:
    found: dict[str, list[Place]] = {}
    for text, place in breaches:
        found.setdefault(text, []).append(place)
    return [
        DomainWarning(
            text + (f" ({len(places)} places)" if len(places) > 1 else ""),
            places[0],
            "not-portable",
        )
        for text, places in found.items()
    ]


def _breaches(top: Group) -> Iterator[tuple[str, Place]]:
    for section in top.items[2:]:
        if not isinstance(section, Group):
            continue
        if section.head in SCHEMAS:
            yield from _schema(section)
        elif section.head in (":predicates", ":functions"):
            for item in section.items[1:]:
                if isinstance(item, Group):
                    yield from _typed_together(item.items[1:])
    yield from _everywhere(top)


def _schema(section: Group) -> Iterator[tuple[str, Place]]:
    name = section.items[1].place if len(section.items) > 1 else section.place
    values = values_of(section)
    for key in _KEYS:
        value = values.get(key)
        if value is None:
            empty = "()" if key == ":parameters" else "(and)"
            yield f"`{key}` is left out; write `{key} {empty}`", name
        elif key == ":parameters":
            yield from _typed_together(value.items if isinstance(value, Group) else ())
        elif not isinstance(value, Group) or value.head != "and":
            yield f"`{key}` without `(and ...)` around it", value.place


def _everywhere(node: Node) -> Iterator[tuple[str, Place]]:
    if isinstance(node, Word):
        written = node.place.source.text[node.place.start : node.place.end]
        if written != node.text:
            yield "capital letters; write everything in lower case", node.place
        if is_number(node) and not _PLAIN_DECIMAL.match(node.text):
            yield "a number that is not a plain decimal such as `0.5` or `-2`", node.place
        return
    if node.head in OPERATORS and node.head not in MATH_FUNCTIONS and len(node.items) != 3:
        if node.head == "-" and len(node.items) == 2:
            yield "`(- x)`; write `(- 0 x)`", node.place
        else:
            yield f"`{node.head}` with more than two operands; nest them in pairs", node.place
    if node.head in ("forall", "exists") and len(node.items) > 1:
        variables = node.items[1]
        yield from _typed_together(variables.items if isinstance(variables, Group) else ())
    for item in node.items:
        yield from _everywhere(item)


def _math(node: Node, declared: Collection[str]) -> Iterator[tuple[str, Place]]:
    """Find functions that PDDL does not have."""
    if isinstance(node, Word):
        return
    if node.head in PORTABLE and node.head not in declared:
        text = f"`{node.head}` is not PDDL; {PORTABLE[node.head]}"
        yield text, node.items[0].place
    for item in node.items:
        yield from _math(item, declared)


def _typed_together(nodes: Sequence[Node]) -> Iterator[tuple[str, Place]]:
    """Find variables that share a type, as in `?a ?b - room`."""
    words = [node.text if isinstance(node, Word) else "" for node in nodes]
    if "-" not in words:
        return
    for node, following in zip(nodes, words[1:], strict=False):
        if isinstance(node, Word) and node.text.startswith("?") and following.startswith("?"):
            text = "parameters that share a type; type each by itself, `?a - room ?b - room`"
            yield text, node.place
            return
