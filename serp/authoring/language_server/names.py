"""Names of a domain and its problem: declared, used, completed and explained; words of PDDL.

The index is made of the lists and words of the files, so that it has everything that can be read
of a file that is being written.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from lsprotocol import types

from serp.pddl.parser import (
    DOMAIN_SECTIONS,
    PROBLEM_SECTIONS,
    SCHEMA_FIELDS,
    SCHEMA_SECTIONS,
    SUPPORTED_REQUIREMENTS,
)
from serp.pddl.reader import Group, Node, Word, read_what_can_be
from serp.pddl.scope import INSTEAD, is_name
from serp.pddl.source import Place, Source, comment_of, line_start
from serp.pddl.syntax import Change

FLUENTS = ("predicate", "function")


class DeclaredName(NamedTuple):
    """Where a name, in lower case, is declared.

    `kind` is `predicate`, `function`, `type`, `object`, `action`, `process`, `event` or `variable`;
    `place` the word; `form` the form that it begins or names, else the word itself.
    """

    name: str
    kind: str
    place: Place
    form: Place


class Index:
    """The names in files that belong together."""

    def __init__(self, *sources: Source) -> None:
        self.sources = sources
        self._sections = [section for source in sources for section in read_what_can_be(source)]
        self.declared = [name for section in self._sections for name in _declared(section)]

    def declaration(self, word: Place) -> DeclaredName | None:
        """Return where what a word names is declared; None where it is not."""
        name, source = word.text.lower(), word.source
        if name.startswith("?"):  # where it first is in its section
            for section in self._sections:
                place = section.place
                if place.source.name == source.name and place.start <= word.start < place.end:
                    first = next((w.place for w in _words_of(section) if w.text == name), None)
                    if first is not None:
                        return DeclaredName(name, "variable", first, first)
        same = [declared for declared in self.declared if declared.name == name]
        opens = source.text[: word.start].endswith("(")
        fitting = (declared for declared in same if (declared.kind in FLUENTS) == opens)
        return next(fitting, next(iter(same), None))

    def uses(self, fluent: str) -> Iterator[tuple[str, list[int]]]:
        """Yield each section that names a fluent, such as `action go`, and the lines there."""
        for section in self._sections:
            lines = [word.place.line for word in _words_of(section) if word.text == fluent]
            if lines and section.head not in (":predicates", ":functions"):
                schema = section.head in SCHEMA_SECTIONS
                title = section.place.opening.text.lstrip("(:") if schema else section.head
                yield title, list(dict.fromkeys(lines))


def typed_before(text: str) -> str:
    """Return the word that a text ends with; it may be empty."""
    return re.split(r"[\s();]", text)[-1]


def word_at(source: Source, position: int) -> Place | None:
    """Return the word at a position of a file, or right before it; None in a comment."""
    line = source.text[line_start(source.text, position) : position]
    start = position - len(typed_before(line))
    end = position + len(re.split(r"[\s();]", source.text[position:], maxsplit=1)[0])
    return source.place(start, end) if start < end and ";" not in line else None


def _declared(section: Group) -> Iterator[DeclaredName]:
    items = section.items[1:]
    match section.head:
        case ":types" | ":constants" | ":objects" as head:
            kind = "type" if head == ":types" else "object"
            for word in _without_types(items):
                yield DeclaredName(word.text, kind, word.place, word.place)
        case ":predicates" | ":functions" as head:
            for item in items:
                first = item.items[0] if isinstance(item, Group) and item.items else None
                if isinstance(first, Word) and is_name(first):
                    yield DeclaredName(first.text, head[1:-1], first.place, item.place)
        case head if head in SCHEMA_SECTIONS and items and isinstance(items[0], Word):
            yield DeclaredName(items[0].text, head[1:], items[0].place, section.place.opening)


def _without_types(items: Sequence[Node]) -> Iterator[Word]:
    """Yield the names in a typed list, such as `a` and `b` in `a b - t`."""
    before = ""
    for item in items:
        text = item.text if isinstance(item, Word) else ""
        if isinstance(item, Word) and "-" not in (text, before):
            yield item
        before = text


def _words_of(group: Group) -> Iterator[Word]:
    for item in group.items:
        yield from (item,) if isinstance(item, Word) else _words_of(item)


# Completion and hover -----------------------------------------------------------------------------

MEANINGS = {
    **{
        word: f"Not supported: {instead}."
        for word, instead in INSTEAD.items()
        if word.startswith(":") or word == "preference"
    },
    ":requirements": "The PDDL features that a tool must support to read the file.",
    ":types": "Kinds of objects: `cup plate - dish` declares two kinds of dish.",
    ":constants": "Objects that every problem has.",
    ":predicates": "Facts that are true or false.",
    ":functions": "Quantities with a numeric value.",
    ":action": "What the robot can do. One action is carried out in each step.",
    ":process": "What the world does by itself: while its condition holds, a process changes "
    "numbers at a rate, after the action of each step.",
    ":event": "What happens at a threshold: an event happens once in a step, if its condition "
    "holds after the action and the processes.",
    ":parameters": "Variables for objects. Each choice of objects gives one instance.",
    ":precondition": "When the action, process or event can happen. An action whose "
    "precondition does not hold is not applicable.",
    ":effect": "What changes. All effects are evaluated before any is applied.",
    ":init": "The initial state. Predicates that it does not list are false.",
    ":goal": "If this holds, the task ends.",
    ":metric": "What is to be maximised or minimised; `(reward)` by default.",
    "imply": "If the first condition holds, the second must hold, too.",
    "forall": "Applies to every object of a type.",
    "exists": "Holds if at least one object of a type satisfies the condition.",
    "when": "An effect that happens only if a condition holds before the step.",
    "probabilistic": "At most one of the effects happens, each with the probability before it.",
    "oneof": "One of the effects happens; all are equally likely.",
    "assign": "Sets a function to a number.",
    "increase": "Adds a number to a function. In a process it is a rate: `(* #t rate)`.",
    "decrease": "Subtracts a number from a function. In a process it is a rate: `(* #t rate)`.",
    "scale-up": "Multiplies a function by a number.",
    "scale-down": "Divides a function by a number.",
    "#t": "The time that passes in a step, by which a process multiplies its rate.",
    "reward": "Reserved: its increase in a step is the reward of the step.",
    "unsafe": "Reserved: make it true if something is damaged. Actions that make it true are "
    "avoided while another action is possible. It is false again in the next step.",
    "terminal": "Reserved: if it becomes true, the task ends.",
    "minimize": "The decrease of this number in a step is the reward of the step.",
    "maximize": "The increase of this number in a step is the reward of the step.",
    "total-time": "The time since the start; a metric can read it.",
    ":math-functions": "The file may use functions such as `sqrt`; other PDDL tools refuse them.",
}
"""Word → its meaning, of those that a name does not tell."""

_KEYWORDS = (*DOMAIN_SECTIONS, *SCHEMA_SECTIONS, *SCHEMA_FIELDS, *PROBLEM_SECTIONS)
_FORMS = (
    *("and", "or", "not", "imply", "forall", "exists", "when", "probabilistic", "oneof"),
    *("=", "<", "<=", ">", ">=", "+", "-", "*", "/"),
    *(change.value for change in Change),
)
"""Words that a form begins with."""
_VARIABLE = re.compile(r"\?[\w-]+")
_KINDS = {
    "predicate": types.CompletionItemKind.Property,
    "function": types.CompletionItemKind.Field,
    "type": types.CompletionItemKind.Class,
    "object": types.CompletionItemKind.Constant,
}


def completions(index: Index, source: Source, position: int) -> list[types.CompletionItem]:
    """Return what may be written at a position of a file, in alphabetical order within a kind.

    Each takes the place of the word that ends at the position.
    """
    text = source.text[:position]
    if ";" in text[text.rfind("\n") + 1 :]:
        return []
    typed = typed_before(text)
    start = len(text) - len(typed)
    before, section = text[:start].rstrip(), text[max(text.rfind("(:"), 0) : start]
    if typed.startswith("?"):
        items = _variables(section)
    elif before.endswith((" -", "\n-")):
        items = _names(index, "type") + _words(("object", "number"))
    elif typed.startswith(":"):
        listed = section.startswith("(:requirements")
        items = _words(sorted(SUPPORTED_REQUIREMENTS) if listed else _KEYWORDS)
    elif before.endswith("("):
        items = _names(index, "predicate") + _names(index, "function") + _words(_FORMS)
    else:
        items = _names(index, "object") + _variables(section)
    return [item for item in items if item.label.startswith(typed.lower())]


def _words(words: Iterable[str]) -> list[types.CompletionItem]:
    keyword = types.CompletionItemKind.Keyword
    return [types.CompletionItem(word, kind=keyword, documentation=MEANINGS.get(word))
            for word in dict.fromkeys(words)]  # fmt: skip


def _names(index: Index, kind: str) -> list[types.CompletionItem]:
    declared = {each.name: each for each in index.declared if each.kind == kind}
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


def explained(index: Index, source: Source, position: int) -> tuple[str, Place] | None:
    """Return the explanation of a word in Markdown, and its place; None where there is none.

    A fluent comes with the expert's comment, and the parts of the files that name it, with their
    lines.
    """
    place = word_at(source, position)
    if place is None:
        return None
    word, declared = place.text.lower(), index.declaration(place)
    texts: list[str] = []
    if declared is not None and declared.kind in FLUENTS:
        uses = [
            f"`{title}` (line{'s' * (len(lines) > 1)} {', '.join(map(str, lines))})"
            for title, lines in index.uses(word)
        ]
        texts = [f"```pddl\n{declared.form.text}\n```", comment_of(declared.form)]
        texts.append(f"Used in {', '.join(uses) or 'nothing'}")
    elif declared is not None:
        texts = [f"{declared.kind} `{word}`"]
        if declared.kind != "variable":
            line = declared.form.source_line.partition(";")[0].strip()
            texts += [f"```pddl\n{line}\n```", comment_of(declared.form)]
    if word in MEANINGS and (declared is None or word in ("reward", "unsafe", "terminal")):
        texts.append(MEANINGS[word])
    return ("\n\n".join(filter(None, texts)), place) if texts else None
