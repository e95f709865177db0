"""The recorded transitions of a run, read from its folder without the environment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from serp._util.saved_state import Saved
from serp.adaptation.adoption import ModelAdoption
from serp.errors import RunError
from serp.model.loading import Domain
from serp.model.transition_model import TransitionModel
from serp.review.run_model import RunModel
from serp.sysid.transitions import TransitionMemory


@dataclass(frozen=True)
class Recorded:
    """The recorded data of a run, as of its newest checkpoint.

    Attributes:
        run: The run's folder.
        domain: The run's copy of the domain.
        files: Name of the copy in the folder → name of the original file.
        model: The domain's transition model as written, with the task's control period.
        experience: The newest transitions.
        adoption: Which parts of the adapted model were in use, and why others were not.
        env_steps: Env steps of the run.
        learned_from: The reward that its learner used: `domain`, `environment` or `sum`.
        notice: A sentence if the newest checkpoint is damaged; else None.
    """

    run: Path
    domain: Domain
    files: Mapping[str, str]
    model: TransitionModel
    experience: TransitionMemory
    adoption: ModelAdoption
    env_steps: int
    learned_from: str
    notice: str | None


def read_recorded(run: Path) -> Recorded:
    """Read the recorded data of a run from its folder.

    Raises:
        RunError: The folder is not a run, it has no intact checkpoint, or its copy of the domain
            was changed.
        DomainError: Its copy of the domain is damaged.
    """
    read = RunModel(run)
    checkpoint, adaptation = read.checkpoint, read.adaptation
    whole = Saved("run", checkpoint.arrays, checkpoint.meta)
    experience = adaptation.experience
    if not len(experience):
        raise RunError(
            f"{run} has no env step in its last checkpoint; train it for a while: "
            f"serp plan-and-learn --resume {run}"
        )
    damage = checkpoint.fallback
    return Recorded(
        run=run,
        domain=read.domain,
        files={str(k): str(v) for k, v in read.folder.metadata["domain_files"].items()},
        model=read.model,
        experience=experience,
        adoption=adaptation.adoption,
        env_steps=whole.whole("env_steps"),
        learned_from=str(read.folder.metadata["config"].get("learned_from", "")),
        notice=None if damage is None else f"{damage} This diagnosis uses the one before.",
    )
