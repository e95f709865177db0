"""The soccer defender of the SErP paper, section 4.2, as a Gymnasium environment."""

from __future__ import annotations

from serp_envs.soccer.contest import Contest
from serp_envs.soccer.environment import SoccerEnv
from serp_envs.soccer.fields import field_named


class SoccerDefender(SoccerEnv):
    """TODO."""

    def __init__(
        self,
        field: str = "spl-2020",
        render_mode: str | None = None,
        real_time: bool | None = None,
    ) -> None:
        super().__init__(Contest(field_named(field)), render_mode, real_time)
