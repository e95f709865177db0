"""A pendulum that its motor is too weak to lift: it has to be swung up."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from gymnasium import spaces

from serp_envs.drawn import BODY, FORCE, HEIGHT, INK, WIDTH, DrawnEnv, Observation

GRAVITY: Final = 9.8
"""m/s²; the mass is 1 kg, and 1 m from the axis."""
FRICTION: Final = 0.01
"""Friction of the axis, N·m per rad/s."""
TORQUES: Final = (-5.0, 0.0, 5.0)
"""Torque of each action, N·m. Holding the pendulum level takes 9.8."""
TOP_SPEED: Final = 4.0 * math.pi
"""Largest angular velocity, rad/s; larger ones are clipped."""
CONTROL_PERIOD: Final = 0.05
"""Seconds from one decision to the next."""
START_BOUND: Final = 0.2
"""Largest initial angle from hanging, rad, and largest initial angular velocity, rad/s."""
SOLVED: Final = 140.0
"""A mean return of the 200 steps of `serp/SwingUp-v0` from which the task counts as solved."""

_SUBSTEPS: Final = 5


class Motion(NamedTuple):
    """The state of the pendulum.

    Attributes:
        angle: Angle from upright, positive to the right, rad; not wrapped.
        speed: Angular velocity, rad/s.
    """

    angle: float
    speed: float


def advance(motion: Motion, torque: float) -> Motion:
    """Return the motion a control period later.

    The equation is Doya's, integrated by semi-implicit Euler over 0.01 s.

    Args:
        motion: The state.
        torque: Constant torque of the motor, N·m, positive to the right.
    """
    angle, speed = motion
    step = CONTROL_PERIOD / _SUBSTEPS
    for _ in range(_SUBSTEPS):
        speed += step * (GRAVITY * math.sin(angle) + torque - FRICTION * speed)
        speed = min(max(speed, -TOP_SPEED), TOP_SPEED)
        angle += step * speed
    return Motion(angle, speed)


class SwingUp(DrawnEnv):
    """A pendulum hangs down; swinging brings it up, and there it is to be held.

    ## Description

    The pendulum with limited torque of Doya, "Reinforcement Learning in Continuous Time and Space"
    (Neural Computation 12, 2000): a mass of 1 kg, 1 m from the axis, gravity 9.8 m/s², friction
    0.01 N·m per rad/s, a motor of 5 N·m. That is about half of what it takes to lift the pendulum,
    so the motor has to swing it to and fro until it gets over the top. Here the motor has three
    torques, and there is a decision every 0.05 s.

    ## Action space

    `Discrete(3)`.

    | Action | Meaning                   |
    |--------|---------------------------|
    | 0      | turn to the left, −5 N·m  |
    | 1      | no torque                 |
    | 2      | turn to the right, +5 N·m |

    ## Observation space

    `Box` of shape `(3,)`, float32. Cosine and sine, as the angle itself would jump at the bottom.

    | Index | Observation                    | Unit  | Min    | Max   |
    |-------|--------------------------------|-------|--------|-------|
    | 0     | cosine of the angle: height    | m     | −1     | 1     |
    | 1     | sine of the angle, right is +  | m     | −1     | 1     |
    | 2     | angular velocity, right is +   | rad/s | −4 π   | 4 π   |

    The angle is 0 upright. Larger angular velocities than 4 π are clipped.

    ## Reward

    The height of the mass, from 0 (hanging) to 1 (upright), after every step: (1 + cosine) / 2.

    ## Starting state

    Hanging: angle and angular velocity uniform within ± 0.2 rad and rad/s of that, from the
    environment's own generator. Equal seeds give equal episodes bit for bit.

    ## Episode end

    Truncation after 200 steps, 10 s, by the `TimeLimit` of `gymnasium.make`; nothing else. The
    info has `upright`: whether the mass is higher than 0.95.

    ## Solved

    A mean return of at least 140 (`SOLVED`). No torque at all is worth 0, torques at random 10, and
    swinging up without a detour 165 to 170.

    ## Arguments

    * `render_mode`: `None`, `"human"` (a window) or `"rgb_array"` (uint8 of shape `(400, 600, 3)`).
    """

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode)
        high = np.array([1.0, 1.0, TOP_SPEED], dtype=np.float32)
        self.observation_space = spaces.Box(-high, high, dtype=np.float32)
        self.action_space = spaces.Discrete(3)  # type: ignore[assignment]
        self.motion = Motion(math.pi, 0.0)
        self._torque = 0.0

    def _start(self) -> None:
        angle, speed = self.np_random.uniform(-START_BOUND, START_BOUND, 2).tolist()
        self.motion = Motion(math.pi + angle, speed)
        self._torque = 0.0

    def _act(self, action: int) -> None:
        self._torque = TORQUES[action]
        self.motion = advance(self.motion, self._torque)

    def _judge(self, info: dict[str, Any]) -> tuple[float, bool]:
        return self._height(), False

    def _height(self) -> float:
        return 0.5 * (1.0 + math.cos(self.motion.angle))

    def _observation(self) -> Observation:
        angle, speed = self.motion
        return np.array([math.cos(angle), math.sin(angle), speed], dtype=np.float32)

    def _info(self) -> dict[str, Any]:
        return {"upright": self._height() > 0.95}

    def _draw(self, pygame: Any, surface: Any) -> None:
        axis = (WIDTH // 2, HEIGHT // 2)
        reach = 0.4 * HEIGHT
        angle = self.motion.angle
        end = (round(axis[0] + reach * math.sin(angle)), round(axis[1] - reach * math.cos(angle)))
        pygame.draw.line(surface, INK, axis, end, 6)
        pygame.draw.circle(surface, BODY, end, 20)
        pygame.draw.circle(surface, INK, axis, 6)
        if self._torque:
            length = round(8.0 * self._torque)
            pygame.draw.line(surface, FORCE, axis, (axis[0] + length, axis[1]), 4)
