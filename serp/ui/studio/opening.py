"""What `serp studio` is asked to open: a domain file, an installed task by name, or a run."""

from __future__ import annotations

from pathlib import Path

from serp.authoring.scenarios.syntax import SUFFIX
from serp.errors import SerpError
from serp.model.domain import Domain, problem_beside
from serp.pddl.source import Source
from serp.runs.folder import CONFIG, RunFolder
from serp.runs.run import read_run_metadata
from serp.settings import Settings, resolve
from serp.tasks.registry import find_domain_file, load_task, task_entries, task_of
from serp.tasks.task import Task
from serp.ui.studio.document import Document
from serp.ui.studio.reading import Surroundings, Version
from serp.ui.studio.recorded import RecordedRun
from serp.ui.studio.session import Session


def open_session(
    name: str, folder: Path, own: Task | None = None, own_name: str | None = None
) -> Session:
    """Open a domain file, with the problem beside it and the task that it belongs to.

    Args:
        name: A domain file, its scenarios, the name of an installed task, or the folder of a run.
        folder: The working folder.
        own: The task of `--task`.
        own_name: What `--task` says.

    Raises:
        SerpError: There is no such file, task or run.
    """
    if (Path(name) / CONFIG).is_file():
        return _open_run(Path(name), folder, own, own_name)
    if Path(name).suffix == SUFFIX:
        name = str(Path(name).with_suffix(".pddl"))
    file = own_file = find_domain_file(name)
    task = own
    if file is None:
        task = own or load_task(name)
        if isinstance(task.domain, Domain):
            file = Path(task.domain.source.name)
        else:
            file = Path(task.domain)
    if file.is_dir():
        raise SerpError(f"{file}: a folder, but not that of a run; give a domain file")
    if not file.is_file():
        raise SerpError(f"{file}: there is no such file")
    problem = problem_beside(file)
    if own_file is None and task is not None and task.problem is not None:
        problem = Path(task.problem)
    documents = _opened(file, problem, folder)
    task = task or _task_of(file)
    return Session(folder, *documents, _surroundings(task), task, own_name)


def _open_run(path: Path, folder: Path, own: Task | None, own_name: str | None) -> Session:
    """Open the steps of a run, and the file of its name in the working folder.

    Where there is none, the run's copies are opened, and saved elsewhere: they stay as they are.
    """
    run = RunFolder.open(path)
    made = read_run_metadata(run)
    domain, problem = run.copies()
    copy = Version(
        str(domain), _text(domain), str(problem or domain), _text(problem) if problem else None
    )
    name = Domain.parse(copy.sources()[0]).name
    file = find_domain_file(name)
    if file is not None and file.is_file() and Domain.parse(Source.read(file)).name == name:
        documents = _opened(file, problem_beside(file), folder)
    else:
        documents = (
            Document(domain, folder, f"{name}.pddl"),
            None if problem is None else Document(problem, folder, f"{name}-problem.pddl"),
        )
    surroundings = Surroundings(
        dt=made.control_period,
        planner=made.settings.planner,
        observed=made.observed is not None,
        supplied=frozenset(made.observed or ()),
    )
    task = None
    if made.world is None:
        task = own or load_task(made.task)
    return Session(folder, *documents, surroundings, task, own_name, RecordedRun(path, copy))


def _opened(file: Path, problem: Path, folder: Path) -> tuple[Document, Document | None]:
    """Return a domain and its problem; what comes from outside of the folder is saved beside."""
    domain = Document(file, folder)
    if not problem.is_file():
        return domain, None
    found = Document(problem, folder)
    if found.elsewhere:
        found = Document(problem, folder, str(problem_beside(domain.target).absolute()))
    return domain, found


def _text(file: Path) -> str:
    return Source.read(file).text.replace("\r\n", "\n")


def _task_of(file: Path) -> Task | None:
    """Return the installed task of a file, which may be wrong; None where there is none."""
    try:
        domain = Domain.parse(Source.read(file))
    except SerpError:
        return load_task(file.stem) if file.stem in task_entries() else None
    return task_of(domain, file)


def _surroundings(task: Task | None) -> Surroundings:
    if task is None:
        return Surroundings(planner=Settings().planner)
    return Surroundings(
        dt=float(task.dt),
        planner=resolve("default", task.settings).planner,
        observed=not task.closed,
    )
