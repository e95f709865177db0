"""What to write instead of a line of a scenario file that cannot be read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from serp._util.text import closest, did_you_mean, listed
from serp.pddl.source import DomainError, Place

BEGINNINGS: Final = {
    "chooses": "chooses push-left",
    "does not choose": "does not choose push-left",
    "refuses": "refuses push-left because unsafe",
    "allows": "allows push-right",
    "is indifferent": "is indifferent",
    "value of": "value of push-right is about 2.5",
    "reward of": "reward of push-right is at least 0",
    "after": "after 3 steps (pole-angle) is about 0.05",
}
"""How an expectation begins → an example."""


def for_beginning(line: str, word: Place, fluents: Sequence[str]) -> DomainError:
    """Return the error of a line that begins neither a situation nor an expectation.

    Args:
        line: It, as written.
        word: The place of its first word.
        fluents: Names that a situation may give.
    """
    name, equals, value = line.partition("=")
    problem = f"`{word.text}` begins neither a situation nor an expectation"
    if name.strip().lower() in fluents:
        write = f"({name.strip()})" + (f" = {value.strip()}" if equals else "")
        return DomainError(problem, word, f"a fluent stands in parentheses: `{write}`")
    if closest(word.text, BEGINNINGS):
        return DomainError(problem, word, did_you_mean(word.text, BEGINNINGS))
    return DomainError(problem, word, "an expectation begins with " + listed(BEGINNINGS))


def for_action(name: str, known: Sequence[str]) -> str:
    """Return what to write instead of a name that no ground action has."""
    if objects := [action for action in known if action.startswith(f"{name} ")]:
        return f"write it with its objects: {listed(objects)}"
    if begun := [action for action in known if name.startswith(f"{action} ")]:
        action = max(begun, key=len)
        return (
            f"the action is `{action}`; a reason follows `because`, another action follows `or`, "
            f"and `{name[len(action) + 1 :]}` is neither"
        )
    return did_you_mean(name, known)
