"""The files of `serp new` work at once, whatever the environment calls its things."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from click.testing import CliRunner
from gymnasium import spaces

from serp.authoring.play import Game
from serp.authoring.scaffold import describe, new_task
from serp.errors import TaskError
from serp.model.domain import load_domain
from serp.tasks.registry import custom_task
from serp.tasks.spaces import Observations
from serp.ui.root import serp

OWN = '''
import gymnasium
from gymnasium import spaces


class Robot(gymnasium.Env):
    """A robot.

    ## Action Space

    * 0: go "left"\\"); import os  # evil
    * 1: object

    ## Observation Space
    """

    observation_space = spaces.Dict({
        "arm": spaces.Dict({
            "pose": spaces.Box(-1, 1, (1, 2)), "g\\"r'i\\np${name}": spaces.Discrete(3),
        }),
        "lamps": spaces.MultiBinary(1),
        "mode": spaces.Tuple([spaces.MultiDiscrete([2]), spaces.Box(0, 9, ())]),
    })
    action_space = spaces.Discrete(2, start=-1)
    steps = 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.steps = 0
        self.observation_space.seed(seed)
        return self.observation_space.sample(), {}

    def step(self, action):
        self.steps += 1
        return self.observation_space.sample(), float(action), self.steps > 4, False, {}
'''


@pytest.mark.parametrize(
    ("env", "actions", "numbers"),
    [
        ("CartPole-v1", "push-cart-to-the-left", "pole-angular-velocity"),
        ("Acrobot-v1", "apply-minus-1-torque-to-the-actuated", "cosine-of-theta1"),
        ("Taxi-v4", "pickup-passenger", "observation"),
        ("Blackjack-v1", "hit", "observation-2"),
    ],
)
def test_what_an_environment_documents_names_actions_and_fluents(folder, env, actions, numbers):
    name = f"new-{env.partition('-')[0].lower()}"
    new_task(Path(name), env)
    with custom_task(f"{name}.py").bind() as bound:
        assert actions in [action.name for action in bound.model.actions]
        state = bound.ground(bound.reset(seed=0)[0])
        assert numbers in bound.model.values(state)
        assert bound.rewarded_by == "environment"
        bound.step(0)
    assert load_domain(f"{name}.pddl").model.actions


@pytest.mark.parametrize(
    ("space", "value", "says"),
    [
        ("action_space", spaces.Box(-1, 1), r"Box.*serp_envs\.MacroActions"),
        ("observation_space", spaces.Tuple([spaces.Box(0, 1, (50,))] * 2), r"more than 64 numbers"),
        (
            "observation_space",
            spaces.Dict({"seen": spaces.Sequence(spaces.Discrete(3)), "to": spaces.Box(0, 1)}),
            r"`seen` .*FilterObservation\(env, \['to'",
        ),
    ],
)
def test_spaces_without_names_for_all_are_refused(space, value, says):
    env = gym.make("CartPole-v1").unwrapped
    setattr(env, space, value)
    with pytest.raises(TaskError, match=says):
        describe(env, "env")


def test_texts_and_pictures_are_no_fluents():
    env = gym.make("CartPole-v1").unwrapped
    parts = {"at": spaces.Discrete(4), "said": spaces.Text(9), "image": spaces.Box(0, 1, (9, 9, 3))}
    env.observation_space = spaces.Dict(parts)
    _, numbers, _ = describe(env, "env")
    assert [entry.name for entry in numbers] == ["at", "seen"]
    assert numbers[1].comment == "compute it from observation['image']"
    flat = Observations(env.observation_space)
    read = flat.read({"at": 1, "said": "hello", "image": np.ones((9, 9, 3), np.float32)})
    assert flat.size == len(read) == 4 + 243 and flat.name(3) == "at = 3"


def test_an_environment_of_ones_own_fits_at_once(folder):
    Path("own_robot.py").write_text(OWN)
    shown = CliRunner().invoke(serp, ["new", "my-own-robot", "--env", "own_robot.py:Robot"])
    assert shown.exit_code == 0, shown.output
    assert "serp plan-and-learn --task my-own-robot.py" in shown.output
    domain, adapter = Path("my-own-robot.pddl").read_text(), Path("my-own-robot.py").read_text()
    assert "(:action go-left  ; go left ); import os # evil\n" in domain
    assert "(:action the-object  ; object\n" in domain and "(arm-g-ri-p-name)" in domain
    assert "import os" not in adapter
    checked = CliRunner().invoke(serp, ["check", "my-own-robot.pddl", "--task", "my-own-robot.py"])
    assert "fit together" in checked.output
    assert "1 passed" in CliRunner().invoke(serp, ["test", "my-own-robot.pddl"]).output
    with custom_task("my-own-robot.py").bind() as bound:
        assert bound.time_limited
        assert len(bound.ground(bound.reset(seed=1)[0])) == 6
        assert bound.step(0)[1] == -1.0 and bound.step(1)[1] == 0.0


def test_nothing_is_overwritten_and_names_do_not_clash(folder):
    written = new_task(Path("rail"))
    assert [file.name for file in written] == ["rail.pddl", "rail-problem.pddl", "rail.scenarios"]
    assert "5 passed" in CliRunner().invoke(serp, ["test", "rail.pddl"]).output
    assert not load_domain("rail.pddl").warnings
    game = Game(load_domain("rail.pddl"))
    for name in ("charge", *["forward"] * 3, "pick-up", *["back"] * 3):
        played = game.step(game.model.action_index(name))
    assert game.moment.over and game.moment.total > 10
    assert all(cause.what != "unsafe" for cause in played.brought)
    text = written[0].read_text()
    Path("robot_arm.py").write_text(f"{OWN}\nclass Arm(Robot):\n    def __init__(self, n): ...\n")
    for name, env, said in (
        ("a", "robot_arm.py", "`--env robot_arm.py:Arm`, `--env robot_arm.py:Robot`"),
        ("a", "robot_arm:Robot", "`--env robot_arm.py:Robot`"),
        ("a", "robot_arm.py:Arm", "name a function without required arguments"),
        ("rail", None, "these files exist: .*rail.scenarios; .* such as rail-task"),
        ("Rail", None, "lower-case letters"),
        ("no/rail", None, "there is no folder no"),
        ("cartpole-two", None, "`cartpole` is an installed task"),
        ("json", "CartPole-v1", "a Python module has this name"),
        ("a", "CartPoole-v1", "FILE.py:CLASS"),
        ("a", "own_robt.py:Robot", "--env own_robt.py:Robot: there is no such file"),
    ):
        with pytest.raises(TaskError, match=said):
            new_task(Path(name), env)
    assert written[0].read_text() == text and not Path("a.pddl").exists()
