"""Changes that an editor offers: other names, fixes of findings, comments that silence."""

from __future__ import annotations

import re

from serp.errors import SerpError
from serp.language_server.index import Index, NameKind, Occurrence
from serp.lint.findings import Finding
from serp.pddl import syntax as x
from serp.pddl.declarations import RESERVED_WORDS
from serp.pddl.edits import Edit, line_end
from serp.pddl.source import Place, Source

_NAME = re.compile(r"[a-z][a-z0-9_\-]*\Z", re.IGNORECASE | re.ASCII)
_FIXED = (x.REWARD, x.UNSAFE, x.TERMINAL, x.OBJECT)


def renamable(index: Index, source: Source, position: int) -> Occurrence | None:
    """Return the name at a position where the files declare it, and it is not reserved."""
    here = index.at(source, position)
    if here is None or here.name in _FIXED or index.declaration(here) is None:
        return None
    return here


def renamed(index: Index, source: Source, position: int, name: str) -> list[Place]:
    """Return all places of a name that is to be another one.

    Raises:
        SerpError: There is nothing to rename, or the new name is none, or is taken.
    """
    here = renamable(index, source, position)
    if here is None:
        raise SerpError("nothing that the files declare stands here")
    variable = here.kind is NameKind.VARIABLE
    plain = name.removeprefix("?") if variable else name
    if variable != name.startswith("?") or not _NAME.match(plain):
        wanted = "`?` and a name" if variable else "a letter, then letters, digits, `-` and `_`"
        raise SerpError(f"`{name}` cannot be a name here: expected {wanted}")
    if plain.lower() in (*RESERVED_WORDS, *_FIXED):
        raise SerpError(f"`{name}` is a word of PDDL, or reserved")
    same_scope = [o for o in index.occurrences if not variable or o.inside == here.inside]
    if name.lower() != here.name and any(o.name == name.lower() for o in same_scope):
        raise SerpError(f"`{name}` is taken")
    return [occurrence.place for occurrence in index.same(here)]


def silence(finding: Finding) -> Edit | None:
    """Return the edit that puts the comment which silences a warning; None for an error."""
    place = finding.place
    if finding.severity == "error" or place is None or finding.code == "useless-silence":
        return None
    end = line_end(place.source.text, place.start)
    comment = f"  ; serp: ignore[{finding.code}]"
    return Edit(end, end, comment)
