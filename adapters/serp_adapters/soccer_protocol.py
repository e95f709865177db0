"""How the soccer tasks are trained: the paper's games, and how far exploration may stray."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

PROTOCOL: Final[Mapping[str, Mapping[str, Mapping[str, Any]]]] = {
    # The paper's iteration is a game, 28 of which make a cycle (section 4.2). Refused is what the
    # domain expects to end with a goal or a collision; what loses the ball may be worth a try.
    "paper": {
        "arbiter": {"rho_increment": 0.1, "rho_unit": "game", "r_min": -5.0},
        "training": {"units": 28},
    },
    # Explored is what may end as well as the best plan, or at most half a goal worse.
    # Decisions are few and dear: each is learned from twice.
    "default": {
        "arbiter": {"exploration_slack": 5.0},
        "learner": {"updates_per_step": 2.0},
    },
}
