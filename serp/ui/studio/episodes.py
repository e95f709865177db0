"""Episodes whose steps can be shown, played with the text as it is."""

from __future__ import annotations

import base64
import contextlib
import dataclasses
import itertools

from serp.errors import EnvironmentFailure, MissingExtra, TaskError, needs_extra
from serp.model.domain import Domain
from serp.pddl.source import DomainError, Source
from serp.tasks.environment import BoundTask
from serp.tasks.file_world import file_task
from serp.tasks.task import Task
from serp.ui.options import rolled_out
from serp.ui.studio.view import Ranges, Surroundings, Version


@dataclasses.dataclass(frozen=True)
class EpisodeStep:
    """A moment of an episode: the values of the fluents, who does what there (empty at the end).

    `indifferent`: whether all actions promise the same; `picture`: the environment's, as a data
    URL, or empty.
    """

    values: dict[str, float | bool]
    action: str
    indifferent: bool
    picture: str = ""


@dataclasses.dataclass(frozen=True)
class ShownEpisode:
    """An episode, from the reset on, and what it is, for people.

    `supplied` has the facts of `:init` that the grounding observes, `note` why there are no
    pictures.
    """

    steps: tuple[EpisodeStep, ...]
    name: str
    supplied: frozenset[str] = frozenset()
    note: str = ""

    def ranges(self) -> Ranges:
        """Return the least and greatest value of each fluent."""
        columns = {name: [float(step.values[name]) for step in self.steps]
                   for name in self.steps[0].values}  # fmt: skip
        return {name: (min(column), max(column)) for name, column in columns.items()}


def play(
    task: Task | None, version: Version, surroundings: Surroundings, seed: int
) -> ShownEpisode:
    """Play an episode with the planner of a version, for at most 100 steps.

    Without a task it is played in the file's own world.
    """
    domain = Domain.parse(
        *(Source(*file) for file in version), observed=task is not None and not task.closed
    )
    note = ""
    if task is not None:
        bound, note = _drawable(dataclasses.replace(task, domain=domain, problem=None))
    elif domain.problem_syntax is None or not domain.problem_syntax.has_init:
        raise DomainError(
            "an episode in the world of a file needs the :init of a problem, but none was found",
            domain.syntax.place,
        )
    else:
        bound = file_task(domain, dt=surroundings.dt).bind()
    pictures, steps = task is not None and not note, list[EpisodeStep]()
    with bound:
        planner = dataclasses.replace(surroundings, dt=bound.model.dt).planner_of(bound.domain)
        for state, plan, over in itertools.islice(rolled_out(bound, planner, seed), 101):
            last = over or len(steps) == 100
            action = "" if last else f"planner: {plan.name}"
            picture = _picture(bound) if pictures else ""
            values = bound.model.values(state)
            steps.append(EpisodeStep(values, action, plan.forecast.indifferent, picture))
            if last:
                break
        supplied = bound.domain.supplied or frozenset()
    return ShownEpisode(tuple(steps), f"an episode of the planner, seed {seed}", supplied, note)


def _drawable(task: Task) -> tuple[BoundTask, str]:
    """Return the task with an environment that can be drawn, else with one that cannot, and why."""
    try:
        with needs_extra("watch", "a picture of the environment"):
            import serp.ui.pictures.camera  # noqa: F401
        return task.bind(render_mode="rgb_array"), ""
    except (MissingExtra, TaskError) as error:
        return task.bind(), f"There is no picture of the environment: {error}"


def _picture(bound: BoundTask) -> str:
    """Return what an environment draws as a data URL; empty where it draws nothing."""
    from serp.ui.pictures.camera import Camera, webp

    with contextlib.suppress(EnvironmentFailure):  # a picture is not worth a failure
        drawn = webp(Camera(bound).take()[-1], 640)
        return f"data:image/webp;base64,{base64.b64encode(drawn).decode()}"
    return ""
