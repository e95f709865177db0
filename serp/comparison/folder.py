"""The folder of a comparison: its lock, and its copies of the domain files.

comparison/plan.json                     the plan
comparison/domains/VARIANT.pddl          copies of the domain files at the beginning
comparison/trials/…                      complete trials, see `serp.comparison.trial_files`
comparison/report.md, …                  the report, see `serp.comparison.report.report`
"""

from __future__ import annotations

import contextlib
import dataclasses
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from serp._util.files import cannot_write, make_inside, write_durably
from serp.comparison.plan import has_plan
from serp.comparison.trial_files import file_name
from serp.errors import RunError
from serp.model.facts import MAX_GROUND_SCHEMAS
from serp.model.loading import Domain, load_domain
from serp.runs.config import CONFIG
from serp.runs.lock import LOCK, RunLock
from serp.tasks.task import Task

_DOMAINS: Final = "domains"


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Create a folder and lock it; remove it again if the body writes no plan.

    Raises:
        RunError: It cannot be created, holds other files, or another process writes it.
    """
    if (
        folder.is_dir()
        and not has_plan(folder)
        and {file.name for file in folder.iterdir()} - {LOCK}
    ):
        what = "a run" if (folder / CONFIG).exists() else "other files"
        raise RunError(
            f"{folder} holds {what}, not a comparison. Give a new or empty folder with --out. "
            "Nothing was changed."
        )
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error, "Nothing was made.") from error
    lock = RunLock(folder)
    try:
        yield
    finally:
        begun = has_plan(folder)
        if not begun:  # the folder was empty before
            shutil.rmtree(folder / _DOMAINS, ignore_errors=True)
        lock.release()
        if folder in missing and not begun:
            shutil.rmtree(folder, ignore_errors=True)
            with contextlib.suppress(OSError):  # another process may have written there
                for place in missing[1:]:
                    place.rmdir()


def kept_file(folder: Path, variant: str) -> Path:
    """Return where a comparison keeps the domain file of a variant."""
    return folder / _DOMAINS / f"{file_name(variant)}.pddl"


def kept_files(folder: Path, variant: str) -> tuple[Path, Path]:
    """Return where a comparison keeps the domain file of a variant, and its problem file if any."""
    domain = kept_file(folder, variant)
    return domain, domain.with_name(f"{domain.stem}-problem.pddl")


def keep_domain(folder: Path, variant: str, domain: Domain, task: Task) -> Task:
    """Return a task with the comparison's copy of its domain file.

    The file is copied into the folder at the beginning, so that later edits have no effect.
    """
    place, beside = kept_files(folder, variant)
    texts = {place: domain.source.text}
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
    return with_domain(task, place, domain.max_ground_schemas)


def texts_of(task: Task) -> list[str]:
    """Return the texts of all files of a loaded task: domain, problem, and its planners' ones."""
    domains = [d for d in (task.domain, *task.planners.values()) if isinstance(d, Domain)]
    return [source.text for domain in domains for source in domain.sources]


def with_domain(task: Task, file: Path, limit: int = MAX_GROUND_SCHEMAS) -> Task:
    """Return a task with another domain file, and the problem file beside it if there is one.

    With another limit on its size than the default, the file is loaded at once.
    """
    if limit == MAX_GROUND_SCHEMAS:
        return dataclasses.replace(task, domain=file, problem=None)
    domain = load_domain(file, observed=not task.closed, max_ground_schemas=limit)
    return dataclasses.replace(task, domain=domain, problem=None)
