"""Shows frames in a pygame window."""

from __future__ import annotations

import os
import sys
import time
import warnings
from collections.abc import Iterable
from typing import Any, Final

from serp.errors import MissingExtra, SerpError
from serp.viz.film import Frame

FASTEST: Final = 60.0
"""Largest number of frames per second."""
_SHARE = 0.8  # largest share of the screen's height for the pictures
_ADVICE = "write a file instead: --out FILE.gif"
_NO_SCREEN = ("dummy", "offscreen")  # SDL's drivers that show nothing


class NoDisplay(SerpError):
    """There is no screen to open a window on."""

    def __init__(self, why: str) -> None:
        super().__init__(f"no window can be opened here ({why}); {_ADVICE}")


def require_display() -> None:
    """Check by the environment variables that a window can be opened.

    Raises:
        MissingExtra: Pygame is not installed.
        NoDisplay: There is no screen.
    """
    _pygame()
    driver = os.environ.get("SDL_VIDEODRIVER", "")
    if driver in _NO_SCREEN:
        raise NoDisplay(f"SDL_VIDEODRIVER is {driver}")
    graphical = sys.platform in ("win32", "darwin") or driver not in ("", "x11", "wayland")
    if not (graphical or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise NoDisplay("neither DISPLAY nor WAYLAND_DISPLAY is set")


def _pygame() -> Any:
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        import pygame
    except ImportError:
        error = MissingExtra("a window", "watch")
        error.add_note(f"Or {_ADVICE}")
        raise error from None
    return pygame


class Window:
    """A window that opens with its first frame. Space pauses, Escape and Q close it.

    Args:
        title: Its title.

    Raises:
        MissingExtra: Pygame is not installed.
        NoDisplay: There is no screen.
    """

    def __init__(self, title: str) -> None:
        self._pygame = _pygame()
        self._title = title
        self._screen: Any = None
        try:
            self._pygame.display.init()
            sizes = self._pygame.display.get_desktop_sizes()
        except self._pygame.error as error:
            raise NoDisplay(str(error)) from error
        self.limits = (sizes[0][0], round(_SHARE * sizes[0][1]))
        """Width and height, pixels, that pictures should keep within."""

    def __enter__(self) -> Window:
        return self

    def __exit__(self, *exception: object) -> None:
        self._pygame.display.quit()

    def show(self, frames: Iterable[Frame]) -> bool:
        """Show frames; return whether all were shown before the window was closed."""
        due = time.monotonic()
        for frame in frames:
            self._draw(frame)
            due += frame.seconds
            now = time.monotonic()
            due = max(due, now)  # delays are not made up for
            while (now := time.monotonic()) < due:
                paused = self._wait(due - now)
                if paused is None:
                    return False
                due += paused
            if self._wait(0.0) is None:
                return False
        return True

    def _draw(self, frame: Frame) -> None:
        pygame, image = self._pygame, frame.image
        if self._screen is None:
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # "no fast renderer": it is fast enough
                    self._screen = pygame.display.set_mode(
                        image.size, pygame.SCALED | pygame.RESIZABLE
                    )
            except pygame.error as error:
                raise NoDisplay(str(error)) from error
            pygame.display.set_caption(self._title)
        surface = pygame.image.frombuffer(image.tobytes(), image.size, "RGB")
        self._screen.blit(surface, (0, 0))
        pygame.display.flip()

    def _wait(self, seconds: float) -> float | None:
        """Wait for a time or a key; return the time of a pause, None if the window is closed."""
        pygame = self._pygame
        event = (
            pygame.event.wait(round(1000 * seconds)) if seconds >= 0.001 else pygame.event.poll()
        )
        if self._closes(event):
            return None
        if event.type != pygame.KEYDOWN or event.key != pygame.K_SPACE:
            return 0.0
        begun = time.monotonic()
        while True:
            event = pygame.event.wait()
            if self._closes(event):
                return None
            if event.type == pygame.KEYDOWN and event.key == pygame.K_SPACE:
                return time.monotonic() - begun

    def _closes(self, event: Any) -> bool:
        pygame = self._pygame
        return bool(
            event.type == pygame.QUIT
            or (event.type == pygame.KEYDOWN and event.key in (pygame.K_ESCAPE, pygame.K_q))
        )
