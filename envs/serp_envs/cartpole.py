"""The cart-pole of Gymnasium with the limits of the SErP paper, and exact snapshots."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, SupportsInt

import numpy as np
from gymnasium import spaces
from gymnasium.envs.classic_control.cartpole import CartPoleEnv
from numpy.typing import NDArray

START_BOUND = 0.05
"""Each component of an initial state lies within ± this many metres, m/s, radians, rad/s."""

_SNAPSHOT = ("angle_limit", "track_limit", "state", "steps_beyond_terminated", "np_random")
"""The keys of a snapshot."""


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

    ## Snapshots

    `state_dict` and `load_state_dict` save and continue an episode in the middle, exactly.
    They do not include wrappers: the steps counted by `TimeLimit` are not saved.

    ## Version history

    * v0: first release.

    Raises:
        ValueError: A limit is outside its range.
    """

    steps_beyond_terminated: int | None  # type: ignore[assignment]
    """Steps since the episode ended, counted by Gymnasium; None before."""

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

    def state_dict(self) -> dict[str, Any]:
        """Return all that the rest of the episode and later episodes depend on.

        Returns:
            Plain JSON values: the limits, the state in float64, and the state of the generator.
        """
        return {
            "angle_limit": self.theta_threshold_radians,
            "track_limit": self.x_threshold,
            "state": None if self.state is None else [float(value) for value in self.state],
            "steps_beyond_terminated": self.steps_beyond_terminated,
            "np_random": self.np_random.bit_generator.state,
        }

    def load_state_dict(self, snapshot: Mapping[str, Any]) -> None:
        """Continue where `state_dict` was called, on this object or on another.

        Args:
            snapshot: What `state_dict` returned, also after conversion to JSON and back.

        Raises:
            ValueError: It is not a snapshot of this environment, or one with other limits. The
                environment is then unchanged.
        """
        if set(snapshot) != set(_SNAPSHOT):
            raise ValueError(f"a snapshot of CartPole has {_SNAPSHOT}, not {tuple(snapshot)}")
        limits = (snapshot["angle_limit"], snapshot["track_limit"])
        own = (self.theta_threshold_radians, self.x_threshold)
        if limits != own:
            raise ValueError(
                f"the snapshot is of an environment with angle_limit, track_limit = {limits}, "
                f"and this one has {own}"
            )
        state, beyond = snapshot["state"], snapshot["steps_beyond_terminated"]
        if state is not None:
            state = _state_array(state)
        if beyond is not None and not (isinstance(beyond, int) and beyond >= 0):
            raise ValueError(f"steps_beyond_terminated must be null or a count, not {beyond!r}")
        generator = self.np_random.bit_generator
        try:
            generator.state = snapshot["np_random"]
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"np_random is not a state of {type(generator).__name__}") from error
        self.state = state
        self.steps_beyond_terminated = beyond

    def _info(self) -> dict[str, Any]:
        assert self.state is not None
        x, _, theta, _ = self.state
        return {
            "fallen": bool(abs(theta) > self.theta_threshold_radians),
            "off_track": bool(abs(x) > self.x_threshold),
        }


def _state_array(values: Any) -> NDArray[np.float64]:
    """Return the four components of the state in a snapshot.

    Raises:
        ValueError: They are not four finite numbers.
    """
    try:
        state = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"the state must be four numbers, not {values!r}") from error
    if state.shape != (4,) or not np.isfinite(state).all():
        raise ValueError(f"the state must be four finite numbers, not {values!r}")
    return state
