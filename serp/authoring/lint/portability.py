"""Rules: forms that serp reads and some other PDDL tools do not.

The rules are those that unified-planning, pddl, tarski, pddl-plus-parser and VAL have in common
(processes and events apart). Breaking one is not an error: serp reads more than they do.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace

from serp.authoring.lint.subject import SCHEMAS, values_of
from serp.pddl.expressions import is_number
from serp.pddl.reader import Group, Node, Word, read_group
from serp.pddl.slips import PORTABLE
from serp.pddl.source import (
    DomainWarning,
    Edit,
    Fix,
    Place,
    Source,
    indent_at,
    line_start,
    newline_of,
)
from serp.pddl.syntax import MATH_FUNCTIONS, OPERATORS

_PLAIN_DECIMAL = re.compile(r"-?\d+(\.\d+)?\Z", re.ASCII)
_EMPTY = {":parameters": "()", ":precondition": "(and)", ":effect": "(and)"}
"""Field of a schema → what it says where it says nothing."""
_CODE = "not-portable"


def outside_portable_subset(source: Source) -> list[DomainWarning]:
    """Return the forms in a file that some PDDL tools do not read, each with its place."""
    return [*_breaches(read_group(source))]


def beyond_pddl(source: Source, declared: Collection[str]) -> list[DomainWarning]:
    """Return the functions in a file that the requirement `:math-functions` admits.

    `declared` are the predicates and functions of the domain, which may have the same names.
    """
    return [*_math(read_group(source), declared)]


def one_per_rule(warnings: Iterable[DomainWarning]) -> list[DomainWarning]:
    """Return warnings with the same form at several places of a file told once, at the first."""
    found: dict[tuple[str, object], list[DomainWarning]] = {}
    for number, warning in enumerate(warnings):
        file = warning.place.source.name if warning.place is not None else ""
        key = (warning.text, file if warning.code == _CODE else number)
        found.setdefault(key, []).append(warning)
    return [_together(same) if len(same) > 1 else same[0] for same in found.values()]


def _together(same: Sequence[DomainWarning]) -> DomainWarning:
    fixes = [warning.fix for warning in same if warning.fix is not None]
    edits = tuple(edit for fix in fixes for edit in fix.edits)
    return replace(
        same[0],
        text=f"{same[0].text} ({len(same)} places)",
        fix=Fix(edits, sure=all(fix.sure for fix in fixes)) if fixes else None,
    )


def _breach(text: str, place: Place, fix: Fix | None = None) -> DomainWarning:
    return DomainWarning(text, place, _CODE, fix=fix)


def _breaches(top: Group) -> Iterator[DomainWarning]:
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


def _schema(section: Group) -> Iterator[DomainWarning]:
    name = section.items[1].place if len(section.items) > 1 else section.place
    values = values_of(section)
    for key, empty in _EMPTY.items():
        value = values.get(key)
        if value is None:
            written = f"{key} {empty}"
            fix = Fix((_inserted(section, key, written),)) if len(section.items) > 1 else None
            yield _breach(f"`{key}` is left out; write `{written}`", name, fix)
        elif key == ":parameters":
            yield from _typed_together(value.items if isinstance(value, Group) else ())
        elif not isinstance(value, Group) or value.head != "and":
            yield _breach(f"`{key}` without `(and ...)` around it", value.place)


def _inserted(section: Group, key: str, written: str) -> Edit:
    """Return the edit that puts a field into a schema: before those that follow it, else last."""
    keys = [*_EMPTY]
    following = keys[keys.index(key) + 1 :]
    after = (k for k in section.items[2::2] if isinstance(k, Word) and k.text in following)
    if (before := next(after, None)) is None:
        end = section.items[-1].place.end
        return Edit(end, end, f" {written}")
    start, text = before.place.start, section.place.source.text
    blank = " "
    if not text[line_start(text, start) : start].strip():
        blank = newline_of(text) + indent_at(text, start)
    return Edit(start, start, written + blank)


def _everywhere(node: Node) -> Iterator[DomainWarning]:
    if isinstance(node, Word):
        written = node.place.source.text[node.place.start : node.place.end]
        if written != node.text:
            yield _breach("capital letters; write everything in lower case", node.place)
        if is_number(node) and not _PLAIN_DECIMAL.match(node.text):
            yield _breach("a number that is not a plain decimal such as `0.5` or `-2`", node.place)
        return
    if node.head in OPERATORS and node.head not in MATH_FUNCTIONS and len(node.items) != 3:
        if node.head == "-" and len(node.items) == 2:
            yield _breach("`(- x)`; write `(- 0 x)`", node.place)
        else:
            yield _breach(
                f"`{node.head}` with more than two operands; nest them in pairs", node.place
            )
    if node.head in ("forall", "exists") and len(node.items) > 1:
        variables = node.items[1]
        yield from _typed_together(variables.items if isinstance(variables, Group) else ())
    for item in node.items:
        yield from _everywhere(item)


def _math(node: Node, declared: Collection[str]) -> Iterator[DomainWarning]:
    """Find functions that PDDL does not have."""
    if isinstance(node, Word):
        return
    if node.head in PORTABLE and node.head not in declared:
        text = f"`{node.head}` is not PDDL; {PORTABLE[node.head]}"
        yield _breach(text, node.items[0].place)
    for item in node.items:
        yield from _math(item, declared)


def _typed_together(nodes: Sequence[Node]) -> Iterator[DomainWarning]:
    """Find variables that share a type, as in `?a ?b - room`."""
    words = [node.text if isinstance(node, Word) else "" for node in nodes]
    if "-" not in words:
        return
    for node, following in zip(nodes, words[1:], strict=False):
        if isinstance(node, Word) and node.text.startswith("?") and following.startswith("?"):
            text = "parameters that share a type; type each by itself, `?a - room ?b - room`"
            yield _breach(text, node.place)
            return
