"""Films of a policy as MP4: what the environment draws; below it who acts, and what was refused."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

import matplotlib
from imageio_ffmpeg import write_frames
from PIL import Image, ImageDraw, ImageFont

from serp._util.figures import ACTORS, REFUSED
from serp._util.files import replaced_durably
from serp.agent.agent import Agent
from serp.agent.decision import Actor
from serp.agent.sentences import signed
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


def render_mode_of(run: Run) -> str:
    """Return the render mode that gives the most pictures of a run's environment."""
    with run.environment("rgb_array") as task:
        modes = task.env.metadata.get("render_modes") or ()
        for mode in ("rgb_array_list", "rgb_array"):
            if mode in modes:
                return mode
        raise TaskError(
            f"task {task.name}: the environment draws no pictures; it needs the render mode "
            f"`rgb_array`, but metadata['render_modes'] lists {', '.join(modes) or 'none'}"
        )


class Mark(NamedTuple):
    """An event that is marked red, a veto or an unsafe action, and its reason by the file."""

    what: str
    why: str


class Caption(NamedTuple):
    """The content of a caption; without an actor before the first decision.

    The `facts` are episode, step, return and, at its end, how the episode ended.
    """

    actor: Actor | None
    action: str
    facts: tuple[str, ...]
    marks: tuple[Mark, ...] = ()


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
    recorder: Recorder | None = None,
) -> Iterator[Frame]:
    """Play a policy, as `serp.Run.evaluate` does, and yield the frames of a film.

    The environment of the task, made with a render mode that gives arrays, is not used otherwise.
    """
    camera, draw = Camera(task), _FrameDrawing()
    played = play(agent, task, policy, episodes=episodes, seed=seed, recorder=recorder)
    for episode, steps in enumerate(played, 1):
        number = f"episode {episode}"
        marks: tuple[Mark, ...] = ()
        hold = 0.0
        for picture in camera.take()[-1:]:  # a reset is one moment
            yield draw.frame(picture, camera.period(1), Caption(None, "start", (number,)))
        for step in steps:
            if new := marks_of(agent, step):
                marks, hold = new, HOLD
            decision, pictures = step.decision, camera.take()
            facts = [number, f"step {step.number - 1}", f"return {signed(step.episode.return_)}"]
            name = agent.task.actions.name(decision.action)
            for k, picture in enumerate(pictures, 1):
                seconds, shown = camera.period(len(pictures)), marks if hold > 0.0 else ()
                if step.last and k == len(pictures):
                    seconds = max(seconds + END, hold)
                    facts += filter(None, [outcome_of(step.info)])
                hold -= seconds
                caption = Caption(decision.executed_by, name, tuple(facts), shown)
                yield draw.frame(picture, seconds, caption)


def marks_of(agent: Agent, step: StepRecord) -> tuple[Mark, ...]:
    """Return the marks of a step: a veto, and the execution of an unsafe or risky action."""
    decision, arbiter = step.decision, agent.arbiter
    marks: tuple[Mark, ...] = ()
    if decision.vetoed:
        name = arbiter.actions.name(decision.proposed)
        why = arbiter.explain(decision, step.state).removeprefix(f"{name}: ")
        what = f"Refused in step {step.number - 1}: {name}, proposed by {decision.proposed_by}"
        marks = (Mark(what, why),)
    if int(decision.forecast.flags[decision.action]) & (UNSAFE | RISKY):
        taken = arbiter.alternatives(decision.forecast, step.state)[decision.action]
        what = "Unsafe" if decision.unsafe else "Risky"
        what = f"{what}, executed in step {step.number - 1}: {taken.name}"
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
            font = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans-Bold.ttf"
            self._font = ImageFont.truetype(font, letters)
            self._pad, self._line = letters // 2, 2 * letters
        width, height = self._size
        frame = Image.new("RGB", (width, height + _even(4 * self._line)), _BACKGROUND)
        frame.paste(image.resize(self._size, Image.Resampling.HAMMING))
        self._draw(ImageDraw.Draw(frame), caption, frame.size)
        return Frame(frame, seconds, caption)

    def _draw(self, draw: ImageDraw.ImageDraw, caption: Caption, size: tuple[int, int]) -> None:
        (_, top), pad, line, actor = self._size, self._pad, self._line, caption.actor
        rows, left = [(caption.action, _INK), ("   ".join(caption.facts), _FAINT)], 2 * pad
        if caption.marks:
            draw.rectangle((0, top + 2 * line, *size), fill=REFUSED)
            # A single reason has a line of its own.
            several = len(caption.marks) > 1
            texts = map("   ".join, caption.marks[:2]) if several else caption.marks[0]
            rows += [(text, _INK) for text in texts]
        if actor is not None:
            word, dark = actor.value.upper(), actor in (Actor.LEARNER, Actor.FALLBACK)
            ink, end = _BACKGROUND if dark else _INK, 3 * pad + round(self._font.getlength(word))
            draw.rectangle((pad, top + pad // 2, end, top + line - pad // 2), fill=ACTORS[actor])
            draw.text((2 * pad, top + line // 2), word, fill=ink, font=self._font, anchor="lm")
            left = end + pad
        for number, (text, ink) in enumerate(rows):
            start = 2 * pad if number else left
            while self._font.getlength(text) > size[0] - start - pad and len(text) > 1:
                text = text.removesuffix("…")[:-1] + "…"
            at = start, top + line // 2 + number * line
            draw.text(at, text, fill=ink, font=self._font, anchor="lm")


def _even(length: float) -> int:
    return max(2, 2 * round(length / 2))  # as videos require


def write_film(
    run: Run, path: Path, policy: Policy = "serp", episodes: int = 3, seed: int = 0
) -> None:
    """Play a run's policy and write a film of it, an MP4; a failure leaves no file."""
    agent = run.agent
    with (
        replaced_durably(path) as aside,
        run.environment(render_mode_of(run)) as task,
        run.recorder(policy, seed) as recorder,
    ):
        frames = film(agent, task, policy, episodes, seed, recorder=recorder)
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
