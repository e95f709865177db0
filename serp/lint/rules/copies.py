"""Rule: actions, processes and events that were copied and not changed."""

from __future__ import annotations

from collections.abc import Iterator

from serp.lint.subject import SCHEMAS, LintSubject, values_of
from serp.pddl import syntax as x
from serp.pddl.sexpr import Group, Node, Word
from serp.pddl.slips import written
from serp.pddl.source import DomainWarning


def _same_schema(subject: LintSubject) -> Iterator[DomainWarning]:
    """Find schemas that say the same as an earlier one.

    Actions that do nothing, or cost something only, are described by their names: nobody has
    measured what they do.
    """
    known: dict[tuple[object, ...], str] = {}
    schemas = subject.domain.syntax.schemas
    telling = {s.name for s in schemas if s.kind is not x.Kind.ACTION or _changes_something(s)}
    for section in subject.sections(*SCHEMAS):
        name = section.items[1].place.text.lower() if len(section.items) > 1 else ""
        if name not in telling:
            continue
        values = values_of(section)
        key = (section.head, *(_sorted(values.get(k)) for k in values), *values)
        first = known.setdefault(key, name)
        if first != name:
            kind = section.head[1:]
            yield DomainWarning(
                f"{kind} `{name}` says the same as {kind} `{first}`",
                section.place.opening,
                advice="is one of them a copy that should have been changed?",
            )


def _changes_something(schema: x.Schema) -> bool:
    return any(
        (isinstance(effect, x.ChangeFunction) and effect.function.name != x.REWARD)
        or isinstance(effect, x.SetPredicate)
        for effect in x.nested_effects(schema.effects)
    )


def _sorted(node: Node | None) -> object:
    """Return a form without places; the order under `and` and `or` does not count."""
    if not isinstance(node, Group):
        return "" if node is None else node.text
    items = [item.text if isinstance(item, Word) else written(item).lower() for item in node.items]
    return tuple([*items[:1], *sorted(items[1:])] if node.head in ("and", "or") else items)


RULES = {"same-schema": _same_schema}
