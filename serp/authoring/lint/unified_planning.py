"""Whether unified-planning reads domain and problem files as well."""

from __future__ import annotations

import contextlib
import json
import re
import subprocess
import sys
import warnings
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Literal

from pydantic import TypeAdapter

from serp._util.processes import python_command
from serp.pddl.reader import Group, Word, read_group
from serp.pddl.source import DomainWarning, Place, Source

_WHERE = re.compile(r"line:?\s*(\d+)\s*,\s*col(?:umn)?:?\s*(\d+)")
_NOISE = re.compile(
    r"\s*(\(at char \d+\)|,?\s*\(line:\s*\d+, col:\s*\d+\)"
    r"|(found at|\.? ?from) line:.*)",
    re.IGNORECASE,
)


def ask_unified_planning(
    domain: Source, problem: Source | None, seconds: float
) -> tuple[str, DomainWarning | None]:
    """Return `yes`, `no`, or why there is no answer; and what unified-planning refuses.

    It is asked in a process of its own, for some seconds: its reader takes minutes for large files,
    and cannot be stopped.
    """
    if find_spec("unified_planning") is None:
        return "not known (it is not installed: pip install 'serp[check]')", None
    sources = [source for source in (domain, problem) if source is not None]
    try:
        answer = subprocess.run(
            python_command(__name__),
            input=json.dumps([(source.name, source.text) for source in sources]).encode(),
            capture_output=True,
            timeout=seconds,
            check=True,
        )
        found = _ANSWER.validate_json(answer.stdout)
    except subprocess.TimeoutExpired:
        return f"not known after {seconds:g} seconds", None
    except subprocess.CalledProcessError as error:
        return f"not known (its process ended with status {error.returncode})", None
    except ValueError:
        return "not known (its process gave no answer)", None
    if found is None:
        return "yes", None
    refusal, number, span = found
    place = sources[number].place(*span) if span is not None else None
    return "no", DomainWarning(refusal, place, "not-portable")


_ANSWER = TypeAdapter(tuple[str, Literal[0, 1], tuple[int, int] | None] | None)
"""What the process writes: what is refused, in which of the files, and from where to where."""


def _answer() -> None:
    """Read files as JSON from standard input, and write as JSON what is refused in them."""
    sources = [Source(name, text) for name, text in json.load(sys.stdin)]
    with contextlib.redirect_stdout(sys.stderr):  # the reader may print
        found = refused_by_unified_planning(sources[0], *sources[1:])
    answer = None
    if found is not None:
        place = found.place
        number = sources.index(place.source) if place else 0
        answer = found.text, number, (place.start, place.end) if place else None
    sys.stdout.write(json.dumps(answer))


def refused_by_unified_planning(
    domain: Source, problem: Source | None = None
) -> DomainWarning | None:
    """Return what unified-planning's `PDDLReader` refuses, or None for nothing."""
    source, error = domain, _reading_error(domain.text, None)
    if error is None and problem is not None:
        source, error = problem, _reading_error(domain.text, problem.text)
    if error is None:
        return None
    for word in _requirements(source):
        minimal = f"(define (domain d) (:requirements {word.text}) (:predicates (p)))"
        if _reading_error(minimal, None) is not None:
            text = f"unified-planning does not know the requirement `{word.text}`"
            return DomainWarning(text, word.place, "not-portable")
    text = str(error)
    place = _place(source, text)
    reason = " ".join(_NOISE.sub("", text).split()) or type(error).__name__
    if isinstance(error, KeyError):
        reason = f"{reason} is unknown to it"
    whole = "" if place else f"{source.name}: "
    return DomainWarning(
        f"{whole}unified-planning cannot read this: {reason}", place, "not-portable"
    )


def _reading_error(domain: str, problem: str | None) -> Exception | None:
    from unified_planning.io import PDDLReader

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            PDDLReader().parse_problem_string(domain, problem)
    except Exception as error:  # pyparsing's, its own, and failed assertions
        return error
    return None


def _place(source: Source, message: str) -> Place | None:
    """Return the place that a message names, to the end of its word."""
    match = _WHERE.search(message)
    if match is None:
        return None
    lines = source.text.split("\n")  # as it counts them
    line, column = int(match[1]), int(match[2])
    if not 1 <= line <= len(lines):
        return None
    before = sum(map(len, lines[: line - 1])) + line - 1
    start = min(before + max(column - 1, 0), len(source.text))
    word = re.match(r"[^\s()]+|.?", source.text[start:])
    return source.place(start, start + (word.end() if word else 0))


def _requirements(source: Source) -> Iterator[Word]:
    for section in read_group(source).items[2:]:
        if isinstance(section, Group) and section.head == ":requirements":
            yield from (word for word in section.items[1:] if isinstance(word, Word))


if __name__ == "__main__":
    _answer()
