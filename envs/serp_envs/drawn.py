"""The base class of the small environments: seeding, pictures and windows with pygame."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, Final, SupportsInt

import gymnasium as gym
import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

Observation = NDArray[np.float32]

WIDTH: Final = 600
HEIGHT: Final = 400
"""Size of a picture, pixels."""
INK: Final = (40, 40, 40)
PAPER: Final = (255, 255, 255)
GROUND: Final = (110, 140, 90)
BODY: Final = (202, 152, 101)
FORCE: Final = (200, 60, 50)
"""Colours: lines, background, fixed bodies, moving bodies, forces."""


class DrawnEnv(gym.Env[Observation, int]):
    """An environment with discrete actions that can be drawn.

    A subclass defines the start of an episode (`_start`), what an action does (`_act`), what it is
    worth (`_judge`), the observation (`_observation`, `_info`) and the picture (`_draw`). pygame is
    imported when the first picture is drawn: `pip install 'serp[watch]'`.

    Args:
        render_mode: `None`, `"human"` (a window) or `"rgb_array"` (uint8 of shape
            `(400, 600, 3)`).

    Raises:
        ValueError: There is no such render mode.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (gymnasium declares it so)
        "render_modes": ["human", "rgb_array"],
        "render_fps": 20,
    }

    def __init__(self, render_mode: str | None = None) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(
                f"render_mode must be None or one of {self.metadata['render_modes']}, "
                f"not {render_mode!r}"
            )
        self.render_mode = render_mode
        self._surface: Any = None
        self._clock: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode.

        Args:
            seed: Seeds the environment's generator; None: the generator is unchanged.
            options: Not used.

        Returns:
            The observation, float32 of the shape of the observation space, and the info.
        """
        super().reset(seed=seed)
        self._start()
        self._show()
        return self._observation(), self._info()

    def step(self, action: SupportsInt) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Do an action for one control period.

        Returns:
            The observation; the reward; whether the episode ended (terminated); False, as the class
            knows no time limit (truncated); the info.

        Raises:
            AssertionError: There is no such action.
        """
        assert self.action_space.contains(action), f"{action!r} is an invalid action"
        self._act(int(action))
        self._show()
        info = self._info()
        return self._observation(), *self._judge(info), False, info

    @abstractmethod
    def _start(self) -> None:
        """Draw a starting state from `np_random`."""

    @abstractmethod
    def _act(self, action: int) -> None:
        """Move on by a control period."""

    @abstractmethod
    def _judge(self, info: dict[str, Any]) -> tuple[float, bool]:
        """Return the reward of the last step, and whether it ended the episode."""

    @abstractmethod
    def _observation(self) -> Observation:
        """Return the observation of the current state."""

    @abstractmethod
    def _info(self) -> dict[str, Any]:
        """Return the info of the current state."""

    @abstractmethod
    def _draw(self, pygame: Any, surface: Any) -> None:
        """Draw the current state on a blank surface of WIDTH × HEIGHT."""

    def _show(self) -> None:
        """Update the window, if there is one."""
        if self.render_mode == "human":
            self._picture()

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture in the mode `rgb_array`; a window needs no calls.

        Raises:
            DependencyNotInstalled: pygame is not installed.
        """
        if self.render_mode is None:
            gym.logger.warn("render() without a render_mode draws nothing")
            return None
        picture = self._picture()
        return picture if self.render_mode == "rgb_array" else None

    def _picture(self) -> NDArray[np.uint8]:
        try:
            import pygame
        except ImportError as error:
            raise DependencyNotInstalled(
                "pygame is not installed, run `pip install 'serp[watch]'`"
            ) from error
        window = self.render_mode == "human"
        if self._surface is None:
            if window:
                pygame.init()
                self._surface = pygame.display.set_mode((WIDTH, HEIGHT))
                self._clock = pygame.time.Clock()
            else:
                self._surface = pygame.Surface((WIDTH, HEIGHT))
        self._surface.fill(PAPER)
        self._draw(pygame, self._surface)
        if window:
            pygame.event.pump()
            self._clock.tick(self.metadata["render_fps"])
            pygame.display.flip()
        return np.transpose(np.array(pygame.surfarray.pixels3d(self._surface)), axes=(1, 0, 2))

    def close(self) -> None:
        """Close the window, where there is one."""
        if self._clock is not None:
            import pygame

            pygame.display.quit()
            pygame.quit()
        self._surface = self._clock = None
