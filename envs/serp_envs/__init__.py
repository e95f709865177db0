"""Plain Gymnasium environments, usable without serp.

Importing this package registers them; Gymnasium imports it by itself where an id names it:

    import gymnasium
    env = gymnasium.make("serp_envs:serp/CartPole-v0")
"""

from __future__ import annotations

import gymnasium

from serp_envs.cartpole import CartPole
from serp_envs.soccer import SoccerDefender

__all__ = ["CartPole", "SoccerDefender", "register"]


def register() -> None:
    """Put the environments of this package into Gymnasium's registry, those it lacks.

    Importing the package has done this already. Call it again where the registry was emptied since.
    """
    if "serp/CartPole-v0" not in gymnasium.registry:
        gymnasium.register(
            id="serp/CartPole-v0",
            entry_point="serp_envs.cartpole:CartPole",
            max_episode_steps=500,
            reward_threshold=475.0,
        )
    if "serp/SoccerDefender-v0" not in gymnasium.registry:
        gymnasium.register(
            id="serp/SoccerDefender-v0", entry_point="serp_envs.soccer:SoccerDefender"
        )


register()
