"""A comparison before its trials run: what the names of its plan stand for."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from serp.comparison.algorithms import Algorithm, find_algorithm
from serp.comparison.folder import texts_of
from serp.comparison.plan import ComparisonPlan
from serp.comparison.trial_files import digest, is_complete, read_metadata
from serp.comparison.trial_records import Trial
from serp.comparison.trials.characteristics import settings_in_use
from serp.comparison.workers import Job
from serp.errors import RunError, SettingsError
from serp.settings import Changes, Settings
from serp.tasks.task import Task

_WHAT: Final = {
    "settings": "other settings",
    "domain": "another domain file",
    "protocol": "another budget or other evaluations",
    "algorithm": "another algorithm",
}


@dataclass(frozen=True)
class PreparedComparison:
    """A plan, and what its names stand for.

    Attributes:
        folder: The folder of the comparison.
        plan: The plan.
        tasks: Name of each domain file → the task with that file, the base first.
        algorithms: Name → algorithm.
    """

    folder: Path
    plan: ComparisonPlan
    tasks: Mapping[str, Task]
    algorithms: Mapping[str, Algorithm]
    _known: dict[tuple[str, str], tuple[Job, dict[str, str]]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def settings(self, trial: Trial) -> Settings:
        """Return the settings of a trial."""
        task = self.tasks[trial.variant]
        return self.algorithms[trial.algorithm].settings(task, self.plan.changes)

    def made_of(self, trial: Trial) -> dict[str, str]:
        """Return digests of everything that the result of a trial depends on but its seed."""
        return self._specified(trial)[1]

    def job(self, trial: Trial) -> Job:
        """Return what a worker needs for a trial."""
        return dataclasses.replace(self._specified(trial)[0], trial=trial)

    def metadata(self, trial: Trial) -> dict[str, Any]:
        """Return what `trial.json` says of a trial beside its results."""
        job = self._specified(trial)[0]
        return {
            "settings": settings_in_use(job.algorithm, job.settings),
            "made_of": self.made_of(trial),
        }

    def _specified(self, trial: Trial) -> tuple[Job, dict[str, str]]:
        """Return job and digests of a trial; those of other seeds are the same but for the seed."""
        key = (trial.algorithm, trial.variant)
        if key not in self._known:
            algorithm, settings = self.algorithms[trial.algorithm], self.settings(trial)
            task = self.tasks[trial.variant].loaded()
            job = Job(trial, algorithm, task, settings, self.plan.protocol)
            parts: dict[str, dict[str, Any]] = {
                "settings": settings.as_dict(),
                "domain": {"texts": texts_of(task)},
                "protocol": self.plan.protocol.model_dump(),
                "algorithm": {"kind": algorithm.kind, "preset": algorithm.preset},
            }
            self._known[key] = job, {name: digest(part) for name, part in parts.items()}
        return self._known[key]

    def missing(self) -> list[Trial]:
        """Return the trials that are not complete, seed by seed.

        Raises:
            RunError: A complete trial was made from other settings or files.
        """
        missing: list[Trial] = []
        for trial in sorted(self.plan.trials, key=lambda trial: trial.seed):
            if not is_complete(self.folder, trial):
                missing.append(trial)
                continue
            before = read_metadata(self.folder, trial).get("made_of", {})
            now = self.made_of(trial)
            other = [what for part, what in _WHAT.items() if before.get(part) != now[part]]
            if other:
                raise RunError(
                    f"{self.folder}: the trial of {trial} was made with {other[0]} than now. "
                    "Compare in another folder (--out), or remove that trial."
                )
        return missing


def named_algorithms(names: Iterable[str], changed: Mapping[str, Changes]) -> dict[str, Algorithm]:
    """Return algorithms by name; `changed` has the settings of those named `algorithm:text`."""
    found: dict[str, Algorithm] = {}
    for name in names:
        base, colon, _ = name.partition(":")
        algorithm = find_algorithm(base)
        if colon:
            if name not in changed:
                raise SettingsError(f"`{name}`: say in `changed` which settings it changes")
            algorithm = algorithm.changed(name, changed[name])
        found[name] = algorithm
    return found


def trials_of(
    algorithms: Iterable[Algorithm], variants: Sequence[str], seeds: Iterable[int]
) -> list[Trial]:
    """Return all trials; algorithms that use no model run only on the first variant."""
    return [
        Trial(algorithm.name, variant, seed)
        for seed in seeds
        for variant in variants
        for algorithm in algorithms
        if algorithm.uses_model or variant == variants[0]
    ]
