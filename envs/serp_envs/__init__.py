"""Plain Gymnasium environments, usable without serp.

Importing this package registers them; Gymnasium imports it by itself where an id names it:

    import gymnasium
    env = gymnasium.make("serp_envs:serp/CartPole-v0")
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import gymnasium

from serp_envs import hill, landing, swing_up
from serp_envs.cartpole import CartPole
from serp_envs.hill import Hill
from serp_envs.landing import Landing
from serp_envs.macro_actions import MacroActions, Option, option
from serp_envs.sub_task import SubTask
from serp_envs.swing_up import SwingUp

if TYPE_CHECKING:
    from serp_envs.soccer import CornerKickDefender, SoccerDefender

__all__ = [
    "CartPole",
    "CornerKickDefender",
    "Hill",
    "Landing",
    "MacroActions",
    "Option",
    "SoccerDefender",
    "SubTask",
    "SwingUp",
    "option",
]

_ENVIRONMENTS: Final[dict[str, dict[str, Any]]] = {
    "serp/CartPole-v0": {
        "entry_point": "serp_envs.cartpole:CartPole",
        "max_episode_steps": 500,
        "reward_threshold": 475.0,
    },
    "serp/Hill-v0": {
        "entry_point": "serp_envs.hill:Hill",
        "max_episode_steps": 200,
        "reward_threshold": hill.SOLVED,
    },
    "serp/Landing-v0": {
        "entry_point": "serp_envs.landing:Landing",
        "max_episode_steps": 200,
        "reward_threshold": landing.SOLVED,
    },
    "serp/SwingUp-v0": {
        "entry_point": "serp_envs.swing_up:SwingUp",
        "max_episode_steps": 200,
        "reward_threshold": swing_up.SOLVED,
    },
    "serp/TidyRoom-v0": {"entry_point": "serp_envs.tidy:TidyRoom", "max_episode_steps": 80},
    # These end their episodes by themselves.
    "serp/SoccerDefender-v0": {"entry_point": "serp_envs.soccer:SoccerDefender"},
    "serp/CornerKick-v0": {"entry_point": "serp_envs.soccer:CornerKickDefender"},
}


def __getattr__(name: str) -> Any:
    """Import the soccer environments on first access: only they need pymunk."""
    if name not in ("CornerKickDefender", "SoccerDefender"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from serp_envs import soccer

    return getattr(soccer, name)


for _name, _specification in _ENVIRONMENTS.items():
    gymnasium.register(id=_name, **_specification)
