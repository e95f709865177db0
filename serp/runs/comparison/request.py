"""The options of `compare`, and the plan that they give together with an existing one."""

from __future__ import annotations

import dataclasses
import glob
import json
import os
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from pydantic import (
    Field,
    FiniteFloat,
    PositiveInt,
    field_validator,
)

from serp._util.text import did_you_mean
from serp.errors import RunError, SettingsError, TaskError
from serp.model.reachability import MAX_GROUND_SCHEMAS
from serp.runs.comparison.algorithms import (
    DQN,
    PLANNER,
    SERP,
    Algorithm,
    find_algorithm,
    settings_in_use,
)
from serp.runs.comparison.folder import keep_domain, kept_file, texts_of, with_domain
from serp.runs.comparison.plan import ComparisonPlan, ComparisonProtocol, SettingChanges, Trial
from serp.runs.comparison.trial_files import digest, is_complete, read_metadata
from serp.runs.comparison.workers import Job, TrialsRequest
from serp.runs.folder import machine, versions
from serp.settings import Changes, Settings, resolve
from serp.tasks.registry import find_task, load_task, task_entries
from serp.tasks.task import BoundTask, Task, reward_source

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


ALGORITHMS: Final = (SERP, PLANNER, DQN)
"""Algorithms compared by default."""
SEEDS: Final = range(5)
_PROTOCOL: Final = ("env_steps", "evaluate_every", "evaluation_episodes", "final_episodes")


class ComparisonRequest(TrialsRequest):
    """The options of `serp.compare`, which describes them; None stands for the default."""

    algorithms: tuple[str, ...] = ()
    env_steps: PositiveInt | None = None
    model_variants: tuple[str, ...] = ()
    changed: Mapping[str, SettingChanges] = Field(default_factory=dict)
    threshold: FiniteFloat | None = None
    evaluate_every: PositiveInt | None = None
    evaluation_episodes: PositiveInt | None = None
    final_episodes: PositiveInt | None = None
    out: Path | None = None
    merge: tuple[Path, ...] = ()

    @classmethod
    def section(cls) -> str:
        """Return the first part of the names in messages."""
        return "compare"

    @field_validator("algorithms", "model_variants", mode="before")
    @classmethod
    def _names(cls, value: Any) -> Any:
        if isinstance(value, str | os.PathLike) or not isinstance(value, Iterable):
            raise ValueError("must be a list of names, such as ['serp', 'dqn']")
        return tuple(dict.fromkeys(map(str, value)))

    @field_validator("merge", mode="before")
    @classmethod
    def _folders(cls, value: Any) -> Any:
        if isinstance(value, str | os.PathLike) or not isinstance(value, Iterable):
            raise ValueError("must be a list of folders")
        return tuple(map(_path, value))

    @field_validator("out", mode="before")
    @classmethod
    def _folder(cls, value: Any) -> Path:
        return _path(value)


def _path(value: Any) -> Path:
    if not isinstance(value, str | os.PathLike) or "\0" in str(value):
        raise ValueError("must be the name of a folder")
    return Path(value)


def requested_task(
    task: Task | str | None, before: ComparisonPlan | None, folder: Path | None
) -> Task:
    """Return the requested task."""
    if isinstance(task, Task):
        return task
    if isinstance(task, str):
        return find_task(task, worlds=True)
    if task is not None:
        raise TaskError(f"a task is a serp.Task, a name or a domain file, not {task!r}")
    if folder is None:
        raise RunError("say what to compare on: name a task")
    if before is None:
        raise RunError(f"say what to compare on: name a task; {folder} holds no comparison yet")
    try:
        own = load_task(before.task)
    except TaskError as error:
        if before.task in task_entries():
            raise
        raise TaskError(
            f"{folder} compares on task {before.task}, which is not installed: name it again, as a "
            "serp.Task (--task), or by the domain file that is its world (--domain)"
        ) from error
    # The copy, because the original file may have changed.
    kept = kept_file(folder, before.base)
    return with_domain(own, kept, limit=before.max_ground_schemas)


def prepare(
    folder: Path, before: ComparisonPlan | None, bound: BoundTask, request: ComparisonRequest
) -> PreparedComparison:
    """Return the existing plan extended by a request; domain files are copied into the folder."""
    base = before.base if before else _base_name(bound)
    files = domain_files(request.model_variants, bound.name, _installed(bound, folder))
    named = [base, *(file.stem for file in files)]
    now = list(request.algorithms or (before.algorithms if before else ALGORITHMS))
    if files:  # what results on domain files are compared with
        now = _unique(now, (PLANNER, DQN))
    seeds = request.seeds
    if before is None:
        settings = resolve("default", bound.task.settings)
        steps = request.env_steps or settings.training.env_steps
        given = request.model_dump(include={*_PROTOCOL}, exclude_none=True)
        before = ComparisonPlan(
            task=bound.name,
            variants=(base,),
            algorithms={},
            trials=(),
            protocol=ComparisonProtocol(
                **{"env_steps": steps, "evaluate_every": max(1, steps // 10), **given}
            ),
            changes=request.settings,
            threshold=default_threshold(bound),
            max_ground_schemas=bound.domain.max_ground_schemas,
        )
        seeds = seeds or tuple(SEEDS)
    else:
        _refuse_contradictions(folder, before, bound, request)
        if not files:
            named = list(before.variants)
        if not (files or seeds or request.algorithms):
            now = []
    algorithms = named_algorithms(
        _unique(before.algorithms, now), {**before.algorithms, **request.changed}
    )
    tasks = _tasks(folder, before, bound, files)
    added = trials_of([algorithms[name] for name in now], named, seeds or before.seeds)
    update: dict[str, Any] = {
        "variants": tuple(tasks),
        "algorithms": {name: found.changes for name, found in algorithms.items()},
        "trials": tuple(_unique(before.trials, added)),
        "max_ground_schemas": bound.domain.max_ground_schemas,
    }
    if request.threshold is not None:
        update["threshold"] = request.threshold
    return PreparedComparison(folder, before.model_copy(update=update), tasks, algorithms)


def _refuse_contradictions(
    folder: Path, before: ComparisonPlan, bound: BoundTask, request: ComparisonRequest
) -> None:
    """Raise a SerpError for a request that differs from the existing plan."""
    if before.task != bound.name:
        raise RunError(f"{folder} compares on task {before.task}, not on {bound.name}")
    if request.settings and request.settings != before.changes:
        raise SettingsError(
            "settings of a comparison cannot change once it has begun. Compare in another folder "
            "(--out)."
        )
    for name in _PROTOCOL:
        value, own = getattr(request, name), getattr(before.protocol, name)
        if value not in (None, own):
            raise SettingsError(
                f"this comparison has {name} = {own}, not {value}: all of its trials have the same "
                "protocol. Compare in another folder (--out)."
            )


def _tasks(
    folder: Path, before: ComparisonPlan, bound: BoundTask, files: Sequence[Path]
) -> dict[str, Task]:
    """Return the task with the comparison's copy of each domain file, the base first."""
    base, *others = before.variants
    places: dict[str, Path] = {}
    for file in files:
        if file.stem == base:
            raise SettingsError(f"{file}: a model variant needs another name than `{base}`")
        other = places.setdefault(file.stem, file)
        if other != file:
            raise SettingsError(f"two model variants are called `{file.stem}`: {other} and {file}")
    tasks = {base: keep_domain(folder, base, bound.domain, bound.task)}
    for name in _unique(others, places):
        file = places.get(name, kept_file(folder, name))
        task = with_domain(bound.task, file, limit=bound.domain.max_ground_schemas)
        with task.bind() as variant:  # checks that the file fits the task
            tasks[name] = keep_domain(folder, name, variant.domain, task)
    return tasks


def domain_files(asked: Iterable[str], task: str, own: Path) -> list[Path]:
    """Return the domain files that `model_variants` names, in order, each once."""
    found: list[Path] = []
    for name in asked:
        with_suffix = name if name.endswith(".pddl") else f"{name}.pddl"
        if name == "all":
            matches = sorted(own.parent.glob(f"{glob.escape(task)}-*.pddl"))
        elif glob.has_magic(name):
            matches = sorted(map(Path, glob.glob(name))) or sorted(own.parent.glob(with_suffix))
        else:
            places = (Path(name), own.parent / with_suffix)
            matches = [path for path in places if path.is_file()][:1]
        matches = [path for path in matches if not path.name.endswith("-problem.pddl")]
        if not matches:
            known = sorted(path.stem for path in own.parent.glob("*.pddl") if path != own)
            raise TaskError(f"there is no domain file {name}; {did_you_mean(name, known)}")
        found = _unique(found, matches)
    return found


def _installed(bound: BoundTask, folder: Path) -> Path:
    """Return the task's own domain file, beside which its variants lie."""
    own = Path(bound.domain.source.name)
    if own.parent == kept_file(folder, "any").parent:
        own = Path(load_task(bound.name).load().source.name)
    return own


def _base_name(bound: BoundTask) -> str:
    """Return the name of the base variant: that of the task, or of a variant's file."""
    name = Path(bound.domain.source.name).stem
    return name if name.startswith(f"{bound.name}-") else bound.name


def default_threshold(bound: BoundTask) -> float | None:
    """Return the `reward_threshold` of the environment's specification, if it has one."""
    specification = bound.env.spec
    return None if specification is None else specification.reward_threshold


def _unique(*items: Iterable[Any]) -> list[Any]:
    return list(dict.fromkeys(item for several in items for item in several))


@dataclass(frozen=True, kw_only=True)
class ComparisonMetadata:
    """What a report says of a comparison beside its numbers.

    Attributes:
        plan: The plan; its algorithms and variants are in the order of the tables.
        rewarded_by: The source of the reward: `domain`, `environment` or `sum`.
        command: The command that runs the same comparison again.
        notes: Sentences for the top of the report.
        machine: Description of the machine.
        versions: Package → version.
    """

    plan: ComparisonPlan
    rewarded_by: str
    command: str
    notes: Sequence[str] = ()
    machine: Mapping[str, Any] = field(default_factory=machine)
    versions: Mapping[str, str | None] = field(default_factory=versions)


def metadata_of(
    prepared: PreparedComparison, bound: BoundTask, notes: Sequence[str]
) -> ComparisonMetadata:
    """Return the metadata of a planned comparison."""
    settings = resolve("default", bound.task.settings, prepared.plan.changes)
    return ComparisonMetadata(
        plan=prepared.plan,
        rewarded_by=reward_source(bound.rewarded_by, settings),
        command=rerun_command(prepared, default_threshold(bound)),
        notes=notes,
    )


def rerun_command(prepared: PreparedComparison, threshold: float | None) -> str:
    """Return the command that repeats the comparison with its copies of the domain files.

    Paths are relative to its folder. For a task that is not installed the command has a
    placeholder.
    """
    plan, protocol = prepared.plan, prepared.plan.protocol
    files = (kept_file(prepared.folder, name) for name in plan.variants)
    base, *others = (file.relative_to(prepared.folder).as_posix() for file in files)
    words = ["--domain", base]
    if plan.task not in task_entries():
        words += ["--task", "FILE.py:FUNCTION"]
    words += ["--algorithms", ",".join(plan.algorithms), "--seeds", _seeds(plan.seeds)]
    for name in ("env_steps", "evaluate_every", "evaluation_episodes", "final_episodes"):
        words += [f"--{name.replace('_', '-')}", str(getattr(protocol, name))]
    if plan.threshold != threshold:
        words += ["--threshold", str(plan.threshold)]
    if plan.max_ground_schemas != MAX_GROUND_SCHEMAS:
        words += ["--max-ground-schemas", str(plan.max_ground_schemas)]
    for file in others:
        words += ["--model-variants", file]
    for setting in _assignments(plan.changes):
        words += ["--set", setting]
    return shlex.join(["serp", "compare", *words, "--out", "again"])


def _seeds(seeds: Sequence[int]) -> str:
    if all(b == a + 1 for a, b in pairwise(seeds)):  # a single number would mean a count
        return f"{seeds[0]}-{seeds[-1]}"
    return ",".join(map(str, seeds))


def _assignments(changes: Changes) -> Iterator[str]:
    """Yield settings in the form of the command line."""
    for section, values in changes.items():
        for name, value in values.items():
            json_like = value is None or isinstance(value, bool | tuple)
            yield f"{section}.{name}={json.dumps(value) if json_like else value}"
