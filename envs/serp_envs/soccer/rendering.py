"""Pictures of a pitch from above, drawn with pygame."""

from __future__ import annotations

import os
from collections.abc import Sequence
from math import cos, sin
from typing import Any, Final

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from serp_envs.soccer.fields import Field
from serp_envs.soccer.world import World

try:
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    import pygame
except ImportError as error:
    raise DependencyNotInstalled(
        "pictures of the pitch need pygame: pip install 'serp[render]'"
    ) from error

Color = tuple[int, int, int]
SCALE: Final = 100.0
"""Pixels per metre."""
BANNER: Final = 40
"""Height of the strip of text above the pitch, pixels."""
GRASS: Final[Color] = (58, 125, 68)
STRIPE: Final[Color] = (64, 134, 74)
LINE: Final[Color] = (240, 240, 240)
INK: Final[Color] = (24, 26, 30)
TEXT: Final[Color] = (236, 236, 236)
ALARM: Final[Color] = (255, 92, 80)
BALL: Final[Color] = (255, 255, 255)
TEAMS: Final[tuple[Color, ...]] = ((66, 133, 244), (234, 97, 60), (150, 180, 250), (244, 160, 130))
"""Colours of the robots, in the order of the world's; the learning one is blue."""
LINE_WIDTH: Final = 4
"""Pixels."""


class Viewer:
    """Draws worlds on one field, into a picture or a window."""

    def __init__(self, field: Field, window: bool = False) -> None:
        """A viewer of that field.

        Args:
            field: The pitch.
            window: Open a window, at the first `show`.
        """
        pygame.font.init()
        self._field = field
        self._size = (
            round(2 * SCALE * field.max_x),
            round(2 * SCALE * field.max_y) + BANNER,
        )
        self._canvas = pygame.Surface(self._size)
        self._font = pygame.font.Font(None, 28)
        self._pitch = self._draw_pitch()
        self._window = window
        self._screen: Any = None

    def _at(self, x: float, y: float) -> tuple[int, int]:
        field = self._field
        return round(SCALE * (x + field.max_x)), BANNER + round(SCALE * (field.max_y - y))

    def _box(self, surface: Any, x: float, width: float, depth: float) -> None:
        """The outline of a rectangle on the goal line at x, that deep into the pitch."""
        inner = x + depth if x < 0.0 else x - depth
        half = 0.5 * width
        corners = [self._at(*c) for c in ((x, half), (inner, half), (inner, -half), (x, -half))]
        pygame.draw.lines(surface, LINE, False, corners, LINE_WIDTH)

    def _draw_pitch(self) -> Any:
        field = self._field
        surface = pygame.Surface(self._size)
        surface.fill(GRASS)
        stripe = max(1, round(SCALE))
        for left in range(0, self._size[0], 2 * stripe):
            surface.fill(STRIPE, (left, BANNER, stripe, self._size[1]))
        half, wide = 0.5 * field.length, 0.5 * field.width
        corners = [
            self._at(*c) for c in ((-half, wide), (half, wide), (half, -wide), (-half, -wide))
        ]
        pygame.draw.lines(surface, LINE, True, corners, LINE_WIDTH)
        pygame.draw.line(surface, LINE, self._at(0, wide), self._at(0, -wide), LINE_WIDTH)
        radius = round(SCALE * field.circle_radius)
        pygame.draw.circle(surface, LINE, self._at(0, 0), radius, LINE_WIDTH)
        post = field.half_goal + field.post_radius
        for x in (-half, half):
            self._box(surface, x, field.goal_area_width, field.goal_area_length)
            self._box(surface, x, field.penalty_width, field.penalty_length)
            spot = x + field.penalty_spot if x < 0.0 else x - field.penalty_spot
            pygame.draw.circle(surface, LINE, self._at(spot, 0), LINE_WIDTH)
            back = x - 0.5 if x < 0.0 else x + 0.5
            net = [self._at(*c) for c in ((x, post), (back, post), (back, -post), (x, -post))]
            pygame.draw.lines(surface, (190, 200, 190), False, net, 2)
            for y in (-post, post):
                width = max(3, round(SCALE * field.post_radius))
                pygame.draw.circle(surface, (250, 220, 60), self._at(x, y), width)
        surface.fill(INK, (0, 0, self._size[0], BANNER))
        return surface

    def draw(
        self,
        world: World,
        teams: Sequence[str],
        words: str = "",
        alarm: bool = False,
        status: str = "",
        outcome: str = "",
        caption: str = "",
    ) -> None:
        """Draw a world.

        Args:
            world: What to draw, on this viewer's field.
            teams: A word for each robot.
            words: What the first robot is doing.
            alarm: Whether that is unsafe.
            status: Game and clock.
            outcome: How the episode ended; nothing while it runs.
            caption: A line below the pitch.
        """
        canvas = self._canvas
        canvas.blit(self._pitch, (0, 0))
        for number, (robot, team) in enumerate(zip(world.robots, teams, strict=True)):
            down = robot.down_until > world.tick
            self._robot(robot.x, robot.y, robot.heading, robot.walk.radius, number, down, team)
        ball = self._at(world.ball_x, world.ball_y)
        radius = max(4, round(SCALE * self._field.ball_radius))
        pygame.draw.circle(canvas, BALL, ball, radius)
        pygame.draw.circle(canvas, INK, ball, radius, 1)
        width, height = self._size
        self._write(words, ALARM if alarm else TEXT, (12, BANNER // 2), "midleft")
        self._write(outcome.upper(), (250, 220, 60), (width // 2, BANNER // 2), "center")
        self._write(status, TEXT, (width - 12, BANNER // 2), "midright")
        self._write(caption, TEXT, (width // 2, height - 18), "center")

    def _robot(
        self, x: float, y: float, heading: float, radius: float, number: int, down: bool, team: str
    ) -> None:
        colour = TEAMS[number % len(TEAMS)]
        centre = self._at(x, y)
        pixels = round(SCALE * radius)
        if down:
            pygame.draw.circle(self._canvas, colour, centre, pixels, 3)
            arm = pixels // 2
            for sign in (-1, 1):
                start = (centre[0] - arm, centre[1] - sign * arm)
                end = (centre[0] + arm, centre[1] + sign * arm)
                pygame.draw.line(self._canvas, colour, start, end, 3)
        else:
            pygame.draw.circle(self._canvas, colour, centre, pixels)
            nose = self._at(x + radius * cos(heading), y + radius * sin(heading))
            pygame.draw.line(self._canvas, INK, centre, nose, 4)
        # Labels above and below, so that those of two robots in a duel do not meet.
        away = pixels + 12
        label = (centre[0], centre[1] + (away if number % 2 == 0 else -away))
        self._write(team, LINE, label, "center")

    def _write(self, text: str, colour: Color, place: tuple[int, int], anchor: str) -> None:
        if text:
            image = self._font.render(text, True, colour)
            self._canvas.blit(image, image.get_rect(**{anchor: place}))

    def picture(self) -> NDArray[np.uint8]:
        """What was drawn last, uint8 of shape `(height, width, 3)`."""
        pixels: NDArray[np.uint8] = pygame.surfarray.array3d(self._canvas)
        return np.ascontiguousarray(pixels.transpose(1, 0, 2))

    def show(self) -> None:
        """Put what was drawn last into the window."""
        if not self._window:
            return
        if self._screen is None:
            pygame.display.init()
            self._screen = pygame.display.set_mode(self._size)
            pygame.display.set_caption("SErP soccer")
        pygame.event.pump()
        self._screen.blit(self._canvas, (0, 0))
        pygame.display.flip()

    def close(self) -> None:
        """Close the window; a later `show` opens another."""
        if self._screen is not None:
            pygame.display.quit()
            self._screen = None
