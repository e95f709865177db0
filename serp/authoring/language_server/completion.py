"""What can stand at a position: names that are declared, variables in scope, words of PDDL."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from serp.authoring.language_server.index import FLUENTS, Index, NameKind, Occurrence, Use
from serp.pddl.scope import INSTEAD, REQUIREMENTS_INSTEAD
from serp.pddl.source import Place, Source, comment_of

_REFUSED = {**INSTEAD, **REQUIREMENTS_INSTEAD}
MEANINGS = {
    **{
        word: f"Not supported: {instead}."
        for word, instead in _REFUSED.items()
        if word.startswith(":") or word in ("oneof", "probabilistic", "preference")
    },
    "define": "A file holds one definition: a domain, or a problem of it.",
    "domain": "The name of the domain; the task of the same name belongs to it.",
    "problem": "The name of the problem.",
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
    "and": "All of these hold, or happen.",
    "or": "At least one of these holds.",
    "not": "This does not hold; as an effect, it becomes false.",
    "imply": "Where the first holds, so does the second.",
    "forall": "For every object of a type.",
    "exists": "For at least one object of a type.",
    "when": "An effect that happens only where a condition holds before the step.",
    "assign": "Sets a function to a number.",
    "increase": "Adds a number to a function; in a process, a rate: `(* #t rate)`.",
    "decrease": "Takes a number from a function; in a process, a rate: `(* #t rate)`.",
    "scale-up": "Multiplies a function by a number.",
    "scale-down": "Divides a function by a number.",
    "either": "One of several types.",
    "#t": "The time that passes in a step; a factor of a rate in a process.",
    "reward": "Reserved: what it gains in a step is the reward of the step.",
    "unsafe": "Reserved: what makes it true damages something, and is avoided as long as anything "
    "else is possible. It is false again in the next step.",
    "terminal": "Reserved: what makes it true ends the task.",
    "+": "The sum of two numbers.",
    "-": "A difference; in lists, the type of what stands before it.",
    "*": "The product of two numbers.",
    "/": "A quotient.",
    "=": "Two numbers, or two objects, are equal.",
    "<": "Less than.",
    "<=": "At most.",
    ">": "More than.",
    ">=": "At least.",
    "sqrt": "The root of a number.",
    "abs": "A number without its sign.",
    "min": "The least of some numbers.",
    "max": "The greatest of some numbers.",
    "sin": "The sine of an angle in radians.",
    "cos": "The cosine of an angle in radians.",
    "atan2": "The angle, in radians, of a point with coordinates y and x.",
    "object": "The type that all objects have.",
    "number": "What functions have; it need not be written.",
    "minimize": "What it loses in a step is the reward of the step.",
    "maximize": "What it gains in a step is the reward of the step.",
    "total-time": "The time since the start; a metric can read it.",
    ":strips": "The file has predicates, and effects on them.",
    ":typing": "The file gives types to objects and parameters.",
    ":equality": "The file compares objects: `(= ?a ?b)`.",
    ":negative-preconditions": "The file has conditions with `not`.",
    ":disjunctive-preconditions": "The file has conditions with `or` or `imply`.",
    ":existential-preconditions": "The file has conditions with `exists`.",
    ":universal-preconditions": "The file has conditions with `forall`.",
    ":quantified-preconditions": "The file has conditions with `exists` or `forall`.",
    ":conditional-effects": "The file has effects under `when` or `forall`.",
    ":adl": "The file has types, conditions of every kind, and conditional effects.",
    **dict.fromkeys((":fluents", ":numeric-fluents"), "The file has functions of numbers."),
    ":action-costs": "The file has functions of numbers that are increased only, as costs.",
    **dict.fromkeys(
        (":time", ":hybrid", ":continuous-effects"), "The file has processes, or events."
    ),
    ":processes": "The file has processes.",
    ":events": "The file has events.",
    ":math-functions": "The file has `sqrt`, `sin` and the like, which other PDDL tools refuse.",
}
"""Word → its meaning."""

SECTIONS = (":requirements", ":types", ":constants", ":predicates", ":functions",
            ":action", ":process", ":event", ":domain", ":objects", ":init", ":goal",
            ":metric")  # fmt: skip
FIELDS = (":parameters", ":precondition", ":effect")
COMPARISONS = ("=", "<", "<=", ">", ">=")
CONDITIONS = ("and", "or", "not", "imply", "forall", "exists", *COMPARISONS)
CHANGES = ("assign", "increase", "decrease", "scale-up", "scale-down")
EFFECTS = ("and", "not", "when", "forall", *CHANGES)
NUMBERS = ("+", "-", "*", "/")
OF_NUMBERS = (*COMPARISONS, *CHANGES, *NUMBERS)
"""What numbers stand behind."""
REQUIREMENTS = (":strips", ":typing", ":equality", ":adl", ":conditional-effects",
                ":negative-preconditions", ":disjunctive-preconditions", ":numeric-fluents",
                ":time", ":math-functions")  # fmt: skip


_BEFORE = re.compile(r"([^\s();]*)\Z")
_VARIABLE = re.compile(r"\?[\w-]+")
_SECTION = re.compile(r"\(\s*(:[\w-]+)", re.ASCII)


class Choice(NamedTuple):
    """One thing that can stand there.

    Attributes:
        text: What is written.
        kind: `keyword`, or what the name names.
        detail: Parameters or type, shown beside it.
        explanation: The expert's comment, or the meaning of a keyword.
        start: Where the word begins that it takes the place of.
    """

    text: str
    kind: str
    detail: str
    explanation: str
    start: int


def choices(index: Index, source: Source, position: int) -> list[Choice]:
    """Return what can stand at a position of a file, in alphabetical order within a kind."""
    text = source.text[:position]
    if ";" in text[text.rfind("\n") + 1 :]:
        return []
    word = _BEFORE.search(text)
    start = word.start() if word is not None else position
    typed, before = text[start:], text[:start].rstrip()
    section, field, heads = _surroundings(text[:start])
    if typed.startswith("?"):
        found = _variables(text, section, start)
    elif before.endswith(" -") or before.endswith("\n-"):
        found = _names(index, (NameKind.TYPE,), start) + _words(("object", "number"), start)
    elif typed.startswith(":") or (before.endswith("(") and section == ""):
        found = _keywords_of(section, before, start)
    elif before.endswith("("):
        found = _forms(index, field, heads, start)
    else:
        found = _names(index, (NameKind.OBJECT,), start) + _variables(text, section, start)
    return [choice for choice in found if choice.text.startswith(typed.lower())]


def _surroundings(text: str) -> tuple[str, str, list[str]]:
    """Return the section and the field that a text ends in, and the first words of open lists.

    Section and field are empty where there is none; so is the first word of a list that has none.
    """
    section = field = ""
    heads: list[str] = []
    for match in re.finditer(r";[^\n]*|[()]|[^\s();]+", text):
        token = match[0].lower()
        if token == "(":
            heads.append("")
            head = _SECTION.match(text, match.start())
            if len(heads) <= 2 and head is not None:
                section, field = head[1].lower(), ""
        elif token == ")":
            del heads[-1:]
            if len(heads) <= 1:
                section = field = ""
        elif token in FIELDS:
            field = token
        elif heads and not heads[-1]:
            heads[-1] = token
    return section, field, heads


def _forms(index: Index, field: str, heads: Sequence[str], start: int) -> list[Choice]:
    """Return what a list can begin with that stands in others with some first words."""
    around = heads[-2] if len(heads) > 1 else ""
    if around in OF_NUMBERS:
        return _names(index, (NameKind.FUNCTION,), start) + _words(NUMBERS, start)
    words: tuple[str, ...] = CONDITIONS
    if field == ":effect":
        words = EFFECTS + (CONDITIONS if "when" in heads else ())
    words = tuple(dict.fromkeys(words))
    return _names(index, (NameKind.PREDICATE,), start) + _words(words, start)


def _keywords_of(section: str, before: str, start: int) -> list[Choice]:
    if section == ":requirements":
        return _words(REQUIREMENTS, start)
    if section in (":action", ":process", ":event") and not before.endswith("("):
        return _words(FIELDS, start)
    return _words(SECTIONS, start)


def _words(words: Iterable[str], start: int) -> list[Choice]:
    return [Choice(w, "keyword", "", MEANINGS.get(w, ""), start) for w in words]


def _names(index: Index, kinds: tuple[NameKind, ...], start: int) -> list[Choice]:
    found = {o.name: o for o in index.declared(*kinds)}
    return [
        Choice(name, found[name].kind.value, _parameters(found[name]), _comment(found[name]), start)
        for name in sorted(found)
    ]


def _parameters(occurrence: Occurrence) -> str:
    return occurrence.form.text if occurrence.form != occurrence.place else ""


def _comment(occurrence: Occurrence) -> str:
    return comment_of(occurrence.form)


def _variables(text: str, section: str, start: int) -> list[Choice]:
    """Return the variables that stand in the section so far."""
    begin = text.rfind(f"({section}") if section else len(text)
    names = dict.fromkeys(_VARIABLE.findall(text[max(begin, 0) : start]))
    return [Choice(name.lower(), NameKind.VARIABLE.value, "", "", start) for name in sorted(names)]


_WORD = re.compile(r"[^\s();]+")
_MOST = 12
"""Places of one kind that are listed."""


def explained(index: Index, source: Source, position: int) -> tuple[str, Place] | None:
    """Return what is known of a word, and its place; None where nothing is.

    A fluent comes with the expert's comment, its value in the problem's `:init`, and the actions,
    processes and events that change and read it, with their lines.
    """
    place = _word_at(source, position)
    if place is None:
        return None
    occurrence = index.at(source, position)
    word = place.text.lower()
    texts: list[str] = []
    if occurrence is not None and occurrence.kind in FLUENTS:
        texts += _fluent(index, occurrence)
    elif occurrence is not None:
        texts += _other(index, occurrence)
    if word in MEANINGS and (occurrence is None or word in ("reward", "unsafe", "terminal")):
        texts.append(MEANINGS[word])
    return ("\n\n".join(texts), place) if texts else None


def _word_at(source: Source, position: int) -> Place | None:
    line = source.place(position, position).line
    start = source.line_starts[line - 1]
    code = source.line_text(line).partition(";")[0]
    for match in _WORD.finditer(code):
        if start + match.start() <= position <= start + match.end():
            return source.place(start + match.start(), start + match.end())
    return None


def _fluent(index: Index, occurrence: Occurrence) -> list[str]:
    declaration = index.declaration(occurrence)
    form = declaration.form if declaration is not None else occurrence.form
    texts = [f"```pddl\n{form.text}\n```"]
    comment = comment_of(form)
    same = index.same(occurrence)
    initial = [o.form.text for o in same if o.use is Use.INITIAL]
    texts += [comment] if comment else []
    if initial:
        texts.append(f"At the start: {_listed(f'`{text}`' for text in initial)}")
    changed = _sections([o for o in same if o.use is Use.CHANGED])
    read = _sections([o for o in same if o.use is Use.READ])
    texts.append(f"Changed by {changed or 'nothing'}  \nRead by {read or 'nothing'}")
    return texts


def _sections(occurrences: Iterable[Occurrence]) -> str:
    """Return in what sections a name occurs, and in which lines."""
    lines: dict[str, list[int]] = {}
    for occurrence in occurrences:
        kind, _, name = occurrence.inside.text.lstrip("(:").partition(" ")
        named = f"{kind} `{name}`" if name and not name.startswith("(") else f"`:{kind}`"
        lines.setdefault(named, []).append(occurrence.place.line)
    return _listed(
        f"{named} (line{'s' if len(set(at)) > 1 else ''} {', '.join(map(str, sorted(set(at))))})"
        for named, at in lines.items()
    )


def _listed(texts: Iterable[str]) -> str:
    found = list(dict.fromkeys(texts))
    more = f" and {len(found) - _MOST} more" if len(found) > _MOST else ""
    return ", ".join(found[:_MOST]) + more


def _other(index: Index, occurrence: Occurrence) -> list[str]:
    declaration = index.declaration(occurrence)
    if declaration is None:
        return []
    of_type = f" of type `{declaration.type}`" if declaration.type else ""
    texts = [f"{occurrence.kind.value} `{occurrence.name}`{of_type}"]
    is_schema = occurrence.kind in (NameKind.ACTION, NameKind.PROCESS, NameKind.EVENT)
    comment = comment_of(declaration.inside if is_schema else declaration.place)
    if comment and occurrence.kind is not NameKind.VARIABLE:
        texts.append(comment)
    return texts
