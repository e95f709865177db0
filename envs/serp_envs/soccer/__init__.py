"""Robot soccer on pymunk: fields, world, robots, opponents, and the scenarios played on them.

Importing this package without pymunk raises `gymnasium.error.DependencyNotInstalled`.
"""

from __future__ import annotations

from importlib.util import find_spec

from gymnasium.error import DependencyNotInstalled

if find_spec("pymunk") is None:
    raise DependencyNotInstalled("robot soccer needs pymunk: pip install 'serp[soccer]'")

from serp_envs.soccer.corner_defender import CornerKickDefender
from serp_envs.soccer.defender import SoccerDefender

__all__ = ["CornerKickDefender", "SoccerDefender"]
