"""One trial: a run of one algorithm with one seed on one domain file, evaluated at fixed points.

The folder of a trial is a run folder. Beside the run it holds `evaluations.csv`, one row for each
episode in which the learner or the trained policy was evaluated.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import json
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, PositiveInt

from serp._util.files import read_regular, write_durably
from serp._util.numbers import real
from serp._util.plugins import blaming
from serp._util.processes import one_thread
from serp.agent.agent import Agent, account_of
from serp.agent.decision import Decision
from serp.agent.protocols import Learner, Mask
from serp.agent.step_record import OnStep, StepRecord
from serp.errors import Interrupted, RunError, TaskError
from serp.learning.dqn import Proposal
from serp.model.transition_model import Vector
from serp.runs.comparison.algorithms import Algorithm, ExternalAlgorithm
from serp.runs.evaluation import Policy, outcome_of, play
from serp.runs.folder import SUMMARY
from serp.runs.guarded_env import TaskEnv
from serp.runs.results import write_results
from serp.runs.rollout import Rollout, evaluation_seed, training_seed
from serp.runs.run import Run
from serp.runs.run_config import CONFIG, Budget
from serp.runs.run_log import Bookkeeping, RunLog
from serp.runs.tables import MetricsRow
from serp.runs.train import restore, train
from serp.runs.trainer import Callbacks, Trainer
from serp.settings import Settings
from serp.tasks.environment import BoundTask
from serp.tasks.spaces import single
from serp.tasks.task import Task

Columns = dict[str, NDArray[Any]]
"""Name of a column → its values, one entry per row."""

EVALUATIONS: Final = "evaluations.csv"
_SEED: Final = 99
"""Seed of the episodes of all evaluations, which are the same for all trials."""


class Trial(NamedTuple):
    """The key of a trial; the seed is that of everything random in its training."""

    algorithm: str
    seed: int

    def __str__(self) -> str:
        return f"{self.algorithm}, seed {self.seed}"


class TrialProtocol(BaseModel):
    """Budget and evaluations, the same for all trials of a comparison; see `serp.compare`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    env_steps: PositiveInt
    evaluate_every: PositiveInt
    evaluation_episodes: PositiveInt = 10
    final_episodes: PositiveInt = 50

    def points(self, env_steps: int) -> set[int]:
        """Return the numbers of env steps, up to this one, at which the learner is evaluated."""
        last = min(env_steps, self.env_steps)
        every = range(self.evaluate_every, last + 1, self.evaluate_every)
        return {*every, *([last] if last == self.env_steps else ())}


@dataclass(frozen=True)
class Job:
    """The specification of one trial: everything that its result depends on, and its folder.

    It is sent to other machines, so its task has the domain itself, not the name of a file.
    """

    algorithm: Algorithm
    seed: int
    task: Task
    settings: Settings
    protocol: TrialProtocol
    folder: Path

    @property
    def trial(self) -> Trial:
        """The key of the trial."""
        return Trial(self.algorithm.name, self.seed)

    @property
    def begun(self) -> bool:
        """Whether the folder holds a run."""
        return (self.folder / CONFIG).is_file()

    @property
    def complete(self) -> bool:
        """Whether the trial is complete: trained to its budget and evaluated there."""
        if not (self.folder / SUMMARY).is_file():
            return False
        return self.protocol.env_steps in read_evaluations(self.folder).get("env_steps", ())

    def refuse_changes(self) -> None:
        """Raise a RunError if the run in the folder has other settings or another domain file."""
        run = Run(self.folder)
        domain = self.task.load()
        copies = [read_regular(file) for file in run.copies()]
        settings = json.loads(json.dumps(self.settings.as_dict()))
        parts = {
            "settings": run.config["settings"] != settings,
            "seeds": run.made.seed != self.seed,
            "domain files": copies != [source.text.encode() for source in domain.sources],
        }
        if other := [what for what, differs in parts.items() if differs]:
            raise RunError(
                f"{self.folder}: the trial of {self.trial} was made with different {other[0]}. "
                "Compare in another folder (--out), or remove that trial."
            )


def file_name(name: str) -> str:
    """Return a unique file name for a name, valid on every file system."""
    longest = 100
    plain = re.sub(r"[^A-Za-z0-9_.=@-]", "_", name)
    if plain == name and len(name) <= longest and not plain.startswith("."):
        return plain
    return f"{plain[:longest]}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"


def run_trial(job: Job, stopped: Callable[[], bool] = lambda: False) -> None:
    """Train and evaluate into the job's folder, or go on with the run that is there.

    After every episode, `stopped` says whether to stop.

    Raises:
        Interrupted: It was stopped; a trial of serp's algorithms can be continued.
        SerpError: The training or an evaluation failed.
    """
    if job.begun:
        job.refuse_changes()
    with one_thread(), job.task.bind() as bound, job.task.bind() as arena:
        run = _train if job.algorithm.make_external is None else _train_external
        run(job, bound, arena, stopped)


def _train(job: Job, bound: BoundTask, arena: BoundTask, stopped: Callable[[], bool]) -> None:
    """Train one of serp's algorithms."""
    seed, settings, budget = job.seed, job.settings, Budget(env_steps=job.protocol.env_steps)
    baseline = job.algorithm.kind == "baseline"
    with Trainer(bound, settings, seed, baseline=baseline) as trainer:
        agent = trainer.agent
        evaluations = _Evaluations(job, agent, bound, arena)

        def after_step(step: StepRecord) -> None:
            if trainer.env_steps in evaluations.due:
                with trainer.paused():
                    evaluations.evaluate(trainer.env_steps)

        def after_episode(row: MetricsRow) -> None:
            if stopped():
                raise Interrupted(f"stopped after {trainer.env_steps} env steps", 0)

        if job.begun:
            run = Run(job.folder).lock()
        else:
            run = Run.begin(
                job.folder, bound, settings, preset=job.algorithm.preset, seed=seed, budget=budget,
                baseline=baseline,
            )  # fmt: skip
        with run:
            restore(run, trainer, budget)
            if job.protocol.points(trainer.env_steps) & evaluations.due:
                raise RunError(
                    f"{job.folder} ran without the evaluations of this comparison, or one of "
                    "them failed. Remove the folder to run the trial again."
                )
            callbacks = Callbacks(after_step, after_episode)
            (job.folder / SUMMARY).unlink(missing_ok=True)  # it says that the trial is complete
            train(run, trainer, budget, callbacks, quiet=True)


class _Spent(BaseException):
    """The budget is spent; no `Exception`, which an external algorithm might handle."""


class ExternalEnv(Bookkeeping, TaskEnv):
    """A task as a Gymnasium environment for a learner that trains itself.

    Episodes begin with the same seeds as in serp's training, whatever is given to `reset`. Nothing
    is refused; the agent forecasts steps to count unsafe ones. No more than `budget` steps are
    made; `on_step` is called with each.
    """

    def __init__(
        self, task: BoundTask, agent: Agent, seed: int, on_step: OnStep | None = None
    ) -> None:
        Bookkeeping.__init__(self)
        TaskEnv.__init__(self, task, agent)
        self.budget: int | None = None
        self._seed, self.on_step = seed, on_step

    def next_seed(self, seed: int | None) -> int:
        """Return the seed of the next episode of serp's training."""
        return training_seed(self._seed, self.episode)

    def decide(self, rollout: Rollout, action: int) -> Decision:
        """Execute the action, whatever it is."""
        if self.env_steps == self.budget:
            raise _Spent
        return self._agent.guarded.execute(rollout.state, Proposal(action, False))

    def action_masks(self, x: Vector | None = None) -> Mask:
        """Return `[E]` the actions that the file allows for an input, by default the current one.

        These are the applicable ones that it does not flag, and those that it does not know; all,
        if there are none. Nothing learned is in it.
        """
        state = self.running.state if x is None else x[self._task.observation_size :]
        forecast = self._agent.guarded.execute(state, Proposal(0, False)).forecast
        allowed: Mask = forecast.unflagged | (forecast.ground < 0)
        return allowed if allowed.any() else np.ones_like(allowed)

    def after_step(self, step: StepRecord) -> dict[str, Any]:
        """Count, write and report the step; the info is the task's."""
        self.record_step(step, self.episode + 1)
        if step.last:
            self.record_episode(step.episode, rho=1.0)
        if self.on_step is not None:
            self.on_step(step)
        return step.info


def make_external(
    algorithm: Algorithm, bound: BoundTask, settings: Settings, seed: int
) -> tuple[Agent, ExternalEnv, ExternalAlgorithm]:
    """Return an external algorithm, ready to be trained, with its agent and its environment."""
    assert algorithm.make_external is not None
    agent = Agent(bound, settings, seed)
    env = ExternalEnv(bound, agent, seed)
    with _blamed(algorithm.name), env.paused():
        return agent, env, algorithm.make_external(env, bound.name, seed)


def _blamed(name: str) -> contextlib.AbstractContextManager[None]:
    """Raise a RunError that names an external algorithm for any exception of it."""
    return blaming(f"`{name}` failed", RunError)


class _ExternalLearner(NamedTuple):
    """The greedy choice of an external algorithm, as that of a learner."""

    external: ExternalAlgorithm
    name: str
    actions: int
    env: ExternalEnv

    def propose_greedily(self, x: Vector) -> Proposal:
        """Propose the greedy action for one input `[F]`."""
        masked = getattr(self.external, "masked", False)
        masks = [self.env.action_masks(x)[np.newaxis]] if masked else []
        with _blamed(self.name):
            (action,) = self.external.act(x[np.newaxis].astype(np.float32), *masks)
            if action not in range(self.actions):
                raise ValueError(
                    f"act returned {action!r}; expected a whole number from 0 to {self.actions - 1}"
                )
            return Proposal(int(action), False)


def _train_external(
    job: Job, bound: BoundTask, arena: BoundTask, stopped: Callable[[], bool]
) -> None:
    """Let an external algorithm train itself, from the beginning: it has no checkpoints."""
    seed, settings, budget = job.seed, job.settings, job.protocol.env_steps
    agent, env, external = make_external(job.algorithm, bound, settings, seed)
    shutil.rmtree(job.folder, ignore_errors=True)
    learner = _ExternalLearner(external, job.algorithm.name, bound.actions.size, env)
    agent.learner = cast(Learner, learner)
    evaluations = _Evaluations(job, agent, bound, arena)
    run = Run.begin(
        job.folder, bound, settings, preset=job.algorithm.preset, seed=seed,
        budget=Budget(env_steps=budget), baseline=True,
    )  # fmt: skip
    env.log = log = RunLog(run.path, bound)
    env.budget = budget

    def after_step(step: StepRecord) -> None:
        made = env.env_steps
        if step.last and stopped():
            raise Interrupted(f"stopped after {made} env steps", 0)
        # At the budget it still learns from the last steps, and then ends.
        if made in evaluations.due and made < budget:
            with env.paused():
                evaluations.evaluate(made)

    env.on_step = after_step
    with run, log:
        with _blamed(job.algorithm.name), contextlib.suppress(_Spent):
            external.learn(budget)
        if (made := env.env_steps) < budget:
            raise RunError(f"`{job.algorithm.name}` ended after {made} of {budget} env steps")
        evaluations.evaluate(budget)
        log.flush()
        write_results(run, {}, account=account_of(agent))


class _Evaluations:
    """Evaluates a learner, always on the same episodes, and keeps the rows in the run folder.

    `due` are the numbers of env steps at which there is no evaluation yet.
    """

    def __init__(self, job: Job, agent: Agent, trained_in: BoundTask, arena: BoundTask) -> None:
        self._job, self._agent = job, agent
        self._trained_in, self._arena = trained_in, arena
        self._file = job.folder / EVALUATIONS
        self._text = self._file.read_text("utf-8") if self._file.is_file() else ""
        protocol, found = job.protocol, read_evaluations(job.folder)
        self.due = protocol.points(protocol.env_steps) - {*found.get("env_steps", ())}
        if job.algorithm.kind == "planner":
            self.due &= {protocol.env_steps}

    def evaluate(self, env_steps: int) -> None:
        """Evaluate after so many env steps with the running statistics of the training."""
        protocol, kind = self._job.protocol, self._job.algorithm.kind
        last = env_steps == protocol.env_steps
        policies: dict[str, Policy] = {} if kind == "planner" else {"learner": "learner"}
        if last and kind in ("guided", "planner"):
            policies["policy"] = "serp" if kind == "guided" else "planner"
        self._arena.restore_environment(self._trained_in.environment_state(), statistics_only=True)
        rows = [
            {"env_steps": env_steps, "policy": name, "episode": episode, **row}
            for name, policy in policies.items()
            for episode, row in enumerate(self._played(policy) if last else self._returns(), 1)
        ]
        table = io.StringIO()
        writer = csv.DictWriter(table, list(rows[0]), lineterminator="\n")
        if not self._text:
            writer.writeheader()
        writer.writerows(rows)
        self._text += table.getvalue()
        write_durably(self._file, self._text)
        self.due.discard(env_steps)

    def _returns(self) -> Iterator[dict[str, Any]]:
        """Play episodes of the learner without a forecast, which would take most of the time."""
        arena, agent = self._arena, self._agent
        for episode in range(self._job.protocol.evaluation_episodes):
            return_, length, over, terminated = 0.0, 0, False, False
            raw, info = arena.reset(seed=evaluation_seed(_SEED, episode))
            while not over:
                _, x = agent.perceive(raw, info, arena.env)
                action = agent.learner.propose_greedily(x).action
                raw, reward, terminated, truncated, info = arena.step(action)
                return_, length = return_ + reward, length + 1
                limit = length >= agent.settings.training.episode_steps
                over = terminated or truncated or limit
            yield self._row(return_, length, terminated, "", "", info)

    def _played(self, policy: Policy) -> Iterator[dict[str, Any]]:
        """Play episodes of a policy at the end of training, whose unsafe steps are counted."""
        count = self._job.protocol.final_episodes
        for steps in play(self._agent, self._arena, policy, episodes=count, seed=_SEED):
            *_, last = steps
            totals = last.episode
            unsafe = totals.decisions.unsafe_executed, totals.unsafe_observed
            yield self._row(totals.return_, totals.length, totals.terminated, *unsafe, last.info)

    def _row(
        self, return_: float, length: int, terminated: bool, unsafe: Any, seen: Any, info: Any
    ) -> dict[str, Any]:
        return {
            "return": return_,
            "length": length,
            "terminated": int(terminated),
            "outcome": outcome_of(info),
            "unsafe": unsafe,
            "unsafe_observed": seen,
            **{f"info.{name}": _counted(info, name) for name in self._arena.task.counters},
        }


def _counted(info: dict[str, Any], name: str) -> float:
    counter = single(info.get(name, 0))
    value = real(int(counter) if isinstance(counter, bool) else counter)
    if value is None:
        raise TaskError(
            f"the task counts `{name}`, but the environment's info[{name!r}] is {info[name]!r}; "
            "expected a finite number"
        )
    return float(value)


def read_evaluations(folder: Path) -> Columns:
    """Return the evaluations of a trial: numbers, NaN for an empty cell, and texts."""
    file = folder / EVALUATIONS
    if not file.is_file():
        return {}
    texts, needed = ("policy", "outcome"), {"env_steps", "policy", "return"}
    try:
        rows = list(csv.DictReader(io.StringIO(read_regular(file).decode())))
        if rows and (missing := needed - rows[0].keys()):
            raise ValueError(f"it has no column {missing.pop()}")
        return {
            name: np.array(
                [row[name] if name in texts else float(row[name] or "nan") for row in rows],
                dtype=np.str_ if name in texts else np.float64,
            )
            for name in (rows[0] if rows else ())
        }
    except (ValueError, TypeError, KeyError, csv.Error) as error:
        raise RunError(
            f"{file} is damaged: {error}. Remove the folder of this trial to run it again."
        ) from None


@dataclass(frozen=True)
class Record:
    """The record of a complete trial.

    Attributes:
        episodes: The columns of `metrics.csv` of the episodes that ended within the budget.
        evaluations: The columns of `evaluations.csv`, with `info.<name>` for each counter of the
            environment's info that the task declares (`Task.counters`).
        versions: Package → version of what ran the trial.
        reward: What its learner learned from, in words.
    """

    trial: Trial
    episodes: Columns
    evaluations: Columns
    versions: dict[str, str | None]
    reward: str = ""


def read_trial(job: Job) -> Record:
    """Return a complete trial; a RunError if a file is damaged, or evaluations are missing."""
    run, protocol = Run(job.folder), job.protocol
    metrics = run.metrics
    within = metrics["env_steps"] <= protocol.env_steps
    evaluations = read_evaluations(job.folder)
    made = {*evaluations["env_steps"][evaluations["policy"] == "learner"].tolist()}
    if made != (set() if job.algorithm.kind == "planner" else protocol.points(protocol.env_steps)):
        raise RunError(
            f"{job.folder / EVALUATIONS} lacks the evaluations of this comparison. Remove the "
            "folder of this trial to run it again."
        )
    return Record(
        job.trial,
        {name: column[within] for name, column in metrics.items()},
        evaluations,
        run.metadata["versions"],
        run.learned_reward,
    )
