"""A part of an environment's episodes as an environment, to train on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import gymnasium as gym

from serp_envs.macro_actions import Option, run_option

_MOST_TRIES: Final = 100
"""Most episodes in a row that end before the part begins."""


class SubTask(gym.Wrapper[Any, Any, Any, Any]):
    """The part of another environment's episodes that begins after an option and ends early.

    Like an option that is chosen as an action, a part has one step or more. Whether an option ends
    is a property of the states that it leads to, not of the one in which it is chosen (Sutton,
    Precup and Singh 1999). So `until` may hold where a part begins: it is the first step that shows
    whether it holds any longer, and the part is trained from every state that it is chosen in.

    Args:
        env: The environment of the whole task.
        until: Observation → whether the part is over; asked after every step, which is then
            terminated.
        begin: An option that is run after a reset, so that the part begins where it ends. An
            episode that ends meanwhile is begun anew. None: the part begins with the episode.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        *,
        until: Callable[[Any], bool],
        begin: Option[Any, Any] | None = None,
    ) -> None:
        super().__init__(env)
        self._until = until
        self._begin = begin

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode, and run it to where the part begins.

        Raises:
            gymnasium.error.Error: The option `begin` ended 100 episodes in a row.
        """
        observation, info = self.env.reset(seed=seed, options=options)
        if self._begin is None:
            return observation, info
        for _ in range(_MOST_TRIES):
            answer = run_option(self.env, self._begin, observation)
            if answer is None:  # the part begins at once
                return observation, info
            after, _, terminated, truncated, its_info = answer
            if not (terminated or truncated):
                return after, its_info
            observation, info = self.env.reset(options=options)
        raise gym.error.Error(
            f"{_MOST_TRIES} episodes in a row ended in the option `begin`, before the part began"
        )

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Make a step, which is terminated where the part is over."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, reward, terminated or bool(self._until(observation)), truncated, info
