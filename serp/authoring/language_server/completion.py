"""Completion and hover: names that are declared, variables in scope, words of PDDL."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from lsprotocol import types

from serp.authoring.language_server.index import FLUENTS, Index, NameKind, word_at
from serp.pddl.parser import (
    DOMAIN_SECTIONS,
    PROBLEM_SECTIONS,
    SCHEMA_FIELDS,
    SCHEMA_SECTIONS,
    SUPPORTED_REQUIREMENTS,
)
from serp.pddl.scope import INSTEAD
from serp.pddl.source import Place, Source, comment_of
from serp.pddl.syntax import Change

MEANINGS = {
    **{
        word: f"Not supported: {instead}."
        for word, instead in INSTEAD.items()
        if word.startswith(":") or word in ("oneof", "probabilistic", "preference")
    },
    ":requirements": "What other PDDL tools have to support to read the file.",
    ":types": "Kinds of objects: `cup plate - dish` are two kinds of dishes.",
    ":constants": "Objects that every problem has.",
    ":predicates": "What is true or false.",
    ":functions": "What has a number.",
    ":action": "What the robot can do. One action is carried out in each step.",
    ":process": "What the world does by itself: while its condition holds, it changes numbers at a "
    "rate, after the action of each step.",
    ":event": "What happens at a point: once in a step, as soon as its condition holds, after "
    "action and processes.",
    ":parameters": "The objects that it is about; there is an instance for each choice of them.",
    ":precondition": "When it can happen. An action whose precondition does not hold is not "
    "applicable.",
    ":effect": "What it changes. All effects are evaluated before any of them is made.",
    ":domain": "The domain that the problem belongs to.",
    ":objects": "The objects of the problem.",
    ":init": "The state at the start; what is not stated is false.",
    ":goal": "Where this holds, the task ends.",
    ":metric": "What is to be maximised or minimised; `(reward)` by default.",
    "imply": "Where the first holds, so does the second.",
    "forall": "For every object of a type.",
    "exists": "For at least one object of a type.",
    "when": "An effect that happens only where a condition holds before the step.",
    "assign": "Sets a function to a number.",
    "increase": "Adds a number to a function; in a process, a rate: `(* #t rate)`.",
    "decrease": "Takes a number from a function; in a process, a rate: `(* #t rate)`.",
    "scale-up": "Multiplies a function by a number.",
    "scale-down": "Divides a function by a number.",
    "#t": "The time that passes in a step; a factor of a rate in a process.",
    "reward": "Reserved: what it gains in a step is the reward of the step.",
    "unsafe": "Reserved: what makes it true damages something, and is avoided as long as anything "
    "else is possible. It is false again in the next step.",
    "terminal": "Reserved: what makes it true ends the task.",
    "minimize": "What it loses in a step is the reward of the step.",
    "maximize": "What it gains in a step is the reward of the step.",
    "total-time": "The time since the start; a metric can read it.",
    ":math-functions": "The file has `sqrt`, `sin` and the like, which other PDDL tools refuse.",
}
"""Word → its meaning, of those that a name does not tell."""

_KEYWORDS = (*DOMAIN_SECTIONS, *SCHEMA_SECTIONS, *SCHEMA_FIELDS, *PROBLEM_SECTIONS)
_FORMS = (
    *("and", "or", "not", "imply", "forall", "exists", "when"),
    *("=", "<", "<=", ">", ">=", "+", "-", "*", "/"),
    *(change.value for change in Change),
)
"""Words that a form begins with."""
_BEFORE = re.compile(r"([^\s();]*)\Z")
_VARIABLE = re.compile(r"\?[\w-]+")


_KINDS = {
    NameKind.PREDICATE: types.CompletionItemKind.Property,
    NameKind.FUNCTION: types.CompletionItemKind.Field,
    NameKind.TYPE: types.CompletionItemKind.Class,
    NameKind.OBJECT: types.CompletionItemKind.Constant,
}


def completions(index: Index, source: Source, position: int) -> list[types.CompletionItem]:
    """Return what may be written at a position of a file, in alphabetical order within a kind.

    Each takes the place of the word that ends at the position.
    """
    text = source.text[:position]
    if ";" in text[text.rfind("\n") + 1 :]:
        return []
    start = word_start(text)
    typed, before = text[start:].lower(), text[:start].rstrip()
    section = text[max(text.rfind("(:"), 0) : start]
    if typed.startswith("?"):
        items = _variables(section)
    elif before.endswith((" -", "\n-")):
        items = _names(index, NameKind.TYPE) + _words(("object", "number"))
    elif typed.startswith(":"):
        items = _words(_KEYWORDS)
        if section.startswith("(:requirements"):
            items = _words(sorted(SUPPORTED_REQUIREMENTS))
    elif before.endswith("("):
        items = _names(index, NameKind.PREDICATE) + _names(index, NameKind.FUNCTION)
        items += _words(_FORMS)
    else:
        items = _names(index, NameKind.OBJECT) + _variables(section)
    return [item for item in items if item.label.startswith(typed)]


def word_start(text: str) -> int:
    """Return where the word begins that a text ends with."""
    match = _BEFORE.search(text)
    return match.start() if match is not None else len(text)


def _words(words: Iterable[str]) -> list[types.CompletionItem]:
    keyword = types.CompletionItemKind.Keyword
    return [types.CompletionItem(word, kind=keyword, documentation=MEANINGS.get(word))
            for word in dict.fromkeys(words)]  # fmt: skip


def _names(index: Index, kind: NameKind) -> list[types.CompletionItem]:
    declared = {each.name: each for each in index.declared if each.kind is kind}
    return [
        types.CompletionItem(
            name,
            kind=_KINDS[kind],
            detail=each.form.text if each.form != each.place else None,
            documentation=comment_of(each.form) or None,
        )
        for name, each in sorted(declared.items())
    ]


def _variables(text: str) -> list[types.CompletionItem]:
    """Return the variables in the section so far."""
    names = {name.lower() for name in _VARIABLE.findall(text)}
    return [types.CompletionItem(name, kind=types.CompletionItemKind.Variable)
            for name in sorted(names)]  # fmt: skip


# Hover -------------------------------------------------------------------------------------------


def explained(index: Index, source: Source, position: int) -> tuple[str, Place] | None:
    """Return the explanation of a word in Markdown, and its place; None where there is none.

    A fluent comes with the expert's comment, its value in the problem's `:init`, and the actions,
    processes and events that change and read it, with their lines.
    """
    place = word_at(source, position)
    if place is None:
        return None
    word, declared = place.text.lower(), index.declaration(place)
    texts: list[str] = []
    if declared is not None:
        of_type = f" of type `{declared.type}`" if declared.type else ""
        fluent = declared.kind in FLUENTS
        texts.append(
            f"```pddl\n{declared.form.text}\n```"
            if fluent
            else f"{declared.kind.value} `{declared.name}`{of_type}"
        )
        if declared.kind is not NameKind.VARIABLE:
            texts.append(comment_of(declared.form))
        texts += _uses(index, word) if fluent else []
    if word in MEANINGS and (declared is None or word in ("reward", "unsafe", "terminal")):
        texts.append(MEANINGS[word])
    return ("\n\n".join(filter(None, texts)), place) if texts else None


def _uses(index: Index, fluent: str) -> Iterator[str]:
    """Yield at what values a fluent begins, and what changes and reads it, with the lines."""
    initial: list[str] = []
    sections: dict[str, dict[str, list[int]]] = {"changed": {}, "read": {}}
    for use in index.uses(fluent):
        if use.what == "initial":
            initial.append(f"`{use.place.text}`")
            continue
        kind, _, name = use.section.text.lstrip("(:").partition(" ")
        named = f"{kind} `{name}`" if name and not name.startswith("(") else f"`:{kind}`"
        lines = sections[use.what].setdefault(named, [])
        lines += [use.place.line] * (use.place.line not in lines)
    if initial:
        yield f"At the start: {_listed(initial)}"
    changed, read = (
        _listed(
            f"{named} (line{'s' * (len(lines) > 1)} {', '.join(map(str, lines))})"
            for named, lines in places.items()
        )
        for places in sections.values()
    )
    yield f"Changed by {changed or 'nothing'}  \nRead by {read or 'nothing'}"


def _listed(texts: Iterable[str]) -> str:
    most = 12  # Places of one kind that are listed.
    known = list(texts)
    more = f" and {len(known) - most} more" if len(known) > most else ""
    return ", ".join(known[:most]) + more
