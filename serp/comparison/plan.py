"""The plan of a comparison: its algorithms, domain files, seeds and protocol."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from serp.comparison.algorithms import Algorithm, Changes, ablation, find_algorithm
from serp.comparison.folder import SavedPlan
from serp.comparison.protocol import ComparisonProtocol
from serp.comparison.trial_files import digest, is_complete, read_metadata
from serp.comparison.trial_records import Trial
from serp.comparison.trials.trial import trial_settings
from serp.errors import RunError, SettingsError
from serp.settings import Settings
from serp.tasks.task import Task

_WHAT: Final = {
    "settings": "other settings",
    "domain": "another domain file",
    "protocol": "another budget or other evaluations",
    "algorithm": "another algorithm",
}


@dataclass(frozen=True, kw_only=True)
class ComparisonPlan:
    """The plan of a comparison.

    Attributes:
        folder: The folder of the comparison.
        task: Name of the task.
        variants: Name of each domain file → the task with that file. The first is the base:
            algorithms that use no model run only on it.
        algorithms: Name → algorithm.
        trials: All requested trials.
        protocol: Budget and evaluations.
        changes: Changes to the settings of all algorithms.
        threshold: Return from which a policy counts as good; None for none.
        max_ground_schemas: Limit on the size of the grounded domains.
    """

    folder: Path
    task: str
    variants: Mapping[str, Task]
    algorithms: Mapping[str, Algorithm]
    trials: Sequence[Trial]
    protocol: ComparisonProtocol
    changes: Changes
    threshold: float | None
    max_ground_schemas: int

    @property
    def base(self) -> str:
        """Name of the base variant."""
        return next(iter(self.variants))

    @property
    def seeds(self) -> list[int]:
        """All seeds, in ascending order."""
        return sorted({trial.seed for trial in self.trials})

    def saved(self) -> SavedPlan:
        """Return the plan as `plan.json` holds it."""
        return SavedPlan(
            task=self.task,
            variants=list(self.variants),
            algorithms={name: found.changes for name, found in self.algorithms.items()},
            trials=self.trials,
            protocol=self.protocol,
            changes=self.changes,
            threshold=self.threshold,
            max_ground_schemas=self.max_ground_schemas,
        )

    def settings(self, trial: Trial) -> Settings:
        """Return the settings of a trial."""
        task = self.variants[trial.variant]
        return trial_settings(self.algorithms[trial.algorithm], task, self.changes)

    def made_of(self, trial: Trial) -> dict[str, str]:
        """Return digests of everything that the result of a trial depends on."""
        algorithm = self.algorithms[trial.algorithm]
        domain = self.variants[trial.variant].load()
        texts = [s.text for s in (domain.source, domain.problem_source) if s is not None]
        return {
            "settings": digest(self.settings(trial).as_dict()),
            "domain": digest({"texts": texts}),
            "protocol": digest(asdict(self.protocol)),
            "algorithm": digest({"kind": algorithm.kind, "preset": algorithm.preset}),
        }

    def missing(self) -> list[Trial]:
        """Return the trials that are not complete, seed by seed.

        Raises:
            RunError: A complete trial was made from other settings or files.
        """
        missing: list[Trial] = []
        for trial in sorted(self.trials, key=lambda trial: trial.seed):
            if not is_complete(self.folder, trial):
                missing.append(trial)
                continue
            before, now = read_metadata(self.folder, trial).get("made_of", {}), self.made_of(trial)
            for part, what in _WHAT.items():
                if before.get(part) != now[part]:
                    raise RunError(
                        f"{self.folder}: the trial of {trial.algorithm} on {trial.variant}, seed "
                        f"{trial.seed}, was made with {what} than now. Compare in another folder "
                        "(--out), or remove that trial."
                    )
        return missing


def named_algorithms(names: Iterable[str], changed: Mapping[str, Changes]) -> dict[str, Algorithm]:
    """Return algorithms by name.

    Args:
        names: Names of algorithms.
        changed: Name of the form `algorithm:text` → what is changed in that algorithm's settings.

    Raises:
        SettingsError: There is no such algorithm.
    """
    found: dict[str, Algorithm] = {}
    for name in names:
        base, colon, _ = name.partition(":")
        algorithm = find_algorithm(base)
        if colon:
            if name not in changed:
                raise SettingsError(f"`{name}`: say in `changed` which settings it changes")
            algorithm = ablation(algorithm, name, changed[name])
        found[name] = algorithm
    return found


def trials_of(
    algorithms: Mapping[str, Algorithm], variants: Sequence[str], seeds: Iterable[int]
) -> list[Trial]:
    """Return all trials; algorithms that use no model run only on the first variant."""
    return [
        Trial(name, variant, seed)
        for seed in seeds
        for variant in variants
        for name, algorithm in algorithms.items()
        if algorithm.uses_model or variant == variants[0]
    ]
