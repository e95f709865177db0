"""Films of a policy as MP4: what the environment draws; below it who acts, and what was refused."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

import matplotlib
from imageio_ffmpeg import write_frames
from PIL import Image, ImageDraw, ImageFont

from serp._util.figures import ACTORS, REFUSED
from serp._util.files import replaced_durably
from serp.agent.agent import Agent
from serp.agent.decision import Actor
from serp.agent.step_record import StepRecord
from serp.errors import RunError, TaskError
from serp.model.flags import RISKY, UNSAFE
from serp.runs.evaluation import Policy, outcome_of, play
from serp.runs.recording import Recorder
from serp.runs.run import Run
from serp.tasks.environment import BoundTask
from serp.ui.pictures.camera import Camera, Picture

HOLD: Final = 1.5
"""Time that a mark is shown, unless another one follows, s."""
END: Final = 1.0
"""Additional duration of the last picture of an episode, s."""
_MOST_FPS: Final = 60.0
_BACKGROUND, _INK, _FAINT = "#16191F", "#F2F4F7", "#A9B0BB"
OnEpisode = Callable[[int, StepRecord], None]
"""Called with the number of an episode and its last step."""


def render_mode_of(run: Run) -> str:
    """Return the render mode that gives the most pictures of a run's environment."""
    with run.environment("rgb_array") as task:
        modes = task.env.metadata.get("render_modes") or ()
        for mode in ("rgb_array_list", "rgb_array"):
            if mode in modes:
                return mode
        raise TaskError(
            f"task {task.name}: the environment draws no pictures; it needs the render mode "
            f"`rgb_array`, and among metadata['render_modes'] are {', '.join(modes) or 'none'}"
        )


class Mark(NamedTuple):
    """An event that is marked red, a veto or an unsafe action, and its reason by the file."""

    what: str
    why: str


class Caption(NamedTuple):
    """The content of a caption; without an actor before the first decision.

    If there is little room, the first ones of the `facts` (episode, step, return) are left out.
    `outcome` is how the episode ended; empty while it runs, or if the environment does not say.
    """

    actor: Actor | None
    action: str
    facts: tuple[str, ...]
    marks: tuple[Mark, ...] = ()
    outcome: str = ""


class Frame(NamedTuple):
    """A frame of a film: the picture above its caption, RGB, all of one size; its duration, s."""

    image: Image.Image
    seconds: float
    caption: Caption


def film(
    agent: Agent,
    task: BoundTask,
    policy: Policy = "serp",
    episodes: int = 3,
    seed: int = 0,
    *,
    on_episode: OnEpisode | None = None,
    recorder: Recorder | None = None,
) -> Iterator[Frame]:
    """Play a policy, as `serp.Run.evaluate` does, and yield the frames of a film.

    The environment of the task, made with a render mode that gives arrays, is not used otherwise.
    """
    camera, draw = Camera(task), _FrameDrawing()
    for episode in play(agent, task, policy, episodes=episodes, seed=seed, recorder=recorder):
        number = f"episode {episode.number}"
        marks: tuple[Mark, ...] = ()
        hold = 0.0
        for picture in camera.take()[-1:]:  # a reset is one moment
            yield draw.frame(picture, camera.period(1), Caption(None, "start", (number,)))
        for step in episode.steps:
            if new := marks_of(agent, step):
                marks, hold = new, HOLD
            decision, pictures = step.decision, camera.take()
            return_ = f"{step.episode.return_ + 0.0:+.2f}".replace("-", "−")
            facts = (number, f"step {step.number}", f"return {return_}")
            name = agent.task.actions.name(decision.action)
            for k, picture in enumerate(pictures, 1):
                seconds = camera.period(len(pictures))
                caption = Caption(decision.executed_by, name, facts, marks if hold > 0.0 else ())
                if step.last and k == len(pictures):
                    seconds = max(seconds + END, hold)
                    caption = caption._replace(outcome=outcome_of(step.info))
                hold -= seconds
                yield draw.frame(picture, seconds, caption)
            if step.last and on_episode is not None:
                on_episode(episode.number, step)


def marks_of(agent: Agent, step: StepRecord) -> tuple[Mark, ...]:
    """Return the marks of a step: a veto, and the execution of an unsafe or risky action."""
    decision, arbiter = step.decision, agent.arbiter
    marks: tuple[Mark, ...] = ()
    if decision.vetoed:
        name = arbiter.actions.name(decision.proposed)
        why = arbiter.explain(decision, step.state).removeprefix(f"{name}: ")
        what = f"Refused in step {step.number}: {name}, proposed by {decision.proposed_by}"
        marks = (Mark(what, why),)
    if int(decision.forecast.flags[decision.action]) & (UNSAFE | RISKY):
        taken = arbiter.alternatives(decision.forecast, step.state)[decision.action]
        what = "Unsafe" if decision.unsafe else "Risky"
        what = f"{what}, executed in step {step.number}: {taken.name}"
        marks = (*marks, Mark(what, taken.remark))
    return marks


class _FrameDrawing:
    """Draws frames, all of the size of the first one."""

    _size = (0, 0)  # of the picture alone

    def frame(self, picture: Picture, seconds: float, caption: Caption) -> Frame:
        """Return the frame of a picture."""
        image = Image.fromarray(picture)
        if not self._size[0]:
            self._size = (_even(image.width), _even(image.height))
            letters = min(max(self._size[0] // 44, 12), 26)
            fonts = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
            self._plain = ImageFont.truetype(fonts / "DejaVuSans.ttf", letters)
            self._bold = ImageFont.truetype(fonts / "DejaVuSans-Bold.ttf", letters)
            self._pad, self._line = letters // 2, 2 * letters
        width, height = self._size
        frame = Image.new("RGB", (width, height + _even(3 * self._line)), _BACKGROUND)
        frame.paste(image.resize(self._size, Image.Resampling.HAMMING))
        self._draw(ImageDraw.Draw(frame), caption, frame.height)
        return Frame(frame, seconds, caption)

    def _draw(self, draw: ImageDraw.ImageDraw, caption: Caption, bottom: int) -> None:
        (width, top), pad, line = self._size, self._pad, self._line
        middle, left, actor = top + line // 2, pad, caption.actor
        labels = [(caption.outcome.upper(), _INK, _BACKGROUND)]
        if actor is not None:
            ink = _BACKGROUND if actor in (Actor.LEARNER, Actor.FALLBACK) else _INK
            labels.insert(0, (actor.value.upper(), ACTORS[actor], ink))
        for word, colour, ink in labels:
            if word := _cut(self._bold, word, width // 3):
                end = left + round(self._bold.getlength(word)) + 2 * pad
                draw.rectangle((left, top + pad, end, top + line - 2), fill=colour)
                draw.text((left + pad, middle), word, fill=ink, font=self._bold, anchor="lm")
                left = end + pad
        # If there is little room, the action comes before the facts.
        action, right = _cut(self._bold, caption.action, width - pad - left), width - pad
        draw.text((left, middle), action, fill=_INK, font=self._bold, anchor="lm")
        room, facts = right - left - self._bold.getlength(action) - 2 * pad, caption.facts
        while facts and self._plain.getlength("   ".join(facts)) > room:
            facts = facts[1:]
        text = "   ".join(facts)
        draw.text((right, middle), text, fill=_FAINT, font=self._plain, anchor="rm")
        if not caption.marks:
            return
        draw.rectangle((0, top + line, width, bottom), fill=REFUSED)
        # A single reason has a line of its own.
        lines = [f"{mark.what}   {mark.why}" for mark in caption.marks[:2]]
        lines = [*caption.marks[0]] if len(lines) == 1 else lines
        for number, text in enumerate(lines, 1):
            shown, at = _cut(self._bold, text, width - 2 * pad), middle + number * line
            draw.text((pad, at), shown, fill=_INK, font=self._bold, anchor="lm")


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
    run: Run,
    path: Path,
    policy: Policy = "serp",
    episodes: int = 3,
    seed: int = 0,
    on_episode: OnEpisode | None = None,
) -> None:
    """Play a run's policy and write a film of it, an MP4; a failure leaves no file."""
    agent = run.agent
    with (
        replaced_durably(path) as aside,
        run.environment(render_mode_of(run)) as task,
        run.recorder(policy, seed) as recorder,
    ):
        frames = film(agent, task, policy, episodes, seed, on_episode=on_episode, recorder=recorder)
        write_mp4(aside, frames)


def write_mp4(path: Path, frames: Iterator[Frame]) -> None:
    """Write an MP4 of at most 60 frames a second.

    The duration of the first frame, at most 1 s, gives the rate; longer frames are repeated.
    """
    first = next(frames)
    rate = max(round(1.0 / first.seconds, 2), 1.0)  # of which ffmpeg gets two decimals
    output = ["-crf", "20", "-movflags", "+faststart", "-f", "mp4", "-r", f"{min(rate, _MOST_FPS)}"]
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
