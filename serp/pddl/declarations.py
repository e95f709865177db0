"""Parsing typed lists and the declarations made of them: types, objects, predicates, functions."""

from __future__ import annotations

import re
from collections.abc import Sequence

from serp._util.text import closest, did_you_mean
from serp.pddl import syntax as x
from serp.pddl.scope import INSTEAD
from serp.pddl.sexpr import Group, Node, Word
from serp.pddl.source import DomainError, Place

TOTAL_TIME = "total-time"
_NAME = re.compile(r"[a-z][a-z0-9_\-]*\Z")
_VARIABLE = re.compile(r"\?[a-z][a-z0-9_\-]*\Z")


def is_name(word: Word) -> bool:
    """Whether a word is a plain PDDL name."""
    return _NAME.match(word.text) is not None


def expect_name(node: Node, what: str) -> Word:
    """Return the node as a plain PDDL name."""
    if isinstance(node, Group) and node.head.startswith(":") and node.head in INSTEAD:
        problem, instead = f"`{node.head}` is not supported", INSTEAD[node.head]
        raise DomainError(problem, node.place.opening, instead, code="unsupported")
    if not isinstance(node, Word):
        raise DomainError(f"expected {what}, found a list", node.place)
    if not is_name(node):
        raise DomainError(
            f"`{node.text}` is not a name for {what}",
            node.place,
            "names begin with a letter and go on with letters, digits, `-` and `_`",
            code="bad-name",
        )
    return node


def expect_group(node: Node, what: str) -> Group:
    """Return the node as a parenthesised list."""
    if isinstance(node, Word):
        raise DomainError(f"expected {what} in parentheses, found `{node.text}`", node.place)
    return node


def typed_list(
    nodes: Sequence[Node], what: str, *, variables: bool
) -> list[tuple[Word, tuple[Word, ...]]]:
    """Split `a b - t c` into (name, type names) pairs; no type names where none is written."""
    pairs: list[tuple[Word, tuple[Word, ...]]] = []
    waiting: list[Word] = []
    index = 0
    while index < len(nodes):
        node = nodes[index]
        if isinstance(node, Word) and node.text.startswith("-"):
            type_node, index = after_dash(nodes, index, "a type")
            types = _type_names(type_node)
            if not waiting:
                problem = f"`- {type_node.place.text}` without {what} before it"
                if variables:
                    raise DomainError(problem, node.place)
                node.place.warn(problem, "needless")
            pairs += [(word, types) for word in waiting]
            waiting = []
            continue
        if variables:
            if not isinstance(node, Word) or not _VARIABLE.match(node.text):
                shown = node.text if isinstance(node, Word) else "a list"
                advice = "variables begin with `?`, as in `?robot`"
                if waiting and isinstance(node, Word) and is_name(node):
                    last = waiting[-1].text
                    advice = f"write `{last} - {shown}` for a type, `?{shown}` for a variable"
                raise DomainError(
                    f"expected a variable for {what}, found `{shown}`",
                    node.place,
                    advice,
                )
            waiting.append(node)
        else:
            waiting.append(expect_name(node, what))
        index += 1
    return pairs + [(word, ()) for word in waiting]


def after_dash(nodes: Sequence[Node], index: int, what: str) -> tuple[Node, int]:
    """Return what follows a `-`, and the index behind it; `-type` without a blank is warned of."""
    dash = nodes[index]
    if isinstance(dash, Word) and dash.text != "-":
        place = dash.place
        text = f"`{place.text}` is read as `- {dash.text[1:]}`, which other tools may not do"
        place.warn(text, write=f"- {place.text[1:]}")
        return Word(dash.text[1:], place.source.place(place.start + 1, place.end)), index + 1
    if index + 1 == len(nodes):
        raise DomainError(f"`-` without {what} after it", dash.place)
    return nodes[index + 1], index + 2


def _type_names(node: Node) -> tuple[Word, ...]:
    if isinstance(node, Word):
        return (expect_name(node, "a type"),)
    if node.head != "either" or len(node.items) < 2:
        raise DomainError("expected a type or `(either type ...)`", node.place)
    return tuple(expect_name(item, "a type") for item in node.items[1:])


def declared_again(word: Node, what: str, *, same: bool) -> None:
    """Warn of a second declaration that says the same as the first."""
    problem = f"{what} `{word.place.text.lower()}` is declared twice"
    if not same:
        advice = "the two differ; leave one of them out"
        raise DomainError(problem, word.place, advice, code="declared-twice")
    word.place.warn(problem, "declared-twice")


def parse_types(group: Group) -> dict[str, str]:
    """Parse `(:types ...)` into type → parent.

    A parent that is not declared itself is a child of `object`, as other PDDL tools have it. A type
    that is declared both below `object` and below another type is below the other.
    """
    parents: dict[str, str] = {}
    places: dict[str, Place] = {}
    mentioned: list[str] = []
    for word, types in typed_list(group.items[1:], "a type", variables=False):
        if len(types) > 1:
            raise DomainError(
                "a type has one parent; `either` is for parameters",
                word.place,
                code="type-conflict",
            )
        parent = types[0].text if types else x.OBJECT
        if word.text == x.OBJECT:
            if types:
                raise DomainError(
                    "`object` is the root of all types", word.place, code="reserved-name"
                )
            continue
        if (known := parents.get(word.text)) is not None:
            declared_again(word, "type", same=known == parent or x.OBJECT in (known, parent))
            parent = known if parent == x.OBJECT else parent
        parents[word.text] = parent
        places[word.text] = word.place
        mentioned.append(parent)
    for parent in mentioned:
        if parent != x.OBJECT:
            parents.setdefault(parent, x.OBJECT)
    for name in places:
        seen: set[str] = set()
        current = parents[name]
        while current != x.OBJECT and current not in seen:
            if current == name:
                raise DomainError(
                    f"type `{name}` is its own ancestor", places[name], code="type-conflict"
                )
            seen.add(current)
            current = parents[current]
    return parents


def check_type(word: Word, parents: dict[str, str]) -> str:
    """Return the name of a declared type."""
    if word.text != x.OBJECT and word.text not in parents:
        known = [*parents, x.OBJECT]
        advice, guess = did_you_mean(word.text, known), closest(word.text, known)
        others = "... " if parents else ""
        raise DomainError(
            f"unknown type `{word.text}`",
            word.place,
            advice if guess else f"{advice}; or declare it: `(:types {others}{word.text})`",
            guess=guess,
            code="unknown-type",
        )
    return word.text


def parse_parameters(
    nodes: Sequence[Node], parents: dict[str, str], *, positional: bool = False
) -> tuple[x.SchemaParameter, ...]:
    """Parse a typed list of variables."""
    parameters: dict[str, x.SchemaParameter] = {}
    for word, types in typed_list(nodes, "a parameter", variables=True):
        names = tuple(check_type(t, parents) for t in types) or (x.OBJECT,)
        name = word.text
        if name in parameters:
            declared_again(word, "parameter", same=positional or parameters[name].types == names)
            if positional:
                name = f"{name}-{len(parameters) + 1}"
        parameters[name] = x.SchemaParameter(name, names, word.place)
    return tuple(parameters.values())


def parse_objects(group: Group, parents: dict[str, str]) -> dict[str, x.ObjectDeclaration]:
    """Parse `(:constants ...)` or `(:objects ...)`."""
    objects: dict[str, x.ObjectDeclaration] = {}
    for word, types in typed_list(group.items[1:], "an object", variables=False):
        if len(types) > 1:
            raise DomainError("an object has one type", word.place, code="type-conflict")
        type_name = check_type(types[0], parents) if types else x.OBJECT
        if word.text in objects:
            declared_again(word, "object", same=objects[word.text].type == type_name)
        objects[word.text] = x.ObjectDeclaration(word.text, type_name, word.place)
    return objects


def parse_declarations(
    group: Group, parents: dict[str, str], *, numeric: bool
) -> dict[str, x.Declaration]:
    """Parse `(:predicates ...)` or `(:functions ...)`."""
    what = "function" if numeric else "predicate"
    declared: dict[str, x.Declaration] = {}
    index = begin = 1
    while index < len(group.items):
        node = group.items[index]
        index += 1
        if numeric and isinstance(node, Word) and node.text.startswith("-"):
            since = group.items[begin:index]
            with node.place.source.place(since[0].place.start, node.place.end).recovering():
                kind, index = after_dash(group.items, index - 1, "`number`")
                begin = index
                _check_number_type(kind, since)
                continue
            for item in since:  # an error was taken: they are no functions of numbers
                declared.pop(item.head if isinstance(item, Group) else item.text, None)
            begin = index
            continue
        with node.place.recovering():
            if numeric and isinstance(node, Word):
                node = without_parentheses(expect_name(node, "a function"))
            declaration = _declaration(expect_group(node, f"a {what}"), parents, what)
            if declaration is None:
                continue
            name = declaration.name
            if name in declared:
                known = declared[name].parameters
                same = [p.types for p in known] == [p.types for p in declaration.parameters]
                declared_again(expect_group(node, what).items[0], what, same=same)
            declared[name] = declaration
    return declared


def _declaration(item: Group, parents: dict[str, str], what: str) -> x.Declaration | None:
    """Parse `(name parameters)`; None for `(total-time)`, which needs no declaration."""
    if not item.items:
        raise DomainError(f"empty declaration of a {what}", item.place)
    numeric = what == "function"
    word = expect_name(item.items[0], f"a {what}")
    if numeric and word.text == TOTAL_TIME and len(item.items) == 1:
        item.place.warn("`(total-time)` needs no declaration", "needless", write="")
        return None
    if word.text in RESERVED_WORDS:
        raise DomainError(
            f"`{word.text}` is a word of PDDL and cannot be a {what}",
            word.place,
            code="reserved-name",
        )
    parameters = parse_parameters(item.items[1:], parents, positional=True)
    return x.Declaration(word.text, parameters, numeric, item.place)


def without_parentheses(word: Word) -> Group:
    """Return the function that a bare name means, with a warning."""
    text = f"`{word.text}` is read as `({word.text})`, which other tools may not do"
    word.place.warn(text, write=f"({word.place.text})")
    return Group((word,), word.place)


def _check_number_type(kind: Node, since: Sequence[Node]) -> None:
    """Check the type of the functions since the one before; the last of them is the dash."""
    if len(since) == 1:
        raise DomainError("`-` needs functions before it and `number` after it", since[0].place)
    if not isinstance(kind, Word) or kind.text != "number":
        raise DomainError(
            "functions with values other than numbers are not supported",
            kind.place,
            INSTEAD[":object-fluents"],
            code="unsupported",
        )


RESERVED_WORDS = frozenset(
    (
        *("and", "or", "not", "imply", "forall", "exists", "when", "either", "preference"),
        *("assign", "increase", "decrease", "scale-up", "scale-down"),
        *("define", "domain", "problem", "number", "object", TOTAL_TIME),
    )
)
