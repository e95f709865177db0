"""What domain and problem files begin with: `(define (domain name) ...)` and `:requirements`."""

from __future__ import annotations

import re
from collections.abc import Sequence

from serp._util.text import closest, did_you_mean
from serp.pddl.declarations import expect_group, expect_name, is_name
from serp.pddl.scope import INSTEAD, REQUIREMENTS_INSTEAD
from serp.pddl.sexpr import Group, Word, read_group
from serp.pddl.source import DomainError, Source
from serp.pddl.syntax import MATH_REQUIREMENT

SUPPORTED_REQUIREMENTS = frozenset(
    (
        *(":strips", ":typing", ":equality", ":adl", ":conditional-effects"),
        *(":negative-preconditions", ":disjunctive-preconditions", ":quantified-preconditions"),
        *(":existential-preconditions", ":universal-preconditions"),
        *(":fluents", ":numeric-fluents", ":action-costs"),
        *(":time", ":processes", ":events", ":continuous-effects", ":hybrid", MATH_REQUIREMENT),
    )
)
"""What a file may list under `:requirements`."""
_FILE_NAME = re.compile(r"[a-z0-9][a-z0-9_.\-]*\Z")


def read_definition(source: Source, what: str) -> tuple[str, Group, tuple[Group, ...]]:
    """Return the name, the whole, and the sections of `(define (what name) ...)`."""
    top = read_group(source)
    if top.head != "define":
        raise DomainError("a PDDL file begins with `(define`", top.place, code="malformed")
    title = expect_group(top.items[1], f"`({what} name)`") if len(top.items) > 1 else top
    if title is top or title.head not in ("domain", "problem"):
        raise DomainError(f"expected `({what} name)` after `define`", title.place, code="malformed")
    if title.head != what:
        raise DomainError(
            f"this is a {title.head} file, a {what} file is needed", title.place, code="malformed"
        )
    name = _name(title, what)
    sections: list[Group] = []
    for item in top.items[2:]:
        with item.place.recovering():
            sections.append(expect_group(item, "a section"))
    return name, top, tuple(sections)


def _name(title: Group, what: str) -> str:
    """Return the name in `(what name)`, with a warning where it is an unusual one.

    A domain's name becomes part of file names; a problem's name is not used.
    """
    words = [node.text for node in title.items[1:] if isinstance(node, Word)]
    if what == "problem" and len(words) == len(title.items) - 1 and len(words) != 1:
        title.place.warn(f"`{title.place.text}`: other tools take one name")
        return " ".join(words)
    if len(title.items) != 2:
        raise DomainError(f"expected `({what} name)` after `define`", title.place, code="malformed")
    node = title.items[1]
    if isinstance(node, Word) and (what == "problem" or _FILE_NAME.match(node.text)):
        if not is_name(node):
            node.place.warn(f"`{node.text}`: for other tools a name begins with a letter and goes "
                            "on with letters, digits, `-` and `_`")  # fmt: skip
        return node.text
    return expect_name(node, f"the {what}").text


def read_requirements(group: Group | None) -> frozenset[str]:
    """Return what `:requirements` lists.

    It warns of what is unknown or not supported; what needs that is refused itself.
    """
    listed: set[str] = set()
    for node in group.items[1:] if group is not None else ():
        if not isinstance(node, Word):
            raise DomainError("expected a requirement such as `:typing`", node.place)
        if (instead := REQUIREMENTS_INSTEAD.get(node.text)) is not None:
            text = f"requirement `{node.text}` is not supported"
            node.place.warn(text, "unknown-requirement", advice=instead)
        elif node.text not in SUPPORTED_REQUIREMENTS:
            advice = did_you_mean(node.text, SUPPORTED_REQUIREMENTS)
            text = f"requirement `{node.text}` is unknown; {advice}"
            node.place.warn(text, "unknown-requirement")
        listed.add(node.text)
    return frozenset(listed)


def unknown_section(section: Group, known: Sequence[str], what: str) -> DomainError:
    """Return the error of a section that a `domain` or a `problem` does not have."""
    head = section.head
    place = section.items[0].place if head else section.place
    instead = INSTEAD.get(head)
    return DomainError(
        f"`{head or '()'}` is not supported in a {what}",
        place,
        instead or did_you_mean(head, known),
        guess=None if instead else closest(head, known),
        code="unsupported" if instead else "unknown-section",
    )


def add_section(section: Group, single: dict[str, Group]) -> None:
    """Add a section to those that a file has once."""
    if section.head in single:
        raise DomainError(
            f"a second `{section.head}`", section.place, "merge the two", code="declared-twice"
        )
    single[section.head] = section
