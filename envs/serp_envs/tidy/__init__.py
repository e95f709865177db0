"""A mobile manipulator that tidies up, in MuJoCo: `pip install 'serp[mujoco]'`."""

from serp_envs.tidy.controllers import MACROS
from serp_envs.tidy.environment import OBSERVED, SPILL, TidyRoom
from serp_envs.tidy.room import PLACES, TABLE, THINGS, Pose, Thing, lies_on_table, stands_at

__all__ = [
    "MACROS",
    "OBSERVED",
    "PLACES",
    "SPILL",
    "TABLE",
    "THINGS",
    "Pose",
    "Thing",
    "TidyRoom",
    "lies_on_table",
    "stands_at",
]
