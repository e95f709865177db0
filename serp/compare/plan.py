"""What a comparison consists of: its algorithms, domain files, seeds and terms."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from serp._util.files import make_inside, write_durably
from serp._util.json_files import finite, json_text, read_json
from serp.compare.algorithms import Algorithm, Changes, ablation, find_algorithm
from serp.compare.protocol import ComparisonProtocol
from serp.compare.records import Trial
from serp.compare.storage import DOMAINS, PLAN, digest, file_name, is_complete, read_about
from serp.compare.trials.trial import trial_settings
from serp.errors import RunError, SettingsError
from serp.model.loading import Domain
from serp.settings import Settings
from serp.tasks.task import Task

_WHAT: Final = {
    "settings": "other settings",
    "domain": "another domain file",
    "conditions": "another budget or other evaluations",
    "algorithm": "another algorithm",
}


@dataclass(frozen=True)
class ComparisonPlan:
    """A comparison, as far as it was asked for up to now.

    Attributes:
        folder: Its folder.
        name: Name of the task.
        variants: Name of each domain file → the task with that file. The first is the base:
            algorithms that use no model run on it alone.
        algorithms: By name.
        trials: All that are asked for.
        conditions: The equal terms.
        changes: What is changed in the settings of all algorithms.
        threshold: Return from which a policy counts as good; None for none.
    """

    folder: Path
    name: str
    variants: Mapping[str, Task]
    algorithms: Mapping[str, Algorithm]
    trials: Sequence[Trial]
    conditions: ComparisonProtocol
    changes: Changes
    threshold: float | None

    @property
    def base(self) -> str:
        """Name of the base variant."""
        return next(iter(self.variants))

    @property
    def seeds(self) -> list[int]:
        """All seeds, in ascending order."""
        return sorted({trial.seed for trial in self.trials})

    def settings(self, trial: Trial) -> Settings:
        """Return the settings of a trial."""
        task = self.variants[trial.variant]
        return trial_settings(self.algorithms[trial.algorithm], task, self.changes)

    def made_of(self, trial: Trial) -> dict[str, str]:
        """Return digests of what a trial is made of."""
        algorithm = self.algorithms[trial.algorithm]
        domain = self.variants[trial.variant].load()
        texts = [s.text for s in (domain.source, domain.problem_source) if s is not None]
        return {
            "settings": digest(self.settings(trial).as_dict()),
            "domain": digest({"texts": texts}),
            "conditions": digest(self.conditions.as_dict()),
            "algorithm": digest({"kind": algorithm.kind, "preset": algorithm.preset}),
        }

    def missing(self) -> list[Trial]:
        """Return the trials that are not complete, seed by seed.

        Raises:
            RunError: A complete one is made of something else than is asked for now.
        """
        missing: list[Trial] = []
        for trial in sorted(self.trials, key=lambda trial: trial.seed):
            if not is_complete(self.folder, trial):
                missing.append(trial)
                continue
            before, now = read_about(self.folder, trial).get("made_of", {}), self.made_of(trial)
            for part, what in _WHAT.items():
                if before.get(part) != now[part]:
                    raise RunError(
                        f"{self.folder}: the trial of {trial.algorithm} on {trial.variant}, seed "
                        f"{trial.seed}, was made with {what} than now. Compare in another folder "
                        "(--out), or remove that trial."
                    )
        return missing

    def write(self) -> None:
        """Write `plan.json`, so that the comparison can be continued.

        Raises:
            RunError: The disk refused it.
        """
        values = {
            "task": self.name,
            "variants": list(self.variants),
            "algorithms": {
                name: {"changes": algorithm.changes} for name, algorithm in self.algorithms.items()
            },
            "trials": [list(trial) for trial in self.trials],
            "conditions": self.conditions.as_dict(),
            "changes": self.changes,
            "threshold": self.threshold,
        }
        write_durably(self.folder / PLAN, json_text(_plain(values)))


def _plain(value: Any) -> Any:
    """Return JSON values, the infinities as text."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, float) and finite(value) is None else value


def read_plan(folder: Path) -> dict[str, Any] | None:
    """Return what `ComparisonPlan.write` wrote; None where there is no comparison.

    Raises:
        RunError: The file is damaged.
    """
    if not (folder / PLAN).is_file():
        return None
    advice = "Restore it from a copy, or begin another comparison."
    plan = read_json(folder / PLAN, advice)
    try:
        ComparisonProtocol.from_dict(plan["conditions"])
        whole = (
            all(isinstance(entry["changes"], dict) for entry in plan["algorithms"].values())
            and all(len(trial) == 3 for trial in plan["trials"])
            and isinstance(plan["variants"][0], str)
            and {"task", "changes", "threshold"} <= plan.keys()
        )
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, SettingsError):
        whole = False
    if not whole:
        raise RunError(f"{folder / PLAN} is no plan of a comparison. {advice}")
    return plan


def named(names: Iterable[str], changed: Mapping[str, Changes]) -> dict[str, Algorithm]:
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
                raise SettingsError(f"nothing is said of what `{name}` changes")
            algorithm = ablation(algorithm, name, changed[name])
        found[name] = algorithm
    return found


def trials_of(
    algorithms: Mapping[str, Algorithm], variants: Sequence[str], seeds: Iterable[int]
) -> list[Trial]:
    """Return all trials: what uses no model runs on the first variant alone."""
    return [
        Trial(name, variant, seed)
        for seed in seeds
        for variant in variants
        for name, algorithm in algorithms.items()
        if algorithm.uses_model or variant == variants[0]
    ]


def kept_file(folder: Path, variant: str) -> Path:
    """Return where a comparison keeps the domain file of a variant."""
    return folder / DOMAINS / f"{file_name(variant)}.pddl"


def keep_domain(folder: Path, variant: str, domain: Domain, task: Task) -> Task:
    """Return the task with the domain file as the comparison keeps it.

    The file as it was at the beginning is copied into the folder, so that an edit in between
    changes nothing.

    Raises:
        RunError: The comparison has another file of that name.
    """
    place = kept_file(folder, variant)
    texts = {place: domain.source.text}
    beside = place.with_name(f"{place.stem}-problem.pddl")
    problem = None if domain.problem_source is None else beside
    if domain.problem_source is not None:
        texts[beside] = domain.problem_source.text
    elif place.is_file() and beside.is_file():
        raise RunError(
            f"{beside} is a problem file, and the domain file `{variant}` has none now. Compare in "
            "another folder (--out)."
        )
    folder.mkdir(parents=True, exist_ok=True)
    make_inside(folder, DOMAINS)
    for file, text in texts.items():
        if file.is_file() and file.read_bytes() != text.encode():
            raise RunError(
                f"{file} is not what the domain file `{variant}` says now: it was edited since "
                "this comparison began. Compare in another folder (--out)."
            )
        write_durably(file, text)
    return dataclasses.replace(task, domain=place, problem=problem)
