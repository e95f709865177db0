"""The plan of a comparison: everything that was requested of it so far, kept in `plan.json`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    NonNegativeInt,
    PlainSerializer,
    PositiveInt,
    ValidationError,
)

from serp._util.files import json_text, read_json, write_durably
from serp.errors import RunError
from serp.settings import from_json

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


FORMAT: Final = 2
_PLAN: Final = "plan.json"


def _mapped(changes: Any, convert: Callable[[Any], Any]) -> Any:
    if not isinstance(changes, Mapping):
        return convert(changes)
    return {name: _mapped(value, convert) for name, value in changes.items()}


def _loaded(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else from_json(value)


def _saved(value: Any) -> Any:
    return str(value) if value in (math.inf, -math.inf) else value


SettingChanges = Annotated[
    Mapping[str, Mapping[str, Any]],
    BeforeValidator(lambda changes: _mapped(changes, _loaded)),
    PlainSerializer(lambda changes: _mapped(changes, _saved)),
]
"""Section → setting → value; JSON has neither tuples nor infinities, which are restored."""


class ComparisonProtocol(BaseModel):
    """Budget and evaluations, the same for all trials of a comparison; see `serp.compare`.

    Every evaluation plays the same episodes, those of `evaluation_seed`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    env_steps: PositiveInt
    evaluate_every: PositiveInt
    evaluation_episodes: PositiveInt = 10
    final_episodes: PositiveInt = 50
    evaluation_seed: NonNegativeInt = 99

    def due(self, env_steps: int) -> bool:
        """Return whether the learner is evaluated after so many env steps."""
        return env_steps % self.evaluate_every == 0 or env_steps == self.env_steps


class ComparisonPlan(BaseModel):
    """The content of `plan.json`.

    Attributes:
        variants: Names of the domain files. The first is the base: algorithms that use no model run
            only on it.
        algorithms: Name → its own changes to the settings.
        changes: Changes to the settings of all algorithms.
        threshold: Return from which a policy counts as good; None for none.
        max_ground_schemas: Limit on the size of the grounded domains.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal[2] = FORMAT
    task: str
    variants: tuple[str, ...] = Field(min_length=1)
    algorithms: dict[str, SettingChanges]
    trials: tuple[Trial, ...]
    protocol: ComparisonProtocol
    changes: SettingChanges
    threshold: float | None
    max_ground_schemas: int

    @property
    def base(self) -> str:
        """Name of the base variant."""
        return self.variants[0]

    @property
    def seeds(self) -> list[int]:
        """All seeds, in ascending order."""
        return sorted({trial.seed for trial in self.trials})


def write_plan(folder: Path, plan: ComparisonPlan) -> None:
    """Write `plan.json`, so that the comparison can be continued."""
    write_durably(folder / _PLAN, json_text(plan.model_dump()))


def has_plan(folder: Path) -> bool:
    """Return whether a folder holds a comparison."""
    return (folder / _PLAN).is_file()


def read_plan(folder: Path) -> ComparisonPlan | None:
    """Return what `write_plan` wrote; None if the folder holds no comparison."""
    if not has_plan(folder):
        return None
    file, advice = folder / _PLAN, "Restore it from a copy, or begin another comparison."
    values = read_json(file, advice)
    if values.get("format", FORMAT) != FORMAT:
        raise RunError(
            f"{file} was written by another version of serp, with other names of settings: this "
            "comparison cannot be continued. Compare in another folder (--out)."
        )
    try:
        return ComparisonPlan(**values)
    except (ValidationError, TypeError, AttributeError):
        raise RunError(f"{file} is not the plan of a comparison. {advice}") from None
