"""Shows a film in a pygame window."""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Iterable
from typing import Any

from PIL import ImageOps

from serp.errors import SerpError, needs_extra
from serp.runs.run import Run
from serp.ui.pictures.film import FilmSettings, Frame, OnEpisode, film_of_run


class NoDisplay(SerpError):
    """There is no screen to open a window on."""

    def __init__(self, why: str) -> None:
        super().__init__(
            f"no window can be opened here ({why}); write a file instead: --out FILE.gif"
        )


def show_film(
    run: Run, settings: FilmSettings, title: str, on_episode: OnEpisode | None = None
) -> None:
    """Play a run's policy in a window, until its end or until the window is closed.

    Raises:
        MissingExtra: Pygame is not installed.
        NoDisplay: There is no screen.
        SerpError: The run or task cannot be loaded or draws no pictures, or its environment failed.
    """
    with Window(title) as window:
        width, height = window.limits
        within = dataclasses.replace(
            settings,
            width=min(settings.width or width, width),
            height=min(settings.height or height, height),
        )
        with film_of_run(run, within, on_episode) as frames:
            window.show(frames)


class Window:
    """A window that opens with its first frame. Space pauses, Escape and Q close it.

    Attributes:
        limits: Width and height, pixels, that pictures should keep within.

    Raises:
        MissingExtra: Pygame is not installed.
        NoDisplay: There is no screen.
    """

    def __init__(self, title: str) -> None:
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        with needs_extra("watch", "a window"):
            import pygame
        self._pygame: Any = pygame
        self._title = title
        self._screen: Any = None
        try:
            pygame.display.init()
            ((width, height), *_) = pygame.display.get_desktop_sizes()
        except pygame.error as error:
            raise NoDisplay(str(error)) from error
        if (driver := pygame.display.get_driver()) in ("dummy", "offscreen"):
            raise NoDisplay(f"SDL uses the driver {driver}")
        self.limits = (width, round(0.8 * height))

    def __enter__(self) -> Window:
        return self

    def __exit__(self, *exception: object) -> None:
        self._pygame.display.quit()

    def show(self, frames: Iterable[Frame]) -> bool:
        """Show frames; return whether all were shown before the window was closed."""
        pygame = self._pygame
        due = time.monotonic()
        paused = False
        for frame in frames:
            self._draw(frame)
            due = max(due + frame.seconds, time.monotonic())  # delays are not made up for
            waiting = True
            while waiting:
                remaining = due - time.monotonic()
                event = pygame.event.wait(50 if paused else max(1, round(1000 * remaining)))
                key = event.key if event.type == pygame.KEYDOWN else None
                if event.type == pygame.QUIT or key in (pygame.K_ESCAPE, pygame.K_q):
                    return False
                paused ^= key == pygame.K_SPACE
                waiting = paused or time.monotonic() < due
        return True

    def _draw(self, frame: Frame) -> None:
        pygame, image = self._pygame, frame.image
        if self._screen is None:
            try:
                # Not pygame.SCALED: its renderer outlives the display, and a second window crashes
                # (https://github.com/pygame/pygame/issues/2660).
                self._screen = pygame.display.set_mode(image.size, pygame.RESIZABLE)
            except pygame.error as error:
                raise NoDisplay(str(error)) from error
            pygame.display.set_caption(self._title)
        image = ImageOps.pad(image, self._screen.get_size())
        surface = pygame.image.frombuffer(image.tobytes(), image.size, "RGB")
        self._screen.blit(surface, (0, 0))
        pygame.display.flip()
