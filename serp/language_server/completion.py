"""What can stand at a position: names that are declared, variables in scope, words of PDDL."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from serp.language_server import keywords
from serp.language_server.index import Index, NameKind, Occurrence
from serp.pddl.comments import comment_of
from serp.pddl.source import Source

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
        elif token in keywords.FIELDS:
            field = token
        elif heads and not heads[-1]:
            heads[-1] = token
    return section, field, heads


def _forms(index: Index, field: str, heads: Sequence[str], start: int) -> list[Choice]:
    """Return what a list can begin with that stands in others with some first words."""
    around = heads[-2] if len(heads) > 1 else ""
    if around in keywords.OF_NUMBERS:
        return _names(index, (NameKind.FUNCTION,), start) + _words(keywords.NUMBERS, start)
    words: tuple[str, ...] = keywords.CONDITIONS
    if field == ":effect":
        words = keywords.EFFECTS + (keywords.CONDITIONS if "when" in heads else ())
    words = tuple(dict.fromkeys(words))
    return _names(index, (NameKind.PREDICATE,), start) + _words(words, start)


def _keywords_of(section: str, before: str, start: int) -> list[Choice]:
    if section == ":requirements":
        return _words(keywords.REQUIREMENTS, start)
    if section in (":action", ":process", ":event") and not before.endswith("("):
        return _words(keywords.FIELDS, start)
    return _words(keywords.SECTIONS, start)


def _words(words: Iterable[str], start: int) -> list[Choice]:
    return [Choice(w, "keyword", "", keywords.MEANINGS.get(w, ""), start) for w in words]


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
