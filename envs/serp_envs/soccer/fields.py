"""Pitches as data: dimensions, goal and ball of a competition."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final


@dataclass(frozen=True, slots=True)
class Field:
    """A pitch and its ball. Lengths in metres, masses in kilograms.

    The origin is the centre spot. The defended goal is at x = −`length`/2 and y points to the left
    of a robot that looks from its own goal up the field.
    """

    name: str
    """Name for `SoccerDefender(field=…)`."""
    length: float
    """From goal line to goal line."""
    width: float
    """From touchline to touchline."""
    border: float
    """The carpet outside the lines; robots do not leave it on purpose."""
    goal_width: float
    """Between the insides of the posts."""
    post_radius: float
    """Of the round posts."""
    goal_area_length: float
    """Depth of the goal area, drawn only."""
    goal_area_width: float
    """Width of the goal area, drawn only."""
    penalty_length: float
    """Depth of the penalty area, drawn only."""
    penalty_width: float
    """Width of the penalty area, drawn only."""
    penalty_spot: float
    """Distance of the penalty spot from the goal line, drawn only."""
    circle_radius: float
    """Of the centre circle, drawn only."""
    ball_radius: float
    """Of the ball."""
    ball_mass: float
    """Of the ball."""
    ball_deceleration: float
    """Deceleration of the rolling ball on this carpet, m/s²."""
    ball_spin_torque: float
    """Largest torque against the spin of the ball about the vertical, N·m."""

    @property
    def own_goal_x(self) -> float:
        """The x of the defended goal line."""
        return -0.5 * self.length

    @property
    def half_goal(self) -> float:
        """Half the inner width of a goal."""
        return 0.5 * self.goal_width

    @property
    def max_x(self) -> float:
        """Largest x of the carpet."""
        return 0.5 * self.length + self.border

    @property
    def max_y(self) -> float:
        """Largest y of the carpet."""
        return 0.5 * self.width + self.border


SPL_2020: Final = Field(
    name="spl-2020",
    length=9.0,
    width=6.0,
    border=0.7,
    goal_width=1.5,
    post_radius=0.05,
    goal_area_length=0.6,
    goal_area_width=2.2,
    penalty_length=1.65,
    penalty_width=4.0,
    penalty_spot=1.3,
    circle_radius=0.75,
    ball_radius=0.05,
    ball_mass=0.045,
    ball_deceleration=0.30,
    ball_spin_torque=1e-4,
)
"""The RoboCup Standard Platform League of 2020, the field of the paper's section 4.2."""

HSL_SMALL_2026: Final = replace(
    SPL_2020,
    name="hsl-small-2026",
    goal_width=2.6,
    goal_area_length=1.0,
    goal_area_width=3.0,
    penalty_length=2.0,
    penalty_width=5.0,
    penalty_spot=1.5,
    ball_radius=0.11,
    ball_mass=0.43,
    ball_spin_torque=4.6e-3,
)
"""The small size of the RoboCup Humanoid Soccer League of 2026: wider goal, full-size ball.

The ball's mass is the middle of what the laws of the game allow a size 5 ball. Its torque slows the
spin as fast as that of the `spl-2020` ball, 1.8 rad/s².
"""

FIELDS: Final[dict[str, Field]] = {field.name: field for field in (SPL_2020, HSL_SMALL_2026)}
"""The presets by name."""


def field_named(name: str) -> Field:
    """Return the preset of a name.

    Raises:
        ValueError: There is no such field.
    """
    if name not in FIELDS:
        raise ValueError(f"there is no field {name!r}; the fields are {', '.join(FIELDS)}")
    return FIELDS[name]
