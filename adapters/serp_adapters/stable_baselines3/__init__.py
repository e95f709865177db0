"""Stable-baselines3: its learners under serp's arbiter, and beside it in comparisons.

Importing this package without stable-baselines3 raises `serp.errors.MissingExtra`.
"""

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from serp.errors import MissingExtra

if find_spec("stable_baselines3") is None:
    raise MissingExtra("stable-baselines3 (`sb3-dqn`, `ppo`, `maskable-ppo`)", "sb3")

from serp_adapters.stable_baselines3.algorithms import MaskedPPO, StableBaselines3, dqn, ppo

if TYPE_CHECKING:
    from serp_adapters.stable_baselines3.buffer import ExecutedActionBuffer

__all__ = ["ExecutedActionBuffer", "MaskedPPO", "StableBaselines3", "dqn", "ppo"]


def __getattr__(name: str) -> Any:
    """Import the buffer, whose class is one of stable-baselines3's, where it is used."""
    if name != "ExecutedActionBuffer":
        raise AttributeError(f"module `{__name__}` has no attribute `{name}`")
    from serp_adapters.stable_baselines3.buffer import ExecutedActionBuffer

    return ExecutedActionBuffer
