"""A task fits together, or says what does not; no mistake in one is a traceback."""

import dataclasses
import json
import sys
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from serp._util.files import json_text
from serp.errors import EnvironmentFailure, SettingsError, TaskError
from serp.model.domain import load_domain
from serp.pddl.source import DomainError
from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp.tasks.spaces import Observations, described, space_of
from tests.serp.sample_tasks import CORRIDOR, CableCut, Corridor, corridor
from tests.worlds import text


class Odd(Corridor):
    """An environment that returns what it is told to, and counts how often it was closed."""

    def __init__(self, *, step=None, reset=None, **attributes):
        super().__init__()
        self.answer, self.start = step, reset
        self.closed = []
        self.stuck = False
        for name, value in attributes.items():
            setattr(self, name, value)

    def step(self, action):
        return super().step(action) if self.answer is None else self.answer

    def reset(self, **options):
        return super().reset(**options) if self.start is None else self.start

    def close(self):
        self.closed.append("closed")
        if self.stuck:
            raise RuntimeError("the cable is stuck")


def odd(folder, **attributes):
    return corridor(folder, lambda: Odd(**attributes)).bind()


SEEN = np.array([0.0, 0.0])

DOORS = text("doors")
DOORS_PROBLEM = """(define (problem p) (:domain doors)
  (:init (locked west) (= (limit) 9) {}))"""

# A task that fits --------------------------------------------------------------------------------


@pytest.mark.parametrize("stated", ["", "(open west)", "(open west) (= (x) 0)"])
def test_what_the_grounding_gives_is_no_constant_though_init_states_it(tmp_path, stated):
    file = tmp_path / "doors.pddl"
    file.write_text(DOORS)
    (tmp_path / "doors-problem.pddl").write_text(DOORS_PROBLEM.format(stated))
    ground = {"x": 0.0, "open west": False, "open east": False}
    for domain in (file, str(file), load_domain(file)):
        task = dataclasses.replace(
            corridor(tmp_path),
            domain=domain,
            ground=lambda seen: ground,
            actions={"left": 0, "right": 1, "wait": 2},
            name="doors",
            reward="environment",
        )
        bound = task.bind()
        assert [f.name for f in bound.model.fluents] == ["open west", "open east", "x"]
        assert bound.model.ground.static == {"locked west": 1.0, "limit": 9.0}
        shut, opened = (bound.model.state(ground | {"open west": seen}) for seen in (False, True))
        assert [bound.model.step(state, "wait").unsafe for state in (shut, opened)] == [False, True]


# What does not fit -------------------------------------------------------------------------------


class Half(gym.Env[Any, Any]):
    action_space = spaces.Discrete(3)


def unplugged():
    raise OSError("no robot on /dev/ttyUSB0")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"dt": float("nan")}, "control period.*a number > 0, not "),
        ({"ground": {"x": 0}}, "ground must be a function of an observation, not {'x': 0}"),
        ({"actions": {"left": 0, "right": 1}}, "no environment action for `wait`"),
        ({"domain": "nowhere.pddl"}, r"nowhere\.pddl"),
        ({"make_env": "CartPole-v1"}, "make_env must be a function.*not 'CartPole-v1'"),
        ({"make_env": unplugged}, r"corridor.*OSError: no robot on /dev/ttyUSB0"),
        ({"make_env": Half}, "observations of None cannot be flattened"),
        (
            {"make_env": lambda: Odd(action_space=spaces.Box(0, 1))},
            "discrete actions.*MacroActions",
        ),
        ({"ground": lambda seen: {}}, "the grounding does not fit .*: no value for fluent `x`"),
        ({"ground": lambda seen: {"x": 0.0, "y": 1.0}}, "does not fit .*: unknown fluent `y`"),
        ({"ground": lambda seen: np.zeros(0)}, "a state .* 1 number .* found 0: none for `x`"),
        ({"ground": lambda seen, infos: {}}, r"ground\(seen, infos\) cannot be called: .*`infos?`"),
        ({"ground": lambda seen, info: info["place"]}, r"failed on .*KeyError: 'place'"),
    ],
)
def test_what_does_not_fit_is_named(tmp_path, changes, said):
    kind = DomainError if "domain" in changes else TaskError
    with pytest.raises(kind, match=said):
        corridor(tmp_path, **changes).bind()


def test_a_bound_task_closes_its_environment_and_hides_no_error(tmp_path):
    closed = []
    with odd(tmp_path, closed=closed):
        assert closed == []
    assert closed == ["closed"]
    stuck = corridor(tmp_path, lambda: Odd(stuck=True))
    with pytest.raises(ZeroDivisionError), stuck.bind():
        raise ZeroDivisionError
    with pytest.raises(EnvironmentFailure, match="cable is stuck"), stuck.bind():
        pass


# Groundings that are wrong ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ground", "said"),
    [
        (lambda seen: {"x": float("nan")}, "`x` must be a finite number, not nan"),
        (lambda seen: np.array(["3.5"]), "a state must consist of numbers"),
        (lambda seen: [[1.0], [2.0, 3.0]], "a state must consist of numbers"),
        (lambda seen: [][3], "the grounding failed on .*IndexError"),
    ],
)
def test_a_grounding_that_is_wrong_is_a_task_error(tmp_path, ground, said):
    with pytest.raises(TaskError, match=f"task corridor.*{said}"):
        corridor(tmp_path, ground=ground).bind().ground(SEEN)


# Environments that are wrong ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ((SEEN, np.nan, False, False, {}), "the reward is nan, not a finite number"),
        ((SEEN, "1.5", False, False, {}), "the reward is '1.5' .str., not one number"),
        ((SEEN, 0.0, None, False, {}), "terminated is None .NoneType., not True or False"),
        ((SEEN, 0.0, False, False, None), "info is None .NoneType., not a dictionary"),
        ((SEEN, 0.0, False, False, {"unsafe": "maybe"}), "info..unsafe.. is 'maybe' .str., not"),
        ((SEEN, 0.0, False, {}), "it returned 4 values, not the five values .observation, reward"),
    ],
)
def test_an_answer_of_another_kind_is_named_with_what_is_wanted(tmp_path, answer, said):
    bound = odd(tmp_path, step=answer)
    with pytest.raises(TaskError, match=f"task corridor: step with action right failed: {said}"):
        bound.step(1)


def test_an_answer_that_a_wrapper_cannot_unpack_is_named_with_what_is_wanted(tmp_path):
    limited = gym.wrappers.TimeLimit(Odd(step=(SEEN, 0.0, False, {})), 9)
    (bound := corridor(tmp_path, lambda: limited).bind()).reset()
    with pytest.raises(EnvironmentFailure, match="it must return observation, reward"):
        bound.step(1)


def test_observations_are_flattened_and_what_is_wrong_is_named_by_its_place(tmp_path):
    space = spaces.Dict(
        at=spaces.Box(-1, 1, (2, 2)), go=spaces.Tuple((spaces.Discrete(2), spaces.Box(0, 1, ())))
    )
    bound = odd(tmp_path, observation_space=space)
    assert bound.observation_size == 7
    good = {"at": np.zeros((2, 2)), "go": (1, 0.5)}
    assert bound.observation(good).tolist() == [0, 0, 0, 0, 0, 1, 0.5]
    for part, said in (
        ({"at": [[0, 0], [np.inf, 0]]}, r"entry \[1, 0\] of `at` is inf"),
        ({"go": (1, np.nan)}, "the number of `go.1` is nan"),
        ({"go": (1, "0.5")}, r"`go.1` is '0.5' \(str\); expected real numbers"),
        ({"go": (2, 0.5)}, r"`go.0` is 2 \(int\); expected a member of Discrete\(2\)"),
        ({"go": (1,)}, r"`go` is \(1,\) \(tuple\); expected Tuple"),
    ):
        with pytest.raises(EnvironmentFailure, match=said):
            bound.observation({**good, **part})


def test_a_space_is_described_in_json_and_its_vector_names_every_number():
    space = spaces.Dict(
        b=spaces.Tuple((spaces.Discrete(2, start=3), spaces.Box(0, 255, (1, 2), np.uint8))),
        a=spaces.MultiDiscrete([[2, 3]], start=[[0, 7]]),
        c=spaces.MultiBinary(2),
        d=spaces.Box(0, 1, (1,), bool),
    )
    rebuilt = space_of(json.loads(json_text(described(space))), spaces.flatdim(space))
    raw = {"a": np.array([[1, 9]]), "b": (4, np.array([[5, 6]])), "c": np.array([1, 0])} | {
        "d": [1]
    }
    vector, observations = Observations(space).read(raw), Observations(rebuilt)
    assert str(spaces.unflatten(rebuilt, vector)) == str(spaces.unflatten(space, vector))
    assert [observations.name(k) for k in vector.nonzero()[0]] == [
        *("b.0 = 4", "entry [0, 0] of `b.1`", "entry [0, 1] of `b.1`"),
        *("a[0, 0] = 1", "a[0, 1] = 9", "entry 0 of `c`", "entry 0 of `d`"),
    ]
    with_text = space_of(described(spaces.Dict(said=spaces.Text(9), at=spaces.Discrete(2))), 2)
    assert Observations(with_text).read({"said": "hello", "at": 1}).tolist() == [0, 1]
    huge = {"Box": {"shape": [10**6, 10**6], "dtype": "<f8"}}
    for forged in (huge, {"MultiBinary": {"n": 10**12}}, {"Space": {}}, {"flatten": {}}):
        with pytest.raises(ValueError, match="entries|there is no space"):
            space_of(forged, 5)


def test_spaces_that_change_and_observations_that_are_none_are_named(tmp_path):
    bound = corridor(tmp_path).bind()
    with pytest.raises(EnvironmentFailure, match="task corridor: the observation: None .NoneType"):
        bound.observation(None)
    bound.env.action_space = spaces.Discrete(7)
    with pytest.raises(EnvironmentFailure, match=r"reset failed.*action_space.* now is Discrete.7"):
        bound.reset()


def test_an_environment_that_raises_is_named_with_action_and_reason(tmp_path):
    bound = corridor(tmp_path, lambda: CableCut(Corridor(), at=2)).bind()
    bound.reset(seed=0)
    bound.step(0)
    with pytest.raises(EnvironmentFailure, match=r"action dance|action 3.*cable cut") as caught:
        bound.step(3)
    assert isinstance(caught.value.__cause__, ConnectionError)

    class Exits(Corridor):  # as some that draw do, when their window is closed
        def step(self, action):
            sys.exit(3)

    with pytest.raises(EnvironmentFailure, match="step with action left failed: SystemExit: 3"):
        corridor(tmp_path, Exits).bind().step(0)


def test_what_an_environment_writes_into_its_buffers_later_changes_nothing(tmp_path):
    buffer, info = np.zeros(2), {"game": 1}
    bound = odd(tmp_path, step=(buffer, 0.0, False, False, info), reset=({"seen": buffer}, info))
    (reset, first), (seen, *_, second) = bound.reset(), bound.step(0)
    buffer[:], info["game"] = 7.0, 2
    assert not seen.any() and not reset["seen"].any()
    assert first["game"] == second["game"] == 1


class Located(Corridor):
    """Says in its info where the robot is."""

    def info(self):
        return {"x": self.x}


def of_both(seen, *, env, info):
    assert env.x == info["x"] == seen[0]
    return {"x": info["x"]}


def test_a_grounding_of_info_or_of_the_environment_trains_as_one_of_the_observation(tmp_path):
    """Also where an episode ends and the next begins: no info is used a step too late."""
    weights = []
    for ground in (
        lambda seen: {"x": seen[0]},
        lambda seen, info: {"x": info["x"]},
        lambda seen, env: [env.unwrapped.x],
        of_both,
    ):
        task = corridor(tmp_path, Located, ground=ground)
        trainer = Trainer(task.bind(), resolve("default", task.settings), 3)
        rows = [next(trainer.run()) for _ in range(4)]
        weights.append((trainer.agent.learner.state_dict()[0], [row.return_ for row in rows]))
    (expected, returns), *others = weights
    for arrays, others_returns in others:
        assert others_returns == returns
        assert all(np.array_equal(arrays[name], expected[name]) for name in expected)


class Valves(gym.ActionWrapper[Any, Any, Any]):
    """The corridor with the four actions as combinations of two numbers."""

    def __init__(self, space):
        super().__init__(Corridor())
        self.action_space = space

    def action(self, action):
        assert self.action_space.contains(action)
        first, second = np.ravel(action - getattr(self.action_space, "start", 0)).tolist()
        return int(2 * first + second)


SPACES = [
    spaces.MultiDiscrete([2, 2]),
    spaces.MultiDiscrete([[2], [2]], start=[[3], [-1]]),
    spaces.MultiBinary(2),
]


def walk(folder, make_env, **changes):
    """Return what 60 steps in the corridor return."""
    seen = []
    with corridor(folder, make_env, **changes).bind() as bound:
        assert bound.actions.size == 4
        bound.reset(seed=1)
        for action in np.random.default_rng(0).integers(4, size=60).tolist():
            raw, *rest, _ = bound.step(action)
            seen.append((raw.tolist(), *rest))
            if rest[1] or rest[2]:
                bound.reset()
    return seen


@pytest.mark.parametrize("make", [lambda: Corridor(10), *(lambda s=s: Valves(s) for s in SPACES)])
def test_actions_are_counted_from_zero_in_every_space(tmp_path, make):
    assert walk(tmp_path, make) == walk(tmp_path, Corridor)


@pytest.mark.parametrize("space", SPACES)
def test_a_combination_is_named_by_its_tuple_or_number(tmp_path, space):
    named = {"left": (0, 1), "right": [1, 0], "wait": np.int64(3)}
    bound = corridor(tmp_path, lambda: Valves(space), actions=named).bind()
    assert bound.actions.environment_action == [1, 2, 3]
    for wrong in ((0, 2), (0,), (-1, 0), (0.5, 1), "01", None):
        with pytest.raises(
            TaskError, match=r"corridor.*actions: `left` is mapped to .*(at most|0 to) "
        ):
            corridor(tmp_path, lambda: Valves(space), actions=named | {"left": wrong}).bind()


BONUS = 100.0
LEARNED = [("environment", "task"), ("environment", "domain"), ("environment", "sum"),
           ("domain", "task"), ("domain", "environment"), ("domain", "sum")]  # fmt: skip


def task_with_bonus(folder, declared):
    """The corridor, whose file gives 100 for waiting; its environment gives nothing for it."""
    begin = CORRIDOR.index("(:action wait")
    text = CORRIDOR[:begin] + CORRIDOR[begin:].replace(
        "(decrease (reward) 0.1)", f"(increase (reward) {BONUS:g})", 1
    )
    file = folder / "corridor.pddl"
    file.write_text(text)
    return corridor(folder, domain=file, reward=declared)


@pytest.mark.parametrize(("declared", "learned"), LEARNED)
def test_the_experts_reward_is_remembered_where_it_is_learned_from(tmp_path, declared, learned):
    task = task_with_bonus(tmp_path, declared)
    asked = {"training": {"reward": learned}, "learner": {"n_step": 1}}
    trainer = Trainer(task.bind(), resolve("default", task.settings, asked), 3)
    rows = [next(trainer.run()) for _ in range(3)]
    arrays, _ = trainer.agent.learner.replay.state_dict()
    remembered = arrays["reward"]
    assert len(remembered) == trainer.env_steps
    source = declared if learned == "task" else learned
    by_environment, by_domain = (
        sum(row.return_ for row in rows), sum(row.domain_return or 0.0 for row in rows)
    )  # fmt: skip
    assert by_domain > BONUS  # the planner goes by it whatever the learner learns from
    expected = {
        "environment": by_environment,
        "domain": by_domain,
        "sum": by_environment + by_domain,
    }
    assert sum(remembered) == pytest.approx(expected[source], rel=1e-5)
    assert (max(remembered) > 0.9 * BONUS) == (source != "environment")


def test_rewards_that_the_file_does_not_give_cannot_be_learned_from(tmp_path):
    text = CORRIDOR.replace("(decrease (reward) 0.1)", "").replace("(decrease (reward) 5)", "")
    file = tmp_path / "silent.pddl"
    file.write_text(text.replace("(increase (reward) 5)", ""))
    task = corridor(tmp_path, domain=file)
    for learned in ("domain", "sum"):
        settings = resolve("default", task.settings, {"training": {"reward": learned}})
        with pytest.raises(SettingsError, match=f"reward is {learned}, but the domain of task"):
            Trainer(task.bind(), settings, 0)
    with pytest.raises(SettingsError, match="'environment' or 'sum', not 'both'"):
        resolve("default", task.settings, {"training": {"reward": "both"}})
