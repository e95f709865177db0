"""Rules: names, parameters and types that a domain declares and does not use."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from serp.lint.subject import SCHEMAS, LintSubject, groups_in, words_in
from serp.pddl import syntax as x
from serp.pddl.sexpr import Group, Node, Word, read_group
from serp.pddl.source import DomainWarning


def _unused_names(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find what is declared but neither changed nor read, by name."""
    sections = list(subject.sections(*SCHEMAS, ":goal", ":metric"))
    read = {group.head for section in sections for group in groups_in(section)}
    bare = {word.text for section in sections for word in words_in(section)}
    for declaration in subject.domain.syntax.declarations.values():
        name = declaration.name
        # A function without arguments may stand without parentheses.
        used = name in read or (declaration.numeric and not declaration.parameters and name in bare)
        if not used and name not in (x.REWARD, x.UNSAFE):
            what = "function" if declaration.numeric else "predicate"
            yield DomainWarning(
                f"{what} `{name}` is declared, but nothing changes or reads it",
                declaration.place,
            )


def _unused_variables(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find parameters of actions, processes, events and quantifiers that nothing there reads."""
    understood = {schema.name for schema in subject.domain.syntax.schemas}
    for section in subject.sections(*SCHEMAS):
        if len(section.items) < 2 or section.items[1].place.text.lower() not in understood:
            continue
        listed, rest = _split_parameters(section)
        what = " ".join(item.text for item in section.items[:2] if isinstance(item, Word))
        yield from _unread(listed, rest, f"`({what}`")
        for group in groups_in(section):
            if group.head in ("forall", "exists") and len(group.items) == 3:
                yield from _unread(group.items[1], group.items[2:], f"`({group.head}`")


def _split_parameters(section: Group) -> tuple[Node | None, list[Node]]:
    """Return the list of parameters of a schema, and all the rest of it."""
    items = list(section.items)
    for index, item in enumerate(items[:-1]):
        if isinstance(item, Word) and item.text == ":parameters":
            return items[index + 1], items[:index] + items[index + 2 :]
    return None, items


def _unread(listed: Node | None, rest: Iterable[Node], what: str) -> Iterator[DomainWarning]:
    read = {word.text for node in rest for word in words_in(node)}
    for word in words_in(listed) if listed is not None else ():
        if word.text.startswith("?") and word.text not in read:
            yield DomainWarning(f"parameter `{word.text}` of {what} is not used", word.place)


def _unused_types(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find types that no parameter and no object has, nor one of a type below them."""
    domain = subject.domain
    syntax = domain.syntax
    read = {
        word.text
        for source in (domain.source, domain.problem_source)
        if source is not None
        for section in read_group(source).items[2:]
        if isinstance(section, Group) and section.head != ":types"
        for word in words_in(section)
    }
    used: set[str] = set()
    for name in read & syntax.parents.keys():
        while name in syntax.parents and name not in used:  # what it is a kind of is used as well
            used.add(name)
            name = syntax.parents[name]
    for section in subject.sections(":types"):
        for word in words_in(section):
            if word.text in syntax.parents and word.text not in used:
                used.add(word.text)
                yield DomainWarning(
                    f"type `{word.text}` is declared, but no object or parameter has it", word.place
                )


RULES = {
    "unused-name": _unused_names,
    "unused-parameter": _unused_variables,
    "unused-type": _unused_types,
}
