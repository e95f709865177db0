"""Forms that are no standard PDDL but in wide use: they load, with a warning each."""

import pytest

from tests.generated import Texts, load_texts
from tests.worlds import text

DOMAIN = text("car")
PROBLEM = text("car-problem")

# What to write in the stead of what, and the warning.
# fmt: off
FORMS = {
    "no blank after the dash": ("boat - vehicle", "boat -vehicle", "read as `- vehicle`"),
    "variables of PDDL 1.2": ("(?x - boat ?y - lake)", "(?x - boat) :vars (?y - lake)",
        "`:vars` is read as more parameters"),
    "nor before number": (") (fuel ?x - boat)", ") (fuel ?x - boat) -number", "`- number`"),
    "a type twice": ("boat - vehicle", "boat - vehicle boat - object", "type `boat` is declared"),
    "a constant twice": ("here there", "here here there", "object `here` is declared twice"),
    "a function twice": ("functions (speed)",
        "functions (speed) (speed)", "function `speed` is declared twice"),
    "a function that is a predicate, too": ("(:predicates",
        "(:predicates (speed)", "`speed` is both a predicate and a function"),
    "a variable twice": ("(linked ?x ?y)", "(linked ?x ?x)", "parameter `?x` is declared twice"),
    "an empty list": ("(:objects ferry", "(:objects - lake ferry", "`- lake` needs an object"),
    "a number as name": ("(problem lake)", "(problem 4)", "`4`: other tools expect a name"),
    "no name": ("(problem lake)", "(problem)", "other tools expect a single name"),
    "another domain": ("(:domain car)", "(:domain ship)", "names domain `ship`, not `car`"),
    "an idle requirement": (":typing", ":typing :durative-actions", "actions` is not supported"),
    "a strange requirement": (":typing", ":typng", "is unknown; did you mean `:typing`?"),
    "a declared clock": ("(limit) (fuel ?x",
        "(limit) (total-time) (fuel ?x", "needs no declaration"),
    "a clock at 0": ("(= (limit) 2)",
        "(= (limit) 2) (= (total-time) 0)", "(total-time)` always starts"),
    "a value twice": ("(= (limit) 2)", "(= (limit) 2) (= (limit) 2.0)", "a second value for"),
    "a value of nothing": ("(= (limit) 2)",
        "(= (limit) 2) (= (odometer) 0)", "no function `odometer`; its value is left out"),
    "a bare declaration": ("(:functions (speed)",
        "(:functions speed", "`speed` is read as `(speed"),
    "a bare target": ("(increase (speed)", "(increase speed", "`speed` is read as `(speed)`"),
}
# fmt: on


def told(domain):
    """What the model comes to, apart from places."""
    ground = domain.model.ground
    state = domain.model.initial_state
    return [
        str([fluent.name for fluent in ground.fluents]),
        str([schema.name for schema in (*ground.actions, *ground.events)]),
        str([domain.model.step(state, k) for k in range(len(ground.actions))]),
        str(sorted(ground.static.items())),
    ]


@pytest.mark.parametrize("form", FORMS)
def test_a_form_in_wide_use_means_what_the_standard_one_does_and_is_warned_of(form):
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


def test_a_variable_begins_with_its_question_mark():
    glued = Texts(DOMAIN.replace("(at ?x ?y)", "(at?x?y)"), PROBLEM)
    assert told(load_texts(glued)) == told(load_texts(Texts(DOMAIN, PROBLEM)))


def test_an_object_may_be_called_like_a_connective():
    problem = "(define (problem p) (:objects b or - boat) (:init (= (speed) 0) (linked or or)))"
    assert load_texts(Texts(DOMAIN, problem)).model.ground.static["linked or or"] == 1.0
