"""Names for a domain file, made of whatever an environment calls things."""

from __future__ import annotations

import re
import unicodedata
from typing import Final

from serp.pddl.declarations import RESERVED_WORDS

_RESERVED: Final = RESERVED_WORDS | {"reward", "unsafe", "terminal", "over", "at-start", "at-end"}
_LONGEST: Final = 40
_ASIDE: Final = re.compile(r"\([^()]*\)|\[[^\[\]]*\]|`")
_MINUS: Final = re.compile(r"(?<![\w.])[-−](?=\d)")


class Names:
    """Makes names of PDDL of any texts; no name is given twice."""

    def __init__(self) -> None:
        self._given: set[str] = set()

    def make(self, text: str, otherwise: str) -> str:
        """Return a name that says what a text says; `otherwise` where the text has no letters.

        What stands in brackets is left out, and all but the first sentence.
        """
        plain = unicodedata.normalize("NFKD", _ASIDE.sub("", text)).encode("ascii", "ignore")
        words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", _MINUS.sub("minus ", plain.decode()))
        words = re.split(r"[.;:,](?:\s|$)", words.strip())[0].lower().replace("'", "")
        name = "-".join(re.findall(r"[a-z0-9]+", words))
        while len(name) > _LONGEST and "-" in name:
            name = name.rpartition("-")[0]
        name = name[:_LONGEST].strip("-")
        if not re.search("[a-z]", name):
            name = "-".join(re.findall(r"[a-z0-9]+", otherwise.lower())) or "entry"
        if not name[0].isalpha() or name in _RESERVED:
            name = f"the-{name}"
        unique, number = name, 1
        while unique in self._given:
            number += 1
            unique = f"{name}-{number}"
        self._given.add(unique)
        return unique


def remark(text: str) -> str:
    """Return a text for a comment of one line: no line breaks, control characters and quotes."""
    kept = (c if c.isprintable() and c not in '"\\' else " " for c in text)
    return " ".join("".join(kept).split())[:100]
