"""The recorded steps of a run, to look at them with the file as it is edited."""

from __future__ import annotations

import base64
import dataclasses
import functools
import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from serp.errors import MissingExtra, TaskError
from serp.model.domain import Domain
from serp.model.transition_model import TransitionModel
from serp.pddl.source import DomainError, Source
from serp.planning.replanner import MonitorReplanner
from serp.runs.recording import VETO_COLUMNS, Recording, open_recording, vetoed
from serp.tasks.file_world import file_task
from serp.tasks.task import BoundTask, Task
from serp.ui.studio.reading import Surroundings, Version, planner_of
from serp.ui.studio.shown_state import ShownState

MOST_STEPS: Final = 100
_WIDTH: Final = 640
"""Most pixels of a picture in width."""


@dataclasses.dataclass(frozen=True)
class PlayedStep:
    """A moment of an episode.

    Attributes:
        values: Fluent → value.
        action: Who does what there; empty where nobody has an action, or at the end.
        indifferent: Whether all actions promise the same there.
        picture: The environment's picture as a data URL of a PNG; empty where there is none.
    """

    values: dict[str, float | bool]
    action: str
    indifferent: bool
    picture: str


@dataclasses.dataclass(frozen=True)
class PlayedEpisode:
    """An episode.

    Attributes:
        steps: Its moments, from the reset on.
        name: What it is, for people.
        supplied: Facts of `:init` that the grounding observes.
        note: Why there are no pictures; empty where there are.
    """

    steps: tuple[PlayedStep, ...]
    name: str
    supplied: frozenset[str] = frozenset()
    note: str = ""

    @property
    def telling(self) -> int:
        """Position of the first moment with something to decide; 0 where there is none."""
        return next((k for k, step in enumerate(self.steps) if not step.indifferent), 0)

    def ranges(self) -> dict[str, tuple[float, float]]:
        """Return the least and greatest value of each fluent."""
        names = self.steps[0].values
        return {
            name: (min(column), max(column))
            for name in names
            for column in [[float(step.values[name]) for step in self.steps]]
        }


def play(
    task: Task | None, version: Version, surroundings: Surroundings, seed: int
) -> PlayedEpisode:
    """Play an episode with the planner of a version, for at most `MOST_STEPS` steps.

    Without a task it is played in the file's own world.

    Raises:
        SerpError: The version is wrong, does not fit the task, or the environment fails.
    """
    problem = version.problem
    domain = Domain.parse(
        Source(version.domain_name, version.domain),
        Source(version.problem_name, problem) if problem is not None else None,
        observed=task is not None and not task.closed,
    )
    note = ""
    if task is not None:
        bound, note = _bound(dataclasses.replace(task, domain=domain, problem=None))
    elif domain.problem_syntax is None or not domain.problem_syntax.has_init:
        raise DomainError(
            "an episode in the world of a file begins in the :init of a problem, and there is none",
            domain.syntax.place,
        )
    else:
        bound = file_task(domain, dt=surroundings.dt).bind()
    with bound:
        supplied = bound.domain.supplied or frozenset()
        model = TransitionModel(bound.model.ground, dt=bound.model.dt, own_code=False)
        planner = planner_of(model, surroundings.planner)
        steps = tuple(_steps(bound, planner, seed, pictures=task is not None and not note))
    return PlayedEpisode(steps, f"an episode of the planner, seed {seed}", supplied, note)


def _bound(task: Task) -> tuple[BoundTask, str]:
    """Return the task with an environment that can be drawn, else with one that cannot, and why."""
    try:
        import PIL  # noqa: F401  (needed to write pictures)
    except ModuleNotFoundError:
        return task.bind(), str(MissingExtra("A picture of the environment", "watch"))
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # environments draw with SDL on no screen
    try:
        return task.bind(render_mode="rgb_array"), ""
    except TaskError as error:
        return task.bind(), f"There is no picture of the environment: {error}"


def _steps(
    bound: BoundTask, planner: MonitorReplanner, seed: int, *, pictures: bool
) -> Iterator[PlayedStep]:
    raw, info = bound.reset(seed)
    over = False
    for number in range(MOST_STEPS + 1):
        state = bound.ground(raw, info, bound.env)
        plan = planner.plan(state)
        over = over or plan.action is None or number == MOST_STEPS
        picture = _picture(bound.env) if pictures else ""
        action = "" if over or plan.name is None else f"planner: {plan.name}"
        yield PlayedStep(bound.model.values(state), action, plan.indifferent, picture)
        if over or plan.action is None:
            return
        raw, _, terminated, truncated, info = bound.step(
            bound.actions.environment_action[plan.action]
        )
        over = terminated or truncated


def _picture(env: Any) -> str:
    """Return what an environment draws as a data URL; empty where it draws nothing."""
    from PIL import Image

    try:
        drawn = env.render()
    except Exception:  # a picture is not worth a failure
        return ""
    if not isinstance(drawn, np.ndarray) or drawn.ndim != 3 or drawn.dtype != np.uint8:
        return ""
    image = Image.fromarray(drawn)
    image.thumbnail((_WIDTH, _WIDTH))
    buffer = io.BytesIO()
    image.save(buffer, "PNG")
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


_SAMPLE: Final = 500
"""Most states of a run that versions are compared on."""


class RecordedRun:
    """The recording of a run.

    Args:
        run: The folder of the run.
        version: The files as the run has them.

    Raises:
        RunError: It has no recording, or a part of that is damaged: what a page needs later is
            checked before there is one.
    """

    def __init__(self, run: Path, version: Version) -> None:
        self.run = run
        self.version = version
        self._recording: Recording = open_recording(run)
        self._recording.check()

    @functools.cached_property
    def vetoes(self) -> list[int]:
        """Positions of the steps in which a proposal was refused."""
        return np.flatnonzero(vetoed(self._recording.columns(*VETO_COLUMNS))).tolist()

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """The least and greatest value of each fluent in the run."""
        if not len(self._recording):
            return {}
        low, high = self._recording.ranges
        names = self._recording.layout.fluents
        return dict(zip(names, zip(low.tolist(), high.tolist(), strict=True), strict=True))

    def next_veto(self, after: int) -> int | None:
        """Return the first step with a veto after a step; from the beginning where none follows."""
        return next((step for step in self.vetoes if step > after), next(iter(self.vetoes), None))

    def episode(self, number: int) -> PlayedEpisode:
        """Return an episode, from 1.

        Raises:
            RunError: There is none of that number.
        """
        self._recording.find(number, 1)
        steps = self._recording.episodes[number]
        name = f"episode {number} of {self.run.name}"
        return PlayedEpisode(tuple(self._steps(int(step) for step in steps)), name)

    def place_of(self, step: int) -> tuple[int, int]:
        """Return episode, from 1, and number in it, from 0, of a step."""
        found = self._recording.step(step)
        return found.episode, found.number - 1

    def sample(self) -> list[ShownState]:
        """Return states from all over the run."""
        count = len(self._recording)
        every = max(1, -(-count // _SAMPLE))
        names = self._recording.layout.fluents
        return [
            ShownState(
                dict(zip(names, self._recording.step(step).state.tolist(), strict=True)),
                f"run step {step}",
            )
            for step in range(0, count, every)
        ]

    def _steps(self, steps: Iterator[int]) -> Iterator[PlayedStep]:
        layout = self._recording.layout
        for step in steps:
            found = self._recording.step(step)
            decision = found.decision
            said = f"{decision.executed_by}: {layout.actions[decision.action]}"
            if decision.vetoed:
                proposed = (
                    layout.actions[decision.proposed] if decision.proposed >= 0 else "nothing"
                )
                said += f" instead of {proposed}: {decision.reason}"
            values = dict(zip(layout.fluents, found.state.tolist(), strict=True))
            yield PlayedStep(values, said, bool(decision.forecast.indifferent), "")
