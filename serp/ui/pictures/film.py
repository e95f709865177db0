"""Films of a policy: pictures with captions and durations, as GIF or MP4."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import matplotlib
import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw, ImageFont

from serp._util.figures import ACTORS, REFUSED
from serp._util.files import replaced_durably
from serp._util.numbers import real
from serp.agent.agent import Agent
from serp.agent.decision import Actor
from serp.agent.step_record import StepRecord
from serp.errors import EnvironmentFailure, RunError, TaskError, needs_extra
from serp.model.flags import RISKY, UNSAFE
from serp.runs.evaluation import Policy, outcome_of, play
from serp.runs.recording import Recorder
from serp.runs.run import Run
from serp.tasks.task import BoundTask

HOLD: Final = 1.5
"""Time that a mark is shown, unless another one follows, s."""
END: Final = 1.0
"""Additional duration of the last picture of an episode, s."""
_BACKGROUND, _INK = "#16191F", "#F2F4F7"
Picture = NDArray[np.uint8]
OnEpisode = Callable[[int, StepRecord], None]
"""Called with the number of an episode and its last step."""


def render_mode_of(run: Run) -> str:
    """Return the render mode that gives the most pictures of a run's environment.

    Raises:
        TaskError: The environment draws no pictures.
    """
    with run.environment("rgb_array") as task:
        modes = task.env.metadata.get("render_modes") or ()
        for mode in ("rgb_array_list", "rgb_array"):
            if mode in modes:
                return mode
        raise TaskError(
            f"task {task.name}: the environment draws no pictures; it needs the render mode "
            f"`rgb_array`, and among metadata['render_modes'] are {', '.join(modes) or 'none'}"
        )


class Camera:
    """Takes the pictures of a task whose environment was made with one of the two modes."""

    def __init__(self, task: BoundTask) -> None:
        self._task = task
        self._several = task.env.render_mode == "rgb_array_list"
        self._rate = real(task.env.metadata.get("render_fps"))

    def take(self) -> list[Picture]:
        """Return the pictures since the last call, each uint8 of shape `(height, width, 3)`.

        Raises:
            EnvironmentFailure: The environment cannot draw, or gave something else.
        """
        try:
            rendered: Any = self._task.env.render()
        except DependencyNotInstalled as error:
            raise self._failure(
                f"the environment cannot draw: {error} (what serp's own environments need comes "
                "with pip install 'serp[watch]')"
            ) from error
        except (Exception, SystemExit) as error:
            raise self._failure(f"render failed: {type(error).__name__}: {error}") from error
        pictures = rendered if self._several and isinstance(rendered, list) else [rendered]
        return [self._checked(picture) for picture in pictures]

    def _checked(self, picture: Any) -> Picture:
        array = np.asarray(picture)
        if array.dtype != np.uint8 or array.ndim != 3 or array.shape[2] != 3 or not array.size:
            raise self._failure(
                f"render returned {type(picture).__name__} {array.shape} of {array.dtype}; a "
                "picture is uint8 of shape (height, width, 3)"
            )
        return array

    def _failure(self, why: str) -> EnvironmentFailure:
        return EnvironmentFailure(f"task {self._task.name}: {why}")

    def period(self, count: int) -> float:
        """Return the duration of each of a step's pictures, s of the task's time.

        Pictures share the control period, unless the environment's `render_fps` says how long each
        of several lasts.
        """
        if self._several and self._rate is not None and self._rate > 0:
            return 1.0 / self._rate
        return self._task.model.dt / max(count, 1)


@dataclass(frozen=True)
class FilmSettings:
    """Settings of a film.

    Attributes:
        policy, episodes, seed: As in `serp.Run.evaluate`.
        fps: Largest number of frames per second. Pictures beyond it are left out, except the first
            and last of an episode and the first after a veto.
        width: Largest width, pixels; None for no limit.
    """

    policy: Policy = "serp"
    episodes: int = 3
    seed: int = 0
    fps: float = 50.0
    width: int | None = None


class Frame(NamedTuple):
    """A frame of a film.

    Attributes:
        image: Picture and caption, RGB; all frames of a film have one size.
        seconds: Its duration.
        caption: The content of its caption.
    """

    image: Image.Image
    seconds: float
    caption: Caption


def film(
    agent: Agent,
    task: BoundTask,
    settings: FilmSettings,
    on_episode: OnEpisode | None = None,
    recorder: Recorder | None = None,
) -> Iterator[Frame]:
    """Play a policy and yield the frames of a film as they are made.

    The environment of the task, made with a render mode of this module, is not used otherwise.
    """
    camera, frames = Camera(task), _Frames(settings)
    for episode in play(
        agent, task, settings.policy, episodes=settings.episodes, seed=settings.seed,
        recorder=recorder,
    ):  # fmt: skip
        number = f"episode {episode.number}"
        frames.show_marks(())
        for picture in camera.take()[-1:]:  # a reset is one moment
            start = Caption(None, "start", (number,))
            yield from frames.of(picture, camera.period(1), start, always=True)
        for step in episode.steps:
            decision = step.decision
            if marks := marks_of(agent, step):
                frames.show_marks(marks)
            return_ = f"{step.episode.return_ + 0.0:+.2f}".replace("-", "−")
            facts = (number, f"step {step.number}", f"return {return_}")
            name = agent.task.actions.name(decision.action)
            caption = Caption(decision.executed_by, name, facts)
            pictures = camera.take()
            period = camera.period(len(pictures))
            for k, picture in enumerate(pictures):
                end = step.last and k == len(pictures) - 1
                if end:
                    caption = caption._replace(outcome=outcome_of(step.info))
                always = end or (bool(marks) and k == 0)
                yield from frames.of(picture, period, caption, always=always, end=end)
            if step.last and on_episode is not None:
                on_episode(episode.number, step)


def marks_of(agent: Agent, step: StepRecord) -> tuple[Mark, ...]:
    """Return the marks of a step: a veto, and the execution of an unsafe or risky action."""
    decision, arbiter = step.decision, agent.arbiter
    marks = []
    if decision.vetoed:
        name = arbiter.actions.name(decision.proposed)
        why = arbiter.explain(decision, step.state).removeprefix(f"{name}: ")
        what = f"Refused in step {step.number}: {name}, proposed by {decision.proposed_by}"
        marks.append(Mark(what, why))
    if int(decision.forecast.flags[decision.action]) & (UNSAFE | RISKY):
        taken = arbiter.alternatives(decision.forecast, step.state)[decision.action]
        what = "Unsafe" if decision.unsafe else "Risky"
        marks.append(Mark(f"{what}, executed in step {step.number}: {taken.name}", taken.remark))
    return tuple(marks)


class _Frames:
    """Makes frames of pictures: which of them are due, for how long, and with which marks."""

    def __init__(self, settings: FilmSettings) -> None:
        self._settings = settings
        self._band: CaptionBand | None = None
        self._size = (0, 0)
        self._due = 0.0  # frames due so far minus frames shown
        self._marks: tuple[Mark, ...] = ()
        self._marked = 0.0  # remaining time of the marks, s

    def show_marks(self, marks: tuple[Mark, ...]) -> None:
        """Show these marks in place of those before, for a time in which they can be read."""
        self._marks, self._marked = marks, HOLD if marks else 0.0

    def of(
        self,
        picture: Picture,
        period: float,
        caption: Caption,
        *,
        always: bool,
        end: bool = False,
    ) -> Iterator[Frame]:
        """Make the frame of a picture, if one is due."""
        self._due += period * self._settings.fps
        if not always and self._due < 1.0 - 1e-9:
            return
        self._due = min(max(self._due - 1.0, 0.0), 1.0)
        seconds = max(period, 1.0 / self._settings.fps) + (END if end else 0.0)
        if self._marked > 0.0:
            caption = caption._replace(marks=self._marks)
            seconds = max(seconds, self._marked) if end else seconds
            self._marked -= seconds
        yield Frame(self._compose(picture, caption), seconds, caption)

    def _compose(self, picture: Picture, caption: Caption) -> Image.Image:
        image = Image.fromarray(picture)
        if self._band is None:
            scale = min(1.0, (self._settings.width or math.inf) / image.width)
            self._size = (_even(scale * image.width), _even(scale * image.height))
            self._band = CaptionBand(self._size[0])
        if image.size != self._size:
            image = image.resize(self._size, Image.Resampling.HAMMING)
        width, height = self._size
        frame = Image.new("RGB", (width, height + self._band.size[1]))
        frame.paste(image)
        frame.paste(self._band.draw(caption), (0, height))
        return frame


class Mark(NamedTuple):
    """An event that is marked red, a veto or an unsafe action, and its reason by the file."""

    what: str
    why: str


class Caption(NamedTuple):
    """The content of a caption.

    Attributes:
        actor: Who acts; None before the first decision.
        action: Name of the action.
        facts: Episode, step, return; if there is little room, the first ones are left out.
        marks: Texts marked red.
        outcome: How the episode ended; empty while it runs, or if the environment does not say.
    """

    actor: Actor | None
    action: str
    facts: tuple[str, ...]
    marks: tuple[Mark, ...] = ()
    outcome: str = ""


class CaptionBand:
    """Draws captions of one width; all have the same `size`, pixels."""

    def __init__(self, width: int) -> None:
        letters = min(max(width // 44, 12), 26)
        fonts = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
        self._plain = ImageFont.truetype(fonts / "DejaVuSans.ttf", letters)
        self._bold = ImageFont.truetype(fonts / "DejaVuSans-Bold.ttf", letters)
        self._pad = letters // 2
        self._line = round(1.5 * letters)
        height = 3 * (self._pad + self._line)
        self.size = (width, height + height % 2)  # videos want even numbers

    def draw(self, caption: Caption) -> Image.Image:
        """Return the band of a caption, RGB."""
        image = Image.new("RGB", self.size, _BACKGROUND)
        draw = ImageDraw.Draw(image)
        self._draw_decision(draw, caption)
        if caption.marks:
            self._draw_marks(draw, caption.marks)
        return image

    def _draw_decision(self, draw: ImageDraw.ImageDraw, caption: Caption) -> None:
        gap = "   "
        width, pad = self.size[0], self._pad
        middle = pad + self._line // 2
        left, right = pad, width - pad
        if (actor := caption.actor) is not None:
            ink = _BACKGROUND if actor in (Actor.LEARNER, Actor.FALLBACK) else _INK
            left = self._draw_label(draw, left, actor.value.upper(), ACTORS[actor], ink)
        if caption.outcome:
            word = _cut(self._bold, caption.outcome.upper(), width // 3)
            right -= round(self._bold.getlength(word)) + 2 * pad
            self._draw_label(draw, right, word, _INK, _BACKGROUND)
            right -= pad
        # If there is little room, the action comes before the facts.
        action = _cut(self._bold, caption.action, right - left)
        draw.text((left, middle), action, fill=_INK, font=self._bold, anchor="lm")
        room = right - left - self._bold.getlength(action) - 2 * pad
        facts = list(caption.facts)
        while facts and self._plain.getlength(gap.join(facts)) > room:
            del facts[0]
        draw.text((right, middle), gap.join(facts), fill="#A9B0BB", font=self._plain, anchor="rm")

    def _draw_label(
        self, draw: ImageDraw.ImageDraw, left: int, word: str, colour: str, ink: str
    ) -> int:
        """Write a word on a coloured background; return the position to its right."""
        pad = self._pad
        end = left + self._bold.getlength(word) + 2 * pad
        draw.rounded_rectangle((left, pad, end, pad + self._line - 2), pad // 2, fill=colour)
        draw.text((left + pad, pad + self._line // 2), word, fill=ink, font=self._bold, anchor="lm")
        return round(end) + pad

    def _draw_marks(self, draw: ImageDraw.ImageDraw, marks: tuple[Mark, ...]) -> None:
        width, height = self.size
        pad = self._pad
        top = height - 2 * self._line - pad // 2
        draw.rectangle((0, top - pad // 2, width, height), fill=REFUSED)
        # A single reason has a line of its own.
        lines = [(marks[0].what, ""), ("", marks[0].why)] if len(marks) == 1 else marks[:2]
        for number, (what, why) in enumerate(lines):
            left, middle = pad, top + number * self._line + self._line // 2
            for text, font in ((what, self._bold), (why, self._plain)):
                shown = _cut(font, text, width - pad - left)
                draw.text((left, middle), shown, fill=_INK, font=font, anchor="lm")
                left += round(font.getlength(shown)) + 2 * pad if shown else 0


def _cut(font: ImageFont.FreeTypeFont, text: str, room: float) -> str:
    """Return a text, cut to the available width."""
    if font.getlength(text) <= room:
        return text
    while text and font.getlength(text + "…") > room:
        text = text[:-1]
    return text and text + "…"


def _even(length: float) -> int:
    return max(2, 2 * round(length / 2))  # as videos require


def write_film(
    run: Run, path: Path, settings: FilmSettings, on_episode: OnEpisode | None = None
) -> None:
    """Play a run's policy and write a film of it, `.gif` or `.mp4`; a failure leaves no file.

    Raises:
        MissingExtra: It is an MP4, and imageio-ffmpeg is not installed.
        RunError: The file cannot be written, or the run not be read.
        SerpError: The task cannot be loaded or draws no pictures, or its environment failed.
    """
    write = write_gif if path.suffix.lower() == ".gif" else write_mp4
    agent = run.agent
    with (
        replaced_durably(path) as aside,
        run.environment(render_mode_of(run)) as task,
        run.recorder(settings.policy, settings.seed) as recorder,
    ):
        write(aside, film(agent, task, settings, on_episode, recorder))


def write_gif(path: Path, frames: Iterator[Frame]) -> None:
    """Write an endlessly repeated GIF with the colours of its first frames.

    Pillow stores only the pixels that change, and keeps one byte per pixel of every frame until the
    end.
    """
    first = list(itertools.islice(frames, 60))
    palette = _palette([frame.image for frame in first])

    def images() -> Iterator[Image.Image]:
        due, spent = 0.0, 0
        for frame in itertools.chain(first, frames):
            due += frame.seconds / 0.01  # the unit in a GIF; browsers slow down shorter frames
            ticks = max(round(due) - spent, 2)
            spent += ticks
            image = frame.image.quantize(palette=palette, dither=Image.Dither.NONE)
            image.info["duration"] = 10 * ticks
            yield image

    rest = images()
    next(rest).save(
        path, "GIF", save_all=True, append_images=rest, loop=0, optimize=True, disposal=1,
        palette=bytes(palette.getpalette() or ()), transparency=255,
    )  # fmt: skip


def _palette(images: list[Image.Image]) -> Image.Image:
    """Return an image whose palette fits pictures and captions, even marks that come later."""
    red, white = (np.array(ImageColor.getrgb(name)) for name in (REFUSED, _INK))
    shades = [red + (white - red) * k // 4 for k in range(5)]  # for smooth letters
    fixed = np.concatenate([*shades, *(ImageColor.getrgb(name) for name in ACTORS.values())])
    sample = np.concatenate([np.asarray(image) for image in images[::7]])
    free = 255 - len(fixed) // 3  # 255 is the transparent one
    others = Image.fromarray(sample).quantize(free, Image.Quantize.MAXCOVERAGE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([*fixed.tolist(), *others[: 3 * free]])
    return palette


def write_mp4(path: Path, frames: Iterator[Frame]) -> None:
    """Write an MP4.

    The duration of the first frame, at most 1 s, gives the frame rate; longer frames are repeated.
    """
    with needs_extra("watch", "writing MP4"):
        from imageio_ffmpeg import write_frames
    first = next(frames)
    rate = max(round(1.0 / first.seconds, 2), 1.0)  # of which ffmpeg gets two decimals
    output = ["-crf", "20", "-movflags", "+faststart", "-f", "mp4"]
    due, count = 0.0, 0
    try:
        path.touch()  # else ffmpeg would fail later, and its pipe stay open
        writer = write_frames(
            f"file:{path}", first.image.size, fps=rate, codec="libx264", quality=None,
            macro_block_size=2, ffmpeg_log_level="error", output_params=output,
        )  # fmt: skip
        with contextlib.closing(writer):
            writer.send(None)
            for frame in itertools.chain([first], frames):
                due += frame.seconds * rate
                for _ in range(max(1, round(due) - count)):
                    writer.send(frame.image.tobytes())
                    count += 1
    except (OSError, RuntimeError) as error:
        raise RunError(f"ffmpeg could not write {path}: {error}") from error
    if not path.stat().st_size:
        raise RunError(f"ffmpeg could not write {path}")
