"""Effects that can never happen together are refused, with their place."""

from __future__ import annotations

import pytest

from serp.pddl.source import DomainError
from tests.generated import Texts, load_texts


def load(effect: str) -> None:
    load_texts(
        Texts(
            "(define (domain d) (:types t) (:constants o - t) (:predicates (p))"
            " (:functions (x) (y) (f ?i - t))\n"
            " (:action act :parameters (?i - t) :precondition (and)\n"
            f" :effect (and {effect})))",
            None,
        )
    )


@pytest.mark.parametrize(
    "effect",
    [
        "(assign (x) 1) (increase (x) 1)",
        "(scale-up (x) 2) (decrease (x) 1)",
        "(assign (x) 1) (assign (x) 2)",
        "(assign (x) (y)) (assign (x) 1) (assign (x) 2)",
        "(assign (f ?i) 1) (and (p) (scale-down (f ?i) 2))",
        "(when (p) (and (assign (x) 1) (increase (x) 1)))",
        "(forall (?j - t) (and (assign (f ?j) 1) (increase (f ?j) 1)))",
    ],
)
def test_effects_that_always_contradict_each_other_are_refused(effect: str) -> None:
    with pytest.raises(DomainError, match=r"contradicts .* in line 3: both would") as raised:
        load(effect)
    assert raised.value.line == 3


@pytest.mark.parametrize(
    "effect",
    [
        "(increase (x) 1) (decrease (x) (y))",
        "(scale-up (x) 2) (scale-down (x) (y))",
        "(assign (x) 1) (assign (y) 2)",
        "(assign (x) 1) (assign (x) 1.0)",
        "(assign (x) (y)) (assign (x) 2)",
        "(assign (f ?i) 1) (increase (f o) 1)",
        "(when (p) (assign (x) 1)) (when (not (p)) (increase (x) 1))",
        "(assign (x) 1) (when (p) (increase (x) 1))",
    ],
)
def test_effects_that_can_happen_are_accepted(effect: str) -> None:
    load(effect)
