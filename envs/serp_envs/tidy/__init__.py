"""A mobile manipulator that tidies up, in MuJoCo: `pip install 'serp[mujoco]'`."""

from serp_envs.tidy.controllers import MACROS
from serp_envs.tidy.environment import OBSERVED, SPILL, TidyRoom
from serp_envs.tidy.room import FACING, PLACES, ROOM, TABLE, THINGS, Pose, Thing

__all__ = [
    "FACING",
    "MACROS",
    "OBSERVED",
    "PLACES",
    "ROOM",
    "SPILL",
    "TABLE",
    "THINGS",
    "Pose",
    "Thing",
    "TidyRoom",
]
