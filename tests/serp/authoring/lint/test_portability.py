"""What other PDDL tools make of a file."""

from __future__ import annotations

from pathlib import Path

import pytest
from unified_planning.io import PDDLReader

from serp.authoring.lint.findings import examine
from serp.authoring.lint.portability import outside_portable_subset
from serp.pddl.source import Source

pytestmark = pytest.mark.filterwarnings("ignore::Warning")  # of unified-planning's parser
ROOT = Path(__file__).resolve().parents[4]
SHIPPED = sorted((ROOT / "domains").glob("*.pddl"))

PLAIN = """
(define (domain plain)
  (:requirements :strips :typing :numeric-fluents :time :negative-preconditions)
  (:types room)
  (:predicates (at ?r - room) (near ?a - room ?b - room))
  (:functions (x))
  (:action go
    :parameters (?a - room ?b - room)
    :precondition (and (at ?a) (near ?a ?b) (forall (?c - room) (not (at ?c))))
    :effect (and (at ?b) (increase (x) (+ 1.5 (- 0 2)))))
  (:process drift
    :parameters ()
    :precondition (and)
    :effect (and (increase (x) (* #t 0.5)))))
"""
PROBLEM = """
(define (problem p) (:domain plain)
  (:objects hall bath - room)
  (:init (at hall) (= (x) -1))
  (:goal (and)))
"""


def breaches(text: str) -> list[str]:
    return [str(f) for f in outside_portable_subset(Source("f.pddl", text))]


@pytest.mark.parametrize("file", SHIPPED, ids=lambda path: path.name)
def test_what_is_shipped_is_portable(file: Path) -> None:
    source = Source.read(file)
    assert outside_portable_subset(source) == []
    if not file.stem.endswith("-problem"):
        sibling = file.with_name(f"{file.stem}-problem.pddl")
        problem = str(sibling) if sibling.exists() else None
        PDDLReader().parse_problem(str(file), problem)


def test_plain_files_are_portable() -> None:
    assert breaches("; A Comment, 1e5\n" + PLAIN) == []
    assert breaches(PROBLEM) == []
    PDDLReader().parse_problem_string(PLAIN, PROBLEM)


@pytest.mark.parametrize(
    ("old", "new", "breach"),
    [
        ("(at hall)", "(At Hall)", "4:11: capital letters; write everything in lower case"),
        ("-1", "-1e0", "4:27: a number that is not a plain decimal"),
        ("1.5", ".5", "10:43: a number that is not a plain decimal"),
        ("(- 0 2)", "(- 2)", "10:47: `(- x)`; write `(- 0 x)`"),
        ("(- 0 2)", "(* 1 2 3)", "10:47: `*` with more than two operands"),
        (":parameters (?a - room ?b - room)", "", "7:12: `:parameters` is left out"),
        (":precondition (and)", "", "11:13: `:precondition` is left out"),
        (":precondition (and)", ":precondition ()", "13:19: `:precondition` without `(and ...)`"),
        ("(and (increase (x) (* #t 0.5)))", "(increase (x) (* #t 0.5))",
         "14:13: `:effect` without `(and ...)`"),
        ("(?a - room ?b - room)\n", "(?a ?b - room)\n", "8:18: parameters that share a type"),
        ("near ?a - room ?b - room", "near ?a ?b - room", "5:37: parameters that share a type"),
        ("(?c - room)", "(?c ?d - room)", "9:54: parameters that share a type"),
    ],
)  # fmt: skip
def test_each_rule_is_said_with_its_place(old: str, new: str, breach: str) -> None:
    text = PLAIN if old in PLAIN else PROBLEM
    assert text.count(old) == 1
    found, *_ = breaches(text.replace(old, new))
    assert found.startswith(f"f.pddl:{breach}")


def test_functions_beyond_pddl_are_said_unless_the_domain_declares_them() -> None:
    text = PLAIN.replace("(- 0 2)", "(abs (min 1 (abs 2)))").replace("(x))", "(x) (min ?a ?b))")
    text = text.replace("(min 1", "(min ?a ?b").replace(":time", ":time :math-functions")
    findings = examine(Source("f.pddl", text), portable=True).findings
    (found,) = (f.message for f in findings if "is not PDDL" in f.message)
    assert found.startswith("`abs` is not PDDL; write two conditions")
