"""What is open in the studio, without a browser: the files, the state, an episode."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from serp.errors import SerpError
from serp.model.domain import Domain, problem_beside
from serp.pddl.source import Place, Source
from serp.runs.run import Run
from serp.runs.run_config import CONFIG
from serp.settings import Settings, resolve
from serp.tasks.registry import find_domain_file, load_task, task_entries, task_of
from serp.tasks.task import Task
from serp.ui.studio.document import Document
from serp.ui.studio.episodes import ShownEpisode
from serp.ui.studio.view import Request, ShownState, Surroundings, Version

DOMAIN, PROBLEM = "domain", "problem"


class Session:
    """The files that are open (`domain`, `problem`), and the state that decisions are for.

    `task` is the one that the file belongs to, if any; `played` the episode that was played last,
    and `step` that of it which is shown, from 0; `owner` counts the pages, of which the last one
    changes the session.
    """

    def __init__(
        self,
        domain: Document,
        problem: Document | None,
        surroundings: Surroundings,
        task: Task | None = None,
    ) -> None:
        self.documents = {DOMAIN: domain} | ({} if problem is None else {PROBLEM: problem})
        self.surroundings = surroundings
        self.task = task
        self.shown = ShownState(
            {}, "all fluents 0 or false" if problem is None else "the initial state of the problem"
        )
        self.played: ShownEpisode | None = None
        self.step: int | None = None
        self.owner = 0
        self._let_go: Callable[[], None] = lambda: None

    def take_over(self, let_go: Callable[[], None]) -> int:
        """Let go of the page that owned the session; return the number of the new owner.

        `let_go` is called when another page takes over. Where nothing waits to be saved, the new
        page shows what other programs have written.
        """
        self._let_go()
        self._let_go = let_go
        self.owner += 1
        with suppress(SerpError):  # a file that cannot be read is reported when it is saved
            if not self.changed and any(each.outdated for each in self.documents.values()):
                for document in self.documents.values():
                    document.reload()
        return self.owner

    # Editing -----------------------------------------------------------------------------------

    def edit(self, which: str, text: str) -> None:
        """Replace the text of a document."""
        self.documents[which].text = text.replace("\r\n", "\n")

    def document_of(self, place: Place | None) -> str | None:
        """Return the key of the document that a place is in; None for none."""
        name = None if place is None else place.source.name
        documents = self.documents.items()
        return next((which for which, document in documents if str(document.path) == name), None)

    @property
    def version(self) -> Version:
        """The texts as they are edited."""
        domain, *problem = ((str(each.path), each.text) for each in self.documents.values())
        return Version(domain, problem[0] if problem else None)

    @property
    def changed(self) -> bool:
        """Whether a text is not saved."""
        return any(document.changed for document in self.documents.values())

    def save(self) -> list[Path]:
        """Save the documents that were changed, see `Document.save`; return their files.

        Domain and problem move into the working folder together: commands look for the problem
        beside the domain.
        """
        domain, problem = self.documents[DOMAIN], self.documents.get(PROBLEM)
        beside = problem_beside(domain.path).resolve()
        moving = domain.changed or (
            problem is not None and (problem.changed or problem.path.resolve() != beside)
        )
        return [
            document.save()
            for document in self.documents.values()
            if document.changed or (moving and document.elsewhere)
        ]

    # The state ---------------------------------------------------------------------------------

    def request(self) -> Request:
        """Return what the view of this moment is asked of."""
        seen = {} if self.played is None else self.played.ranges()
        return Request(self.version, self.surroundings, self.shown, seen, self.task)

    def set_fluent(self, name: str, value: float | bool) -> None:
        """Change one fluent of the state."""
        self.shown = ShownState({**self.shown.values, name: value}, self.shown.origin)

    def show_initial(self) -> None:
        """Show the decision in the initial state of the problem; numbers it leaves out are 0."""
        self.shown, self.step = ShownState({}, "the initial state of the problem"), None

    def show_step(self, number: int) -> None:
        """Show the decision in a step of the episode, from 0."""
        assert self.played is not None
        steps = self.played.steps
        origin = f"{self.played.name}, step {number} of {len(steps) - 1}"
        self.shown, self.step = ShownState(steps[number].values, origin), number

    @property
    def as_played(self) -> bool:
        """Whether the state is that of the step, with no fluent changed by hand."""
        if self.played is None or self.step is None:
            return False
        return dict(self.shown.values) == self.played.steps[self.step].values

    def take(self, played: ShownEpisode) -> None:
        """Take over an episode, and show the first of its steps with something to decide."""
        self.played = played
        if played.supplied:
            self.surroundings = replace(self.surroundings, supplied=played.supplied)
        self.show_step(next((k for k, s in enumerate(played.steps) if not s.indifferent), 0))

    def close(self) -> list[str]:
        """Keep unsaved texts; return what became of each."""
        return [each.keep() for each in self.documents.values() if each.changed]


# Opening -----------------------------------------------------------------------------------------


def open_session(name: str, folder: Path, own: Task | None = None) -> Session:
    """Open a domain file, with the problem beside it and the task that it belongs to.

    `name` is the file, an installed task, or the folder of a run, whose copies are saved elsewhere;
    `folder` the working folder; `own` the task of `--task`.
    """
    if (Path(name) / CONFIG).is_file():
        run = Run(Path(name))
        made, (copy, *others) = run.made, run.copies()
        title, observed = Domain.parse(Source.read(copy)).name, made.observed is not None
        return Session(
            Document(copy, folder, f"{title}.pddl"),
            Document(others[0], folder, f"{title}-problem.pddl") if others else None,
            Surroundings(
                made.control_period, made.settings.planner, observed, frozenset(made.observed or ())
            ),
            own or (load_task(made.task) if made.world is None else None),
        )
    file, task, problem = find_domain_file(name), own, None
    if file is None:
        task = own or load_task(name)
        domain, problem = task.domain, task.problem
        file = Path(domain.source.name if isinstance(domain, Domain) else domain)
    if file.is_dir():
        raise SerpError(f"{file} is a folder; give a domain file, such as the one in a run")
    if not file.is_file():
        raise SerpError(f"{file}: there is no such file")
    documents = _documents(file, problem_beside(file) if problem is None else Path(problem), folder)
    task = task or _task_of(file)
    surroundings = Surroundings(planner=Settings().planner)
    if task is not None:
        planner = resolve("default", task.settings).planner
        surroundings = Surroundings(float(task.dt), planner, observed=not task.closed)
    return Session(*documents, surroundings, task)


def _documents(file: Path, problem: Path, folder: Path) -> tuple[Document, Document | None]:
    """Return a domain and its problem; what comes from outside of the folder is saved beside."""
    domain = Document(file, folder)
    if not problem.is_file():
        return domain, None
    opened = Document(problem, folder)
    if opened.elsewhere:
        opened = Document(problem, folder, str(problem_beside(domain.target).absolute()))
    return domain, opened


def _task_of(file: Path) -> Task | None:
    """Return the installed task of a file, which may be wrong; None where there is none."""
    try:
        domain = Domain.parse(Source.read(file))
    except SerpError:
        return load_task(file.stem) if file.stem in task_entries() else None
    return task_of(domain, file)
