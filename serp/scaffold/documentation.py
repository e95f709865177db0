"""What the documentation of an environment calls its actions and the numbers of its observations.

Gymnasium's environments are documented in the docstring of their class, under the headings "Action
Space" and "Observation Space": as a list (`- 0: Push cart to the left`) or as a table
(`| 0 | Cart Position | -4.8 | 4.8 |`).
"""

from __future__ import annotations

import re
from typing import Final

_HEADING: Final = re.compile(r"^\s*#+\s*(.+?)\s*$", re.M)
_ITEM: Final = re.compile(r"^\s*(?:[-*+]\s+)?(\d+)\s*[:=.)]\s+(\S.*?)\s*$")
_ROW: Final = re.compile(r"^\s*\|\s*(\d+)\s*\|\s*([^|]*?)\s*\|")


def numbered(documentation: str, heading: str, count: int) -> list[str] | None:
    """Return what stands beside the numbers 0 ... count-1 under a heading.

    None where there is no such list or table. Of several lists the first counts.
    """
    found: dict[int, str] = {}
    for line in _under(documentation, heading).splitlines():
        match = _ROW.match(line) or _ITEM.match(line)
        if match and int(match[1]) == len(found) and match[2]:
            found[int(match[1])] = match[2]
        elif match and int(match[1]) == 0:
            break  # another list
    return [found[k] for k in range(count)] if len(found) == count else None


def _under(documentation: str, heading: str) -> str:
    """Return the text from one heading to the next."""
    headings = list(_HEADING.finditer(documentation))
    for k, match in enumerate(headings):
        if match[1].strip("* ").lower() == heading.lower():
            end = headings[k + 1].start() if k + 1 < len(headings) else len(documentation)
            return documentation[match.end() : end]
    return ""
