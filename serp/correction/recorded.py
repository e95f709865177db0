"""What a run recorded of the world, read back from its folder; the environment is not needed."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from serp.correction.experience import Experience
from serp.correction.monitor import Monitor
from serp.domain.loading import Domain, load_domain
from serp.domain.model import TransitionModel
from serp.errors import RunError
from serp.made_with import made_with
from serp.runs.checkpoint import Checkpoint
from serp.runs.folder import RunFolder
from serp.runs.regular import read_regular
from serp.saved import Saved


@dataclass(frozen=True)
class Recorded:
    """What a run recorded, as of its newest checkpoint.

    Attributes:
        run: The run's folder.
        domain: The domain as the run has it.
        files: Name of the copy in the folder → name of the file that it is a copy of.
        model: The domain's transition model as written, with the task's control period.
        experience: The newest transitions.
        monitor: Predictions beside observations, over the whole run.
        env_steps: Env steps of the run.
        notice: What is to be known of the checkpoint: that the newest is damaged; else None.
    """

    run: Path
    domain: Domain
    files: Mapping[str, str]
    model: TransitionModel
    experience: Experience
    monitor: Monitor
    env_steps: int
    notice: str | None


def read_recorded(run: Path) -> Recorded:
    """Read what a run recorded.

    Args:
        run: The run's folder.

    Raises:
        RunError: It is no run, it has no whole checkpoint, its domain was changed since, or it was
            made before runs recorded their experience.
        DomainError: Its copy of the domain is damaged.
    """
    folder = RunFolder.open(run)
    made = made_with(folder)
    checkpoint = folder.load_checkpoint()
    _refuse_changes(folder, checkpoint)
    domain = load_domain(folder.domain_file, folder.problem_file)
    model = domain.model.replace(dt=made.dt)
    whole = Saved("run", checkpoint.arrays, checkpoint.meta)
    saved = Saved("correction", *Saved("agent", *whole.part("agent")).part("correction"))
    if not (saved.has("experience") and saved.has("monitor")):
        raise RunError(
            f"{run} recorded nothing of what its actions did: an earlier version of serp made it. "
            "Train again with this one, or use the version that config.json names"
        )
    experience, monitor = Experience.of(model), Monitor(model)
    experience.load_state_dict(*saved.part("experience"))
    monitor.load_state_dict(*saved.part("monitor"))
    if not len(experience):
        raise RunError(
            f"{run} has made no env step up to its last checkpoint; let it train for a while: "
            f"serp plan-and-learn --resume {run}"
        )
    damage = checkpoint.fallback
    return Recorded(
        run=run,
        domain=domain,
        files={str(k): str(v) for k, v in folder.about["domain_files"].items()},
        model=model,
        experience=experience,
        monitor=monitor,
        env_steps=whole.whole("env_steps"),
        notice=None if damage is None else f"{damage} What is said here is as of the one before.",
    )


def _refuse_changes(folder: RunFolder, checkpoint: Checkpoint) -> None:
    """Refuse a domain that is not the one the run was made with: its lines would be others."""
    digests = checkpoint.meta.get("made_of", {})
    for file in (folder.domain_file, folder.problem_file):
        if file is None or file.name not in digests:
            continue
        try:
            content = read_regular(file)
        except OSError as error:
            raise RunError(f"cannot read {file}: {error.strerror or error}") from error
        if hashlib.sha256(content).hexdigest() != digests[file.name]:
            raise RunError(
                f"{file.name} of the run was changed since it began, so that what was observed "
                "does not belong to it any more; undo the change"
            )
