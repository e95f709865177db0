"""Another start for a world made of a file: the text of its problem with another `:init`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from serp._util.text import did_you_mean
from serp.model.loading import Domain, problem_beside
from serp.pddl.edits import Edit, edited
from serp.pddl.problem_parser import parse_problem
from serp.pddl.source import DomainError, Source


def starting(domain: Domain, values: Mapping[str, float | bool]) -> Domain:
    """Return the same domain with other values in the `:init` of its problem.

    All else in the problem stays as it is. Where there is no problem, or no `:init` in it, numbers
    begin at 0 and predicates as false, unless values are given.

    Args:
        domain: Domain, with or without a problem.
        values: Name of a ground predicate or function → its value at the start.

    Raises:
        DomainError: There is no predicate or function of that name.
    """
    stated = _stated(domain)
    for name, value in values.items():
        declaration = domain.declared(name)
        if declaration is None:
            known = [*(fluent.name for fluent in domain.model.fluents), *stated]
            raise DomainError(
                f"{domain.source.name}: there is no `{name}`",
                advice=did_you_mean(name, known),
                code="unknown-name",
            )
        if declaration.numeric:
            stated[name] = f"(= ({name}) {np.format_float_positional(value, trim='0')})"
        elif value:
            stated[name] = f"({name})"
        else:
            stated.pop(name, None)
    init = "\n    ".join(["(:init", *stated.values()]) + ")"
    source = _with_init(domain, init)
    return dataclasses.replace(
        domain, problem_source=source, problem_syntax=parse_problem(source, domain.syntax)
    )


def _stated(domain: Domain) -> dict[str, str]:
    """Return name → fact, as text, of what the problem's `:init` states."""
    problem = domain.problem_syntax
    if problem is None:
        return {}
    atoms = [" ".join((a.name, *(t.name for t in a.arguments))) for a in problem.true_atoms]
    stated = {name: f"({name})" for name in atoms}
    for function, number in problem.values:
        name = " ".join((function.name, *(t.name for t in function.arguments)))
        stated[name] = f"(= ({name}) {number.place.text})"
    return stated


def _with_init(domain: Domain, init: str) -> Source:
    """Return the problem file with another `:init`; one that has nothing else if there is none."""
    before = domain.problem_source
    if before is None:
        name = str(problem_beside(Path(domain.source.name)))
        text = f"(define (problem start)\n  (:domain {domain.name})\n  {init}\n  (:goal (and)))\n"
        return Source(name, text)
    assert domain.problem_syntax is not None
    old, end = domain.problem_syntax.init, domain.problem_syntax.place.end - 1
    # A new one stands before the last parenthesis.
    edit = Edit(old.start, old.end, init) if old else Edit(end, end, f"\n  {init}")
    return Source(before.name, edited(before.text, [edit]))
