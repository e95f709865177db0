"""An exported policy: a folder that `serp` runs on a robot, without the task's environment.

It is a run folder with the domain file, the configuration and the agent's checkpoint, without what
the training alone needs. What people and programs read of the policy is in its configuration. The
same agent decides as in the training: one model, one planner, one veto.
"""

from __future__ import annotations

import contextlib
import copy
import itertools
import json
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from serp._util.files import json_text, read_regular, write_together
from serp._util.saved_state import Saved
from serp.agent.agent import Agent
from serp.agent.decision import Decision
from serp.errors import RunError, SerpError
from serp.learning.dqn import DQN
from serp.learning.onnx_export import network_as_onnx
from serp.runs.checkpoint import CHECKPOINT, as_bytes
from serp.runs.evaluation import play
from serp.runs.folder import make_empty, refuse_occupied
from serp.runs.run import Run, digests, load_run
from serp.runs.run_config import CONFIG
from serp.tasks.environment import BoundTask
from serp.tasks.file_world import WorldOptions
from serp.tasks.grounding import Grounding
from serp.tasks.spaces import described, space_of
from serp.tasks.task import Task

NETWORK: Final = "learner.onnx"
"""The network for other programs; written where onnx is installed (extra `export`)."""
_STEPS, _PAIRS = 1_000, 32  # of an episode that is played before; those recorded of them

State = ArrayLike | Mapping[str, float | bool]


def export_policy(run: Run | str | Path, folder: str | Path) -> Path:
    """Export the trained policy of a run, the policy `serp` of `Run.evaluate`.

    An episode is played first: the planner does what is due, and pairs of observation and state are
    recorded, with which a grounding can be checked.

    Args:
        run: The run, or its folder.
        folder: The new folder; it must not exist, or be empty.

    Returns:
        The folder.

    Raises:
        RunError: The folder is not empty, or planner or learner is a part of the task.
        SerpError: The run or its task cannot be loaded, or the environment failed.
    """
    folder = Path(folder)
    run = run if isinstance(run, Run) else load_run(run)
    refuse_occupied(folder)
    agent = run.agent
    for kind, own in (("planner", run.task.planners), ("learner", run.task.learners)):
        if (name := getattr(agent.settings, kind).name) in own:
            raise RunError(
                f"the run's {kind} `{name}` belongs to its task and cannot be exported; train "
                f"with an installed {kind} (see `serp list`)"
            )
    with run.environment() as task:
        arrays, meta = _state(agent, task)
    fluents = [(fluent.name, fluent.numeric) for fluent in task.model.fluents]
    about = {
        "choice": f"{agent.strategy.choice}, within the vetoes",
        "fluents": [{"name": name, "kind": "number" if n else "0 or 1"} for name, n in fluents],
        "observation_space": described(task.observations.space),
        "observation": [task.observations.name(k) for k in range(task.observation_size)],
        "actions": [task.actions.name(action) for action in range(task.actions.size)],
        "ground_actions": task.actions.groups,
    }
    files = {file.name: read_regular(file) for file in run.copies()}
    config = json_text({**run.metadata, "config": {**run.config, "policy": about}})
    whole = {
        "agent": meta,
        "env_steps": run.env_steps,
        "environments": run.checkpoint.meta["environments"],
        "made_of": digests(json.loads(config)["config"], files),
    }
    files |= {CONFIG: config.encode(), CHECKPOINT: as_bytes(arrays, whole)}
    if type(agent.learner) is DQN and find_spec("onnx") is not None:
        files[NETWORK] = network_as_onnx(agent.learner.learning.online)
    make_empty(folder)
    write_together({folder / name: content for name, content in files.items()})
    return folder


def _state(agent: Agent, task: BoundTask) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return the agent without its replay memory, and pairs of a played episode."""
    arrays, meta = agent.state_dict()
    pairs = []
    # What playing does to the agent is undone at the end.
    with contextlib.closing(play(agent, task, episodes=1)) as episodes:
        for step in itertools.islice(next(episodes), _STEPS):
            pairs.append((task.observation(step.observation), step.state.copy()))
    empty, fresh = Agent(task, agent.settings, 0).state_dict()
    replay = "learner.replay."
    arrays = {name: array for name, array in arrays.items() if not name.startswith(replay)}
    arrays |= {name: array for name, array in empty.items() if name.startswith(replay)}
    if "replay" in meta["learner"]:
        meta["learner"]["replay"] = fresh["learner"]["replay"]
    kept = np.linspace(0, len(pairs) - 1, min(_PAIRS, len(pairs))).astype(int)
    for k, name in enumerate(("observation", "state")):
        arrays[f"grounding.{name}"] = np.array([pairs[place][k] for place in kept])
    return arrays, meta


class Policy:
    """A policy that `serp export` wrote.

    Args:
        folder: The exported folder.
        ground: A function from an observation, as the environment gives it, to its state: a mapping
            from the names in `fluents`, or numbers in their order. It is compared with the recorded
            pairs of observation and state. Without it, `decide` needs the state.

    Attributes:
        about: What the folder says of the policy: `policy` in the `config` of its `config.json`.
        fluents: Names of the numbers in a state, in order.
        actions: `[E]` names of the environment's actions.
        agent: Planner, learner and arbiter, as trained.

    Raises:
        RunError: The folder is not one that `serp export` wrote, or it was changed; or see
            `check_grounding`.
    """

    def __init__(self, folder: str | Path, ground: Callable[[Any], State] | None = None) -> None:
        run = Run(Path(folder))
        self._ground = ground
        try:
            self.about: dict[str, Any] = run.config["policy"]
            self.agent = Run(run.path, _task(run, self.about)).agent
            task, saved = self.agent.task, Saved("policy", *run.checkpoint)
            self.fluents = [fluent.name for fluent in task.model.fluents]
            self.actions = [task.actions.name(k) for k in range(task.actions.size)]
            width, size = len(self.fluents), task.observation_size
            observations = saved.array("grounding.observation", np.float64, (-1, size))
            states = saved.array("grounding.state", np.float64, (len(observations), width))
            space = task.observations.space
            whole = size == gym.spaces.flatdim(space)  # without texts
            raw = [gym.spaces.unflatten(space, one) for one in observations if whole]
        except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
            raise RunError(
                f"{folder} is not what `serp export` wrote, or its files do not match ({error}); "
                "copy the whole folder again, or export the run again with `serp export`"
            ) from None
        except SerpError as error:
            raise RunError(f"{folder}: {error}") from None
        self._pairs = list(zip(raw, states, strict=False))
        if ground is not None:
            self.check_grounding(ground)
            self.agent.task = self._grounded_by(ground)
        self.begin_episode()

    def begin_episode(self) -> None:
        """Say that another episode begins, as after a reset of an environment."""
        self.agent.arbiter.begin_episode()

    def decide(self, observation: Any, *, state: State | None = None) -> Decision:
        """Decide as the trained policy does.

        Args:
            observation: As the environment gives it: a member of `observation_space` in `about`.
            state: A mapping from the names in `fluents`, or `[F]` in their order; without it,
                `ground` computes it.

        Raises:
            SerpError: One of them is missing, has another shape, or is not finite; or `ground`
                failed.
        """
        if state is None and self._ground is None:
            raise RunError("give `state=`, or make the policy with Policy(folder, ground=...)")
        agent, task = self.agent, self.agent.task
        if state is None:
            return agent.decide_greedily(*agent.perceive(observation))
        perceived = agent.take_in(task.observation(observation), task.state(state))
        return agent.decide_greedily(*perceived)

    def check_grounding(self, ground: Callable[[Any], State], tolerance: float = 1e-6) -> int:
        """Compare a grounding with recorded pairs of observation and state; return their number.

        `tolerance` is the largest difference of a number, absolute and relative. There are no pairs
        of observations with texts.

        Raises:
            SerpError: It gives another state (the message names the first fluent), or failed.
        """
        for observation, state in self._pairs:
            grounded = self._grounded_by(ground).ground(copy.deepcopy(observation))
            wrong = np.abs(grounded - state) > tolerance * np.maximum(1.0, np.abs(state))
            if wrong.any():
                k = int(wrong.argmax())
                raise RunError(
                    f"the grounding gives `{self.fluents[k]}` = {grounded[k]:g}, but the recorded "
                    f"state has {state[k]:g}, for the observation {observation}"
                )
        return len(self._pairs)

    def _grounded_by(self, ground: Callable[[Any], State]) -> BoundTask:
        task = copy.copy(self.agent.task)
        task.grounding = Grounding(ground)
        return task


def _task(run: Run, about: Mapping[str, Any]) -> Task:
    """Return the task of a policy, whose environment has spaces and nothing else."""
    made, model = run.made, run.model
    space = space_of(about["observation_space"], most=len(about["observation"]))
    groups = enumerate(about["ground_actions"])
    return Task(
        make_env=lambda: _spaces(space, len(about["actions"])),
        domain=run.domain,
        ground=lambda observation: np.zeros(len(model.fluents)),
        name=made.task,
        actions={model.actions[k].name: action for action, group in groups for k in group},
        dt=made.control_period,
        reward=made.reward,
        world=WorldOptions() if made.observed is None else None,
    )


def _spaces(observation: gym.Space[Any], actions: int) -> gym.Env[Any, Any]:
    """Return an environment that only says what observations and actions are."""
    env: gym.Env[Any, Any] = gym.Env()
    env.observation_space, env.action_space = observation, gym.spaces.Discrete(actions)
    return env
