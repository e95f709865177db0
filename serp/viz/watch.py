"""Shows a trained policy in a window, or writes a film of it."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

from serp._util.files import replaced_durably
from serp.errors import SerpError
from serp.training.run import Run
from serp.viz.camera import render_mode_of
from serp.viz.film import EpisodeResult, FilmSettings, Frame, film
from serp.viz.gif import write_gif
from serp.viz.video import find_ffmpeg, write_mp4
from serp.viz.window import Window

KINDS: Final = (".gif", ".mp4")
"""Suffixes of films."""
OnEpisode = Callable[[EpisodeResult], None]


class FilmFile(NamedTuple):
    """A film that was written.

    Attributes:
        path: The file.
        frames: Number of frames.
        seconds: Duration.
        size: Size in bytes.
    """

    path: Path
    frames: int
    seconds: float
    size: int


def write_film(
    run: Run, path: Path, settings: FilmSettings, on_episode: OnEpisode | None = None
) -> FilmFile:
    """Play a run's policy and write a film of it; a failure leaves no file.

    Args:
        run: The run.
        path: The file, with one of the suffixes `KINDS`; an existing one is replaced.
        settings: How the film is made.
        on_episode: Called at the end of each episode.

    Raises:
        MissingExtra: It is an MP4, and imageio-ffmpeg is not installed.
        RunError: The file cannot be written, or the run not be read.
        SerpError: The task cannot be loaded or draws no pictures, or its environment failed.
    """
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise SerpError(f"{path}: a film is a GIF or an MP4; name a file that ends in one of them")
    if kind == ".mp4":
        find_ffmpeg()  # fails before the pictures are made
    write = write_gif if kind == ".gif" else write_mp4
    seconds = 0.0

    def counted(frames: Iterator[Frame]) -> Iterator[Frame]:
        nonlocal seconds
        for frame in frames:
            seconds += frame.seconds
            yield frame

    with (
        _no_screen(),
        replaced_durably(path) as aside,
        _filmed(run, settings, on_episode) as frames,
    ):
        count = write(aside, counted(frames))
    return FilmFile(path, count, seconds, path.stat().st_size)


def show_film(
    run: Run, settings: FilmSettings, title: str, on_episode: OnEpisode | None = None
) -> bool:
    """Play a run's policy in a window; return whether all of it was shown.

    Raises:
        MissingExtra: Pygame is not installed.
        NoDisplay: There is no screen.
        SerpError: The run or task cannot be loaded or draws no pictures, or its environment failed.
    """
    with Window(title) as window:
        width, height = window.limits
        within = settings.replace(
            width=min(settings.width or width, width),
            height=min(settings.height or height, height),
        )
        with _filmed(run, within, on_episode) as frames:
            return window.show(frames)


@contextlib.contextmanager
def _filmed(
    run: Run, settings: FilmSettings, on_episode: OnEpisode | None
) -> Iterator[Iterator[Frame]]:
    agent = run.agent
    with run.environment(render_mode_of(run)) as task:
        yield film(agent, task, settings, on_episode)


@contextlib.contextmanager
def _no_screen() -> Iterator[None]:
    """Let environments that draw with SDL use no screen, unless the user sets a driver."""
    name = "SDL_VIDEODRIVER"
    if name in os.environ:
        yield
        return
    os.environ[name] = "dummy"
    try:
        yield
    finally:
        del os.environ[name]
