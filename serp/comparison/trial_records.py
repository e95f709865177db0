"""The record of a trial: one algorithm with one seed on one domain file (a *variant*)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from numpy.typing import NDArray

Columns = dict[str, NDArray[Any]]
"""Name of a column → its values, one entry per row."""


class Trial(NamedTuple):
    """The key of a trial; the seed is that of everything random in its training."""

    algorithm: str
    variant: str
    seed: int

    def __str__(self) -> str:
        return f"{self.algorithm} on {self.variant}, seed {self.seed}"


class EpisodeRow(NamedTuple):
    """One episode of training.

    Attributes:
        episode: Number of the episode, from 1.
        env_steps: Env steps from the beginning of the trial to the end of the episode.
        return_: The environment's return.
        learner_return: Return in the reward that is learned from.
        length: Env steps.
        terminated: Whether the environment ended it (a fall, a goal; not a time limit).
        outcome: The entry `outcome` of the environment's info; empty if there is none.
        unsafe: Executed actions that the domain file flags unsafe.
        avoidable_unsafe: Those of them that were executed while another action was not flagged.
        unsafe_observed: Steps that came out unsafe, foreseen or not; None, and NaN where it is
            read, in trials of earlier versions.
        vetoes: Refused proposals.
        planner_steps: Steps in which the planner's action was executed.
        seconds: Seconds of training so far, without compilation and evaluations.
    """

    episode: int
    env_steps: int
    return_: float
    learner_return: float
    length: int
    terminated: bool
    outcome: str
    unsafe: int
    avoidable_unsafe: int
    unsafe_observed: int | None
    vetoes: int
    planner_steps: int
    seconds: float


class EvaluationRow(NamedTuple):
    """One episode of an evaluation; columns not described here are as in `EpisodeRow`.

    Attributes:
        env_steps: Env steps of training before it.
        policy: `learner`: the greedy choice without planner and veto, evaluated at each checkpoint.
            `vetoed`: the same within the vetoes, and `planner`: only the planner; both are
            evaluated only at the end of training.
        unsafe: Executed actions that the model predicts unsafe; 0 for `learner` at checkpoints
            before the last, which do not use the model.
        unsafe_observed: As in `EpisodeRow`; at those checkpoints without the actions' own effects.
    """

    env_steps: int
    policy: str
    episode: int
    return_: float
    length: int
    terminated: bool
    outcome: str
    unsafe: int
    unsafe_observed: int | None


EPISODE_COLUMNS: Final = tuple(name.removesuffix("_") for name in EpisodeRow._fields)
EVALUATION_COLUMNS: Final = tuple(name.removesuffix("_") for name in EvaluationRow._fields)
ADDED: Final = ("unsafe_observed",)
"""Columns of both that files of earlier versions lack."""


@dataclass(frozen=True)
class Record:
    """The record of a complete trial.

    Attributes:
        trial: The trial.
        episodes: Columns `EPISODE_COLUMNS`, and one `info.<name>` for each counter of the
            environment's info that the task declares (`Task.counters`): its value at the end of
            the episode.
        evaluations: Columns `EVALUATION_COLUMNS`.
        metadata: JSON values: `characteristics` (name → text: those of the algorithm), `settings`
            (section → setting → value; null for an external algorithm), `seconds` ({"training": …,
            "evaluation": …}), `lead` (who leads after training, see `Measured`), `made_of`
            (digests, see `PreparedComparison.made_of`), `versions` (package → version).
    """

    trial: Trial
    episodes: Columns
    evaluations: Columns
    metadata: dict[str, Any]
