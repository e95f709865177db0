"""What is open in the studio, without a browser: the files, the state, an episode."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from serp.authoring.lint.domain_pairs import title_of
from serp.errors import SerpError
from serp.model.domain import Domain, problem_beside
from serp.pddl.source import Source
from serp.runs.run import Run
from serp.runs.run_config import CONFIG
from serp.runs.step_account import heading
from serp.settings import Settings, resolve
from serp.tasks.registry import find_domain_file, load_task, task_like
from serp.tasks.task import Task
from serp.ui.studio.document import Document
from serp.ui.studio.episodes import ShownEpisode
from serp.ui.studio.view import Surroundings, Values, Version, View, view_of

DOMAIN, PROBLEM = "domain", "problem"
_INITIAL = "the initial state of the problem"


class Session:
    """The files that are open (`domain`, `problem`), and the state that decisions are for.

    `values` is the state, `origin` where it comes from, for people. `task` is the one that the file
    belongs to, if any; `played` the episode that was played last, and `step` that of it which is
    shown, from 0.
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
        self.values: Values = {}
        self._chosen: Values = {}
        self.origin = "all fluents 0 or false" if problem is None else _INITIAL
        self.played: ShownEpisode | None = None
        self.step: int | None = None
        self._let_go: Callable[[], None] = lambda: None

    def take_over(self, let_go: Callable[[], None]) -> None:
        """Let go of the page that owned the session; only the last page changes it.

        `let_go` is called when another page takes over. Where nothing waits to be saved, the new
        page shows what other programs have written.
        """
        self._let_go()
        self._let_go = let_go
        for document in () if self.changed else self.documents.values():
            with suppress(SerpError):  # a file that cannot be read is reported when it is saved
                document.reload()

    # Editing -----------------------------------------------------------------------------------

    def edit(self, which: str, text: str) -> None:
        """Replace the text of a document."""
        self.documents[which].text = text.replace("\r\n", "\n")

    @property
    def version(self) -> Version:
        """The texts as they are edited."""
        return tuple((str(each.path), each.text) for each in self.documents.values())

    @property
    def changed(self) -> bool:
        """Whether a text is not saved."""
        return any(document.changed for document in self.documents.values())

    def save(self) -> list[Path]:
        """Save the documents that were changed, see `Document.save`; return their files.

        Domain and problem move into the working folder together: commands look for the problem
        beside the domain.
        """
        documents = self.documents.values() if self.changed else ()
        return [each.save() for each in documents if each.changed or each.elsewhere]

    # The state ---------------------------------------------------------------------------------

    def asked(self) -> Callable[[], View]:
        """Return what makes the view of this moment; what is edited meanwhile does not change it.

        It may run in a thread.
        """
        seen = {} if self.played is None else self.played.ranges()
        return partial(view_of, self.version, self.surroundings, self.values, seen, self.task)

    def show_initial(self) -> None:
        """Show the decision in the initial state of the problem; numbers it leaves out are 0."""
        self.values = self._chosen = {}
        self.origin, self.step = _INITIAL, None

    def show_recorded(self, run: Run, number: int) -> None:
        """Show the decision in a step that a run recorded, from 0, or raise a RunError."""
        step = run.recording().step(number)
        self.values = self._chosen = run.domain.model.values(step.state)
        self.origin, self.step = f"{run.path.name}, {heading(step)}", None

    def show_step(self, number: int) -> None:
        """Show the decision in a step of the episode, from 0."""
        assert self.played is not None
        steps = self.played.steps
        self.values = self._chosen = steps[number].values
        self.step = number
        self.origin = f"{self.played.name}, step {number} of {len(steps) - 1}"

    @property
    def begins_with_episode(self) -> bool:
        """Whether the page plays an episode unasked: the task is known, and no state was chosen."""
        return self.task is not None and self.played is None and not self.values

    @property
    def by_hand(self) -> bool:
        """Whether a fluent of the chosen state was changed by hand."""
        return self.values != self._chosen

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


def open_session(
    name: str, folder: Path, own: Task | None = None, step: int | None = None
) -> Session:
    """Open a domain file, with the problem beside it and the task that it belongs to.

    `name` is the file, an installed task, or the folder of a run, whose copies are saved elsewhere;
    `folder` the working folder; `own` the task of `--task`; `step` one that the run recorded.
    """
    title, task, surroundings = None, own, Surroundings(planner=Settings().planner)
    run = Run(Path(name)) if (Path(name) / CONFIG).is_file() else None
    if run is not None:
        made, (file, *others) = run.made, run.copies()
        problem = others[0] if others else None
        title = f"{Domain.parse(Source.read(file)).name}.pddl"
        seen, period, planner = made.observed, made.control_period, made.settings.planner
        surroundings = Surroundings(period, planner, seen is not None, frozenset(seen or ()))
        task = task or (load_task(made.task) if made.world is None else None)
    else:
        found, problem = find_domain_file(name), None
        if found is None:
            task = own or load_task(name)
            domain, given = task.domain, task.problem
            found = Path(domain.source.name if isinstance(domain, Domain) else domain)
            problem = None if given is None else Path(given)
        file = found
        if file.is_dir():
            raise SerpError(f"{file} is a folder; give a domain file, such as the one in a run")
        if not file.is_file():
            raise SerpError(f"{file}: there is no such file")
        problem = problem or problem_beside(file)
        # The file may be wrong, so that only its title can be read.
        known = task_like(title_of(Source.read(file)).domain, file.stem)
        task = task or (None if known is None else load_task(known))
        if task is not None:
            planner = resolve("default", task.settings).planner
            surroundings = Surroundings(float(task.dt), planner, observed=not task.closed)
    opened, other = Document(file, folder, title), None
    if problem is not None and problem.is_file():
        other = Document(problem, folder)
        if title is not None or other.elsewhere:  # it is saved beside the domain
            other = Document(problem, folder, str(problem_beside(opened.target).absolute()))
    session = Session(opened, other, surroundings, task)
    if step is not None:
        if run is None:
            raise SerpError(f"--step shows a step of a run, but {name} is not a run's folder")
        session.show_recorded(run, step)
    return session
