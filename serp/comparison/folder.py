"""The folder of a comparison: its lock, its plan, and its copies of the domain files.

comparison/plan.json                     the plan
comparison/domains/VARIANT.pddl          copies of the domain files at the beginning
comparison/trials/…                      complete trials, see `serp.comparison.trial_files`
comparison/report.md, …                  the report, see `serp.comparison.report.report`
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from serp._util.files import cannot_write, make_inside, write_durably
from serp._util.json_files import json_text, read_json
from serp.comparison.algorithms import Changes
from serp.comparison.protocol import ComparisonProtocol
from serp.comparison.trial_files import file_name
from serp.comparison.trial_records import Trial
from serp.errors import RunError, SettingsError
from serp.model.facts import MAX_GROUND_SCHEMAS
from serp.model.loading import Domain, load_domain
from serp.runs.config import CONFIG
from serp.runs.lock import LOCK, RunLock
from serp.tasks.task import Task

FORMAT: Final = 2
_PLAN: Final = "plan.json"
_DOMAINS: Final = "domains"


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Create a folder and lock it; remove it again if the body writes no plan.

    Args:
        folder: The folder, which may exist.

    Raises:
        RunError: It cannot be created, holds other files, or another process writes it.
    """
    _refuse_foreign(folder)
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error, "Nothing was made.") from error
    lock = RunLock(folder)
    try:
        yield
    finally:
        begun = (folder / _PLAN).exists()
        if not begun:  # the folder was empty before
            shutil.rmtree(folder / _DOMAINS, ignore_errors=True)
        lock.release()
        if folder in missing and not begun:
            shutil.rmtree(folder, ignore_errors=True)
            with contextlib.suppress(OSError):  # another process may have written there
                for place in missing[1:]:
                    place.rmdir()


def _refuse_foreign(folder: Path) -> None:
    """Raise RunError for a folder that holds something other than a comparison."""
    if not folder.is_dir() or (folder / _PLAN).exists():
        return
    if any(entry.name != LOCK for entry in folder.iterdir()):
        what = "a run" if (folder / CONFIG).exists() else "other files"
        raise RunError(
            f"{folder} holds {what}, not a comparison. Give a new or empty folder with --out. "
            "Nothing was changed."
        )


# The plan -----------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class SavedPlan:
    """The content of `plan.json`: everything requested of a comparison so far.

    Attributes:
        task: Name of the task.
        variants: Names of the domain files, the base first.
        algorithms: Name → changes to the settings; not empty for names such as `algorithm:text`.
        trials: All requested trials.
        protocol: Budget and evaluations.
        changes: Changes to the settings of all algorithms.
        threshold: Return from which a policy counts as good; None for none.
        max_ground_schemas: Limit on the size of the grounded domains.
    """

    task: str
    variants: Sequence[str]
    algorithms: Mapping[str, Changes]
    trials: Sequence[Trial]
    protocol: ComparisonProtocol
    changes: Changes
    threshold: float | None
    max_ground_schemas: int


def write_plan(folder: Path, plan: SavedPlan) -> None:
    """Write `plan.json`, so that the comparison can be continued.

    Raises:
        RunError: The write failed.
    """
    values = {"format": FORMAT, **dataclasses.asdict(plan)}
    write_durably(folder / _PLAN, json_text(_with_infinities_as_text(values)))


def read_plan(folder: Path) -> SavedPlan | None:
    """Return what `write_plan` wrote; None if the folder holds no comparison.

    Raises:
        RunError: The file is damaged, or another version of serp wrote it.
    """
    file = folder / _PLAN
    if not file.is_file():
        return None
    advice = "Restore it from a copy, or begin another comparison."
    values = read_json(file, advice)
    if "conditions" in values or values.get("format", FORMAT) != FORMAT:
        raise RunError(
            f"{file} was written by another version of serp, with other names of settings: this "
            "comparison cannot be continued. Compare in another folder (--out)."
        )
    try:
        return SavedPlan(
            task=str(values["task"]),
            variants=[str(values["variants"][0]), *map(str, values["variants"][1:])],
            algorithms={
                name: loaded_changes(changes) for name, changes in values["algorithms"].items()
            },
            trials=[Trial(str(a), str(v), int(seed)) for a, v, seed in values["trials"]],
            protocol=ComparisonProtocol(**values["protocol"]),
            changes=loaded_changes(values["changes"]),
            threshold=values["threshold"],
            max_ground_schemas=int(values["max_ground_schemas"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, SettingsError):
        raise RunError(f"{file} is not the plan of a comparison. {advice}") from None


_INFINITIES: Final = {"inf": math.inf, "-inf": -math.inf}


def _with_infinities_as_text(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _with_infinities_as_text(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_with_infinities_as_text(item) for item in value]
    return str(value) if value in (math.inf, -math.inf) else value


def loaded_changes(changes: Mapping[str, Mapping[str, Any]]) -> Changes:
    """Return changes of settings, with tuples and infinities restored from JSON values."""

    def value(found: Any) -> Any:
        if isinstance(found, list):
            return tuple(found)
        return _INFINITIES.get(found, found) if isinstance(found, str) else found

    return {
        section: {name: value(found) for name, found in values.items()}
        for section, values in changes.items()
    }


# Domain files -------------------------------------------------------------------------------------


def kept_file(folder: Path, variant: str) -> Path:
    """Return where a comparison keeps the domain file of a variant."""
    return folder / _DOMAINS / f"{file_name(variant)}.pddl"


def keep_domain(folder: Path, variant: str, domain: Domain, task: Task) -> Task:
    """Return a task with the comparison's copy of its domain file.

    The file is copied into the folder at the beginning, so that later edits have no effect.

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
    make_inside(folder, _DOMAINS)
    for file, text in texts.items():
        if file.is_file() and file.read_bytes() != text.encode():
            raise RunError(
                f"{file} differs from the domain file `{variant}`, which was edited since this "
                "comparison began. Compare in another folder (--out)."
            )
        write_durably(file, text)
    return with_domain(task, place, problem, domain.max_ground_schemas)


def with_domain(
    task: Task, file: Path, problem: Path | None = None, limit: int = MAX_GROUND_SCHEMAS
) -> Task:
    """Return a task with another domain file.

    Args:
        task: The task.
        file: The domain file.
        problem: The problem file.
        limit: Limit on the size of the grounded domain; with another than the default, the file is
            loaded at once.

    Raises:
        DomainError: The file was loaded, and is missing or wrong.
    """
    if limit == MAX_GROUND_SCHEMAS:
        return dataclasses.replace(task, domain=file, problem=problem)
    domain = load_domain(file, problem, observed=True, max_ground_schemas=limit)
    return dataclasses.replace(task, domain=domain, problem=None)
