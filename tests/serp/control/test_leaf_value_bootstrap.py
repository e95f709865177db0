"""The learner's values at the leaves of the lookahead: used while they explain what was received.

A chain of places, walked from left to right; what a place is worth is known.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

from serp.control.leaf_value_bootstrap import LeafValueBootstrap
from serp.errors import RunError
from serp.learning.dqn import DQN
from serp.model.transition_model import Vector
from serp.planning.leaf_value import LeafValue
from serp.planning.lookahead import Lookahead
from serp.settings import LearnerSettings, PlannerSettings
from tests.serp.control.records import step_record
from tests.serp.planning.worlds import load

CHAIN = load(
    """
    (define (domain chain)
      (:predicates (unsafe) (terminal))
      (:functions (x) (reward))
      (:action left :parameters () :precondition (and) :effect (and (decrease (x) 1)))
      (:action right :parameters () :precondition (and) :effect (and (increase (x) 1)))
      (:event goal :parameters () :precondition (and (>= (x) 20))
        :effect (and (terminal) (increase (reward) 10))))
    """
)
GOAL = 20
DISCOUNT = 0.9
WINDOW = 29
"""Steps after which what follows weighs less than a twentieth: 0.9 ** 29 = 0.047."""
EMPTY = {"steps": 0, "others": 0, "compared": 0}
MODULE = "serp.control.leaf_value_bootstrap"


class Scene(NamedTuple):
    planner: Lookahead
    learner: DQN
    leaf_values: LeafValueBootstrap

    @property
    def packed(self) -> Vector:
        return self.leaf_values.state_dict()[0]["packed"]

    @property
    def compared(self) -> int:
        return int(self.leaf_values.state_dict()[1]["compared"])


def scene(inputs: int = 1, model: Any = CHAIN, discount: float = DISCOUNT) -> Scene:
    settings = LearnerSettings(
        hidden=(32,), batch_size=32, buffer_size=400, learning_starts=50, target_period=50,
        learning_rate=0.003, protected_share=0.0, discount=discount,
    )  # fmt: skip
    dqn = DQN(inputs, 2, settings, 0)
    planner = Lookahead(model, PlannerSettings(depth=2, leaf_value="indifferent"))
    return Scene(planner, dqn, LeafValueBootstrap(planner, dqn, np.random.SeedSequence(4)))


def believing(worth: Callable[[Vector], Vector], discount: float = DISCOUNT) -> Scene:
    """A scene with known leaf values; nothing replaces them, no learner learns."""
    made, places = scene(discount=discount), np.arange(float(GOAL))
    value = LeafValue(1, np.random.SeedSequence(1))
    value.fit(places[:, np.newaxis], worth(places))
    arrays = {"packed": value.packed, "means": np.zeros(4)}
    made.leaf_values.load_state_dict(arrays, EMPTY)
    return made


class Step(NamedTuple):
    x: float
    next_x: float
    reward: float
    terminated: bool = False
    truncated: bool = False


def tell(made: Scene, steps: list[Step], learned: Callable[[float], float] = float) -> None:
    for step in steps:
        made.leaf_values.observe(
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


def check(made: Scene, *, proven: bool) -> None:
    assert made.leaf_values.proven == proven
    assert made.planner.leaves.tobytes() == (made.packed.tobytes() if proven else b"")


# What is believed --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("worth", "least", "most"),
    [
        (right, 0.99, 1.0),
        (lambda places: right(places) + 100.0, 0.99, 1.0),  # only differences count
        (lambda places: -right(places), -4.0, -2.0),
        (lambda places: right(GOAL - 1 - places), -4.0, -0.1),
        (lambda places: 7.0 * np.cos(2.0 * places), -9.0, 0.4),
        (lambda places: np.full(len(places), 5.0), -0.01, 0.01),
    ],
    ids=["right", "shifted", "the opposite", "the wrong way round", "noise", "all the same"],
)
def test_values_are_believed_where_they_explain_what_is_received(
    worth: Callable[[Vector], Vector], least: float, most: float
) -> None:
    made = believing(worth)
    tell(made, walks(100))
    assert made.compared > 500
    assert least <= made.leaf_values.explained <= most
    check(made, proven=least > 0.5)


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
            if abs(rewards) < 1e150:  # its square is a number
                received.append(rewards)
                errors.append(rewards - predicted)
    return received, errors


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("no_number", [math.nan, -math.inf, 1e200])
def test_what_is_explained_is_a_share_of_the_variance(seed: int, no_number: float) -> None:
    """By the definition, whatever the values, the rewards, and the ends of episodes.

    An end counts also where time is up as well. What an episode that is cut off has begun, and
    rewards that are no numbers, are as if they had never been.
    """
    random = np.random.default_rng(seed)
    made = believing(lambda x: np.sin(x) + right(x) / 5)
    value = LeafValue(1, np.random.SeedSequence(0))
    value.restore(made.packed)
    episodes, steps = [], 0
    while steps < 450:  # up to 500 the mean that forgets is that of all
        length = int(random.choice([*range(1, 3 * WINDOW), *[1, WINDOW - 1, WINDOW] * 5]))
        end = random.random() < 0.5
        places = random.uniform(-3.0, 25.0, length + 1)
        good = random.random(length) < 0.99
        rewards = np.where(good, random.standard_normal(length), no_number)
        rows = [Step(*row) for row in zip(places[:-1], places[1:], rewards, strict=True)]
        rows[-1] = rows[-1]._replace(terminated=end, truncated=not end or length % 2 == 0)
        episodes.append(rows)
        steps += length
    # After so many steps it matters little that a reward that is no number is like no other one.
    made.leaf_values.load_state_dict(made.leaf_values.state_dict()[0], {**EMPTY, "steps": 10**6})
    for episode in episodes:
        tell(made, episode)
    received, errors = by_definition(episodes, value)
    assert made.compared == len(received) <= 500
    expected = 1.0 - np.var(errors) / np.var(received) if len(received) >= 200 else 0.0
    assert made.leaf_values.explained == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_a_few_comparisons_prove_nothing() -> None:
    made = believing(right)
    for _ in range(9):
        tell(made, walk(0))
        assert made.leaf_values.explained == 0.0
        check(made, proven=False)
    tell(made, walk(0))
    assert made.compared == 200
    check(made, proven=True)
    alike = believing(right)  # where nothing differs, nothing is explained
    tell(alike, [Step(19.0, 20.0, 10.0, True)] * 300)
    check(alike, proven=False)


def test_what_no_longer_holds_is_taken_away_and_given_again() -> None:
    made = believing(right)
    for steps, proven in (
        (walks(100), True),
        ([step for k in range(100) for step in walk(k % 19, -10.0)], False),
        (walks(400), True),
    ):
        tell(made, steps)
        check(made, proven=proven)


@pytest.mark.parametrize(("every", "believed"), [(200, True), (101, True), (50, False), (1, False)])
def test_values_of_other_rewards_are_not_believed(every: int, believed: bool) -> None:
    """In more than one step of a hundred the learner is told something else than the planner."""
    made = believing(right)
    tell(made, walks(40, seed=2), lambda r: float(np.float32(r + 1e-10)))  # alike, but for rounding
    check(made, proven=True)
    for number, step in enumerate(walks(200), 1):
        tell(made, [step], lambda r, n=number: r + (n % every == 0))
    check(made, proven=believed)


# Where values come from --------------------------------------------------------------------------


def live(made: Scene, episodes: int) -> None:
    """The chain as a learner walks it: mostly to the right, so that it sees much of both ways."""
    random = np.random.default_rng(0)
    for _ in range(episodes):
        x, steps, over = float(random.integers(0, GOAL)), 0, False
        while not over:
            steps += 1
            action = int(random.random() < 0.8)
            next_x = max(0.0, x + (1.0 if action else -1.0))
            terminated, truncated = next_x >= GOAL, steps >= 40
            reward = 10.0 if terminated else 0.0
            tell(made, [Step(x, next_x, reward, terminated, truncated)])
            state, following = np.array([x]), np.array([next_x])
            made.learner.remember(state, action, reward, following, terminated, truncated)
            made.learner.learn()
            x, over = next_x, terminated or truncated


def test_a_learner_that_learns_is_believed_and_shows_the_planner_the_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(f"{MODULE}._PERIOD", 100)
    made, far = scene(), np.array([6.0])
    before = made.planner.forecast(far)
    assert (before.indifferent, before.choice) == (True, 0)
    live(made, 2)
    assert made.learner.updates == made.packed.size == 0  # it has not learned yet
    live(made, 100)
    check(made, proven=True)
    after = made.planner.forecast(far)
    assert (after.indifferent, after.choice) == (False, 1)
    assert (made.planner.forecast(np.array([18.0])).value == [0.0, 9.9]).all()  # it sees that


def test_a_learner_that_looks_no_step_ahead_sees_nothing_beyond(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(f"{MODULE}._PERIOD", 50)
    made = scene(discount=0.0)
    live(made, 20)
    assert made.learner.updates > 0
    assert made.packed.size == 0
    given = believing(right, discount=0.0)  # values that it is given are judged by a step each
    tell(given, walk(0)[:7])
    assert given.compared == 7


@pytest.mark.parametrize("width", [1, 3])
@pytest.mark.parametrize(
    "model", [CHAIN, load("(define (domain bare) (:functions (reward)) (:action a) (:action b))")]
)
def test_a_fit_is_to_the_states_at_the_end_of_what_the_learner_sees(
    monkeypatch: pytest.MonkeyPatch, width: int, model: Any
) -> None:
    """A state without fluents is none of its inputs' numbers."""
    monkeypatch.setattr(f"{MODULE}._PERIOD", 60)
    monkeypatch.setattr(f"{MODULE}._SAMPLES", 25)
    made, fluents = scene(width, model), len(model.fluents)
    random = np.random.default_rng(0)
    for _ in range(59):
        x, next_x = random.standard_normal((2, width))
        made.learner.remember(x, 0, 1.0, next_x, False, False)
        made.leaf_values.observe(step_record(state=np.zeros(fluents), reward=1.0))
    made.learner.pretrain(3)
    assert made.packed.size == 0
    inputs, values = made.learner.newest_values(25)
    expected = LeafValue(fluents, np.random.SeedSequence(4))
    expected.fit(inputs[:, width - fluents :].astype(np.float64), values)
    made.leaf_values.observe(step_record(state=np.zeros(fluents), reward=1.0))
    assert made.packed.tobytes() == expected.packed.tobytes()


# State -------------------------------------------------------------------------------------------


def test_a_state_that_does_not_fit_is_refused() -> None:
    made = believing(right)
    tell(made, walks(20))
    arrays, meta = made.leaf_values.state_dict()
    before = arrays["means"].tobytes()
    tell(made, walks(20, seed=1))
    assert arrays["means"].tobytes() == before  # what is saved is not changed by what comes
    wider = LeafValue(2, np.random.SeedSequence(0))
    wider.fit(np.zeros((3, 2)), np.arange(3.0))
    for wrong, told in (
        ({"packed": wider.packed}, {}),
        ({"means": np.zeros(3)}, {}),
        ({}, {"steps": None}),
        ({}, {"compared": "many"}),
        ({}, {"others": 10**6}),
    ):
        with pytest.raises(RunError, match="leaf values cannot be restored"):
            scene().leaf_values.load_state_dict({**arrays, **wrong}, {**meta, **told})
