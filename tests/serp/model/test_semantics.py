"""The meaning of a step, with the numbers written out.

`test_transition_model` compares every rule with a slow reading of the file. Here are those that
random domains seldom reach, and the flags of steps without a result.
"""

import itertools
import math

import numpy as np
import pytest

from serp.model.flags import APPLICABLE, TERMINAL, UNDEFINED, UNSAFE
from serp.model.transition_model import StateError
from tests.generated import Texts, load_texts

PREDICATES = "(p) (q) (r) (unsafe) (terminal)"
FUNCTIONS = "(x) (y) (z) (reward)"
ITEMS = "(:types item) (:predicates (on ?i - item) (p) (q)) (:functions (cost ?i - item) (x) (y))"
TWO_ITEMS = "(:domain d) (:objects i1 i2 - item)"


def model_of(schemas, problem="", declarations=""):
    """A domain of some schemas; declared are (p) (q) (r) and (x) (y) (z) unless told otherwise."""
    declarations = declarations or f"(:predicates {PREDICATES}) (:functions {FUNCTIONS})"
    declarations += " (:requirements :math-functions)"
    domain = f"(define (domain d) {declarations} {schemas})"
    return load_texts(Texts(domain, f"(define (problem e) {problem})" if problem else None)).model


def action(effect, precondition="(and)"):
    return f"(:action act :parameters () :precondition {precondition} :effect (and {effect}))"


def event(name, precondition, effect):
    return f"(:event {name} :parameters () :precondition {precondition} :effect (and {effect}))"


def process(name, precondition, effect):
    return f"(:process {name} :parameters () :precondition {precondition} :effect (and {effect}))"


def state_of(model, given):
    """A state that is 0 and false but for what is given."""
    return model.state({f.name: given.get(f.name, 0.0) for f in model.fluents})


def check(model, given, expected):
    """Step the only action; the rest stays as it was, unless a step has no result (flags)."""
    state = state_of(model, given)
    outcome = model.step(state, 0)
    flags = model.transition(state.tolist(), 0)[1]
    sites, traced = model.trace(state, 0)
    assert flags == traced
    if isinstance(expected, int):
        assert flags == expected and not outcome.applicable
        assert (outcome.state == state).all() and outcome[1:] == (0.0, False, False, False, 0.0)
        assert (sites[-1].what == "failed") == (flags == 0)
        return
    assert outcome.applicable
    flagged = {"reward": 0.0, "unsafe": False, "terminal": False} | expected
    values = {name: flagged.pop(name, given.get(name, 0.0)) for name in model.values(state)}
    assert model.values(outcome.state) == values
    assert flagged == {k: getattr(outcome, k) for k in ("reward", "unsafe", "terminal")}


NAN = "(> (/ 1 (y)) 2)"
SQUARE = "(* (y) (y))"
STEPS = {
    "flags are false before the action": (
        action("(unsafe) (terminal) (when (or (unsafe) (terminal)) (p))"),
        [({}, {"unsafe": True, "terminal": True})],
    ),
    "two assignments of one value agree": (
        action("(assign (x) (y)) (assign (x) (+ (z) 1))"),
        [({"y": 2, "z": 1}, {"x": 2}), ({"y": 2, "z": 3}, UNDEFINED)],
    ),
    # Functions
    "functions have their values": (
        action("(assign (x) (max (sqrt (y)) (abs (z)) 1)) (assign (y) (+ (sin (x)) (cos (x))))"
               " (assign (z) (atan2 (z) (min (x) -1)))"),
        [({"y": 9, "z": -2}, {"x": 3, "y": 1, "z": math.atan2(-2, -1)}), ({"y": -9}, UNDEFINED)],
    ),
    "a root of a negative number is undefined, unless it does not matter": (
        action("(q)", "(and (> (y) -1) (< (sqrt (y)) 2))"),
        [({"y": 1}, {"q": 1}), ({"y": 4}, 0), ({"y": -1}, 0), ({"y": -0.5}, UNDEFINED)],
    ),
    "the lesser of a number and nothing is nothing": (
        action("(when (< (min (x) (/ 1 (y)) 0) 1) (p)) (when (> (max (/ 1 (y)) (x)) 1) (unsafe))"),
        [({}, UNDEFINED), ({"y": 0.5}, {"p": 1, "unsafe": True})],
    ),
    # Undefined results
    "an undefined precondition": (
        action("(unsafe)", f"(and {NAN} (q))"),
        [({}, 0), ({"q": 1}, UNDEFINED), ({"q": 1, "y": 1}, 0)],  # it fails whatever NAN is
    ),
    "an undefined process": (
        action("(q)") + process("flow", NAN, "(increase (x) #t)"), [({}, UNDEFINED)]
    ),
    "an undefined event": (
        action("(when (q) (unsafe))") + event("pay", NAN, "(p)"),
        [({}, UNDEFINED), ({"q": 1}, UNDEFINED | UNSAFE)],
    ),
    "an undefined effect of an event counts where it fires": (
        action("(q)") + event("pay", "(p)", f"(when {NAN} (unsafe))"),
        [({"p": 1}, UNDEFINED), ({}, {"q": 1})],
    ),
    "what is certainly unsafe stays so where the rest is undefined": (
        action(f"(when {NAN} (p)) (when (q) (unsafe))"),
        [({"q": 1}, UNDEFINED | UNSAFE), ({}, UNDEFINED), ({"q": 1, "y": 1}, {"unsafe": True})],
    ),
    "unsafe is not certain under an undefined condition": (
        action(f"(when {NAN} (unsafe))"), [({}, UNDEFINED), ({"y": 0.25}, {"unsafe": True})]
    ),
    "an unsafe step without a result is unsafe": (
        action("(unsafe) (assign (x) (/ 1 (y)))"), [({}, UNDEFINED | UNSAFE)]
    ),
    "a difference of overflows is undefined": (
        action(f"(when (> (- {SQUARE} {SQUARE}) 0) (unsafe))"),
        [({"y": 1e200}, UNDEFINED), ({"y": 1e100}, {})],
    ),
    # Events
    "an event fires once a step, however often it is enabled": (
        action("")
        + event("tick", "(and)", "(increase (x) 1) (not (q))")
        + event("tock", "(not (q))", "(increase (y) 1) (q)")
        + event("back", "(q)", "(not (q)) (increase (z) 1)"),
        [({}, {"x": 1, "y": 1, "z": 1})],
    ),
    "events see what those before them did, in sweeps": (
        action("")
        + event("up", "(< (x) 1)", "(increase (x) 1)")
        + event("down", "(>= (x) 1)", "(decrease (x) 5)"),
        [({}, {"x": -4}), ({"x": 1}, {"x": -3})],  # `up` is over; `up` in a second sweep
    ),
    "the condition of an event that has fired may become undefined": (
        action("") + event("below", "(< (y) 0)", "(q)") + event("zero", NAN, "(assign (y) 0)"),
        [({"y": 0.25}, {"y": 0})],
    ),
    "events follow flags and rewards of the action": (
        action("(when (> (x) 1) (unsafe)) (increase (reward) 2)")
        + event("hurt", "(unsafe)", "(terminal) (decrease (reward) 10)"),
        [({}, {"reward": 2}), ({"x": 2}, {"reward": -8, "unsafe": True, "terminal": True})],
    ),
}  # fmt: skip


@pytest.mark.parametrize("rule", STEPS)
def test_a_step_follows_the_rule(rule):
    schemas, cases = STEPS[rule]
    model = model_of(schemas).replace(dt=0.5)
    for given, expected in cases:
        check(model, given, expected)


@pytest.mark.parametrize("operator", ["<", "<=", "=", ">=", ">"])
def test_neither_a_comparison_with_nothing_nor_its_negation_holds(operator):
    condition = f"({operator} (/ 1 (y)) 2)"
    model = model_of(action(f"(when {condition} (p)) (when (not {condition}) (q))"))
    check(model, {}, UNDEFINED)
    for y in (0.25, 0.5, 1.0):
        holds = {"<": 1 / y < 2, "<=": 1 / y <= 2, "=": y == 0.5, ">=": 1 / y >= 2, ">": 1 / y > 2}
        check(model, {"y": y}, {"p": holds[operator], "q": not holds[operator]})


@pytest.mark.parametrize(
    ("condition", "holds"),
    [
        (f"(and {NAN} (p))", False),
        (f"(and (p) {NAN})", False),
        (f"(or {NAN} (not (p)))", True),
        (f"(imply (p) {NAN})", True),
        (f"(not (and {NAN} (p)))", True),
    ],
)
def test_a_condition_whose_truth_does_not_hang_on_the_undefined_part_counts(condition, holds):
    model = model_of(action(f"(when {condition} (q))"))
    check(model, {}, {"q": holds})
    check(model, {"p": 1}, UNDEFINED)


# Quantifiers -----------------------------------------------------------------------------------


def test_forall_changes_every_object_once_and_at_the_same_time():
    every = (
        "(forall (?i - item) (and (increase (x) 1) (when (on ?i) (increase (y) 1))))"
        " (forall (?i ?j - item) (when (not (= ?i ?j)) (assign (cost ?i) (cost ?j))))"
    )
    model = model_of(action(every), TWO_ITEMS, ITEMS)
    after = {"x": 2, "y": 1, "cost i1": 2, "cost i2": 1}
    check(model, {"on i2": 1, "cost i1": 1, "cost i2": 2}, after)
    none = action(f"{every} (p)", "(forall (?i - item) (on ?i))")
    check(model_of(none, "(:domain d)", ITEMS), {}, {"p": 1})  # no object is left to ask
    assert not model_of(action("(p)", "(exists (?i - item) (on ?i))"), "(:domain d)", ITEMS).actions


# Reward, goal, metric --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("goal", "terminal"), [("()", 0), ("(and)", 0), ("(and (and))", 0), ("(= o o)", 1), ("(q)", 0)]
)
def test_a_goal_that_is_empty_never_ends_the_task_and_one_that_holds_always_does(goal, terminal):
    model = model_of(action(""), f"(:domain d) (:objects o) (:goal {goal})")
    check(model, {}, {"terminal": bool(terminal)})


def test_reaching_the_goal_is_worth_1_where_the_files_know_no_reward():
    goal = "(:domain d) (:goal (and (p) (not (q))))"
    silent = "(:predicates (p) (q)) (:functions (x))"
    for declarations, metric, reward in (
        (silent, "", 1.0),
        (silent, "(:metric maximize (x))", 1.0),  # which no step changes
        ("", "", 0.0),
    ):
        model = model_of(action("(p)"), f"{goal} {metric}", declarations)
        check(model, {}, {"p": 1, "terminal": True, "reward": reward})
        check(model, {"q": 1}, {"p": 1})
    undefined = model_of(action("(q)"), f"(:domain d) (:goal {NAN})")
    check(undefined, {}, UNDEFINED)


# Judging what was observed ---------------------------------------------------------------------


def test_an_observed_transition_is_judged_by_where_it_led():
    model = model_of(
        action("(increase (x) 1) (increase (reward) (x))")
        + event("far", "(> (x) 5)", "(unsafe) (decrease (reward) 10)"),
        "(:domain d) (:goal (and (= (y) 1)))",
    )
    before, there, done = (state_of(model, given) for given in ({"x": 2}, {"x": 6}, {"y": 1}))
    assert model.judge(before, 0, there) == (-8.0, True, False)
    assert model.judge(before, 0, done) == (2.0, False, True)
    assert model.judge(before, -1, there) == (-10.0, True, False)  # an action it does not know


def test_an_event_that_ends_its_own_condition_counts_where_the_step_is_as_predicted():
    paid = event("paid", "(and (> (x) 0) (= (y) 0))", "(assign (y) 1) (increase (reward) 50)")
    model = model_of(action("(increase (x) 1)") + paid)
    before, done, other = (state_of(model, {"x": x, "y": y}) for x, y in ((0, 0), (1, 1), (2, 1)))
    assert model.judge(before, 0, done).reward == 50.0
    assert model.judged_passages(before, 0, done)[-1].gained == 50.0
    assert model.judge(before, 0, other).reward == 0.0


@pytest.mark.parametrize("precondition", ["(p)", "(and (q) (p))", f"(or (p) {NAN})"])
def test_an_inapplicable_action_has_no_effects_while_the_world_goes_on(precondition):
    pays = action("(increase (reward) 5) (unsafe) (terminal) (increase (x) 1)", precondition)
    slides = "(:process slides :parameters () :precondition (and) :effect (decrease (reward) #t))"
    far = event("far", "(> (x) 5)", "(terminal) (decrease (reward) 10)")
    model = model_of(pays + slides + far)
    able, unable = (state_of(model, given) for given in ({"p": 1, "q": 1}, {"q": 1}))
    near, there = (state_of(model, given) for given in ({"x": 1}, {"x": 6}))
    assert model.judge(able, 0, near) == (4.0, True, True)
    assert model.judge(unable, 0, near) == (-1.0, False, False)
    assert model.judge(unable, 0, there) == (-11.0, False, True)
    assert not any(p.site.what == "effect" for p in model.judged_passages(unable, 0, near))


def test_events_do_not_move_what_was_observed():
    problem = "(:domain d) (:goal (and (>= (x) 3))) (:metric maximize (x))"
    drift = action("") + event("drift", "(and)", "(increase (x) 1)")
    model = model_of(drift, problem, "(:functions (x))")
    zero, two, three = (np.array([value]) for value in (0.0, 2.0, 3.0))
    assert model.judge(zero, 0, two) == (2.0, False, False)
    assert model.judge(zero, 0, three) == (3.0 + 101.0, False, True)  # an event gains 1 in a step


@pytest.mark.parametrize(
    ("effect", "given", "says"),
    [
        ("(increase (reward) (/ 1 (x)))", {}, "the reward does not give a finite number"),
        (f"(when {NAN} (terminal))", {}, r"1:\d+: `\(> .*` divides by zero"),
        ("(assign (x) 1) (when (q) (assign (x) 2))", {"q": 1}, "contradicts another effect"),
    ],
)
def test_an_observed_transition_without_a_result_is_an_error_with_its_place(effect, given, says):
    model = model_of(action("") + event("pay", "(and)", effect))
    with pytest.raises(StateError, match=says):
        model.judge(state_of(model, {}), 0, state_of(model, given))


# Traces ----------------------------------------------------------------------------------------


def told(sites):
    return [(s.what, s.schema.name, s.item.place.text) for s in sites if s.schema and s.item]


def test_a_trace_names_what_took_part_in_order():
    model = model_of(
        action("(increase (x) 1) (when (q) (p))", "(and (not (r)) (< (x) 5))")
        + process("flow", "(> (x) 1)", "(increase (y) (* #t 2))")
        + event("far", "(> (y) 1)", "(unsafe)")
    )
    increase = ("effect", "act", "(increase (x) 1)")
    rest = [("rate", "flow", "(increase (y) (* #t 2))"), ("effect", "far", "(unsafe)")]
    for given, sites in (
        ({}, [increase]),
        ({"x": 1, "q": 1}, [("effect", "act", "(p)"), increase, *rest]),
        ({"r": 1, "x": 9}, [("failed", "act", "(not (r))")]),
        ({"x": 9}, [("failed", "act", "(< (x) 5)")]),
    ):
        passed, flags = model.trace(state_of(model, given), 0)
        assert told(passed) == sites
        assert bool(flags & APPLICABLE) == (sites[0][0] != "failed") and not flags & TERMINAL


def test_a_condition_inside_another_one_needs_both():
    model = model_of(action("(when (p) (and (when (q) (r)) (increase (x) 1)))"))
    for p, q in itertools.product((0.0, 1.0), repeat=2):
        after = model.step(state_of(model, {"p": p, "q": q}), 0).state
        expected = state_of(model, {"p": p, "q": q, "r": p * q, "x": p})
        np.testing.assert_array_equal(after, expected)


def test_a_predicate_with_parameters_is_no_flag_whatever_its_name():
    declared = "(:types item) (:constants i1 i2 - item) (:predicates (unsafe ?i - item) (p)"
    declared += " (terminal ?i - item))"
    act = action("(unsafe i1) (not (terminal i2)) (when (unsafe i2) (p))", "(not (unsafe i1))")
    model = model_of(act, "(:domain d) (:init (unsafe i2) (terminal i2))", declared)
    assert [f.name for f in model.fluents] == ["unsafe i1", "p", "terminal i2"]
    first = model.step(model.initial_state, 0)
    assert (first.unsafe, first.terminal, [*first.state]) == (False, False, [1.0, 1.0, 0.0])
    assert not model.step(first.state, 0).applicable
