from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings

from serp.model.ground import GroundModel
from serp.model.loading import Domain
from serp.model.symmetry.exchanges import Exchanges, find_exchanges
from serp.model.symmetry.permutation import Asymmetry, Permutations
from serp.tasks.registry import load_task
from tests.generated.models import Generated, load_texts, models, models_with_states
from tests.generated.writer import Texts


def domain(body: str) -> Domain:
    text = f"""(define (domain d) (:types side)
    (:predicates (up ?s - side) (done) (unsafe) (terminal))
    (:functions (load ?s - side) (total) (reward)) {body})"""
    return load_texts(Texts(text, None))


SIDES = "(:constants left right - side)"
LIFT = """(:action lift :parameters (?s - side) :precondition (and (not (up ?s)))
    :effect (and (up ?s) (increase (reward) (load ?s))))"""


def told(loaded: Domain) -> list[str]:
    return find_exchanges(loaded.model.ground).described()


def objects_of(ground: GroundModel) -> list[str]:
    schemas = (*ground.actions, *ground.processes, *ground.events)
    named = {o for x in (*ground.fluents, *schemas) for o in x.arguments}
    return sorted(named | {o for key in ground.static for o in key.split()[1:]})


# --- the whole truth -----------------------------------------------------------------------------


@given(models_with_states(count=4, exact=True))
@settings(max_examples=80, deadline=None)
def test_a_symmetry_found_maps_every_step_onto_its_mirror_image(
    case: tuple[Generated, np.ndarray],
) -> None:
    generated, states = case
    model = generated.model
    for symmetry in find_exchanges(model.ground).symmetries:
        for state in states:
            for action in range(len(model.actions)):
                here = model.step(state, action)
                there = model.step(symmetry.of_state(state), symmetry.actions[action])
                assert there.applicable == here.applicable
                if here.applicable:
                    assert (there.unsafe, there.terminal) == (here.unsafe, here.terminal)
                    assert there.reward == pytest.approx(here.reward)
                    np.testing.assert_allclose(there.state, symmetry.of_state(here.state))


@given(models())
@settings(max_examples=80, deadline=None)
def test_two_objects_are_in_one_class_where_their_exchange_is_a_symmetry(
    generated: Generated,
) -> None:
    ground = generated.model.ground
    permutations = Permutations(ground)
    found = find_exchanges(ground)
    assert found.complete
    first_of = {other: first for first, other in (s.objects for s in found.symmetries)}
    for one, other in combinations(objects_of(ground), 2):
        alike = first_of.get(one, one) == first_of.get(other, other)
        try:
            trivial = permutations.symmetry({one: other, other: one}).trivial
        except Asymmetry:
            assert not alike
        else:
            assert alike or trivial


def test_a_search_that_is_cut_short_says_so() -> None:
    ground = load_task("soccer").load().model.ground
    assert find_exchanges(ground, max_work=10) == Exchanges((), complete=False)


# --- what counts as the same ---------------------------------------------------------------------


def test_the_shipped_soccer_domain_has_two_sides() -> None:
    model = load_task("soccer").load().model
    (found,) = find_exchanges(model.ground).symmetries
    assert found.objects == {"left": "right", "right": "left"}
    names = [action.name for action in model.actions]
    assert [names[k] for k in found.actions] == [
        "cover-goal", "frontal-contrast", "side-advance right", "side-advance left",
        "charge-opponent",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "body",
    [
        # A rule for each side, in any order and any wording that means the same.
        """(:action a :parameters () :precondition (and (up left) (> (load left) 1))
             :effect (and (increase (total) (+ (load left) (load right))) (not (up left))))
           (:action b :parameters () :precondition (and (< 1 (load right)) (up right))
             :effect (and (not (up right)) (increase (total) (+ (load right) (load left)))))""",
        # Processes add up, in whatever order.
        """(:process left-flows :parameters () :precondition (and (up left))
             :effect (and (increase (total) (* #t (load left)))))
           (:process right-flows :parameters () :precondition (and (up right))
             :effect (and (increase (total) (* #t (load right)))))""",
        # Either event may come first.
        """(:event l :parameters () :precondition (and (up left))
             :effect (and (not (up left)) (increase (reward) 1) (terminal)))
           (:event r :parameters () :precondition (and (up right))
             :effect (and (not (up right)) (increase (reward) 1) (terminal)))""",
    ],
)
def test_how_it_is_written_does_not_matter(body: str) -> None:
    assert told(domain(SIDES + LIFT + body)) == ["left <-> right"]


@pytest.mark.parametrize(
    ("body", "why"),
    [
        ("(:action a :parameters () :precondition (and) :effect (and (up left)))", "no mirror"),
        (
            """(:action a :parameters (?s - side) :precondition (and) :effect (and
                 (when (and (up left)) (increase (load ?s) 1))))""",
            "not mirror images",
        ),
        (
            """(:action a :parameters () :precondition (and (up left))
                 :effect (and (increase (reward) 1)))
               (:action b :parameters () :precondition (and (up right))
                 :effect (and (increase (reward) 2)))""",
            "no mirror image",
        ),
        (
            """(:event l :parameters () :precondition (and (up left))
                 :effect (and (done) (increase (reward) 1) (not (up left))))
               (:event r :parameters () :precondition (and (up right) (not (done)))
                 :effect (and (done) (increase (reward) 1) (not (up right))))""",
            "no mirror image",
        ),
        (
            """(:event first :parameters (?s - side) :precondition (and (up ?s) (not (done)))
                 :effect (and (done) (not (up ?s))))""",
            "the order matters",
        ),
        (
            """(:event last :parameters (?s - side) :precondition (and (up ?s))
                 :effect (and (assign (total) (load ?s)) (not (up ?s))))""",
            "the order matters",
        ),
    ],
)
def test_what_differs_is_no_symmetry_and_it_is_said_why(body: str, why: str) -> None:
    loaded = domain(SIDES + LIFT + body)
    assert told(loaded) == []
    with pytest.raises(Asymmetry, match=rf"^generated.pddl:\d+:\d+: .*{why}"):
        Permutations(loaded.model.ground).symmetry({"left": "right", "right": "left"})


def problem(loads: tuple[int, ...], goal: str, metric: str = "") -> str:
    init = " ".join(f"(= (load {o}) {load})" for o, load in zip("abc", loads, strict=True))
    return f"""(define (problem p) (:domain d) (:objects a b c - side)
    (:init {init}) (:goal {goal}) {metric})"""


@pytest.mark.parametrize(
    ("texts", "expected"),
    [
        (problem((1, 1, 1), "(and)"), ["a, b, c in any order"]),
        (problem((1, 1, 1), "(and (up a))"), ["b <-> c"]),
        (problem((1, 2, 1), "(and)"), ["a <-> c"]),
        (problem((1, 2, 3), "(and)"), []),
        (problem((1, 1, 1), "(and)", "(:metric maximize (level c))"), ["a <-> b"]),
    ],
)
def test_values_and_goal_count(texts: str, expected: list[str]) -> None:
    loaded = load_texts(
        Texts(
            """(define (domain d) (:types side) (:predicates (up ?s - side))
              (:functions (load ?s - side) (level ?s - side))
              (:action lift :parameters (?s - side) :precondition (and (not (up ?s)))
                :effect (and (up ?s) (increase (level ?s) (load ?s)))))""",
            texts,
        )
    )
    assert told(loaded) == expected


def test_objects_that_move_together_are_a_symmetry_where_two_alone_are_not() -> None:
    """Four rooms in a ring: it turns and mirrors."""
    ring = [("a", "b"), ("b", "c"), ("c", "d"), ("d", "a")]
    beside = " ".join(f"(beside {x} {y}) (beside {y} {x})" for x, y in ring)
    loaded = load_texts(
        Texts(
            """(define (domain d) (:types room) (:predicates (at ?r - room)
                (beside ?x ?y - room) (clean ?r - room))
              (:action go :parameters (?x ?y - room) :precondition (and (at ?x) (beside ?x ?y))
                :effect (and (not (at ?x)) (at ?y) (clean ?y))))""",
            f"""(define (problem p) (:domain d) (:objects a b c d - room)
              (:init (at a) {beside}) (:goal (and (clean a) (clean b) (clean c) (clean d))))""",
        )
    )
    ground = loaded.model.ground
    turned = Permutations(ground).symmetry(dict(ring))
    assert [ground.actions[k].name for k in turned.actions[:2]] == ["go b c", "go b a"]
    with pytest.raises(Asymmetry, match="is not"):
        Permutations(ground).symmetry({"a": "b", "b": "a"})
