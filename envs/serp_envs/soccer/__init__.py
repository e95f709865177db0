"""Robot soccer on pymunk: fields, world, robots, opponents, and the scenarios played on them."""

from __future__ import annotations

from serp_envs.soccer.corner_defender import CornerKickDefender
from serp_envs.soccer.defender import SoccerDefender

__all__ = ["CornerKickDefender", "SoccerDefender"]
