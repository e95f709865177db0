from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings

from serp.model.ground import GroundModel
from serp.model.loading import Domain
from serp.model.symmetry.automorphisms import find_symmetries
from serp.model.symmetry.model_symmetry import ModelSymmetry
from serp.model.symmetry.permutation import Asymmetry, symmetry_of
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
    return find_symmetries(loaded.model.ground).described()


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
    for symmetry in find_symmetries(model.ground).generators:
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
def test_what_is_found_generates_every_permutation_that_is_a_symmetry(generated: Generated) -> None:
    ground = generated.model.ground
    objects = objects_of(ground)

    def acts(symmetry: ModelSymmetry) -> tuple[tuple[int, ...], tuple[int, ...]]:
        return symmetry.columns, symmetry.actions

    every = set()
    for images in permutations(objects):
        try:
            every.add(acts(symmetry_of(ground, dict(zip(objects, images, strict=True)))))
        except Asymmetry:
            continue
    found = find_symmetries(ground)
    assert found.complete
    reached = {tuple(objects)}
    queue = list(reached)
    for order in queue:
        for generator in found.generators:
            image = tuple(generator.objects.get(o, o) for o in order)
            if image not in reached:
                reached.add(image)
                queue.append(image)
    generated_by = {acts(symmetry_of(ground, dict(zip(objects, o, strict=True)))) for o in reached}
    assert generated_by == every


@given(models())
@settings(max_examples=20, deadline=None)
def test_a_search_is_repeatable_and_never_exceeds_its_effort(generated: Generated) -> None:
    ground = generated.model.ground
    assert find_symmetries(ground) == find_symmetries(ground)
    few = find_symmetries(ground, max_work=60)
    every = find_symmetries(ground)
    assert few.generators == every.generators[: len(few.generators)]
    assert few.complete <= (few == every)


# --- what counts as the same ---------------------------------------------------------------------


def test_the_shipped_soccer_domain_has_two_sides() -> None:
    model = load_task("soccer").load().model
    (found,) = find_symmetries(model.ground).generators
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
    with pytest.raises(Asymmetry, match=why) as caught:
        symmetry_of(loaded.model.ground, {"left": "right", "right": "left"})
    assert caught.value.place is not None


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


def test_objects_that_move_together_are_found() -> None:
    """Four rooms in a ring: neither two alone can be exchanged, yet it turns and mirrors."""
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
    found = find_symmetries(loaded.model.ground)
    reached = {("a", "b", "c", "d")}
    for _ in range(4):
        reached |= {
            tuple(g.objects.get(o, o) for o in order) for g in found.generators for order in reached
        }
    assert len(reached) == 8
