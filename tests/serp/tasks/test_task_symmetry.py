"""A mirrored corridor: what a task declares is checked against its domain and what is observed."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from numpy.typing import NDArray

import serp
from serp.agent.agent import Agent
from serp.errors import TaskError
from serp.runs.evaluation import play
from serp.runs.trainer import Trainer
from serp.settings import Settings
from serp.tasks.symmetry import Symmetry, declared_symmetries, symmetry_group
from serp.tasks.task import Task
from tests.serp.runs.runs import without_pictures
from tests.serp.sample_tasks import SMALL

HALL = """(define (domain hall) (:types side) (:constants left right - side)
  (:predicates (wall ?s - side) (tired) (unsafe) (terminal))
  (:functions (x) (room ?s - side) (reward))
  (:action go :parameters (?s - side) :precondition (and (not (wall ?s)))
    :effect (and (decrease (room ?s) 1) (tired)))
  (:action west :parameters () :precondition (and) :effect (and (decrease (x) 1)))
  (:action east :parameters () :precondition (and) :effect (and (increase (x) 1)))
  (:action wait :parameters () :precondition (and) :effect (and (not (tired))))
  (:event arrived :parameters (?s - side) :precondition (and (< (room ?s) 0.5))
    :effect (and (increase (reward) 1) (terminal))))
"""

SIDES_NAMED = """(define (domain hall)
  (:predicates (wall-left) (wall-right) (tired) (unsafe) (terminal))
  (:functions (x) (room-left) (room-right) (reward))
  (:action go-left :parameters () :precondition (and (not (wall-left)))
    :effect (and (decrease (room-left) 1) (tired)))
  (:action go-right :parameters () :precondition (and (not (wall-right)))
    :effect (and (decrease (room-right) 1) (tired)))
  (:action west :parameters () :precondition (and) :effect (and (decrease (x) 1)))
  (:action east :parameters () :precondition (and) :effect (and (increase (x) 1)))
  (:action wait :parameters () :precondition (and) :effect (and (not (tired))))
  (:event arrived-left :parameters () :precondition (and (< (room-left) 0.5))
    :effect (and (increase (reward) 1) (terminal)))
  (:event arrived-right :parameters () :precondition (and (< (room-right) 0.5))
    :effect (and (increase (reward) 1) (terminal))))
"""
"""The hall without objects."""


class Hall(gym.Env[Any, Any]):
    """A walk between two walls. Seen: x, room on the left, room on the right."""

    observation_space: spaces.Space[Any] = spaces.Box(-9, 9, (3,), np.float32)
    action_space = spaces.Discrete(5)  # type: ignore[assignment]

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.x = float(self.np_random.uniform(-2, 2))
        self.steps = 0
        return self.seen(), {}

    def step(self, action: Any) -> Any:
        self.steps += 1
        self.x += (-1.0, 1.0, -1.0, 1.0, 0.0)[int(action)] + float(self.np_random.normal()) / 9
        ended = abs(self.x) > 2.5
        return self.seen(), float(ended), ended, self.steps > 9, {}

    def seen(self) -> Any:
        return np.array([self.x, 3 + self.x, 3 - self.x], np.float32)


class Told(Hall):
    """The same in a dictionary."""

    observation_space = spaces.Dict(
        {"rooms": spaces.Box(-9, 9, (2,), np.float64), "x": spaces.Box(-9, 9, (1,), np.float64)}
    )

    def seen(self) -> Any:
        return {"rooms": np.array([3 + self.x, 3 - self.x]), "x": np.array([self.x])}


def ground(seen: NDArray[Any]) -> dict[str, float]:
    return {
        "wall left": seen[1] < 1, "wall right": seen[2] < 1, "tired": False,
        "x": seen[0], "room left": seen[1], "room right": seen[2],
    }  # fmt: skip


BOTH_SIDES = Symmetry(
    objects={"left": "right"},
    flip=("x",),
    actions={"west": "east"},
    observation_signs=(-1, 1, 1),
    observation_order=(0, 2, 1),
)
ACTIONS = {"go left": 0, "go right": 1, "west": 2, "east": 3, "wait": 4}


@pytest.fixture
def hall(tmp_path: Path) -> Callable[..., Task]:
    def make(text: str = HALL, **changes: Any) -> Task:
        file = tmp_path / "hall.pddl"
        file.write_text(text, encoding="utf-8")
        fields: dict[str, Any] = {
            "make_env": Hall, "domain": file, "ground": ground, "actions": ACTIONS,
            "symmetries": (BOTH_SIDES,),
        }  # fmt: skip
        return Task(**{**fields, **changes})

    return make


def settings(**training: Any) -> Settings:
    chosen = Settings().replace({**SMALL, "training": {**SMALL["training"], **training}})
    return chosen.replace({"learner": {"symmetry": True}})


def train(task: Task, chosen: Settings, episodes: int = 12) -> Trainer:
    with task.bind() as bound:
        trainer = Trainer(bound, chosen, seed=4)
        for _ in range(episodes):
            trainer.run_episode()
    return trainer


# --- what is right -------------------------------------------------------------------------------


@pytest.mark.parametrize("inputs", ["observation", "state", "both"])
def test_the_learner_sees_mirror_images_alike(hall: Callable[..., Task], inputs: str) -> None:
    trainer = train(hall(), settings(inputs=inputs))
    agent = trainer.agent
    ((declared,), _) = declared_symmetries(agent.task)
    seen = np.array([0.5, 3.5, 2.5], np.float32)
    mirrored = np.array([-0.5, 2.5, 3.5], np.float32)
    assert declared.columns is not None
    np.testing.assert_array_equal(seen[list(declared.columns)] * declared.signs, mirrored)
    _, x = agent.perceive(seen)
    _, image = agent.perceive(mirrored)
    q = agent.learner.q_values(x)
    assert np.ptp(q) > 0.0
    np.testing.assert_allclose(agent.learner.q_values(image), q[[1, 0, 3, 2, 4]], atol=1e-6)


def test_sides_of_different_names_are_one_as_sides_that_are_objects_are(
    hall: Callable[..., Task],
) -> None:
    def of_sides(seen: NDArray[Any]) -> dict[str, float]:
        return {name.replace(" ", "-"): value for name, value in ground(seen).items()}

    named = replace(
        BOTH_SIDES,
        objects={},
        fluents={"wall-left": "wall-right", "room-left": "room-right"},
        actions={"west": "east", "go-left": "go-right"},
    )
    numbers = {name.replace(" ", "-"): number for name, number in ACTIONS.items()}
    plain = {"text": SIDES_NAMED, "ground": of_sides, "actions": numbers}
    with hall().bind() as bound:
        ((expected,), _) = declared_symmetries(bound)
    with hall(**plain, symmetries=(named,)).bind() as bound:
        ((found,), _) = declared_symmetries(bound)
        assert (found.model, found.actions) == (expected.model, expected.actions)
    for fluents, said in {
        "room-left wall-right": "function `room-left` and predicate `wall-right`",
        "room-left room-rihgt": "no fluent .* called `room-rihgt`; did you mean `room-right`",
        "wall-left wall-right": "the domain contradicts it: after",
    }.items():
        wrong = replace(named, fluents=dict([fluents.split()]))
        with hall(**plain, symmetries=(wrong,)).bind() as bound:
            assert re.search(said, declared_symmetries(bound)[1][0])


def test_a_dictionary_is_mirrored_in_the_order_of_its_space(hall: Callable[..., Task]) -> None:
    def of_dict(seen: dict[str, NDArray[Any]]) -> dict[str, float]:
        return ground(np.concatenate((seen["x"], seen["rooms"])))

    symmetry = replace(BOTH_SIDES, observation_signs=(1, 1, -1), observation_order=(1, 0, 2))
    task = hall(make_env=Told, ground=of_dict, symmetries=(symmetry,))
    assert train(task, settings()).agent.learner.symmetry is not None
    with pytest.raises(TaskError, match="an observation was mirrored"):
        train(replace(task, symmetries=(BOTH_SIDES,)), settings())


def test_actions_that_the_domain_does_not_mention_go_by_number(hall: Callable[..., Task]) -> None:
    class Dancing(Hall):
        action_space = spaces.Discrete(7)  # type: ignore[assignment]

    task = hall(make_env=Dancing)
    with task.bind() as bound:
        found, (left_out,) = declared_symmetries(bound)
        assert found == ()
        assert re.search("does not mention .* action 5; say", left_out)
    named = replace(BOTH_SIDES, actions={"west": "east", 5: 6})
    with replace(task, symmetries=(named,)).bind() as bound:
        assert declared_symmetries(bound)[0][0].actions == (1, 0, 3, 2, 4, 6, 5)


def test_a_chain_is_closed(hall: Callable[..., Task]) -> None:
    whole = replace(
        BOTH_SIDES,
        objects={"left": "right", "right": "left"},
        actions={"west": "east", "east": "west"},
    )
    with hall(symmetries=(BOTH_SIDES, whole)).bind() as bound:
        (short, long), _ = declared_symmetries(bound)
        assert (short.model, short.actions) == (long.model, long.actions)
        group = symmetry_group(bound, [s.element("both") for s in (short, long)])
        assert group is not None
        assert len(group) == 2


# --- what is wrong -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"objects": {"left": "right", "right": "right"}}, "two things become `right`"),
        ({"objects": ["left", "right"]}, "expected a mapping"),
        ({"flip": ("wall left",)}, "is true or false and has no sign"),
        ({"flip": "x"}, "flip must be names of fluents"),
        ({"actions": {"west": 3}}, "both by name, or both by number"),
        ({"actions": {"west": "east", 4: 4}}, "call action 4 `wait`"),
        ({"actions": {"west": "east", 9: 9}}, "has no action 9"),
        ({"observation_order": (0, 1, 1)}, "each of the 3 places once"),
        ({"observation_signs": (1, 2, 1)}, "3 times 1 or -1"),
        ({"observation_signs": 1}, "3 times 1 or -1"),
    ],
)
def test_a_wrong_declaration_is_refused(
    hall: Callable[..., Task], changes: dict[str, Any], said: str
) -> None:
    with hall(symmetries=(replace(BOTH_SIDES, **changes),)).bind() as bound:
        with pytest.raises(TaskError, match=said) as caught:
            Agent(bound, settings(), 0)
        assert "task hall: symmetry 1" in str(caught.value)
        assert "learner.symmetry" in str(caught.value)
        Agent(bound, settings().replace({"learner": {"symmetry": False}}), 0)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"objects": {"left": "rigth"}}, "about an object `rigth`; did you mean `right`"),
        ({"flip": ("y",)}, "unknown fluent `y`"),
        ({"flip": ("x", "room left")}, "the domain contradicts it"),
        ({"flip": ()}, "the domain contradicts it: after `(east|west)`"),
        ({"actions": {}}, "after `west` the mirror image of `west` has `x`"),
        ({"actions": {"west": "wait"}}, "the domain contradicts it"),
        ({"actions": {"west": "north"}}, "unknown action `north`"),
    ],
)
def test_what_the_domain_file_does_not_have_is_left_out_and_said(
    hall: Callable[..., Task], changes: dict[str, Any], said: str
) -> None:
    with hall(symmetries=(replace(BOTH_SIDES, **changes),)).bind() as bound:
        agent = Agent(bound, settings(), 0)
        (notice,) = agent.notices
        assert re.search(rf"^The symmetry .* is not used: .*{said}", notice)
        plain = Agent(bound, settings().replace({"learner": {"symmetry": False}}), 0)
        x = np.linspace(-1, 1, agent.learner.input_size)
        np.testing.assert_array_equal(agent.learner.q_values(x), plain.learner.q_values(x))


def test_something_else_than_symmetries_is_refused(hall: Callable[..., Task]) -> None:
    for wrong in (BOTH_SIDES, ({"left": "right"},)):
        with hall(symmetries=wrong).bind() as bound, pytest.raises(TaskError, match=r"serp\.Symm"):
            Agent(bound, settings(), 0)


@pytest.mark.parametrize(
    ("wrong", "fluent"),
    [
        ({"objects": {}}, "room left"),
        ({"observation_signs": (1, 1, 1)}, "x"),
        ({"observation_order": (0, 1, 2)}, "room left"),
    ],
)
def test_what_is_observed_refuses_a_wrong_mirror(
    hall: Callable[..., Task], wrong: dict[str, Any], fluent: str
) -> None:
    task = hall(symmetries=(replace(BOTH_SIDES, **wrong),))
    with pytest.raises(TaskError, match=f"its grounding has `{fluent}` .* where the mirrored"):
        train(task, settings(), episodes=1)


@without_pictures()
def test_a_run_in_use_is_not_asked_for_its_symmetries(
    hall: Callable[..., Task], tmp_path: Path
) -> None:
    """They are checked in training: a worn sensor must not stop the robot."""
    chosen = {"learner": {**SMALL["learner"], "symmetry": True}}
    trained = serp.plan_and_learn(
        hall(), settings={**SMALL, **chosen}, episodes=2, out=tmp_path / "run", quiet=True
    )
    worn = hall(ground=lambda seen: {**ground(seen), "room left": seen[1] + 0.5})
    with pytest.raises(TaskError, match="the mirrored state has"):
        train(worn, settings(), episodes=1)
    run = serp.load_run(trained.path, worn)
    assert run.decide(np.array([0.2, 3.1, 2.7], np.float32)).action in range(5)
    assert run.evaluate(episodes=2).lengths
    with run.environment() as task:
        assert [step for episode in play(run.agent, task, episodes=1) for step in episode.steps]
