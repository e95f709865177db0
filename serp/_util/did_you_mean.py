"""Suggestions for misspelt words: did you mean ...?"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return advice naming the closest known word, or listing a few of them."""
    candidates = sorted(set(known))
    if (close := closest(word, candidates)) is not None:
        return f"did you mean `{close}`?"
    return f"known here: {listed(candidates)}" if candidates else ""


def closest(word: str, known: Iterable[str]) -> str | None:
    """Return the known word most like another one, at best its parts in another order, or None."""
    names = {name.casefold(): name for name in sorted(known)}
    word = word.casefold()
    parts = sorted(word.split("-"))
    turned = [name for name in names if sorted(name.split("-")) == parts]
    close = turned or difflib.get_close_matches(word, names, n=1, cutoff=0.6)
    return names[close[0]] if close else None


def listed(names: Iterable[str], most: int = 8) -> str:
    """Return names in quotes, and how many more there are; empty for none."""
    known = list(names)
    more = f" and {len(known) - most:,} more" if len(known) > most else ""
    return ", ".join(f"`{name}`" for name in known[:most]) + more
