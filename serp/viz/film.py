"""Films of a policy: pictures with captions and durations."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Annotated, Final, NamedTuple

from PIL import Image
from pydantic import Field

from serp.control.decision import Actor
from serp.control.step_record import StepRecord
from serp.model.explanation import why_unsafe
from serp.model.flags import RISKY, UNSAFE
from serp.settings.section import Section
from serp.tasks.bound_task import BoundTask
from serp.training.agent import Agent
from serp.training.evaluation import Episode, outcome_of, play
from serp.training.policies import Policy
from serp.viz.camera import Camera, Picture
from serp.viz.caption import Caption, CaptionBand, Cell, Mark

HOLD: Final = 1.5
"""Time that a mark is shown, unless another one follows, s."""
END: Final = 1.0
"""Additional duration of the last picture of an episode, s."""
_WHOSE: Final = {
    Actor.PLANNER: "the planner's",
    Actor.LEARNER: "the learner's",
    Actor.EXPLORATION: "a random",
    Actor.FALLBACK: "the fallback's",
}
_STRIP = 500  # decisions in a caption


class FilmSettings(Section):
    """Settings of a film."""

    policy: Policy = "serp"
    """The policy; see `serp.training.policies.Policy`."""
    episodes: int = 3
    """Number of episodes."""
    seed: int = 0
    """Seed of the environment; the episodes are those of `evaluate` with this seed."""
    speed: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0
    """Speed relative to real time."""
    fps: Annotated[float, Field(ge=1, allow_inf_nan=False)] = 50.0
    """Largest number of frames per second. Pictures beyond it are left out, except the first and
    last of an episode and the first after a veto."""
    width: int | None = None
    """Largest width of a picture, pixels; None for no limit. Pictures are never enlarged."""
    height: int | None = None
    """Largest height of a picture without caption, pixels; None for no limit."""


class Frame(NamedTuple):
    """A frame of a film.

    Attributes:
        image: Picture and caption, RGB; all frames of a film have one size.
        seconds: Its duration.
        caption: The content of its caption.
        step: The step whose result it shows; None right after a reset.
    """

    image: Image.Image
    seconds: float
    caption: Caption
    step: StepRecord | None


class EpisodeResult(NamedTuple):
    """The result of an episode.

    Attributes:
        number: Number of the episode, from 1.
        steps: Its length.
        total: The environment's return.
        vetoes: Number of refused proposals.
        unsafe: Number of executed actions that the domain file flags unsafe.
        outcome: The outcome that the environment names; may be empty.
    """

    number: int
    steps: int
    total: float
    vetoes: int
    unsafe: int
    outcome: str


def film(
    agent: Agent,
    task: BoundTask,
    settings: FilmSettings,
    on_episode: Callable[[EpisodeResult], None] | None = None,
) -> Iterator[Frame]:
    """Play a policy and yield the frames of a film.

    Args:
        agent: The agent.
        task: The task, in an environment that is not used otherwise, made with a render mode of
            `serp.viz.camera`.
        settings: The settings of the film.
        on_episode: Called at the end of each episode.

    Raises:
        SettingsError: There is no such policy, or `episodes` or `seed` is out of range.
        SerpError: Environment or grounding failed (in a step).
    """
    episodes = play(agent, task, settings.policy, episodes=settings.episodes, seed=settings.seed)
    return _Filming(agent, task, settings, on_episode).frames(episodes)


def marks_of(agent: Agent, step: StepRecord) -> tuple[Mark, ...]:
    """Return the marks of a step: a veto, and the execution of an unsafe or risky action."""
    decision, arbiter = step.decision, agent.arbiter
    names = arbiter.actions
    marks = []
    if decision.vetoed:
        name = names.name(decision.proposed)
        why = arbiter.explain(decision, step.state)
        whose = _WHOSE[decision.proposed_by]
        marks.append(Mark(f"Refused in step {step.number}: {whose} {name}", _without(name, why)))
    if int(decision.forecast.flags[decision.action]) & (UNSAFE | RISKY):
        name = names.name(decision.action)
        ground = int(decision.forecast.ground[decision.action])
        why = why_unsafe(arbiter.model, step.state, ground)
        what = "Unsafe" if decision.unsafe else "Risky"
        marks.append(Mark(f"{what}, executed in step {step.number}: {name}", _without(name, why)))
    return tuple(marks)


def _without(name: str, explanation: str) -> str:
    return explanation.removeprefix(f"{name}: ")


class _Filming:
    """Makes the frames of one film."""

    def __init__(
        self,
        agent: Agent,
        task: BoundTask,
        settings: FilmSettings,
        on_episode: Callable[[EpisodeResult], None] | None,
    ) -> None:
        self._agent = agent
        self._settings = settings
        self._on_episode = on_episode
        self._camera = Camera(task)
        self._band: CaptionBand | None = None
        self._size = (0, 0)
        self._due = 0.0  # frames due so far minus frames shown
        self._marks: tuple[Mark, ...] = ()
        self._marked = 0.0  # remaining time of the mark, s

    def frames(self, episodes: Iterator[Episode]) -> Iterator[Frame]:
        for episode in episodes:
            yield from self._film(episode)

    def _film(self, episode: Episode) -> Iterator[Frame]:
        self._marked = 0.0
        strip: list[Cell] = []
        start = Caption(None, "start", (f"episode {episode.number}",))
        # All that belongs to the reset is one moment.
        for picture in self._camera.take()[-1:]:
            yield from self._shoot(picture, self._camera.period(1), start, None, always=True)
        for step in episode.steps:
            decision = step.decision
            strip.append(Cell(decision.executed_by, decision.vetoed))
            marks = marks_of(self._agent, step)
            if marks:
                self._marks, self._marked = marks, HOLD
            caption = Caption(
                decision.executed_by,
                self._agent.task.actions.name(decision.action),
                (
                    f"episode {episode.number}",
                    f"step {step.number}",
                    f"return {_signed(step.episode.return_)}",
                ),
                strip=tuple(strip[-_STRIP:]),
            )
            ended = caption._replace(outcome=outcome_of(step.info) if step.last else "")
            pictures = self._camera.take()
            period = self._camera.period(len(pictures))
            for k, picture in enumerate(pictures):
                end = step.last and k == len(pictures) - 1
                yield from self._shoot(
                    picture, period, ended if end else caption, step,
                    always=end or (bool(marks) and k == 0), end=end,
                )  # fmt: skip
            if step.last and self._on_episode is not None:
                totals, outcome = step.episode, outcome_of(step.info)
                counts = totals.decisions.vetoes, totals.decisions.unsafe_executed
                self._on_episode(
                    EpisodeResult(episode.number, step.number, totals.return_, *counts, outcome)
                )

    def _shoot(
        self,
        picture: Picture,
        period: float,
        caption: Caption,
        step: StepRecord | None,
        *,
        always: bool,
        end: bool = False,
    ) -> Iterator[Frame]:
        """Make the frame of a picture, if one is due."""
        period /= self._settings.speed
        self._due += period * self._settings.fps
        if not always and self._due < 1.0 - 1e-9:
            return
        self._due = min(max(self._due - 1.0, 0.0), 1.0)
        seconds = max(period, 1.0 / self._settings.fps) + (END if end else 0.0)
        if self._marked > 0.0:
            caption = caption._replace(marks=self._marks)
            seconds = max(seconds, self._marked) if end else seconds
            self._marked -= seconds
        yield Frame(self._compose(picture, caption), seconds, caption, step)

    def _compose(self, picture: Picture, caption: Caption) -> Image.Image:
        image = Image.fromarray(picture)
        if self._band is None:
            self._size = self._fitting(image.size)
            self._band = CaptionBand(self._size[0])
        if image.size != self._size:
            image = image.resize(self._size, Image.Resampling.HAMMING)
        width, height = self._size
        frame = Image.new("RGB", (width, height + self._band.size[1]))
        frame.paste(image)
        frame.paste(self._band.draw(caption), (0, height))
        return frame

    def _fitting(self, size: tuple[int, int]) -> tuple[int, int]:
        """Return the size of the pictures: within the limits, even, as videos require."""
        limits = (self._settings.width or math.inf, self._settings.height or math.inf)
        scale = min(1.0, limits[0] / size[0], limits[1] / size[1])
        return (_even(scale * size[0]), _even(scale * size[1]))


def _even(length: float) -> int:
    return max(2, 2 * round(length / 2))


def _signed(value: float) -> str:
    return f"{value + 0.0:+.2f}".replace("-", "−")
