"""Stable-baselines3: its learners under serp's arbiter, and beside it in comparisons.

Importing this package without stable-baselines3 raises `serp.errors.MissingExtra`.
"""

from importlib.util import find_spec

from serp.errors import MissingExtra

if find_spec("stable_baselines3") is None:
    raise MissingExtra("what is of stable-baselines3 (`sb3-dqn`, `ppo`)", "sb3")

from serp_adapters.stable_baselines3.algorithms import StableBaselines3, dqn, ppo
from serp_adapters.stable_baselines3.buffer import ExecutedActionBuffer

__all__ = ["ExecutedActionBuffer", "StableBaselines3", "dqn", "ppo"]
