"""Whether other PDDL tools read a file as well: the portable subset, and unified-planning's reader.

The rules are those that unified-planning, pddl, tarski, pddl-plus-parser and VAL have in common
(processes and events apart). Breaking one is no error here: serp reads more than they do.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import warnings
from collections.abc import Iterator, Sequence
from importlib.util import find_spec

from serp.pddl.expressions import is_number
from serp.pddl.sexpr import Group, Node, Word, read_group
from serp.pddl.source import DomainWarning, Place, Source

_PLAIN_DECIMAL = re.compile(r"-?\d+(\.\d+)?\Z", re.ASCII)
_SCHEMAS = (":action", ":process", ":event")
_KEYS = (":parameters", ":precondition", ":effect")
_OPERATORS = ("+", "-", "*", "/")
_WHERE = re.compile(r"line:?\s*(\d+)\s*,\s*col(?:umn)?:?\s*(\d+)")
_NOISE = re.compile(
    r"\s*(\(at char \d+\)|,?\s*\(line:\s*\d+, col:\s*\d+\)"
    r"|(found at|\.? ?from) line:.*)",
    re.IGNORECASE,
)


def outside_portable_subset(source: Source) -> list[DomainWarning]:
    """Return what in a domain or problem file not every PDDL tool reads, one finding a rule.

    Args:
        source: A file that serp itself reads.

    Raises:
        DomainError: Its parentheses do not match.
    """
    found: dict[str, list[Place]] = {}
    top = read_group(source)
    for text, place in _breaches(top):
        found.setdefault(text, []).append(place)
    return [
        DomainWarning(text + (f" ({len(places)} places)" if len(places) > 1 else ""), places[0])
        for text, places in found.items()
    ]


def _breaches(top: Group) -> Iterator[tuple[str, Place]]:
    for section in top.items[2:]:
        if not isinstance(section, Group):
            continue
        if section.head in _SCHEMAS:
            yield from _schema(section)
        elif section.head in (":predicates", ":functions"):
            for item in section.items[1:]:
                if isinstance(item, Group):
                    yield from _typed_together(item.items[1:])
    yield from _everywhere(top)


def _schema(section: Group) -> Iterator[tuple[str, Place]]:
    name = section.items[1].place if len(section.items) > 1 else section.place
    values = {
        key.text: value
        for key, value in zip(section.items[2::2], section.items[3::2], strict=False)
        if isinstance(key, Word)
    }
    for key in _KEYS:
        value = values.get(key)
        if value is None:
            empty = "()" if key == ":parameters" else "(and)"
            yield f"`{key}` is left out; write `{key} {empty}`", name
        elif key == ":parameters":
            yield from _typed_together(value.items if isinstance(value, Group) else ())
        elif not isinstance(value, Group) or value.head != "and":
            yield f"`{key}` without `(and ...)` around it", value.place


def _everywhere(node: Node) -> Iterator[tuple[str, Place]]:
    if isinstance(node, Word):
        written = node.place.source.text[node.place.start : node.place.end]
        if written != node.text:
            yield "capital letters; write everything in lower case", node.place
        if is_number(node) and not _PLAIN_DECIMAL.match(node.text):
            yield "a number that is no plain decimal such as `0.5` or `-2`", node.place
        return
    if node.head in _OPERATORS and len(node.items) != 3:
        if node.head == "-" and len(node.items) == 2:
            yield "`(- x)`; write `(- 0 x)`", node.place
        else:
            yield f"`{node.head}` with more than two operands; nest them in pairs", node.place
    if node.head in ("forall", "exists") and len(node.items) > 1:
        variables = node.items[1]
        yield from _typed_together(variables.items if isinstance(variables, Group) else ())
    for item in node.items:
        yield from _everywhere(item)


def _typed_together(nodes: Sequence[Node]) -> Iterator[tuple[str, Place]]:
    """Find variables that share a type, as in `?a ?b - room`."""
    words = [node.text if isinstance(node, Word) else "" for node in nodes]
    if "-" not in words:
        return
    for node, following in zip(nodes, words[1:], strict=False):
        if isinstance(node, Word) and node.text.startswith("?") and following.startswith("?"):
            text = "parameters that share a type; type each by itself, `?a - room ?b - room`"
            yield text, node.place
            return


# unified-planning ------------------------------------------------------------------------------


def ask_unified_planning(
    domain: Source, problem: Source | None, seconds: float
) -> tuple[str, DomainWarning | None]:
    """Ask in a process of its own: its reader takes minutes for large files, and cannot be stopped.

    Args:
        domain: The domain file.
        problem: The problem file, if there is one.
        seconds: Most time to wait, > 0.

    Returns:
        `yes`, `no`, or why there is no answer; and what it has against the files.
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
    found = json.loads(answer.stdout)
    if found is None:
        return "yes", None
    text, file, start, end = found
    source = problem if file and problem is not None else domain
    return "no", DomainWarning(text, None if start is None else source.place(start, end))


def _answer() -> None:
    """Read files as JSON from standard input, and write as JSON what is refused in them."""
    domain, *problem = (Source(name, text) for name, text in json.load(sys.stdin))
    found = refused_by_unified_planning(domain, problem[0] if problem else None)
    place = found.place if found is not None else None
    json.dump(
        None
        if found is None
        else [
            found.text,
            place is not None and place.source is not domain,
            place.start if place is not None else None,
            place.end if place is not None else None,
        ],
        sys.stdout,
    )


def refused_by_unified_planning(domain: Source, problem: Source | None) -> DomainWarning | None:
    """Return what unified-planning's `PDDLReader` has against the files, or None for nothing.

    Args:
        domain: The domain file.
        problem: The problem file, if there is one.
    """
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
