"""A lander that comes down through an atmosphere and has to touch its pad softly."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from gymnasium import spaces

from serp_envs.drawn import BODY, FORCE, GROUND, HEIGHT, INK, WIDTH, DrawnEnv, Observation

GRAVITY: Final = 1.35
"""Gravity of Titan, m/s²."""
DRAG: Final = 0.05
"""Drag of the air, 1/m: deceleration divided by the square of the speed."""
THRUSTS: Final = ((0.0, 0.0), (-1.0, 0.0), (1.0, 0.0), (0.0, 3.0))
"""Thrust of each action, to the right and up, m/s²."""
PAD: Final = 2.0
"""Half the width of the pad, m; its middle is at 0."""
SOFT: Final = 1.0
"""Largest speed of a landing downwards, m/s; sideways it is half of it."""
REACH: Final = (10.0, 20.0)
"""Largest distance to the side and largest height of the lander, m."""
CONTROL_PERIOD: Final = 0.1
"""Seconds from one decision to the next."""
START: Final = ((-4.0, 4.0), (10.0, 14.0), (-0.5, 0.5), (-1.0, 0.0))
"""Bounds of the start: to the side, height, m; sideways, upwards, m/s."""
SOLVED: Final = 0.9
"""A mean return from which the task counts as solved."""

_SUBSTEPS: Final = 2


class Motion(NamedTuple):
    """The state of the lander.

    Attributes:
        offset: Distance from the middle of the pad, positive to the right, m.
        height: Height of its feet above the ground, m.
        sideways: Horizontal velocity, m/s.
        upwards: Vertical velocity, m/s.
    """

    offset: float
    height: float
    sideways: float
    upwards: float


def advance(motion: Motion, thrust: tuple[float, float]) -> Motion:
    """Return the motion a control period later, as if there were no ground.

    Semi-implicit Euler over 0.05 s.

    Args:
        motion: The state.
        thrust: Constant acceleration by the engines, to the right and up, m/s².
    """
    offset, height, sideways, upwards = motion
    step = CONTROL_PERIOD / _SUBSTEPS
    for _ in range(_SUBSTEPS):
        drag = DRAG * math.hypot(sideways, upwards)
        sideways += step * (thrust[0] - drag * sideways)
        upwards += step * (thrust[1] - GRAVITY - drag * upwards)
        offset += step * sideways
        height += step * upwards
    return Motion(offset, height, sideways, upwards)


class Landing(DrawnEnv):
    """A lander falls through thick air; it has to touch the pad, and softly.

    ## Description

    A plain relative of Gymnasium's `LunarLander`: a point that does not turn, with one engine at a
    time, none of them throttled. Gravity is that of Saturn's moon Titan, 1.35 m/s²; the drag of
    its thick air grows with the square of the speed, as for any blunt body (Lorenz and others,
    "Dragonfly: A Rotorcraft Lander Concept for Scientific Exploration at Titan", Johns Hopkins APL
    Technical Digest 34, 2018, describe such a place), and slows a free fall down to 5.2 m/s.

    ## Action space

    `Discrete(4)`. The engine burns for one step of 0.1 s.

    | Action | Meaning                        |
    |--------|--------------------------------|
    | 0      | no engine                      |
    | 1      | push to the left, 1 m/s²       |
    | 2      | push to the right, 1 m/s²      |
    | 3      | main engine, 3 m/s² upwards    |

    ## Observation space

    `Box` of shape `(4,)`, float32.

    | Index | Observation                                  | Unit | Min | Max |
    |-------|----------------------------------------------|------|-----|-----|
    | 0     | offset from the middle of the pad, right is + | m   | −12 | 12  |
    | 1     | height of the feet above the ground          | m    | −2  | 22  |
    | 2     | velocity sideways, right is +                | m/s  | −10 | 10  |
    | 3     | velocity upwards                             | m/s  | −10 | 10  |

    ## Reward

    1 for a landing, −1 for a crash or for getting lost, 0 for every other step.

    ## Starting state

    Uniform from the environment's own generator: offset within ± 4 m, height 10 to 14 m, sideways
    within ± 0.5 m/s, upwards −1 to 0 m/s. Equal seeds give equal episodes bit for bit.

    ## Episode end

    1. Termination: the feet touch the ground, height ≤ 0. It is a landing (`info["landed"]`) on the
       pad, at most 2 m from its middle, at no more than 1 m/s downwards and 0.5 m/s sideways. All
       else is a crash (`info["crashed"]`).
    2. Termination: the lander is lost, more than 10 m to the side or 20 m high. (`info["lost"]`)
    3. Truncation: after 200 steps, 20 s, by the `TimeLimit` of `gymnasium.make`.

    All three flags are in the info of `reset` and of every `step`.

    ## Solved

    A mean return of at least 0.9 (`SOLVED`): all but a few land. Engines at random hardly ever do.

    ## Arguments

    * `render_mode`: `None`, `"human"` (a window) or `"rgb_array"` (uint8 of shape `(400, 600, 3)`).
    """

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode)
        self.observation_space = spaces.Box(
            np.array([-12.0, -2.0, -10.0, -10.0], dtype=np.float32),
            np.array([12.0, 22.0, 10.0, 10.0], dtype=np.float32),
            dtype=np.float32,
        )
        self.action_space = spaces.Discrete(4)  # type: ignore[assignment]
        self.motion = Motion(0.0, START[1][0], 0.0, 0.0)
        self._thrust = THRUSTS[0]

    def _start(self) -> None:
        low, high = zip(*START, strict=True)
        self.motion = Motion(*self.np_random.uniform(low, high).tolist())
        self._thrust = THRUSTS[0]

    def _act(self, action: int) -> None:
        self._thrust = THRUSTS[action]
        self.motion = advance(self.motion, self._thrust)

    def _judge(self, info: dict[str, Any]) -> tuple[float, bool]:
        reward = 1.0 if info["landed"] else -1.0 if info["crashed"] or info["lost"] else 0.0
        return reward, reward != 0.0

    def _observation(self) -> Observation:
        return np.array(self.motion, dtype=np.float32)

    def _info(self) -> dict[str, Any]:
        offset, height, sideways, upwards = self.motion
        down = height <= 0.0
        soft = abs(offset) <= PAD and upwards >= -SOFT and abs(sideways) <= 0.5 * SOFT
        return {
            "landed": down and soft,
            "crashed": down and not soft,
            "lost": not down and (abs(offset) > REACH[0] or height > REACH[1]),
        }

    def _draw(self, pygame: Any, surface: Any) -> None:
        metre = HEIGHT / 22.0
        floor = round(HEIGHT - metre)

        def pixel(offset: float, above: float) -> tuple[int, int]:
            return round(WIDTH / 2 + metre * offset), round(floor - metre * above)

        pygame.draw.rect(surface, GROUND, (0, floor, WIDTH, HEIGHT - floor))
        pygame.draw.line(surface, INK, pixel(-PAD, 0.0), pixel(PAD, 0.0), 5)
        offset, height = self.motion[:2]
        middle = pixel(offset, height + 0.6)
        for side in (-0.5, 0.5):
            pygame.draw.line(surface, INK, middle, pixel(offset + side, height), 3)
        if any(self._thrust):
            across, up = self._thrust
            end = (middle[0] - round(12.0 * across), middle[1] + round(12.0 * up))
            pygame.draw.line(surface, FORCE, middle, end, 6)
        pygame.draw.circle(surface, BODY, middle, 9)
