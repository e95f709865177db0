"""All that the studio's pages show and do, without a browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

from serp._util.text import plural
from serp.agent.explanation import Explanation, explain
from serp.agent.sentences import between, special_about
from serp.authoring.lint.findings import Finding
from serp.authoring.scenarios.syntax import SUFFIX
from serp.errors import SerpError
from serp.model.transition_model import Vector
from serp.pddl.source import Place, Source, edited
from serp.planning.replanner import MonitorReplanner, Plan
from serp.tasks.task import Draw, Task
from serp.ui.pictures.plan_picture import plan_svg
from serp.ui.studio.document import Document, read_instead, save_together
from serp.ui.studio.expectations import Expectations
from serp.ui.studio.reading import Surroundings, Version, read
from serp.ui.studio.recorded import PlayedEpisode, RecordedRun, play
from serp.ui.studio.shown_state import Control, ShownState, controls
from serp.ui.studio.training import BackgroundTraining, run_folder

_MOST_ACTIONS: Final = 60


@dataclass(frozen=True)
class DecisionView:
    """A decision of the planner.

    Attributes:
        account: The account of it.
        order: Positions of the actions that are shown: as in the file, those that are not
            applicable last; or the best first where there are too many.
        verdict: Sentences that sum it up.
        graph: The planning graph as SVG.
        controls: How the fluents of the state can be set.
    """

    account: Explanation
    order: tuple[int, ...]
    verdict: tuple[str, ...]
    graph: str
    controls: tuple[Control, ...]


@dataclass(frozen=True)
class View:
    """What is shown at a time.

    Attributes:
        findings: What is wrong in the files.
        failure: Why there is no decision though the files are right; else empty.
        decision: The decision; None where there is none.
        drawing: The state as the task draws it, an SVG; empty where it does not.
    """

    findings: tuple[Finding, ...]
    failure: str = ""
    decision: DecisionView | None = None
    drawing: str = ""


def look(
    version: Version,
    surroundings: Surroundings,
    shown: ShownState,
    seen: Mapping[str, tuple[float, float]],
    draw: Draw | None = None,
) -> View:
    """Read a version and decide in a situation.

    Args:
        version: The texts.
        surroundings: Control period and planner.
        shown: The state.
        seen: Fluent → the least and greatest value that was observed.
        draw: See `Task.draw`.
    """
    findings: tuple[Finding, ...] = ()
    try:
        reading = read(version, surroundings)
        findings = reading.findings
        if reading.planner is None:
            return View(findings)
        model = reading.planner.model
        state = shown.state(model)
        drawing = "" if draw is None else _drawn(draw, model.values(state))
        return View(findings, "", decide(reading.planner, state, seen), drawing)
    except SerpError as error:
        return View(findings, str(error))


def _drawn(draw: Draw, values: Mapping[str, float | bool]) -> str:
    """Return a drawing; empty where a fluent that it needs is gone, or it fails otherwise."""
    try:
        return str(draw(values))
    except Exception:  # a function of the task, on values that no environment may ever give
        return ""


def decide(
    planner: MonitorReplanner, state: Vector, seen: Mapping[str, tuple[float, float]]
) -> DecisionView:
    """Return what is shown of the planner's decision in a state `[F]`."""
    plan = planner.plan(state)
    discount = planner.settings.discount
    account = explain(
        planner.model, state, plan.forecast, plan.action, paths=plan.paths, discount=discount
    )
    there = plan.forecast.applicable
    order = sorted(range(len(there)), key=lambda k: not there[k])
    if len(order) > _MOST_ACTIONS:
        order.sort(key=lambda k: (k != plan.action, -plan.forecast.value[k]))
    shown = tuple(order[:_MOST_ACTIONS])
    for k in shown:
        account.alternatives[k].behind  # noqa: B018  (traced now, in this thread)
    return DecisionView(
        account,
        shown,
        tuple(_verdict(plan, account)),
        plan_svg(plan, planner),
        tuple(controls(planner.model, state, seen)),
    )


def _verdict(plan: Plan, account: Explanation) -> list[str]:
    if plan.name is None:
        return ["No action is applicable here."]
    said = special_about(plan.forecast)
    if account.runner_up is not None and not plan.indifferent:
        said.insert(0, between(account.runner_up, plan.name))
    looked = f"{plural(plan.depth, 'action')} ahead, {plural(plan.nodes, 'state')}"
    return [*said, f"Looked {looked}."]


_INITIAL: Final = "the initial state of the problem"
_PATIENCE: Final = 20.0
"""Seconds that a training has to save when the studio ends."""
DOMAIN, PROBLEM, SCENARIOS = "domain", "problem", "scenarios"


@dataclass(frozen=True)
class Request:
    """What a view is asked of; whatever is edited meanwhile does not change it."""

    version: Version
    surroundings: Surroundings
    shown: ShownState
    seen: dict[str, tuple[float, float]]
    draw: Draw | None

    def view(self) -> View:
        """Return the view; this may run in a thread."""
        return look(self.version, self.surroundings, self.shown, self.seen, self.draw)


class Session:
    """The files that are open, and the state that decisions are shown for.

    Args:
        folder: The working folder: nothing outside of it is written.
        domain: The domain file.
        problem: The problem file; None where there is none.
        surroundings: Control period and planner.
        task: The task that the file belongs to; None for a file alone.
        task_name: What `--task` says, for commands; None where it is not given.
        recorded: The run whose steps can be looked at; None for none.

    Attributes:
        documents: `domain`, `problem` where there is one, and `scenarios`, which need not exist.
        shown: The state that decisions are shown for.
        played: The episode that was played last, if any.
        step: The step of it that is shown, from 0; None for none.
        run_step: The step of the run with a veto that was shown last; None for none.
        training: The training that was begun last, if any.
        revision: A number that changes with every change of a text or of the state.
        owner: Number of the page that changes the session, counted up from 1; 0 for none.
    """

    def __init__(
        self,
        folder: Path,
        domain: Document,
        problem: Document | None,
        surroundings: Surroundings,
        task: Task | None = None,
        task_name: str | None = None,
        recorded: RecordedRun | None = None,
    ) -> None:
        self.folder = folder
        self.documents = {DOMAIN: domain} | ({} if problem is None else {PROBLEM: problem})
        beside = [path.with_suffix(SUFFIX) for path in (domain.target, domain.path)]
        scenarios = next((path for path in beside if path.exists()), beside[0])
        self.documents[SCENARIOS] = Document(scenarios, folder)
        self.task_name = task_name
        self.surroundings = surroundings
        self.task = task
        self.shown = ShownState({}, "all fluents 0 or false" if problem is None else _INITIAL)
        self.recorded = recorded
        self.played: PlayedEpisode | None = None
        self.step: int | None = None
        self.run_step: int | None = None
        self.training: BackgroundTraining | None = None
        self.revision = 0
        self.owner = 0
        self._let_go: Callable[[], None] = lambda: None

    def take_over(self, let_go: Callable[[], None]) -> int:
        """Let go of the page that owned the session; return the number of the new owner.

        Where nothing waits to be saved, the new page shows what other programs have written.

        Args:
            let_go: Called when another page takes over; this one may no longer change anything.
        """
        self._let_go()
        self._let_go = let_go
        self.owner += 1
        with suppress(SerpError):  # a file that cannot be read is told of when it is saved
            if not self.changed and any(each.outdated for each in self.documents.values()):
                self.reload()
        return self.owner

    # Editing -----------------------------------------------------------------------------------

    def edit(self, which: str, text: str) -> None:
        """Replace the text of a document."""
        self.documents[which].text = text.replace("\r\n", "\n")
        self.revision += 1

    def document_of(self, place: Place | None) -> str | None:
        """Return the key of the document that a place is in; None for none."""
        if place is not None:
            for which, document in self.documents.items():
                if document.name == place.source.name:
                    return which
        return None

    def mend(self, finding: Finding) -> bool:
        """Make the change that mends a finding; return whether its text is still the same."""
        which = self.document_of(finding.place)
        if which is None or finding.place is None or finding.fix is None:
            return False
        text = self.documents[which].text
        if text != finding.place.source.text:
            return False
        self.edit(which, edited(text, finding.fix.edits))
        return True

    @property
    def version(self) -> Version:
        """The texts as they are edited."""
        return self._version({which: each.text for which, each in self.documents.items()})

    @property
    def saved_version(self) -> Version:
        """The texts as they are on the disk."""
        return self._version({which: each.saved for which, each in self.documents.items()})

    def _version(self, texts: dict[str, str]) -> Version:
        domain, problem = self.documents[DOMAIN], self.documents.get(PROBLEM)
        name = domain.name if problem is None else problem.name
        return Version(domain.name, texts[DOMAIN], name, texts.get(PROBLEM))

    @property
    def changed(self) -> bool:
        """Whether a text is not saved."""
        return any(document.changed for document in self.documents.values())

    def save(self, *, anyway: bool = False) -> list[Path]:
        """Save the documents that were changed; return their files.

        Args:
            anyway: Whether to replace what other programs have written.

        Raises:
            ChangedOnDisk: Another program changed one of the files; those before it are saved.
            SerpError: A file cannot be written.
        """
        with self._moved():
            domain, problem = self.documents[DOMAIN], self.documents.get(PROBLEM)
            saved = save_together(domain, problem, anyway=anyway)
            if self.documents[SCENARIOS].changed:
                saved.append(self.documents[SCENARIOS].save(anyway=anyway))
            return saved

    def reload(self) -> None:
        """Take the texts that are on the disk; what was edited is lost."""
        with self._moved():
            for document in self.documents.values():
                document.reload()

    @contextmanager
    def _moved(self) -> Iterator[None]:
        try:
            yield
        finally:
            self.revision += 1

    # Looking -----------------------------------------------------------------------------------

    def request(self) -> Request:
        """Return what the view of this moment is asked of."""
        seen = {} if self.played is None else self.played.ranges()
        if self.recorded is not None:
            seen = self.recorded.ranges
        draw = None if self.task is None else self.task.draw
        return Request(self.version, self.surroundings, self.shown, seen, draw)

    def set_fluent(self, name: str, value: float | bool) -> None:
        """Change one fluent of the state."""
        self.shown = self.shown.changed(name, value)
        self.revision += 1

    def show(self, shown: ShownState) -> None:
        """Show decisions in another state."""
        self.shown, self.step = shown, None
        self.revision += 1

    # Playing -----------------------------------------------------------------------------------

    def player(self, seed: int) -> Callable[[], PlayedEpisode]:
        """Return what plays an episode with the planner of this moment; it may run in a thread."""
        return partial(play, self.task, self.version, self.surroundings, seed)

    def take(self, played: PlayedEpisode) -> None:
        """Take over an episode, and show the first of its steps with something to decide."""
        self.played = played
        if played.supplied:
            self.surroundings = replace(self.surroundings, supplied=played.supplied)
        self.show_step(played.telling)

    def show_episode(self, number: int) -> None:
        """Show an episode of the run, from 1.

        Raises:
            RunError: There is none of that number.
        """
        assert self.recorded is not None
        self.take(self.recorded.episode(number))
        self.run_step = None

    def show_next_veto(self) -> bool:
        """Show the next step of the run in which a proposal was refused; return whether one is."""
        assert self.recorded is not None
        found = self.recorded.next_veto(-1 if self.run_step is None else self.run_step)
        if found is None:
            return False
        episode, number = self.recorded.place_of(found)
        self.played = self.recorded.episode(episode)
        self.show_step(number)
        self.run_step = found
        return True

    def show_initial(self) -> None:
        """Show the decision in the initial state of the problem; numbers it leaves out are 0."""
        self.show(ShownState({}, _INITIAL))

    def show_step(self, number: int) -> None:
        """Show the decision in a step of the episode, from 0."""
        assert self.played is not None
        step = self.played.steps[number]
        origin = f"step {number} of {self.played.name}"
        self.show(ShownState(step.values, origin))
        self.step = number

    @property
    def as_played(self) -> bool:
        """Whether the state is that of the step, with no fluent changed by hand."""
        if self.played is None or self.step is None:
            return False
        return dict(self.shown.values) == self.played.steps[self.step].values

    # Testing, comparing, training ----------------------------------------------------------------

    @property
    def expectations(self) -> Expectations:
        """The scenarios, and what they are about, as they are edited."""
        document = self.documents[SCENARIOS]
        source = Source(document.name, document.text)
        return Expectations(source, self.version, self.surroundings, self.task)

    def states(self) -> list[ShownState]:
        """Return the state that is shown, and those of the episode, or from all over the run."""
        if self.recorded is not None:
            return [self.shown, *self.recorded.sample()]
        steps = () if self.played is None else self.played.steps
        return [self.shown, *(ShownState(each.values, f"step {k}") for k, each in enumerate(steps))]

    def other_version(self, file: Path) -> Version:
        """Return the version that another domain file is, with the same problem.

        Raises:
            DomainError: It cannot be read.
        """
        edited = self.version
        return edited._replace(domain_name=str(file), domain=Source.read(file).text)

    def begin_training(self, env_steps: int, seed: int) -> None:
        """Train on the saved file, in a process of its own and a run folder in the working folder.

        A file without a task is trained on in its own world.

        Raises:
            SerpError: The file is not saved, or a training would read another problem.
        """
        document = self.documents[DOMAIN]
        if self.changed:
            raise SerpError("Save first: a training reads the files.")
        if (problem := read_instead(document, self.documents.get(PROBLEM))) is not None:
            raise SerpError(
                f"A training would read the problem from {problem}, which is not what is open "
                "here. Press Ctrl+S if the files come from another folder; else make that file the "
                "problem that you mean, and open the studio anew."
            )
        command = ["play", str(document.path), "--train"]
        if self.task is not None:
            command = ["plan-and-learn", "--domain", str(document.path)]
        command += [] if self.task_name is None else ["--task", self.task_name]
        command += ["--env-steps", str(env_steps), "--seed", str(seed)]
        run = run_folder(self.folder, document.path.stem)
        if not run.resolve().is_relative_to(self.folder.resolve()):
            raise SerpError(f"{run} leads out of the working folder {self.folder}")
        planner = read(self.saved_version, self.surroundings).planner
        model = None if planner is None else planner.model
        self.training = BackgroundTraining(command, run, model)

    def close(self) -> list[str]:
        """Keep what was changed and not saved, and stop what runs in the background.

        Returns:
            Where each of the texts is kept, or why it is not.
        """
        said = [each.keep() for each in self.documents.values() if each.changed]
        if self.training is not None:
            self.training.stop(wait=_PATIENCE)
        return said

    def set_planner(self, **changes: int | float) -> None:
        """Change settings of the planner, such as `depth`.

        Raises:
            SettingsError: A value is outside its range.
        """
        planner = self.surroundings.planner.replace(**changes)
        self.surroundings = replace(self.surroundings, planner=planner)
        self.revision += 1
