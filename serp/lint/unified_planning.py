"""Whether unified-planning reads domain and problem files as well."""

from __future__ import annotations

import contextlib
import json
import re
import subprocess
import sys
import warnings
from importlib.util import find_spec

from pydantic import BaseModel

from serp.pddl.sexpr import Group, Word, read_group
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
    """Ask in a process of its own: its reader takes minutes for large files, and cannot be stopped.

    Args:
        domain: The domain file.
        problem: The problem file, if there is one.
        seconds: Most time to wait, > 0.

    Returns:
        `yes`, `no`, or why there is no answer; and what it refuses.
    """
    if find_spec("unified_planning") is None:
        return "not known (it is not installed: pip install 'serp[check]')", None
    files = [(s.name, s.text) for s in (domain, problem) if s is not None]
    try:
        answer = subprocess.run(
            [sys.executable, "-P", "-m", __name__],
            input=json.dumps(files).encode(),
            capture_output=True,
            timeout=seconds,
            check=True,
        )
    except subprocess.TimeoutExpired:
        return f"not known after {seconds:g} seconds", None
    except subprocess.CalledProcessError as error:
        return f"not known (its process ended with status {error.returncode})", None
    try:
        found = _Answer.model_validate_json(answer.stdout)
    except ValueError:
        return "not known (its process gave no answer)", None
    if found.refusal is None:
        return "yes", None
    source = problem if found.in_problem and problem is not None else domain
    place = None if found.span is None else source.place(*found.span)
    return "no", DomainWarning(found.refusal, place)


class _Answer(BaseModel):
    """What the process writes: what is refused, in which file, and from where to where."""

    refusal: str | None = None
    in_problem: bool = False
    span: tuple[int, int] | None = None


def _answer() -> None:
    """Read files as JSON from standard input, and write as JSON what is refused in them."""
    domain, *problem = (Source(name, text) for name, text in json.load(sys.stdin))
    with contextlib.redirect_stdout(sys.stderr):  # the reader may print
        found = refused_by_unified_planning(domain, problem[0] if problem else None)
    answer = _Answer()
    if found is not None:
        place = found.place
        answer.refusal = found.text
        answer.in_problem = place is not None and place.source is not domain
        answer.span = None if place is None else (place.start, place.end)
    sys.stdout.write(answer.model_dump_json())


def refused_by_unified_planning(domain: Source, problem: Source | None) -> DomainWarning | None:
    """Return what unified-planning's `PDDLReader` refuses, or None for nothing."""
    error = _reading_error(domain.text, None)
    source = domain
    if error is None and problem is not None:
        source, error = problem, _reading_error(domain.text, problem.text)
    if error is None:
        return None
    unknown = _unknown_requirement(source)
    if unknown is not None:
        return DomainWarning(
            f"unified-planning does not know the requirement `{unknown.text}`", unknown.place
        )
    text = str(error)
    place = _place(source, text)
    reason = " ".join(_NOISE.sub("", text).split()) or type(error).__name__
    if isinstance(error, KeyError):
        reason = f"{reason} is unknown to it"
    whole = "" if place else f"{source.name}: "
    return DomainWarning(f"{whole}unified-planning cannot read this: {reason}", place)


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


def _unknown_requirement(source: Source) -> Word | None:
    """Return the first requirement of the file that unified-planning's reader does not know."""
    for section in read_group(source).items[2:]:
        if isinstance(section, Group) and section.head == ":requirements":
            for word in section.items[1:]:
                if isinstance(word, Word):
                    minimal = f"(define (domain d) (:requirements {word.text}) (:predicates (p)))"
                    if _reading_error(minimal, None) is not None:
                        return word
    return None


if __name__ == "__main__":
    _answer()
