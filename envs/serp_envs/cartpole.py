"""The cart-pole of Gymnasium with the limits of the SErP paper."""

from __future__ import annotations

import math
from typing import Any, SupportsInt

import numpy as np
from gymnasium import spaces
from gymnasium.envs.classic_control.cartpole import CartPoleEnv
from numpy.typing import NDArray

START_BOUND = 0.05
"""Each component of an initial state lies within ± this many metres, m/s, radians, rad/s."""


class CartPole(CartPoleEnv):
    """A pole stands on a cart; pushing the cart left and right keeps it upright.

    ## Description

    The cart-pole of Barto, Sutton and Anderson, "Neuronlike Adaptive Elements That Can Solve
    Difficult Learning Control Problems" (IEEE Transactions on Systems, Man, and Cybernetics 13,
    1983), with the dynamics of Gymnasium's `CartPole-v1` to the last bit: cart 1 kg, pole 0.1 kg
    and 1 m long, gravity 9.8 m/s², no friction, explicit Euler over 0.02 s in float64. What differs
    is when an episode ends: section 4 of the SErP paper lets the pole lean 15°, Gymnasium 12°.

    ## Action space

    `Discrete(2)`. The force acts for one step of 0.02 s; there is no action without a force.

    | Action | Meaning                    |
    |--------|----------------------------|
    | 0      | push the cart left, −10 N  |
    | 1      | push the cart right, +10 N |

    ## Observation space

    `Box` of shape `(4,)`, float32, the state rounded. The bounds are twice the limits, so that the
    state in which an episode ends is inside; with the default limits:

    | Index | Observation           | Unit  | Min      | Max     |
    |-------|-----------------------|-------|----------|---------|
    | 0     | cart position         | m     | −4.8     | 4.8     |
    | 1     | cart velocity         | m/s   | −∞       | ∞       |
    | 2     | pole angle            | rad   | −0.5236  | 0.5236  |
    | 3     | pole angular velocity | rad/s | −∞       | ∞       |

    Right is positive; angle 0 is upright, and a pole with a positive angle leans right.

    ## Reward

    1.0 for every step, the one that ends the episode included: the return equals the length. A step
    after the end is worth 0.0, and Gymnasium warns of it.

    ## Starting state

    All four components uniform in ±0.05, from the environment's own generator.
    `reset(options={"low": …, "high": …})` takes other bounds. Equal seeds give equal episodes bit
    for bit, on a new object and on a used one.

    ## Episode end

    1. Termination: the pole leans beyond `angle_limit`. (`info["fallen"]`)
    2. Termination: the cart is beyond `track_limit`. (`info["off_track"]`)
    3. Truncation: after 500 steps, by the `TimeLimit` of `gymnasium.make`. The class has no cap.

    Exactly at a limit is not beyond it. Both flags are in the info of `reset` and of every `step`.

    ## Arguments

    * `angle_limit`: largest lean of the pole in rad, above 0.05 and below π/2; 15° (0.2618).
    * `track_limit`: largest distance of the cart from the centre in m, above 0.05; 2.4.
    * `render_mode`: `None`, `"human"` (a window) or `"rgb_array"` (uint8 of shape `(400, 600, 3)`).

    Rendering needs pygame: `pip install 'serp[watch]'`.

    Raises:
        ValueError: A limit is outside its range.
    """

    def __init__(
        self,
        angle_limit: float = math.radians(15.0),
        track_limit: float = 2.4,
        render_mode: str | None = None,
    ) -> None:
        if not START_BOUND < angle_limit < math.pi / 2:
            raise ValueError(
                f"angle_limit must lie between {START_BOUND}, where episodes start, and π/2 rad, "
                f"not {angle_limit!r} (it is in radians)"
            )
        if not START_BOUND < track_limit < math.inf:
            raise ValueError(
                f"track_limit must be finite and above {START_BOUND} m, where episodes start, "
                f"not {track_limit!r}"
            )
        super().__init__(render_mode=render_mode)
        self.theta_threshold_radians = float(angle_limit)
        self.x_threshold = float(track_limit)
        high = np.array(
            [2 * self.x_threshold, np.inf, 2 * self.theta_threshold_radians, np.inf],
            dtype=np.float32,
        )
        self.observation_space = spaces.Box(-high, high, dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode.

        Args:
            seed: Seeds the environment's generator; None: the generator is unchanged.
            options: `low` and `high`, other bounds of the initial state.

        Returns:
            The observation, float32 of shape `(4,)`, and the info.
        """
        observation, _ = super().reset(seed=seed, options=options)
        return observation, self._info()

    def step(
        self, action: SupportsInt
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Push for 0.02 s: 0 to the left, 1 to the right.

        Returns:
            The observation, float32 of shape `(4,)`; the reward; whether the episode ended
            (terminated); False, as the class knows no time limit (truncated); the info.

        Raises:
            AssertionError: The action is neither 0 nor 1, or `reset` was never called.
        """
        observation, reward, terminated, truncated, _ = super().step(action)  # type: ignore[no-untyped-call]
        return observation, reward, terminated, truncated, self._info()

    def _info(self) -> dict[str, Any]:
        assert self.state is not None
        x, _, theta, _ = self.state
        return {
            "fallen": bool(abs(theta) > self.theta_threshold_radians),
            "off_track": bool(abs(x) > self.x_threshold),
        }
