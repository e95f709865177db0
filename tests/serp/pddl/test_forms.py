"""Forms that are no standard PDDL but in wide use: they load, with a warning each."""

import pytest

from serp.model.domain import Domain
from serp.pddl.source import Source, comment_of
from tests.generated import Texts, load_texts

DOMAIN = """(define (domain car)
  (:requirements :typing)
  (:types vehicle - object boat - vehicle lake - object)
  (:constants here there - lake)
  (:predicates (at ?x - boat ?y - lake) (linked ?x ?y) (unsafe))
  (:functions (speed) (limit) (fuel ?x - boat))
  (:action row :parameters (?x - boat ?y - lake)
    :precondition (and (at ?x ?y) (< (speed) 5))
    :effect (and (increase (speed) (* (limit) (limit))) (not (at ?x ?y))))
  (:event slow :parameters (?x - boat)
    :precondition (not (and (> (speed) (- 0 (limit))) (>= (fuel ?x) 0)))
    :effect (unsafe)))"""
PROBLEM = """(define (problem lake)
  (:domain car)
  (:objects ferry - boat)
  (:init (at ferry here) (= (speed) 0) (= (limit) 2) (= (fuel ferry) 1))
  (:goal (not (at ferry here)))
  (:metric minimize (speed)))"""

# What to write in the stead of what, and the warning.
# fmt: off
FORMS = {
    "no blank after the dash": ("boat - vehicle", "boat -vehicle", "read as `- vehicle`"),
    "nor before number": (") (fuel ?x - boat)", ") (fuel ?x - boat) -number", "`- number`"),
    "a type twice": ("boat - vehicle", "boat - vehicle boat - object", "type `boat` is declared"),
    "a constant twice": ("here there", "here here there", "object `here` is declared twice"),
    "a function twice": ("functions (speed)",
        "functions (speed) (speed)", "function `speed` is declared twice"),
    "a variable twice": ("(linked ?x ?y)", "(linked ?x ?x)", "parameter `?x` is declared twice"),
    "an empty list": ("(:objects ferry", "(:objects - lake ferry", "`- lake` without an object"),
    "a number as name": ("(problem lake)", "(problem 4)", "`4`: for other tools a name begins"),
    "no name": ("(problem lake)", "(problem)", "other tools take one name"),
    "another domain": ("(:domain car)", "(:domain ship)", "names domain `ship`, not `car`"),
    "an idle requirement": (":typing", ":typing :durative-actions", "actions` is not supported"),
    "a strange requirement": (":typing", ":typng", "is unknown; did you mean `:typing`?"),
    "a declared clock": ("(limit) (fuel ?x",
        "(limit) (total-time) (fuel ?x", "needs no declaration"),
    "a clock at 0": ("(= (limit) 2)",
        "(= (limit) 2) (= (total-time) 0)", "(total-time)` always starts"),
    "a bare declaration": ("(:functions (speed)",
        "(:functions speed", "`speed` is read as `(speed"),
    "a bare target": ("(increase (speed)", "(increase speed", "`speed` is read as `(speed)`"),
}
# fmt: on


def told(domain: Domain) -> list[str]:
    """What the model comes to, apart from places."""
    ground = domain.model.ground
    state = domain.model.initial_state
    assert state is not None
    return [
        str([fluent.name for fluent in ground.fluents]),
        str([schema.name for schema in (*ground.actions, *ground.events)]),
        str([domain.model.step(state, k) for k in range(len(ground.actions))]),
        str(sorted(ground.static.items())),
    ]


@pytest.mark.parametrize("form", FORMS)
def test_a_form_in_wide_use_means_what_the_standard_one_does_and_is_warned_of(form: str) -> None:
    standard, other, warning = FORMS[form]
    texts = Texts(DOMAIN, PROBLEM)
    assert standard in DOMAIN + PROBLEM
    changed = Texts(DOMAIN.replace(standard, other, 1), PROBLEM.replace(standard, other, 1))
    domain = load_texts(changed)
    assert told(domain) == told(load_texts(texts))
    (found,) = {w.text for w in domain.warnings}
    assert warning in found
    assert all(w.place is not None for w in domain.warnings)
    assert not load_texts(texts).warnings


def test_an_object_may_be_called_like_a_connective() -> None:
    problem = "(define (problem p) (:objects b or - boat) (:init (= (speed) 0) (linked or or)))"
    assert load_texts(Texts(DOMAIN, problem)).model.ground.static["linked or or"] == 1.0


TEXT = """; The head of the file.

(define
  (far)     ; what is far, serp: ignore[unused-name]
            ; and farther
  (near)    ; serp: ignore[unused-name]

  ; A goal,
  ;; and its price.
  (goal)

  ; ------------- The end ------------
  (section)

  ; not this one

  (alone) (second) ; of both
  ; at the top (commented) out
  (last))"""


@pytest.mark.parametrize(
    ("form", "comment"),
    [
        ("(far)", "what is far, and farther"),
        ("(near)", ""),
        ("(goal)", "A goal, and its price."),
        ("(section)", ""),
        ("(alone)", "of both"),
        ("(second)", "of both"),
        ("(last)", "at the top (commented) out"),
        ("(define", ""),
    ],
)
def test_the_comment_beside_or_right_above_belongs_to_a_place(form: str, comment: str) -> None:
    source = Source("file", TEXT)
    start = TEXT.index(form)
    assert comment_of(source.place(start, start + len(form))) == comment
