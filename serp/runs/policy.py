"""An exported policy: a folder that `serp` runs on a robot, without the task's environment.

The folder holds the domain file, the agent's checkpoint, and a manifest that people and programs
read. The same agent decides as in the training: one model, one planner, one veto.
"""

from __future__ import annotations

import contextlib
import hashlib
import itertools
from collections.abc import Callable, Generator, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, cast

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from serp import __version__
from serp._util.files import cannot_write, json_text, read_json, read_regular, write_together
from serp._util.saved_state import Saved
from serp.agent.agent import Agent
from serp.agent.decision import Decision
from serp.errors import RunError, SerpError
from serp.learning.dqn import DQN
from serp.model.domain import load_domain
from serp.runs import checkpoint
from serp.runs.evaluation import Episode, play
from serp.runs.run import Run, load_run
from serp.settings import Settings
from serp.tasks.environment import BoundTask
from serp.tasks.file_world import WorldOptions
from serp.tasks.task import Task

FORMAT: Final = 4
MANIFEST, DOMAIN, PROBLEM = "manifest.json", "domain.pddl", "problem.pddl"
AGENT: Final = "agent.safetensors"
NETWORK: Final = "learner.onnx"
"""The network for other programs; written where onnx is installed (extra `export`)."""
FILES: Final = {AGENT, DOMAIN, PROBLEM, NETWORK}
_STEPS, _PAIRS = 1_000, 32
"""Steps of an episode that is played before the export, and pairs recorded of them."""
_AGAIN: Final = "copy the whole folder again, or export the run again with `serp export`"

Grounding = Callable[[NDArray[np.float64]], "ArrayLike | Mapping[str, float]"]


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
        RunError: The folder is not empty, or the planner is a function of the task.
        SerpError: The run or its task cannot be loaded, or the environment failed.
    """
    folder = Path(folder)
    run = run if isinstance(run, Run) else load_run(run)
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir())):
        raise RunError(f"{folder} exists and is not empty; give the name of a new folder")
    agent = run.agent
    planner = agent.settings.planner.name
    if planner in run.task.planners:
        raise RunError(
            f"the run's planner `{planner}` is a part of its task and cannot be exported; train "
            "with an installed planner, such as planner.name=far-sight"
        )
    with run.environment() as task:
        arrays, meta = _state(agent, task)
        about = _about(agent, task)
        domain = task.domain
    files: dict[str, bytes] = {
        AGENT: checkpoint.encoded(arrays, meta),
        DOMAIN: domain.source.text.encode(),
    }
    if type(agent.learner) is DQN and find_spec("onnx") is not None:
        files[NETWORK] = agent.learner.as_onnx()
    if domain.problem_source is not None:
        files[PROBLEM] = domain.problem_source.text.encode()
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    manifest = json_text({"format": FORMAT, "serp": __version__, **about, "files": digests})
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error, "Nothing was made.") from error
    contents: dict[str, bytes | str] = {**files, MANIFEST: manifest}
    write_together({folder / name: content for name, content in contents.items()})
    return folder


def _state(agent: Agent, task: BoundTask) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return the agent without its replay memory, and pairs of a played episode."""
    arrays, meta = agent.state_dict()
    pairs = []
    played = cast("Generator[Episode]", play(agent, task, episodes=1))
    with contextlib.closing(played) as episodes:  # what it does to the agent is then undone
        for step in itertools.islice(next(episodes).steps, _STEPS):
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


def _about(agent: Agent, task: BoundTask) -> dict[str, Any]:
    """Return what people and programs read of a policy."""
    return {
        "task": task.name,
        "policy": f"{agent.strategy.choice}, within the vetoes",
        "control_period": task.model.dt,
        "closed": task.task.closed,
        "supplied": sorted(task.domain.supplied or ()),
        "max_ground_schemas": task.domain.max_ground_schemas,
        "fluents": [
            {"name": fluent.name, "kind": "number" if fluent.numeric else "0 or 1"}
            for fluent in task.model.fluents
        ],
        "observation": [task.observations.name(k) for k in range(task.observation_size)],
        "actions": [task.actions.name(action) for action in range(task.actions.size)],
        "ground_actions": task.actions.groups,
        "reward": task.rewarded_by,
        "settings": agent.settings.as_dict(),
    }


class Policy:
    """A policy that `serp export` wrote.

    Args:
        folder: The exported folder.
        ground: A function from an observation `[O]` to its state: numbers in the order of
            `fluents`, or a mapping from their names. Without it, `decide` needs the state.

    Attributes:
        manifest: What the folder says of the policy, see its `manifest.json`.
        fluents: Names of the numbers in a state, in order.
        actions: `[E]` names of the environment's actions.
        agent: Planner, learner and arbiter, as trained.

    Raises:
        RunError: The folder is not one that `serp export` wrote, or it was changed.
    """

    def __init__(self, folder: str | Path, ground: Grounding | None = None) -> None:
        folder = Path(folder)
        files, self.manifest = _read(folder)
        self._ground = ground
        try:
            task = _task(folder, self.manifest)
            arrays, meta = checkpoint.decoded(folder / AGENT, files[AGENT])
            settings = Settings.from_dict(self.manifest["settings"])
            with contextlib.closing(task.bind()) as bound:
                self.fluents = [fluent.name for fluent in bound.model.fluents]
                self.actions = [bound.actions.name(k) for k in range(bound.actions.size)]
                if self.fluents != [each["name"] for each in self.manifest["fluents"]]:
                    raise RunError(f"the fluents are not those of its {MANIFEST}; {_AGAIN}")
                saved = Saved("policy", arrays, meta)
                self.agent = Agent(bound, settings, 0)
                self.agent.load_state_dict(arrays, meta)
            width, size = len(self.fluents), len(self.manifest["observation"])
            observations = saved.array("grounding.observation", np.float64, (-1, size))
            states = saved.array("grounding.state", np.float64, (len(observations), width))
        except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
            raise RunError(f"{folder} does not fit together ({error}); {_AGAIN}") from None
        except SerpError as error:
            raise RunError(f"{folder}: {error}") from None
        self._pairs = list(zip(observations, states, strict=True))
        self._observation_size = size
        self.begin_episode()

    def begin_episode(self) -> None:
        """Say that another episode begins, as after a reset of an environment."""
        self.agent.arbiter.begin_episode()

    def decide(self, observation: ArrayLike, *, state: ArrayLike | None = None) -> Decision:
        """Decide as the trained policy does.

        Args:
            observation: `[O]`, flat.
            state: `[F]` in the order of `fluents`; without it, `ground` computes it.

        Raises:
            RunError: One of them is missing, has another shape, or is not finite.
        """
        seen = _vector(observation, self._observation_size, "an observation")
        if state is None:
            if self._ground is None:
                raise RunError("give `state=`, or an observation and Policy(folder, ground=...)")
            state = self._grounded(self._ground, seen)
        return self.agent.decide_greedily(
            *self.agent.take_in(seen, _vector(state, len(self.fluents), "a state"))
        )

    def check_grounding(self, ground: Grounding, tolerance: float = 1e-6) -> int:
        """Compare a grounding with recorded pairs of observation and state; return their number.

        Args:
            ground: As in `Policy`.
            tolerance: Largest difference of a number, absolute and relative.

        Raises:
            RunError: It gives another state; the message names the first fluent.
        """
        for observation, state in self._pairs:
            grounded = self._grounded(ground, observation.copy())
            wrong = np.abs(grounded - state) > tolerance * np.maximum(1.0, np.abs(state))
            if wrong.any():
                k = int(wrong.argmax())
                raise RunError(
                    f"the grounding gives `{self.fluents[k]}` = {grounded[k]:g}, and the recorded "
                    f"state has {state[k]:g}, for the observation {observation.tolist()}"
                )
        return len(self._pairs)

    def _grounded(self, ground: Grounding, observation: NDArray[np.float64]) -> NDArray[np.float64]:
        found = ground(observation)
        if isinstance(found, Mapping):
            if set(found) != set(self.fluents):
                odd = sorted(set(found) ^ set(self.fluents))
                raise RunError(f"the grounding and the policy differ in the fluent `{odd[0]}`")
            found = [found[name] for name in self.fluents]
        return _vector(found, len(self.fluents), "the grounding")


def _vector(given: ArrayLike, size: int, what: str) -> NDArray[np.float64]:
    try:
        vector = np.array(given, np.float64)
    except (TypeError, ValueError):
        vector = np.full(0, np.nan)
    if vector.shape != (size,) or not np.isfinite(vector).all():
        raise RunError(f"{what} must be {size} finite numbers, not {given!r}")
    return vector


def _read(folder: Path) -> tuple[dict[str, bytes], dict[str, Any]]:
    """Return the files of a folder, checked by their digests, and its manifest."""
    if not folder.is_dir():
        raise RunError(f"{folder} is not a folder; give the one that `serp export` wrote")
    manifest = read_json(folder / MANIFEST, _AGAIN)
    if manifest.get("format") != FORMAT:
        raise RunError(
            f"{folder / MANIFEST} has format {manifest.get('format')!r}, and this version of serp "
            f"reads format {FORMAT}; export the run again with `serp export`"
        )
    digests = manifest.get("files")
    if not isinstance(digests, dict) or not {AGENT, DOMAIN} <= set(digests) <= FILES:
        raise RunError(f"{folder / MANIFEST} does not list the folder's files; {_AGAIN}")
    files = {}
    for name, digest in digests.items():
        try:
            files[name] = read_regular(folder / name)
        except OSError as error:
            raise RunError(f"cannot read {folder / name}: {error.strerror}; {_AGAIN}") from None
        if hashlib.sha256(files[name]).hexdigest() != digest:
            raise RunError(f"{folder / name} was changed since it was exported; {_AGAIN}")
    return files, manifest


def _task(folder: Path, manifest: Mapping[str, Any]) -> Task:
    """Return the task of a policy, whose environment has spaces and nothing else."""
    closed, problem = manifest["closed"], folder / PROBLEM
    domain = load_domain(
        folder / DOMAIN,
        problem if PROBLEM in manifest["files"] else None,
        observed=not closed,
        max_ground_schemas=manifest["max_ground_schemas"],
    )
    if not closed:
        domain = domain.observed(manifest["supplied"])
    model, size = domain.model, len(manifest["observation"])
    groups = enumerate(manifest["ground_actions"])
    return Task(
        make_env=lambda: _Spaces(size, len(manifest["actions"])),
        domain=domain,
        ground=lambda observation: np.zeros(len(model.fluents)),
        name=manifest["task"],
        actions={model.actions[k].name: action for action, group in groups for k in group},
        dt=manifest["control_period"],
        reward=manifest["reward"],
        world=WorldOptions() if closed else None,
    )


class _Spaces(gym.Env[Any, Any]):
    """An environment that only says what observations and actions are."""

    def __init__(self, observation: int, actions: int) -> None:
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (observation,), np.float64)
        self.action_space = gym.spaces.Discrete(actions)
