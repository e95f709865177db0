"""Slips that experts make: the message names the place and writes the line as it should be."""

import pytest

from serp.pddl.parser import parse_domain
from serp.pddl.source import DomainError, Source
from serp.pddl.syntax import FunctionTerm, NumericComparison, nodes_in
from tests.serp.pddl.rendering import check_rendering
from tests.worlds import text

RIGHT = text("robot")
CONDITION = "(< (x) 9.5)"
BOTH = "(and (near) (< (x) 9.5))"
EFFECT = "(increase (x) 1)"

# What is right, the slip, the corrected form, and a part of the message.
SLIPS = [
    # A missing `)`: where the form should have ended
    ("(< (x) 9.5))", "(< (x) 9.5)", "(< (x) 9.5))", "9:42: a `)` is missing: `(and` of line 9"),
    ("(not (near))))", "(not (near)))", "(not (near))))", "17:38: a `)` is missing: `(:action gra"),
    ("()\n    :precondition (and (near))\n", "(\n    :precondition (and (near))\n",
     ":parameters ()", "15:18: a `)` is missing: `(` of line 15"),
    # One too many
    ("9.5))\n", "9.5)))\n", "9.5))", "9:43: this `)` is one too many: `:effect` in line 10"),
    (EFFECT, "increase (x) 1)", EFFECT, "11:7: a `(` is missing before `increase`"),
    # Comments of other languages
    ("; move", "# move (it) )", "; move", "6:3: `#` does not begin a comment"),
    # Effects
    (EFFECT, "(set (x) 1)", "(assign (x) 1)", "`set` is not supported in an effect"),
    (EFFECT, "(x = x + 1)", "(assign (x) (+ (x) 1))", "`=` stands between"),
    (EFFECT, "(when (near) held)", "(when (near) (held))", "an effect in parentheses"),
    (EFFECT, "(when (near) (held) (unsafe))", "(when (near) (and (held) (unsafe)))",
     "put several under `and`"),
    ("(and (held) (not (near)))", "((held) (not (near)))", "(and (held) (not (near)))",
     "effects are listed without `and`"),
    # Numbers
    (EFFECT, "(increase (x) ((speed) + 1))", "(+ (speed) 1)", "`+` stands between"),
    (EFFECT, "(increase (x) (^ (speed) 2))", None, "write a product"),
    (EFFECT, "(increase (x) (tan (speed)))", None, "write `(/ (sin ...) (cos ...))`"),
    # Conditions
    (CONDITION, "(x < speed + 1)", "(< (x) (+ (speed) 1))", "the operator comes first"),
    (CONDITION, "(not held)", "(not (held))", "a condition in parentheses, found `held`"),
    (CONDITION, "(when (near) (held))", "(imply (near) (held))", "`when` is not supported"),
    (BOTH, "(annd (near) (< (x) 9.5))", BOTH, "`annd` is not a PDDL keyword"),
    (BOTH, "(forall (?r - object) (near) (held))", "(forall (?r - object) (and (near) (held)))",
     "put several under `and`"),
    # Fields
    (":effect (and (held) (not (near)))", "(:effect (and (held) (not (near))))",
     ":effect (and (held) (not (near)))", "is not supported in action `grab`"),
]  # fmt: skip


@pytest.mark.parametrize(("right", "slip", "corrected", "says"), SLIPS, ids=lambda text: str(text))
def test_a_slip_is_named_and_the_corrected_line_is_right(right, slip, corrected, says):
    assert RIGHT.count(right) == 1
    text = RIGHT.replace(right, slip)
    with pytest.raises(DomainError) as caught:
        parse_domain(Source("robot.pddl", text))
    error = caught.value
    check_rendering(error, text)
    assert says in str(error)
    if corrected is None:
        assert not error.corrected_line
        return
    assert corrected in error.corrected_line
    lines = text.split("\n")
    lines[error.line - 1] = error.corrected_line
    parse_domain(Source("robot.pddl", "\n".join(lines)))


def test_names_that_the_file_declares_are_no_slips():
    text = """(define (domain d) (:predicates (set ?a) (if ?a) (near)) (:functions (abs ?a) (x))
      (:constants o) (:requirements %s)
      (:action a :precondition (and (if o) (< (abs o) 1)) :effect (and (set o) (if o))))"""
    for requirement in (":adl", ":adl :math-functions"):
        source = Source("d.pddl", text % requirement)
        (schema,) = parse_domain(source).schemas
        comparisons = [n for n in nodes_in(schema) if isinstance(n, NumericComparison)]
        (comparison,) = comparisons
        assert isinstance(comparison.left, FunctionTerm)
        assert not source.warnings
