"""Effects that can never happen together are refused, with their place."""

from __future__ import annotations

import pytest

from serp.pddl.source import DomainError
from tests.generated import Texts, load_texts


@pytest.mark.parametrize(
    ("effect", "refused"),
    [
        ("(assign (x) 1) (increase (x) 1)", True),
        ("(scale-up (x) 2) (decrease (x) 1)", True),
        ("(assign (x) (y)) (assign (x) 1) (assign (x) 2)", True),
        ("(assign (f ?i) 1) (and (p) (scale-down (f ?i) 2))", True),
        ("(when (p) (and (assign (x) 1) (increase (x) 1)))", True),
        ("(forall (?j - t) (and (assign (f ?j) 1) (increase (f ?j) 1)))", True),
        ("(increase (x) 1) (decrease (x) (y))", False),
        ("(scale-up (x) 2) (scale-down (x) (y))", False),
        ("(assign (x) 1) (assign (y) 2) (assign (x) 1.0) (assign (x) (y))", False),
        ("(assign (f ?i) 1) (increase (f o) 1)", False),
        ("(assign (x) 1) (when (p) (increase (x) 1)) (when (not (p)) (increase (x) 1))", False),
    ],
)
def test_effects_that_always_contradict_each_other_are_refused(effect: str, refused: bool) -> None:
    texts = Texts(
        "(define (domain d) (:types t) (:constants o - t) (:predicates (p))"
        " (:functions (x) (y) (f ?i - t))\n"
        f" (:action act :parameters (?i - t) :precondition (and)\n :effect (and {effect})))",
        None,
    )
    if not refused:
        load_texts(texts)
        return
    with pytest.raises(DomainError, match=r"contradicts .* in line 3: both would") as raised:
        load_texts(texts)
    assert raised.value.line == 3
