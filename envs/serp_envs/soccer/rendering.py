"""Pictures of a pitch from above, drawn with pygame; the defended goal is at the lower edge."""

from __future__ import annotations

import os
from collections.abc import Sequence
from math import cos, sin
from typing import Any, Final

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from serp_envs.soccer.fields import Field
from serp_envs.soccer.physics.world import World

try:
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    import pygame
except ImportError as error:
    raise DependencyNotInstalled(
        "pictures of the pitch need pygame: pip install 'serp[watch]'"
    ) from error

Color = tuple[int, int, int]
SCALE: Final = 120
"""Pixels per metre."""
SEEN: Final = 6.0
"""How much of the pitch's length a picture shows, m: the defended half and a bit."""
AHEAD: Final = 1.0
"""The picture scrolls up the pitch so as to show this much beyond the ball, m."""
BANNER: Final = 48
"""Height of the strip of text above the pitch, pixels."""
SMOOTH: Final = 4
"""Robots and balls are drawn this much larger and scaled down, for smooth edges."""
CARPET: Final[Color] = (44, 98, 58)
GRASS: Final[Color] = (54, 122, 70)
STRIPE: Final[Color] = (60, 131, 77)
LINE: Final[Color] = (238, 242, 238)
NET: Final[Color] = (120, 158, 128)
POST: Final[Color] = (250, 214, 70)
INK: Final[Color] = (22, 25, 31)
TEXT: Final[Color] = (238, 240, 243)
ALARM: Final[Color] = (255, 92, 80)
NEWS: Final[Color] = (250, 214, 70)
BALL: Final[Color] = (255, 255, 255)
TEAMS: Final[tuple[Color, ...]] = ((66, 133, 244), (236, 98, 58), (246, 168, 138), (150, 180, 250))
"""Colours of the robots, in the order of the world's; the learning one is blue."""
NET_DEPTH: Final = 0.4
"""m."""


class Viewer:
    """Draws worlds on one field, into a picture or a window."""

    def __init__(self, field: Field) -> None:
        pygame.font.init()
        self._field = field
        self._size = (round(2 * SCALE * field.max_y), BANNER + round(SCALE * SEEN))
        self._canvas = pygame.Surface(self._size)
        self._inside = self._canvas.get_rect().inflate(-12, 0)
        self._font = pygame.font.Font(None, 32)
        self._small = pygame.font.Font(None, 25)
        self._pitch = _draw_pitch(field)
        self._top = 0.0
        self._screen: Any = None
        self._clock = pygame.time.Clock()

    def _at(self, x: float, y: float) -> tuple[int, int]:
        return round(SCALE * (self._field.max_y - y)), BANNER + round(SCALE * (self._top - x))

    def draw(
        self,
        world: World,
        teams: Sequence[str],
        words: str = "",
        alarm: bool = False,
        status: str = "",
        outcome: str = "",
    ) -> None:
        """Draw a world.

        Args:
            world: What to draw, on this viewer's field.
            teams: A word for each robot.
            words: What the first robot is doing.
            alarm: Whether that is unsafe.
            status: Game and clock.
            outcome: How the episode ended; nothing while it runs.
        """
        canvas, width, field = self._canvas, self._size[0], self._field
        lowest = SEEN - field.max_x
        self._top = min(max(lowest, world.ball_x + AHEAD), field.max_x)
        canvas.blit(self._pitch, (0, BANNER - round(SCALE * (field.max_x - self._top))))
        places = [self._at(robot.x, robot.y) for robot in world.robots]
        for number, robot in enumerate(world.robots):
            down = robot.down_until > world.tick
            pixels = SCALE * robot.walk.radius
            colour = TEAMS[number % len(TEAMS)]
            self._stamp(_robot(pixels, robot.heading, colour, down), places[number])
        self._stamp(
            _ball(max(4.0, SCALE * field.ball_radius)), self._at(world.ball_x, world.ball_y)
        )
        self._draw_labels(places, teams, SCALE * world.robots[0].walk.radius)
        canvas.fill(INK, (0, 0, width, BANNER))
        middle = BANNER // 2
        self._write(words, ALARM if alarm else TEXT, (16, middle), "midleft")
        self._write(outcome.upper(), NEWS, (width // 2, middle), "center")
        self._write(status, TEXT, (width - 16, middle), "midright")

    def _draw_labels(
        self, places: Sequence[tuple[int, int]], teams: Sequence[str], radius: float
    ) -> None:
        """Write the words beside the robots, each on the side away from the other robots."""
        centre = sum(x for x, _ in places) / len(places)
        for (x, y), team in zip(places, teams, strict=True):
            gap = round(radius) + 10
            # Not over the edge, where a robot stands outside the field.
            left = x < centre if gap + 60 < x < self._size[0] - gap - 60 else x > gap + 60
            self._write(
                team,
                TEXT,
                (x - gap if left else x + gap, y),
                "midright" if left else "midleft",
                self._small,
                backed=True,
            )

    def _stamp(self, image: Any, place: tuple[int, int]) -> None:
        self._canvas.blit(image, image.get_rect(center=place))

    def _write(
        self,
        text: str,
        colour: Color,
        place: tuple[int, int],
        anchor: str,
        font: Any = None,
        backed: bool = False,
    ) -> None:
        if not text:
            return
        font = font or self._font
        image = font.render(text, True, colour)
        where = image.get_rect(**{anchor: place}).clamp(self._inside)
        if backed:
            back = pygame.Surface((where.width + 8, where.height + 4), pygame.SRCALPHA)
            back.fill((*INK, 110))
            self._canvas.blit(back, where.move(-4, -2))
        self._canvas.blit(image, where)

    def picture(self) -> NDArray[np.uint8]:
        """Return what was drawn last, uint8 of shape `(height, width, 3)`."""
        width, height = self._size
        pixels = np.frombuffer(pygame.image.tobytes(self._canvas, "RGB"), np.uint8)
        return pixels.reshape(height, width, 3)

    def show(self, frames_per_second: float) -> None:
        """Put what was drawn last into a window, no more often than that."""
        if self._screen is None:
            pygame.display.init()
            self._screen = pygame.display.set_mode(self._size)
            pygame.display.set_caption("SErP soccer")
        pygame.event.pump()
        self._screen.blit(self._canvas, (0, 0))
        pygame.display.flip()
        self._clock.tick(frames_per_second)

    def close(self) -> None:
        """Close the window; a later `show` opens another."""
        if self._screen is not None:
            pygame.display.quit()
            self._screen = None


def _draw_pitch(field: Field) -> Any:
    """Draw the whole carpet with its lines and goals, at twice the size and scaled down."""
    scale = 2 * SCALE
    size = (round(scale * 2 * field.max_y), round(scale * 2 * field.max_x))
    surface = pygame.Surface(size)

    def at(x: float, y: float) -> tuple[int, int]:
        return round(scale * (field.max_y - y)), round(scale * (field.max_x - x))

    def outline(x: float, width: float, inner: float, colour: Color, pixels: int) -> None:
        half = 0.5 * width
        corners = [at(*c) for c in ((x, half), (inner, half), (inner, -half), (x, -half))]
        pygame.draw.lines(surface, colour, False, corners, pixels)

    half, wide, pixels = 0.5 * field.length, 0.5 * field.width, 9
    surface.fill(CARPET)
    left, top = at(half, wide)
    bands = 12
    for band in range(bands):
        upper = top + round(scale * field.length * band / bands)
        lower = top + round(scale * field.length * (band + 1) / bands)
        colour = STRIPE if band % 2 else GRASS
        surface.fill(colour, (left, upper, round(scale * field.width), lower - upper))
    corner = (*at(half, wide), round(scale * field.width), round(scale * field.length))
    pygame.draw.rect(surface, LINE, corner, pixels)
    pygame.draw.line(surface, LINE, at(0, wide), at(0, -wide), pixels)
    pygame.draw.circle(surface, LINE, at(0, 0), round(scale * field.circle_radius), pixels)
    pygame.draw.circle(surface, LINE, at(0, 0), pixels)
    post = field.half_goal + field.post_radius
    for end in (-1.0, 1.0):
        x = end * half
        outline(x, field.goal_area_width, x - end * field.goal_area_length, LINE, pixels)
        outline(x, field.penalty_width, x - end * field.penalty_length, LINE, pixels)
        pygame.draw.circle(surface, LINE, at(x - end * field.penalty_spot, 0), pixels)
        back = x + end * NET_DEPTH
        for share in np.linspace(0.0, 1.0, 5).tolist():
            row = x + share * end * NET_DEPTH
            pygame.draw.line(surface, NET, at(row, -post), at(row, post), 2)
        for y in np.linspace(-post, post, 2 * round(post / 0.1) + 1).tolist():
            pygame.draw.line(surface, NET, at(x, y), at(back, y), 2)
        outline(x, 2.0 * post, back, LINE, 4)
        pygame.draw.line(surface, LINE, at(x, -post), at(x, post), pixels)
        for y in (-post, post):
            radius = round(scale * field.post_radius)
            pygame.draw.circle(surface, POST, at(x, y), radius)
            pygame.draw.circle(surface, INK, at(x, y), radius, 2)
    return pygame.transform.smoothscale(surface, (size[0] // 2, size[1] // 2))


def _blank(pixels: float) -> tuple[Any, int, float]:
    """Return a transparent square around a disc of a radius, its middle, the scaled radius."""
    half = round(pixels) + 3
    side = 2 * half * SMOOTH
    return pygame.Surface((side, side), pygame.SRCALPHA), half * SMOOTH, pixels * SMOOTH


def _smoothed(surface: Any) -> Any:
    width, height = surface.get_size()
    return pygame.transform.smoothscale(surface, (width // SMOOTH, height // SMOOTH))


def _robot(pixels: float, heading: float, colour: Color, down: bool) -> Any:
    """Draw a disc with a white nose in front; a ring with a cross for a robot that is down."""
    surface, middle, radius = _blank(pixels)
    centre = (middle, middle)

    def at(forward: float, left: float) -> tuple[float, float]:
        c, s = cos(heading), sin(heading)
        x, y = forward * c - left * s, forward * s + left * c
        return middle - radius * y, middle - radius * x

    if down:
        pygame.draw.circle(surface, (*INK, 120), centre, radius)
        pygame.draw.circle(surface, colour, centre, radius, 3 * SMOOTH)
        for sign in (-1.0, 1.0):
            start, end = at(-0.5, -0.5 * sign), at(0.5, 0.5 * sign)
            pygame.draw.line(surface, colour, start, end, 3 * SMOOTH)
    else:
        pygame.draw.circle(surface, INK, centre, radius + SMOOTH)
        pygame.draw.circle(surface, colour, centre, radius - SMOOTH)
        pygame.draw.polygon(surface, TEXT, [at(0.86, 0.0), at(0.12, 0.46), at(0.12, -0.46)])
    return _smoothed(surface)


def _ball(pixels: float) -> Any:
    surface, middle, radius = _blank(pixels)
    pygame.draw.circle(surface, INK, (middle, middle), radius + SMOOTH)
    pygame.draw.circle(surface, BALL, (middle, middle), radius)
    return _smoothed(surface)
