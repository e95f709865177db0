"""The learner's values at the leaves of the lookahead: used while they explain what was received.

A chain of places, walked from left to right; what a place is worth is known.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
import torch

from serp.control.leaf_value_bootstrap import LeafValueBootstrap
from serp.errors import RunError
from serp.learning.dqn import DQN
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.leaf_value import LeafValue
from serp.planning.lookahead import Lookahead
from serp.settings import LearnerSettings, PlannerSettings
from tests.generated import Texts, load_texts
from tests.serp.control.records import step_record

CHAIN = """
(define (domain chain)
  (:predicates (unsafe) (terminal))
  (:functions (x) (reward))
  (:action left :parameters () :precondition (and) :effect (and (decrease (x) 1)))
  (:action right :parameters () :precondition (and) :effect (and (increase (x) 1)))
  (:event goal :parameters () :precondition (and (>= (x) 20))
    :effect (and (terminal) (increase (reward) 10))))
"""
GOAL = 20
DISCOUNT = 0.9
WINDOW = 29
"""Steps after which what follows weighs less than a twentieth: 0.9 ** 29 = 0.047."""
EMPTY = {"steps": 0, "others": 0, "compared": 0}


@pytest.fixture(autouse=True, scope="module")
def _one_thread() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module")
def chain() -> TransitionModel:
    return load_texts(Texts(CHAIN, None)).model


def learner(inputs: int = 1, seed: int = 0, **settings: Any) -> DQN:
    small = {
        "hidden": (32,),
        "batch_size": 32,
        "buffer_size": 400,
        "learning_starts": 50,
        "target_period": 50,
        "learning_rate": 0.003,
        "protected_share": 0.0,
        "discount": DISCOUNT,
    }
    return DQN(inputs, 2, LearnerSettings(**{**small, **settings}), seed)


class Scene(NamedTuple):
    planner: Lookahead
    learner: DQN
    leaf_values: LeafValueBootstrap


def scene(model: TransitionModel, dqn: DQN | None = None) -> Scene:
    dqn = dqn or learner()
    planner = Lookahead(model, PlannerSettings(depth=2, leaf_value="indifferent"))
    return Scene(planner, dqn, LeafValueBootstrap(planner, dqn, np.random.SeedSequence(4)))


def packed_of(worth: Callable[[Vector], Vector], places: Vector) -> Vector:
    value = LeafValue(1, np.random.SeedSequence(1))
    value.fit(places[:, np.newaxis], worth(places))
    return value.packed


def believing(
    model: TransitionModel,
    worth: Callable[[Vector], Vector],
    places: Vector | None = None,
    dqn: DQN | None = None,
) -> Scene:
    """A scene with known leaf values; nothing replaces them, no learner learns."""
    made = scene(model, dqn)
    places = np.arange(float(GOAL)) if places is None else places
    arrays = {"packed": packed_of(worth, places), "means": np.zeros(4)}
    made.leaf_values.load_state_dict(arrays, EMPTY)
    return made


class Step(NamedTuple):
    x: float
    next_x: float
    reward: float
    terminated: bool = False
    truncated: bool = False


def tell(
    leaf_values: LeafValueBootstrap, steps: list[Step], learned: Callable[[float], float] = float
) -> None:
    for step in steps:
        leaf_values.observe(
            step_record(
                state=[step.x],
                next_state=[step.next_x],
                reward=learned(step.reward),
                domain_reward=step.reward,
                terminated=step.terminated,
                truncated=step.truncated,
            )
        )


def walk(start: int, reward: float = 10.0) -> list[Step]:
    """From a place to the goal, always to the right."""
    return [
        Step(x, x + 1, reward if x + 1 == GOAL else 0.0, terminated=x + 1 == GOAL)
        for x in range(start, GOAL)
    ]


def walks(count: int, seed: int = 0) -> list[Step]:
    random = np.random.default_rng(seed)
    return [step for _ in range(count) for step in walk(int(random.integers(0, GOAL - 1)))]


def right(places: Vector) -> Vector:
    """What the places of the chain are worth."""
    values: Vector = 10.0 * DISCOUNT ** (GOAL - 1 - places)
    return values


def compared(leaf_values: LeafValueBootstrap) -> int:
    _, meta = leaf_values.state_dict()
    return int(meta["compared"])


# What is believed --------------------------------------------------------------------------------


def test_right_values_explain_what_is_received(chain: TransitionModel) -> None:
    planner, _, leaf_values = believing(chain, right)
    tell(leaf_values, walks(100))
    assert leaf_values.explained == pytest.approx(1.0, abs=0.01)
    assert leaf_values.proven
    assert planner.leaves.tobytes() == packed_of(right, np.arange(float(GOAL))).tobytes()


def test_values_are_worth_what_they_say_about_differences(chain: TransitionModel) -> None:
    """Where the levels are wrong but the differences right, planning is right."""
    _, _, leaf_values = believing(chain, lambda places: right(places) + 100.0)
    tell(leaf_values, walks(100))
    assert leaf_values.explained == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("worth", "least", "most"),
    [
        (lambda places: -right(places), -4.0, -2.0),
        (lambda places: right(GOAL - 1 - places), -4.0, -0.1),
        (lambda places: 7.0 * np.cos(2.0 * places), -9.0, 0.4),
        (lambda places: np.full(len(places), 5.0), -0.01, 0.01),
        (lambda places: np.zeros(len(places)), -0.01, 0.01),
    ],
    ids=["the opposite", "the wrong way round", "noise", "all the same", "nothing"],
)
def test_wrong_values_are_not_believed(
    chain: TransitionModel, worth: Callable[[Vector], Vector], least: float, most: float
) -> None:
    planner, _, leaf_values = believing(chain, worth)
    tell(leaf_values, walks(100))
    assert compared(leaf_values) > 500
    assert least <= leaf_values.explained <= most
    assert not leaf_values.proven
    assert planner.leaves.size == 0


def endless(start: int, steps: int) -> list[Step]:
    """A walk that is cut off: rewards that come and go with the place."""
    return [
        Step(x, x + 1, math.cos((x + 1) / 20), truncated=x + 1 == start + steps)
        for x in range(start, start + steps)
    ]


def of_endless(places: Vector) -> Vector:
    future = np.arange(400)
    rewards = np.cos((places[:, np.newaxis] + 1 + future) / 20)
    values: Vector = (rewards * DISCOUNT**future).sum(axis=1)
    return values


def test_what_follows_the_window_is_worth_what_its_end_is(chain: TransitionModel) -> None:
    places = np.arange(81.0)
    _, _, leaf_values = believing(chain, of_endless, places)
    tell(leaf_values, [step for _ in range(8) for step in endless(0, 80)])
    assert compared(leaf_values) == 8 * (80 - WINDOW)
    assert leaf_values.explained == pytest.approx(1.0, abs=0.01)
    _, _, other = believing(chain, lambda x: of_endless(x + 63), places)  # half a wave ahead
    tell(other, [step for _ in range(8) for step in endless(0, 80)])
    assert other.explained < 0.0


def by_definition(episodes: list[list[Step]], value: LeafValue) -> tuple[list[float], list[float]]:
    """What was received, and how far off the values were, of all that can be told."""
    received, errors = [], []
    for episode in episodes:
        told = episode if episode[-1].terminated else episode[:-1]
        for first, step in enumerate(told):
            following = told[first : first + WINDOW]
            ended = following[-1].terminated
            if len(following) < WINDOW and not ended:
                break
            rewards = sum(DISCOUNT**k * s.reward for k, s in enumerate(following))
            end = 0.0 if ended else value.of(np.array([following[-1].next_x]))
            predicted = value.of(np.array([step.x])) - DISCOUNT ** len(following) * end
            if math.isfinite(rewards):
                received.append(rewards)
                errors.append(rewards - predicted)
    return received, errors


@pytest.mark.parametrize("seed", range(6))
def test_what_is_explained_is_a_share_of_the_variance(chain: TransitionModel, seed: int) -> None:
    """By the definition, whatever the values, the rewards, and the ends of episodes."""
    random = np.random.default_rng(seed)
    _, _, leaf_values = believing(chain, lambda x: np.sin(x) + right(x) / 5)
    value = LeafValue(1, np.random.SeedSequence(0))
    value.restore(leaf_values.state_dict()[0]["packed"])
    episodes, steps = [], 0
    while steps < 450:  # up to 500 the mean that forgets is that of all
        length = int(random.integers(1, 3 * WINDOW))
        end = random.random() < 0.5
        places = random.uniform(-3.0, 25.0, length + 1)
        rewards = random.standard_normal(length) * np.where(random.random(length) < 0.99, 1, np.nan)
        episodes.append(
            [
                Step(
                    places[k],
                    places[k + 1],
                    rewards[k],
                    terminated=k + 1 == length and end,
                    truncated=k + 1 == length and (not end or length % 2 == 0),
                )
                for k in range(length)
            ]
        )
        steps += length
    # After so many steps it matters little that a reward that is no number is like no other one.
    leaf_values.load_state_dict(leaf_values.state_dict()[0], {**EMPTY, "steps": 10**6})
    for episode in episodes:
        tell(leaf_values, episode)
    received, errors = by_definition(episodes, value)
    assert compared(leaf_values) == len(received)
    assert 200 <= len(received) <= 500
    expected = 1.0 - np.var(errors) / np.var(received)
    assert leaf_values.explained == pytest.approx(expected, rel=1e-9, abs=1e-9)


# What is judged, and what not --------------------------------------------------------------------


@pytest.mark.parametrize("length", [1, 2, WINDOW - 1, WINDOW, WINDOW + 1, 70])
def test_a_terminated_episode_is_judged_whole(chain: TransitionModel, length: int) -> None:
    for truncated in (False, True):  # an end counts, also where time is up as well
        _, _, leaf_values = believing(chain, right)
        steps = [Step(0.0, 1.0, 1.0) for _ in range(length - 1)]
        tell(leaf_values, [*steps, Step(0.0, 1.0, 1.0, True, truncated)])
        assert compared(leaf_values) == length


@pytest.mark.parametrize("length", [1, 2, WINDOW - 1, WINDOW, WINDOW + 1, 70])
def test_of_an_episode_cut_off_only_what_is_complete(chain: TransitionModel, length: int) -> None:
    _, _, leaf_values = believing(chain, right)
    steps = [Step(0.0, 1.0, 1.0) for _ in range(length - 1)]
    tell(leaf_values, [*steps, Step(0.0, 1.0, 1.0, truncated=True)])
    assert compared(leaf_values) == max(0, length - WINDOW)


def test_nothing_is_judged_across_the_end_of_an_episode(chain: TransitionModel) -> None:
    """What was begun before an episode was cut off is as if it had never been."""
    _, _, one = believing(chain, right)
    _, _, other = believing(chain, right)
    for start in (0, 5, 11):
        tell(one, [*(step._replace(reward=1e6) for step in walk(0)[:10]),
                   Step(10.0, 11.0, -1e6, truncated=True)])  # fmt: skip
        for leaf_values in (one, other):
            tell(leaf_values, walk(start))
    assert one.state_dict()[0]["means"].tobytes() == other.state_dict()[0]["means"].tobytes()
    assert compared(one) == compared(other) == 20 + 15 + 9


@pytest.mark.parametrize("reward", [math.nan, math.inf, -math.inf, 1e200])
def test_rewards_that_are_no_numbers_teach_nothing(chain: TransitionModel, reward: float) -> None:
    planner, _, leaf_values = believing(chain, right)
    tell(leaf_values, walks(100))
    before = {name: a.tobytes() for name, a in leaf_values.state_dict()[0].items()}
    count = compared(leaf_values)
    tell(leaf_values, walk(0, reward))  # the last one, so that each of its sums holds it
    assert {name: a.tobytes() for name, a in leaf_values.state_dict()[0].items()} == before
    assert compared(leaf_values) == count
    assert leaf_values.proven
    tell(leaf_values, walks(3, seed=1))
    assert compared(leaf_values) > count
    assert planner.leaves.size > 0


def test_a_few_comparisons_prove_nothing(chain: TransitionModel) -> None:
    _, _, leaf_values = believing(chain, right)
    for _ in range(9):
        tell(leaf_values, walk(0))
        assert (leaf_values.explained, leaf_values.proven) == (0.0, False)
    tell(leaf_values, walk(0))
    assert compared(leaf_values) == 200
    assert leaf_values.proven


def test_where_nothing_differs_nothing_is_explained(chain: TransitionModel) -> None:
    _, _, leaf_values = believing(chain, right)
    steps = [Step(19.0, 20.0, 10.0, True)] * 300
    tell(leaf_values, steps)
    assert (leaf_values.explained, leaf_values.proven) == (0.0, False)


# Whose rewards -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("every", "believed"), [(200, True), (101, True), (50, False)])
def test_values_of_other_rewards_are_not_believed(
    chain: TransitionModel, every: int, believed: bool
) -> None:
    """In more than one step of a hundred the learner is told something else than the planner."""
    planner, _, leaf_values = believing(chain, right)
    tell(leaf_values, walks(40, seed=2))  # they have proven right before
    assert leaf_values.proven
    for number, step in enumerate(walks(200), 1):
        tell(leaf_values, [step], lambda r, n=number: r + (n % every == 0))
    assert leaf_values.proven is believed
    assert (planner.leaves.size > 0) is believed


def test_what_is_told_otherwise_from_the_beginning_is_never_believed(
    chain: TransitionModel,
) -> None:
    planner, _, leaf_values = believing(chain, right)
    for step in walks(100):
        tell(leaf_values, [step], lambda r: 2.0 * r - 1.0)
        assert planner.leaves.size == 0
    assert compared(leaf_values) == 0


def test_rewards_that_differ_by_rounding_are_alike(chain: TransitionModel) -> None:
    _, _, leaf_values = believing(chain, right)
    tell(leaf_values, walks(100), lambda r: float(np.float32(r + 1e-10)))
    assert leaf_values.proven


# Where values come from and go -------------------------------------------------------------------


def test_what_no_longer_holds_is_taken_away_and_given_again(chain: TransitionModel) -> None:
    planner, _, leaf_values = believing(chain, right)
    tell(leaf_values, walks(100))
    assert planner.leaves.size > 0
    tell(leaf_values, [step for k in range(100) for step in walk(k % 19, -10.0)])
    assert not leaf_values.proven
    assert planner.leaves.size == 0
    tell(leaf_values, walks(400))
    assert leaf_values.proven
    assert planner.leaves.size > 0


class World:
    """The chain as a learner walks it: mostly to the right, so that it sees much of both ways."""

    def __init__(self, made: Scene, seed: int = 0) -> None:
        self.made = made
        self.random = np.random.default_rng(seed)

    def episode(self) -> None:
        x, steps = float(self.random.integers(0, GOAL)), 0
        while True:
            steps += 1
            action = int(self.random.random() < 0.8)
            next_x = max(0.0, x + (1.0 if action else -1.0))
            terminated, truncated = next_x >= GOAL, steps >= 40
            reward = 10.0 if terminated else 0.0
            state, following = np.array([x]), np.array([next_x])
            self.made.leaf_values.observe(
                step_record(
                    state=state, next_state=following, reward=reward, terminated=terminated,
                    truncated=truncated,
                )
            )  # fmt: skip
            dqn = self.made.learner
            dqn.remember(state, action, reward, following, terminated, truncated)
            dqn.learn()
            if terminated or truncated:
                return
            x = next_x


def living(model: TransitionModel) -> World:
    return World(scene(model))


def test_a_learner_that_learns_is_believed_and_shows_the_planner_the_way(
    chain: TransitionModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("serp.control.leaf_value_bootstrap._PERIOD", 100)
    world = living(chain)
    far = np.array([6.0])
    before = world.made.planner.forecast(far)
    assert (before.indifferent, before.choice) == (True, 0)
    for _ in range(100):
        world.episode()
    assert world.made.leaf_values.proven
    after = world.made.planner.forecast(far)
    assert (after.indifferent, after.choice) == (False, 1)
    assert (world.made.planner.forecast(np.array([18.0])).value == [0.0, 9.9]).all()  # it sees that


def test_nothing_is_learned_from_a_learner_that_has_not_learned(
    chain: TransitionModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("serp.control.leaf_value_bootstrap._PERIOD", 10)
    world = living(chain)
    for _ in range(2):
        world.episode()
    assert world.made.learner.updates == 0
    assert world.made.leaf_values.state_dict()[0]["packed"].size == 0


@pytest.mark.parametrize("width", [1, 3])
def test_a_fit_is_to_the_states_at_the_end_of_what_the_learner_sees(
    chain: TransitionModel, monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    monkeypatch.setattr("serp.control.leaf_value_bootstrap._PERIOD", 60)
    monkeypatch.setattr("serp.control.leaf_value_bootstrap._SAMPLES", 25)
    made = scene(chain, learner(width))
    random = np.random.default_rng(0)
    for _ in range(59):
        x, next_x = random.standard_normal((2, width))
        made.learner.remember(x, 0, 1.0, next_x, False, False)
    made.learner.pretrain(3)
    tell(made.leaf_values, [Step(0.0, 1.0, 1.0)] * 59)
    assert made.leaf_values.state_dict()[0]["packed"].size == 0
    inputs, values = made.learner.newest_values(25)
    expected = LeafValue(1, np.random.SeedSequence(4))
    expected.fit(inputs[:, -1:].astype(np.float64), values)
    tell(made.leaf_values, [Step(0.0, 1.0, 1.0)])
    assert made.leaf_values.state_dict()[0]["packed"].tobytes() == expected.packed.tobytes()


def test_a_domain_without_fluents_is_no_reason_to_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("serp.control.leaf_value_bootstrap._PERIOD", 5)
    model = load_texts(
        Texts(
            "(define (domain bare) (:functions (reward))"
            " (:action a :parameters () :precondition (and) :effect (and (increase (reward) 1)))"
            " (:action b :parameters () :precondition (and) :effect (and (increase (reward) 1))))",
            None,
        )
    ).model
    made = scene(model, learner(2))
    for _ in range(12):
        made.learner.remember(np.zeros(2), 0, 1.0, np.zeros(2), False, False)
        made.learner.pretrain(1)
        made.leaf_values.observe(step_record(state=np.zeros(0), reward=1.0))
    assert made.leaf_values.state_dict()[0]["packed"].size > 0


def test_a_learner_that_looks_no_step_ahead_sees_nothing_beyond(
    chain: TransitionModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("serp.control.leaf_value_bootstrap._PERIOD", 50)
    world = World(scene(chain, learner(discount=0.0)))
    for _ in range(20):
        world.episode()
    assert world.made.learner.updates > 0
    assert world.made.leaf_values.state_dict()[0]["packed"].size == 0
    # Values that it is given are judged by a step each.
    _, _, leaf_values = believing(chain, right, dqn=learner(discount=0.0))
    tell(leaf_values, walk(0)[:7])
    assert compared(leaf_values) == 7


# State -------------------------------------------------------------------------------------------


def test_what_is_saved_is_not_changed_by_what_comes(chain: TransitionModel) -> None:
    _, _, leaf_values = believing(chain, right)
    tell(leaf_values, walks(20))
    arrays, meta = leaf_values.state_dict()
    before = [array.tobytes() for array in arrays.values()], dict(meta)
    tell(leaf_values, walks(20, seed=1))
    assert ([array.tobytes() for array in arrays.values()], meta) == before


def test_a_state_that_does_not_fit_is_refused(chain: TransitionModel) -> None:
    _, _, leaf_values = believing(chain, right)
    arrays, meta = leaf_values.state_dict()
    wider = LeafValue(2, np.random.SeedSequence(0))
    wider.fit(np.zeros((3, 2)), np.arange(3.0))
    for wrong, told in (
        ({"packed": wider.packed}, {}),
        ({"means": np.zeros(3)}, {}),
        ({}, {"steps": None}),
        ({}, {"compared": "many"}),
    ):
        with pytest.raises(RunError, match="leaf values cannot be restored"):
            scene(chain).leaf_values.load_state_dict({**arrays, **wrong}, {**meta, **told})
    for name in arrays:
        with pytest.raises(RunError, match=name):
            scene(chain).leaf_values.load_state_dict(
                {k: a for k, a in arrays.items() if k != name}, meta
            )
    for name in meta:
        with pytest.raises(RunError, match=name):
            scene(chain).leaf_values.load_state_dict(
                arrays, {k: v for k, v in meta.items() if k != name}
            )
