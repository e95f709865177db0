"""The meaning of a step, case by case, with the numbers written out."""

from __future__ import annotations

import numpy as np
import pytest

from serp.model.emit import Site
from serp.model.flags import UNDEFINED, UNSAFE
from serp.model.transition_model import Outcome, StateError, TransitionModel
from serp.pddl.source import DomainError
from tests.generated import Texts, load_texts

PREDICATES = "(p) (q) (r) (unsafe) (terminal)"
FUNCTIONS = "(x) (y) (z) (reward)"


def model_of(
    *schemas: str, predicates: str = "", functions: str = "", types: str = "", problem: str = ""
) -> TransitionModel:
    """A domain of some schemas over (p) (q) (r) and (x) (y) (z), with 0 values at first."""
    types = f"(:types {types})" if types else ""
    domain = (
        f"(define (domain d) {types} (:predicates {PREDICATES} {predicates})"
        f" (:functions {FUNCTIONS} {functions}) {' '.join(schemas)})"
    )
    return load_texts(Texts(domain, f"(define (problem e) {problem})" if problem else None)).model


def action(effect: str, precondition: str = "(and)") -> str:
    return f"(:action act :parameters () :precondition {precondition} :effect (and {effect}))"


def event(name: str, precondition: str, effect: str) -> str:
    return f"(:event {name} :parameters () :precondition {precondition} :effect (and {effect}))"


def process(name: str, precondition: str, effect: str) -> str:
    return f"(:process {name} :parameters () :precondition {precondition} :effect (and {effect}))"


def run(model: TransitionModel, **given: float) -> tuple[Outcome, dict[str, float | bool]]:
    """Step `act` from a state that is 0 and false but for what is given; batched beside."""
    values = {f.name: given.get(f.name, 0.0) for f in model.fluents}
    state = model.state(values)
    outcome = model.step(state, "act")
    batch = model.step(np.stack([state, state]), "act")
    assert batch.state[1].tobytes() == outcome.state.tobytes()
    assert batch.reward[1] == outcome.reward
    assert tuple(column[1] for column in batch[2:]) == outcome[2:]
    return outcome, model.values(outcome.state)


# Effects of one action --------------------------------------------------------------------------


@pytest.mark.parametrize("effect", ["(not (p)) (p)", "(p) (not (p))"])
@pytest.mark.parametrize("before", [0, 1])
def test_adding_wins_over_deleting(effect: str, before: int) -> None:
    assert run(model_of(action(effect)), p=before)[1]["p"] is True


def test_adding_wins_over_deleting_when_both_are_conditional() -> None:
    model = model_of(action("(when (q) (p)) (when (r) (not (p)))"))
    assert run(model, q=1, r=1)[1]["p"] is True
    assert run(model, p=1, r=1)[1]["p"] is False


def test_numbers_swap() -> None:
    _, after = run(model_of(action("(assign (x) (y)) (assign (y) (x))")), x=1.0, y=2.0)
    assert (after["x"], after["y"]) == (2.0, 1.0)


def test_predicates_swap() -> None:
    swap = "(when (p) (q)) (when (q) (p)) (when (not (p)) (not (q))) (when (not (q)) (not (p)))"
    model = model_of(action(swap))
    for p, q in ((0, 0), (0, 1), (1, 0), (1, 1)):
        _, after = run(model, p=p, q=q)
        assert (after["p"], after["q"]) == (bool(q), bool(p))


def test_effects_see_the_state_before_the_action() -> None:
    model = model_of(action("(increase (x) 1) (when (> (x) 0) (p)) (assign (y) (* 2 (x)))"))
    assert run(model, x=0.0)[1] == {"p": False, "q": False, "r": False, "x": 1, "y": 0, "z": 0}
    assert run(model, x=1.0)[1] == {"p": True, "q": False, "r": False, "x": 2, "y": 2, "z": 0}


def test_flags_are_false_before_the_action_whatever_it_sets() -> None:
    model = model_of(action("(unsafe) (terminal) (when (or (unsafe) (terminal)) (p))"))
    outcome, after = run(model)
    assert outcome.unsafe and outcome.terminal and after["p"] is False
    assert run(model_of(action("(p)", "(not (unsafe))")))[0].applicable
    assert not run(model_of(action("(p)", "(unsafe)")))[0].applicable


def test_increases_and_decreases_add_up() -> None:
    model = model_of(action("(increase (x) 1) (decrease (x) (y)) (increase (x) (x))"))
    assert run(model, x=5.0, y=2.0)[1]["x"] == 9.0


def test_scalings_multiply() -> None:
    model = model_of(action("(scale-up (x) 3) (scale-down (x) 2) (scale-up (x) (y))"))
    assert run(model, x=4.0, y=-1.0)[1]["x"] == -6.0


@pytest.mark.parametrize(
    ("effect", "fine", "contradictory"),
    [
        ("(assign (x) 1) (when (p) (assign (x) 2))", {}, {"p": 1}),
        ("(assign (x) 1) (when (p) (increase (x) 2))", {}, {"p": 1}),
        ("(decrease (x) 1) (when (p) (assign (x) 2))", {}, {"p": 1}),
        ("(scale-up (x) 2) (when (p) (increase (x) 2))", {}, {"p": 1}),
        ("(increase (x) 2) (when (p) (scale-down (x) 2))", {}, {"p": 1}),
        ("(scale-up (x) 2) (when (p) (assign (x) 2))", {}, {"p": 1}),
        ("(assign (x) (y)) (assign (x) (z))", {"y": 2.0, "z": 2.0}, {"y": 2.0, "z": 3.0}),
    ],
)
def test_contradictory_effects_make_an_action_not_applicable(
    effect: str, fine: dict[str, float], contradictory: dict[str, float]
) -> None:
    model = model_of(action(effect))
    assert run(model, **fine)[0].applicable
    outcome, after = run(model, x=7.0, **contradictory)
    assert not outcome.applicable and after["x"] == 7.0
    sites, flags = model.trace(model.state({**model.values(outcome.state)}), 0)
    assert (sites[-1].what, flags) == ("conflict", UNDEFINED)


def test_assigning_the_same_value_twice_is_no_contradiction() -> None:
    assert run(model_of(action("(assign (x) 2) (assign (x) (+ 1 1))")))[1]["x"] == 2.0


# Undefined results -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "effect",
    [
        "(assign (x) (/ 1 (y)))",
        "(assign (x) (/ 0 (y)))",
        "(scale-down (x) (y))",
        "(increase (reward) (/ 1 (y)))",
        "(increase (x) (* 1e308 (- 10 (y))))",
        "(decrease (reward) (* 1e308 (- 10 (y))))",
        "(increase (x) (* (/ 1 (y)) 0))",
    ],
)
def test_a_step_without_a_finite_result_is_not_applicable(effect: str) -> None:
    model = model_of(action(f"{effect} (p)"))
    outcome, after = run(model, y=0.0, x=3.0)
    assert outcome[1:5] == (0.0, False, False, False)
    assert after["x"] == 3.0 and after["p"] is False
    state = model.state({f.name: 3.0 * (f.name == "x") for f in model.fluents})
    assert model.trace(state, 0)[0][-1].what == "undefined"
    assert run(model, y=10.0)[0].applicable


@pytest.mark.parametrize("operator", ["<", "<=", "=", ">=", ">"])
def test_neither_a_comparison_with_nothing_nor_its_negation_holds(operator: str) -> None:
    condition = f"({operator} (/ 1 (y)) 2)"
    model = model_of(action(f"(when {condition} (p)) (when (not {condition}) (q))"))
    assert not run(model, y=0.0)[0].applicable
    for y in (0.25, 0.5, 1.0):
        _, after = run(model, y=y)
        holds = {
            "<": 1 / y < 2,
            "<=": 1 / y <= 2,
            "=": 1 / y == 2,
            ">=": 1 / y >= 2,
            ">": 1 / y > 2,
        }
        assert (after["p"], after["q"]) == (holds[operator], not holds[operator])


def test_a_condition_that_hangs_on_a_division_by_zero_refuses_the_step() -> None:
    condition = "(> (/ 1 (y)) 2)"
    for model in (
        model_of(action("(q)", condition)),
        model_of(action(f"(when {condition} (unsafe))")),
        model_of(action("(q)"), process("flow", condition, "(increase (x) #t)")),
        model_of(action("(q)"), event("break", condition, "(unsafe)")),
        model_of(action("(q)"), event("pay", "(q)", f"(when {condition} (unsafe))")),
        model_of(action("(q)"), problem=f"(:domain d) (:goal {condition})"),
    ):
        assert not run(model, y=0.0)[0].applicable
    model = model_of(action("(q)"), event("pay", "(p)", f"(when {condition} (unsafe))"))
    assert run(model, y=0.0)[0].applicable  # the event does not fire: nothing asks


def test_what_is_certainly_unsafe_stays_so_where_the_rest_is_undefined() -> None:
    undefined = "(> (/ 1 (y)) 2)"
    for model, flags in (
        (model_of(action(f"(when {undefined} (p)) (unsafe)")), UNDEFINED | UNSAFE),
        (model_of(action(f"(when {undefined} (p)) (when (q) (unsafe))")), UNDEFINED | UNSAFE),
        (model_of(action(f"(when {undefined} (p)) (when (r) (unsafe))")), UNDEFINED),
        (model_of(action(f"(when {undefined} (unsafe))")), UNDEFINED),
        (model_of(action("(unsafe)"), event("pay", undefined, "(p)")), UNDEFINED | UNSAFE),
        (model_of(action("(unsafe) (assign (x) (/ 1 (y)))")), UNDEFINED | UNSAFE),
        (model_of(action("(unsafe)", f"(and {undefined} (r))")), 0),  # fails whatever it comes to
        (model_of(action("(unsafe)", f"(and {undefined} (q))")), UNDEFINED),
    ):
        state = model.state({f.name: float(f.name == "q") for f in model.fluents})
        assert model.transition(state.tolist(), 0)[1] == flags
        assert model.trace(state, 0)[1] == flags
        assert not model.step(state, 0).applicable


def test_a_condition_whose_truth_does_not_hang_on_the_undefined_part_counts() -> None:
    undefined = "(> (/ 1 (y)) 2)"
    for condition, holds in (
        (f"(and {undefined} (p))", False),
        (f"(and (p) {undefined})", False),
        (f"(or {undefined} (not (p)))", True),
        (f"(imply (p) {undefined})", True),
        (f"(not (and {undefined} (p)))", True),
    ):
        outcome, after = run(model_of(action(f"(when {condition} (q))")), y=0.0, p=0)
        assert outcome.applicable and after["q"] is holds
        assert not run(model_of(action(f"(when {condition} (q))")), y=0.0, p=1)[0].applicable


def test_a_division_by_a_written_zero_is_an_error_with_its_place() -> None:
    with pytest.raises(DomainError, match="a division by zero") as raised:
        model_of(action("(assign (x) (/ (y) 0.0))"))
    assert raised.value.line == 1


def test_a_difference_of_overflows_is_undefined_and_an_overflow_alone_is_large() -> None:
    square = "(* (y) (y))"
    model = model_of(action(f"(when (> (- {square} {square}) 0) (unsafe))"))
    assert not run(model, y=1e200)[0].applicable
    assert run(model, y=1e100)[0].applicable
    assert run(model_of(action(f"(when (> {square} 0) (unsafe))")), y=1e200)[0].unsafe


def test_reaching_the_goal_is_worth_1_where_the_files_know_no_reward() -> None:
    texts = ("(:domain d) (:goal (p))", "(:domain d) (:goal (p)) (:metric maximize (y))")
    silent, metric = (
        load_texts(
            Texts(
                "(define (domain d) (:predicates (p)) (:functions (y))"
                " (:action act :parameters () :precondition (and) :effect (and (p))))",
                f"(define (problem e) {text})",
            )
        ).model
        for text in texts
    )
    assert run(silent)[0].reward == 1.0 and run(silent)[0].terminal and silent.rewarding
    assert run(metric)[0].reward == 1.0 and run(metric)[0].terminal  # no step changes the metric
    with_reward = model_of(action("(p)"), problem=texts[0])
    assert run(with_reward)[0].reward == 0.0 and run(with_reward)[0].terminal


def test_a_process_or_event_without_a_finite_result_makes_the_step_not_applicable() -> None:
    for schema in (
        process("flow", "(p)", "(increase (x) (* #t (/ 1 (y))))"),
        event("jump", "(p)", "(increase (x) (/ 1 (y)))"),
        event("pay", "(p)", "(increase (reward) (/ 1 (y)))"),
    ):
        model = model_of(action("(q)"), schema)
        assert not run(model, p=1)[0].applicable
        assert run(model, p=0)[0].applicable
        assert run(model, p=1, y=1.0)[0].applicable


# Quantifiers -----------------------------------------------------------------------------------

ITEMS = {"types": "item", "predicates": "(on ?i - item)", "functions": "(cost ?i - item)"}
NO_ITEMS = "(:domain d)"
TWO_ITEMS = "(:domain d) (:objects i1 i2 - item)"


def test_forall_over_an_empty_type() -> None:
    every = action("(forall (?i - item) (increase (x) 1)) (p)", "(forall (?i - item) (on ?i))")
    some = action("(p)", "(exists (?i - item) (on ?i))")
    outcome, after = run(model_of(every, problem=NO_ITEMS, **ITEMS))
    assert outcome.applicable and after["x"] == 0.0 and after["p"] is True
    assert len(model_of(some, problem=NO_ITEMS, **ITEMS).actions) == 0  # never applicable


def test_forall_effect_happens_once_for_every_object() -> None:
    model = model_of(
        action("(forall (?i - item) (and (increase (x) 1) (when (on ?i) (increase (y) 1))))"),
        problem=TWO_ITEMS,
        **ITEMS,
    )
    values = {f.name: 0.0 for f in model.fluents} | {"on i2": 1.0}
    after = model.values(model.step(model.state(values), "act").state)
    assert (after["x"], after["y"]) == (2.0, 1.0)


def test_forall_effects_in_different_objects_swap_simultaneously() -> None:
    model = model_of(
        action("(forall (?i ?j - item) (when (not (= ?i ?j)) (assign (cost ?i) (cost ?j))))"),
        problem=TWO_ITEMS,
        **ITEMS,
    )
    values = {f.name: 0.0 for f in model.fluents} | {"cost i1": 1.0, "cost i2": 2.0}
    after = model.values(model.step(model.state(values), "act").state)
    assert (after["cost i1"], after["cost i2"]) == (2.0, 1.0)


def test_inner_variables_hide_outer_ones() -> None:
    model = model_of(
        "(:action act :parameters (?i - item)"
        " :precondition (and (not (on ?i)) (exists (?i - item) (on ?i))) :effect (on ?i))",
        problem=TWO_ITEMS,
        **ITEMS,
    )
    state = model.state({f.name: float(f.name == "on i2") for f in model.fluents})
    assert model.step(state, "act i1").applicable
    assert not model.step(state, "act i2").applicable


def test_either_takes_objects_of_both_types_in_the_order_of_the_file() -> None:
    model = model_of(
        "(:action act :parameters (?i - (either item tool)) :effect (seen ?i))",
        types="item tool other",
        predicates="(seen ?i - (either item tool))",
        problem="(:domain d) (:objects b - tool a - item c - other d - tool)",
    )
    assert [a.name for a in model.actions] == ["act b", "act a", "act d"]


def test_a_static_value_is_needed_only_where_a_static_fact_asks_for_it() -> None:
    texts = Texts(
        "(define (domain d) (:predicates (road ?a ?b) (at ?a)) (:functions (length ?a ?b) (far))"
        " (:action go :parameters (?a ?b) :precondition (and (at ?a) (road ?a ?b)"
        "   (forall (?c) (imply (road ?b ?c) (< (length ?b ?c) 5))))"
        "  :effect (and (at ?b) (not (at ?a)) (increase (far) (length ?a ?b)))))",
        "(define (problem e) (:domain d) (:objects k l m)"
        " (:init (at k) (road k l) (road l m) (= (length k l) 2) (= (length l m) 3) (= (far) 0)))",
    )
    model = load_texts(texts).model
    assert model.initial_state is not None
    assert [a.name for a in model.actions] == ["go k l", "go l m"]
    assert model.values(model.step(model.initial_state, "go k l").state)["far"] == 2.0


# Processes -------------------------------------------------------------------------------------


def test_processes_see_the_state_after_the_action() -> None:
    model = model_of(
        action("(assign (y) 3) (p)"), process("flow", "(p)", "(increase (x) (* #t (y)))")
    ).replace(dt=0.5)
    assert run(model, y=100.0)[1]["x"] == 1.5


def test_all_rates_are_evaluated_before_any_is_applied() -> None:
    model = model_of(
        action(""),
        process("a", "(> (x) 0)", "(increase (y) (* #t (x)))"),
        process("b", "(> (x) 0)", "(decrease (x) (* #t (y)))"),
        process("c", "(<= (x) 0)", "(increase (z) #t)"),
        process("d", "(> (x) 0)", "(increase (x) (* (z) #t))"),
    ).replace(dt=0.25)
    _, after = run(model, x=4.0, y=32.0, z=1.0)
    assert (after["x"], after["y"], after["z"]) == (4.0 - 8.0 + 0.25, 33.0, 1.0)


def test_processes_reward_by_time() -> None:
    model = model_of(action(""), process("pay", "(p)", "(increase (reward) (* #t 3))"))
    assert run(model.replace(dt=0.5), p=1)[0].reward == 1.5
    assert run(model.replace(dt=0.5), p=0)[0].reward == 0.0


# Events ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 0, 2), (1, 2, 0)])
def test_event_chains_run_whatever_the_order_of_the_file(order: tuple[int, ...]) -> None:
    chain = [
        event("first", "(p)", "(q) (increase (x) 1)"),
        event("second", "(q)", "(r) (increase (x) 10)"),
        event("third", "(r)", "(unsafe) (increase (x) 100)"),
    ]
    outcome, after = run(model_of(action("(p)"), *(chain[k] for k in order)))
    assert after["x"] == 111.0 and outcome.unsafe
    assert run(model_of(action("(r)"), *(chain[k] for k in order)))[1]["x"] == 100.0


def test_an_event_fires_once_a_step_however_often_it_is_enabled() -> None:
    model = model_of(
        action(""),
        event("tick", "(and)", "(increase (x) 1) (not (q))"),
        event("tock", "(not (q))", "(increase (y) 1) (q)"),
        event("back", "(q)", "(not (q)) (increase (z) 1)"),
    )
    _, after = run(model)
    assert (after["x"], after["y"], after["z"]) == (1.0, 1.0, 1.0)


def test_events_of_one_sweep_see_what_the_ones_before_them_did() -> None:
    model = model_of(
        action(""),
        event("up", "(< (x) 1)", "(increase (x) 1)"),
        event("down", "(>= (x) 1)", "(decrease (x) 5)"),
    )
    assert run(model, x=0.0)[1]["x"] == -4.0  # `up` is over for this step
    assert run(model, x=1.0)[1]["x"] == -3.0  # `down` first, then `up` in a second sweep


def test_effects_of_an_event_are_simultaneous_too() -> None:
    model = model_of(
        action(""), event("swap", "(p)", "(assign (x) (y)) (assign (y) (x)) (not (p))")
    )
    _, after = run(model, p=1, x=1.0, y=2.0)
    assert (after["x"], after["y"], after["p"]) == (2.0, 1.0, False)


def test_events_follow_flags_and_rewards_of_the_action() -> None:
    model = model_of(
        action("(when (> (x) 1) (unsafe)) (increase (reward) 2)"),
        event("hurt", "(unsafe)", "(terminal) (decrease (reward) 10)"),
    )
    assert run(model, x=0.0)[0][1:5] == (2.0, False, False, True)
    assert run(model, x=2.0)[0][1:5] == (-8.0, True, True, True)


def test_contradictory_effects_of_an_event_make_the_step_not_applicable() -> None:
    clash = event("clash", "(p)", "(assign (x) 1) (when (q) (increase (x) 2))")
    model = model_of(action(""), clash)
    assert run(model, p=1)[0].applicable
    assert not run(model, p=1, q=1)[0].applicable


# Flags, reward, goal ---------------------------------------------------------------------------


def test_unsafe_from_a_conditional_effect_only() -> None:
    model = model_of(action("(increase (x) 1) (when (>= (x) 2) (unsafe))"))
    outcomes = model.step(np.array([[0, 0, 0, x, 0, 0] for x in (0, 1, 2, 3)], dtype=float), "act")
    assert outcomes.unsafe.tolist() == [False, False, True, True]
    assert outcomes.state[:, 3].tolist() == [1, 2, 3, 4]
    sites = model.trace([0, 0, 0, 2, 0, 0], 0)[0]
    assert [site.item.place.text for site in sites] == ["(unsafe)", "(increase (x) 1)"]


def test_flags_and_reward_start_afresh_in_every_step() -> None:
    model = model_of(action("(when (p) (and (unsafe) (terminal) (increase (reward) 1))) (not (p))"))
    first, _ = run(model, p=1)
    assert first[1:5] == (1.0, True, True, True)
    assert model.step(first.state, "act")[1:5] == (0.0, False, False, True)


def test_a_goal_that_is_empty_never_ends_the_task_and_one_that_holds_always_does() -> None:
    for goal, terminal in [("()", 0), ("(and)", 0), ("(and (and))", 0), ("(= o o)", 1), ("(p)", 0)]:
        model = model_of(action(""), problem=f"(:domain d) (:objects o) (:goal {goal})")
        assert run(model)[0].terminal is bool(terminal), goal
    model = model_of(action("(p)"), problem="(:domain d) (:goal (and (p) (not (q))))")
    assert [run(model, q=q)[0].terminal for q in (0, 1)] == [True, False]


def test_time_is_a_cost_where_the_metric_says_so() -> None:
    domain = "(define (domain d) (:functions (x)) (:action act :effect (increase (x) 2)))"
    problem = "(define (problem e) (:domain d) (:init (= (x) 0)) (:metric {}))"
    for metric, reward in [
        ("minimize (total-time)", -0.5),
        ("minimize total-time", -0.5),
        ("maximize (- (x) (* 2 (total-time)))", 1.0),
        ("minimize (* (x) (x))", -4.0),
    ]:
        model = load_texts(Texts(domain, problem.format(metric))).model.replace(dt=0.5)
        assert run(model)[0].reward == reward


def test_reward_may_be_given_its_zero_in_the_problem() -> None:
    model = model_of(action("(increase (reward) 1)"), problem="(:domain d) (:init (= (reward) 0))")
    assert "reward" not in {f.name for f in model.fluents} | model.ground.static.keys()
    assert run(model)[0].reward == 1.0


# Judging what was observed ---------------------------------------------------------------------


def test_an_observed_transition_is_judged_by_where_it_led() -> None:
    model = model_of(
        action("(increase (x) 1) (increase (reward) (x))"),
        event("far", "(> (x) 5)", "(unsafe) (decrease (reward) 10)"),
        problem="(:domain d) (:goal (and (= (y) 1)))",
    )
    before = model.state({f.name: 2.0 * (f.name == "x") for f in model.fluents})
    there = model.state({f.name: 6.0 * (f.name == "x") for f in model.fluents})
    done = model.state({f.name: float(f.name == "y") for f in model.fluents})
    assert model.judge(before, 0, there) == (-8.0, True, False)
    assert model.judge(before, 0, done) == (2.0, False, True)
    assert model.judge(before, -1, there) == (-10.0, True, False)  # an action it does not know


def test_events_do_not_move_what_was_observed() -> None:
    texts = Texts(
        "(define (domain d) (:functions (x)) (:action act :effect (and))"
        " (:event drift :effect (increase (x) 1)))",
        "(define (problem e) (:domain d) (:goal (and (>= (x) 3))) (:metric maximize (x)))",
    )
    model = load_texts(texts).model
    zero, two, three = (np.array([value]) for value in (0.0, 2.0, 3.0))
    assert model.judge(zero, 0, two) == (2.0, False, False)
    assert model.judge(zero, 0, three) == (3.0 + 101.0, False, True)  # an event gains 1 in a step


def test_an_observed_transition_without_a_finite_reward_is_an_error() -> None:
    model = model_of(action(""), event("pay", "(and)", "(increase (reward) (/ 1 (x)))"))
    zero = np.zeros(len(model.fluents))
    with pytest.raises(StateError, match="no finite number"):
        model.judge(zero, 0, zero)


# Explanations ----------------------------------------------------------------------------------


def told(sites: list[Site]) -> list[tuple[str, str, str]]:
    return [
        (site.what, site.schema.name if site.schema else "", site.item.place.text)
        for site in sites
        if site.item is not None and not isinstance(site.item, bool)
    ]


def test_a_trace_names_what_took_part_in_order() -> None:
    model = model_of(
        action("(increase (x) 1) (when (q) (p))", "(and (not (r)) (< (x) 5))"),
        process("flow", "(> (x) 1)", "(increase (y) (* #t 2))"),
        event("far", "(> (y) 1)", "(unsafe)"),
    )
    zero = {f.name: 0.0 for f in model.fluents}
    assert told(model.trace(model.state(zero), 0)[0]) == [("effect", "act", "(increase (x) 1)")]
    assert told(model.trace(model.state(zero | {"x": 1.0, "q": 1.0}), 0)[0]) == [
        ("effect", "act", "(p)"),
        ("effect", "act", "(increase (x) 1)"),
        ("rate", "flow", "(increase (y) (* #t 2))"),
        ("effect", "far", "(unsafe)"),
    ]
    assert told(model.trace(model.state(zero | {"r": 1.0, "x": 9.0}), 0)[0]) == [
        ("failed", "act", "(not (r))")
    ]
    assert told(model.trace(model.state(zero | {"x": 9.0}), 0)[0]) == [
        ("failed", "act", "(< (x) 5)")
    ]
