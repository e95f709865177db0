"""A car in a valley whose engine is too weak for the hill: it has to take a run-up."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from gymnasium import spaces

from serp_envs.drawn import BODY, FORCE, GROUND, HEIGHT, INK, WIDTH, DrawnEnv, Observation

GRAVITY: Final = 9.81
"""m/s²; the car has 1 kg."""
FORCES: Final = (-2.5, 0.0, 2.5)
"""Horizontal force of each action, N. Holding the car where the hill is steepest takes 9.81."""
TOP: Final = 1.0
"""Position of the top, m."""
CONTROL_PERIOD: Final = 0.1
"""Seconds from one decision to the next."""
START: Final = (-0.6, -0.4)
"""Bounds of the initial position, m, around the bottom at −0.5; the car starts at rest."""
SOLVED: Final = -50.0
"""A mean return from which the task counts as solved."""

_SUBSTEPS: Final = 4


class Motion(NamedTuple):
    """The state of the car.

    Attributes:
        position: Along the ground, positive to the right, m.
        velocity: Horizontal velocity, m/s.
    """

    position: float
    velocity: float


def height(position: float) -> float:
    """Return the height of the road, m: −0.25 in the valley at −0.5, 0.408 at the top."""
    if position < 0.0:
        return position * position + position
    return position / math.sqrt(1.0 + 5.0 * position * position)


def _acceleration(position: float, velocity: float, force: float) -> float:
    """Return the horizontal acceleration, m/s²: engine, gravity, and the road that bends."""
    if position < 0.0:  # first and second derivative of the height
        slope, curvature = 2.0 * position + 1.0, 2.0
    else:
        root = 1.0 + 5.0 * position * position
        slope, curvature = root**-1.5, -15.0 * position * root**-2.5
    pull = force - GRAVITY * slope - velocity * velocity * slope * curvature
    return pull / (1.0 + slope * slope)


def advance(motion: Motion, force: float) -> Motion:
    """Return the motion a control period later: four steps of Runge and Kutta's fourth order.

    Args:
        motion: The state.
        force: Constant force of the engine, N, positive to the right.
    """
    x, v = motion
    step = CONTROL_PERIOD / _SUBSTEPS
    half = 0.5 * step
    for _ in range(_SUBSTEPS):
        a1 = _acceleration(x, v, force)
        v2 = v + half * a1
        a2 = _acceleration(x + half * v, v2, force)
        v3 = v + half * a2
        a3 = _acceleration(x + half * v2, v3, force)
        v4 = v + step * a3
        a4 = _acceleration(x + step * v3, v4, force)
        x += step / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
        v += step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    return Motion(x, v)


class Hill(DrawnEnv):
    """A car stands in a valley; it has to back up the other side to get over the hill.

    ## Description

    The task is that of Moore, "Efficient Memory-Based Learning for Robot Control" (dissertation,
    Cambridge, 1990), known as the mountain car from Sutton and Barto, "Reinforcement Learning: An
    Introduction" (example 10.1). Road and equation of motion are those of the car on the hill in
    Ernst, Geurts and Wehenkel, "Tree-Based Batch Mode Reinforcement Learning" (Journal of Machine
    Learning Research 6, 2005): 1 kg, gravity 9.81 m/s², and a road that rises like a parabola to
    the left and levels off to the right. In contrast to theirs, the engine has 2.5 N
    instead of 4, so that one run-up is not enough; the road has no end on the left, and speed is
    not limited.

    ## Action space

    `Discrete(3)`. The force acts for one step of 0.1 s.

    | Action | Meaning                   |
    |--------|---------------------------|
    | 0      | drive to the left, −2.5 N |
    | 1      | no force                  |
    | 2      | drive to the right, 2.5 N |

    ## Observation space

    `Box` of shape `(2,)`, float32.

    | Index | Observation           | Unit | Min | Max |
    |-------|-----------------------|------|-----|-----|
    | 0     | position, right is +  | m    | −2  | 2   |
    | 1     | velocity, right is +  | m/s  | −7  | 7   |

    The valley is at −0.5 and the top at 1. No run-up reaches the other bounds.

    ## Reward

    −1 for every step, the last included.

    ## Starting state

    At rest, the position uniform from −0.6 to −0.4 m, from the environment's own generator. Equal
    seeds give equal episodes bit for bit.

    ## Episode end

    1. Termination: the car is at the top, at 1 m or beyond. (`info["at_top"]`)
    2. Truncation: after 200 steps, 20 s, by the `TimeLimit` of `gymnasium.make`.

    ## Solved

    A mean return of at least −50 (`SOLVED`): 5 s to the top. Driving always the way that the car
    rolls is worth −37, driving at random −190.

    ## Arguments

    * `render_mode`: `None`, `"human"` (a window) or `"rgb_array"` (uint8 of shape `(400, 600, 3)`).
    """

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode)
        high = np.array([2.0, 7.0], dtype=np.float32)
        self.observation_space = spaces.Box(-high, high, dtype=np.float32)
        self.action_space = spaces.Discrete(3)  # type: ignore[assignment]
        self.motion = Motion(-0.5, 0.0)
        self._force = 0.0

    def _start(self) -> None:
        self.motion = Motion(float(self.np_random.uniform(*START)), 0.0)
        self._force = 0.0

    def _act(self, action: int) -> None:
        self._force = FORCES[action]
        self.motion = advance(self.motion, self._force)

    def _judge(self, info: dict[str, Any]) -> tuple[float, bool]:
        return -1.0, info["at_top"]

    def _observation(self) -> Observation:
        return np.array(self.motion, dtype=np.float32)

    def _info(self) -> dict[str, Any]:
        return {"at_top": self.motion.position >= TOP}

    def _draw(self, pygame: Any, surface: Any) -> None:
        def pixel(position: float, above: float = 0.0) -> tuple[int, int]:
            return (
                round(WIDTH * (position + 1.8) / 3.0),
                round(HEIGHT * (0.8 - 0.4 * (height(position) + above))),
            )

        road = [pixel(0.02 * k) for k in range(-90, 61)]
        pygame.draw.polygon(surface, GROUND, [*road, (WIDTH, HEIGHT), (0, HEIGHT)])
        pygame.draw.line(surface, INK, pixel(TOP), pixel(TOP, 0.2), 3)
        car = pixel(self.motion.position, 0.05)
        pygame.draw.circle(surface, BODY, car, 12)
        if self._force:
            pygame.draw.line(surface, FORCE, car, (car[0] + round(8.0 * self._force), car[1]), 4)
