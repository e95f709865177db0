"""Other PDDL tools read what is shipped, and a file's functions beyond PDDL are named."""

from __future__ import annotations

from pathlib import Path

import pytest
from unified_planning.io import PDDLReader

from serp.authoring.lint.findings import examine
from serp.pddl.source import Source

pytestmark = pytest.mark.filterwarnings("ignore::Warning")  # of unified-planning's parser
SHIPPED = sorted((Path(__file__).resolve().parents[4] / "domains").glob("*.pddl"))


@pytest.mark.parametrize("file", SHIPPED, ids=lambda path: path.name)
def test_what_is_shipped_is_portable(file: Path) -> None:
    if not file.stem.endswith("-problem"):
        sibling = file.with_name(f"{file.stem}-problem.pddl")
        PDDLReader().parse_problem(str(file), str(sibling) if sibling.exists() else None)


def test_functions_beyond_pddl_are_named_unless_the_domain_declares_them() -> None:
    text = """(define (domain d) (:requirements :math-functions) (:functions (x) (min ?a ?b))
      (:constants a) (:action go :effect (assign (x) (+ (abs (min a a)) (abs 2)))))"""
    findings = examine(Source("f.pddl", text), portable=True).findings
    (found,) = (f.message for f in findings if "is not PDDL" in f.message)
    assert found.startswith("`abs` is not PDDL; write two conditions")
    assert found.endswith("(2 places)")
