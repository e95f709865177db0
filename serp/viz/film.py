"""Films of a policy: pictures with captions and durations."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from typing import Annotated, Final, NamedTuple

from PIL import Image
from pydantic import Field

from serp.control.decision import Actor
from serp.control.step_record import StepRecord
from serp.explanation.refusals import why_unsafe
from serp.model.flags import RISKY, UNSAFE
from serp.runs.recorder import Recorder
from serp.settings.section import Section
from serp.tasks.bound_task import BoundTask
from serp.training.agent import Agent
from serp.training.evaluation import Episode, outcome_of, play
from serp.training.policies import Policy
from serp.training.run import Run
from serp.viz.camera import Camera, Picture, render_mode_of
from serp.viz.caption import Caption, CaptionBand, Mark

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
OnEpisode = Callable[[int, StepRecord], None]
"""Called with the number of an episode and its last step."""


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


@contextlib.contextmanager
def film_of_run(
    run: Run, settings: FilmSettings, on_episode: OnEpisode | None = None
) -> Iterator[Iterator[Frame]]:
    """Yield the frames of a film of a run's policy, in an environment of their own.

    The steps are recorded as those of an evaluation.

    Raises:
        SerpError: See `render_mode_of` and `film`.
    """
    agent = run.agent
    with (
        run.environment(render_mode_of(run)) as task,
        run.recorder(settings.policy, settings.seed) as recorder,
    ):
        yield film(agent, task, settings, on_episode, recorder)


def film(
    agent: Agent,
    task: BoundTask,
    settings: FilmSettings,
    on_episode: OnEpisode | None = None,
    recorder: Recorder | None = None,
) -> Iterator[Frame]:
    """Play a policy and return the frames of a film as they are made.

    Args:
        agent: The agent.
        task: The task, in an environment that is not used otherwise, made with a render mode of
            `serp.viz.camera`.
        settings: The settings of the film.
        on_episode: Called at the end of each episode.
        recorder: Where the steps are recorded; None for nowhere.

    Raises:
        SettingsError: There is no such policy, or `episodes` or `seed` is out of range.
        SerpError: Environment or grounding failed (in a step).
    """
    episodes = play(
        agent, task, settings.policy, episodes=settings.episodes, seed=settings.seed,
        recorder=recorder,
    )  # fmt: skip
    filming = _Filming(agent, task, settings, on_episode)
    return (frame for episode in episodes for frame in filming.frames(episode))


def marks_of(agent: Agent, step: StepRecord) -> tuple[Mark, ...]:
    """Return the marks of a step: a veto, and the execution of an unsafe or risky action."""
    decision, arbiter = step.decision, agent.arbiter
    names = arbiter.actions
    marks = []
    if decision.vetoed:
        name = names.name(decision.proposed)
        why = arbiter.explain(decision, step.state).removeprefix(f"{name}: ")
        whose = _WHOSE[decision.proposed_by]
        marks.append(Mark(f"Refused in step {step.number}: {whose} {name}", why))
    if int(decision.forecast.flags[decision.action]) & (UNSAFE | RISKY):
        name = names.name(decision.action)
        ground = int(decision.forecast.ground[decision.action])
        why = why_unsafe(arbiter.model, step.state, ground).removeprefix(f"{name}: ")
        what = "Unsafe" if decision.unsafe else "Risky"
        marks.append(Mark(f"{what}, executed in step {step.number}: {name}", why))
    return tuple(marks)


class _Filming:
    """Makes the frames of one film."""

    def __init__(
        self, agent: Agent, task: BoundTask, settings: FilmSettings, on_episode: OnEpisode | None
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

    def frames(self, episode: Episode) -> Iterator[Frame]:
        """Yield the frames of an episode."""
        self._marked = 0.0
        number = f"episode {episode.number}"
        strip: list[tuple[Actor, bool]] = []
        start = Caption(None, "start", (number,))
        # All that belongs to the reset is one moment.
        for picture in self._camera.take()[-1:]:
            yield from self._shoot(picture, self._camera.period(1), start, None, always=True)
        for step in episode.steps:
            decision = step.decision
            strip.append((decision.executed_by, decision.vetoed))
            marks = marks_of(self._agent, step)
            if marks:
                self._marks, self._marked = marks, HOLD
            name = self._agent.task.actions.name(decision.action)
            facts = (number, f"step {step.number}", f"return {_signed(step.episode.return_)}")
            caption = Caption(decision.executed_by, name, facts, strip=tuple(strip))
            pictures = self._camera.take()
            period = self._camera.period(len(pictures))
            for k, picture in enumerate(pictures):
                end = step.last and k == len(pictures) - 1
                if end:
                    caption = caption._replace(outcome=outcome_of(step.info))
                always = end or (bool(marks) and k == 0)
                yield from self._shoot(picture, period, caption, step, always=always, end=end)
            if step.last and self._on_episode is not None:
                self._on_episode(episode.number, step)

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
