"""Scenarios as Gymnasium environments: decisions, the game clock, pictures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, SupportsInt

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from serp_envs.soccer.game_clock import GameClock
from serp_envs.soccer.physics.periods import DECISION, TICK, TICKS_PER_DECISION
from serp_envs.soccer.scenario import PLAYING, Ruling, Scenario

if TYPE_CHECKING:
    from serp_envs.soccer.rendering import Viewer

_EACH_TICK: Final = ("human", "rgb_array_list")
"""The render modes that draw a picture each tick, the other one when asked."""


class SoccerEnv(gymnasium.Env[NDArray[np.float32], np.int64]):
    """Episodes of one scenario, chained to games.

    `SoccerDefender` documents it for users; every scenario has its subclass.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012, Gymnasium declares it so
        "render_modes": ["human", "rgb_array", "rgb_array_list"],
        "render_fps": 1.0 / TICK,
    }

    def __init__(self, scenario: Scenario, render_mode: str | None = None) -> None:
        """Create an environment that plays a scenario.

        Raises:
            ValueError: There is no such render mode.
        """
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(
                f"render_mode must be None or one of {self.metadata['render_modes']}, "
                f"not {render_mode!r}"
            )
        self.scenario = scenario
        self.action_space = spaces.Discrete(len(scenario.actions))
        self.observation_space = scenario.observation_space
        self.render_mode = render_mode
        if render_mode == "rgb_array":  # one picture a decision
            self.metadata = {**self.metadata, "render_fps": 1.0 / DECISION}
        self._viewer: Viewer | None = None
        self._frames: list[NDArray[np.uint8]] = []
        self.clock = GameClock()
        """The game; it goes on from episode to episode."""
        self._running = False
        self._outcome = PLAYING
        self._unsafe_choices = 0
        self._action: int | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode.

        Args:
            seed: Seeds the environment's generator; None: the generator is unchanged. The game
                clock is unchanged in both cases.
            options: `game`: the number, from 0, of the game to begin with; with a seed the result
                equals that on a new object.

        Returns:
            The observation and the info.

        Raises:
            ValueError: An option is not known, or there is no such game.
        """
        options = options or {}
        game = options.get("game")
        if set(options) - {"game"}:
            raise ValueError(f"the only option is game, not {', '.join(sorted(options))}")
        if game is not None and (type(game) is not int or game < 0):
            raise ValueError(f"game must be the number of a game, from 0, not {game!r}")
        super().reset(seed=seed)
        self.clock.start(game)
        self._running = True
        self._outcome = PLAYING
        self._unsafe_choices = 0
        self._action = None
        self.scenario.start(self.np_random)
        self._frames = []
        self._show()
        return self.scenario.observe(), self._info()

    def step(
        self, action: SupportsInt
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Do an action for 0.4 s, less when the episode ends before.

        Returns:
            The observation; the reward; whether the episode ended by its rules (terminated);
            whether it was cut off (truncated); the info.

        Raises:
            gymnasium.error.ResetNeeded: No episode is running.
            AssertionError: There is no such action.
        """
        if not self._running:
            raise ResetNeeded("no episode is running: call reset() before step()")
        assert self.action_space.contains(action), f"{action!r} is an invalid action"
        self._action = int(action)
        self._unsafe_choices += self._action in self.scenario.unsafe
        ruling = self._play(self._action)
        reward = self.scenario.reward()
        if ruling is None:
            return self.scenario.observe(), reward, False, False, self._info()
        observation, info = self.scenario.observe(), self._info()
        self.clock.end(TICK * self.scenario.world.tick + ruling.dead_time)
        self._running = False
        return observation, reward + ruling.reward, not ruling.truncated, ruling.truncated, info

    def _play(self, action: int) -> Ruling | None:
        """Execute an action until it or the episode ends."""
        scenario, rng = self.scenario, self.np_random
        command, advance, judge = scenario.command, scenario.world.advance, scenario.judge
        for _ in range(TICKS_PER_DECISION):
            command(action, rng)
            advance()
            ruling = judge()
            if ruling is not None:
                self._outcome = ruling.outcome
            if self.render_mode in _EACH_TICK:
                self._show()
            if ruling is not None:
                return ruling
        return None

    def _info(self) -> dict[str, Any]:
        info = self.scenario.facts()
        info["outcome"] = self._outcome
        info["game"] = self.clock.game
        info["contest"] = self.clock.contest
        info["clock"] = self._seconds()
        info["unsafe_choices"] = self._unsafe_choices
        info["damaging_hits"] = self.scenario.hits
        return info

    def _seconds(self) -> float:
        """Age of the game now, s."""
        return round(self.clock.seconds + TICK * self.scenario.world.tick, 6)

    def state_dict(self) -> dict[str, Any]:
        """Return what outlasts an episode that begins with a seed: the game clock, as JSON values.

        An episode that is running is not part of it.
        """
        return self.clock.state_dict()

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue the game, between two episodes, where `state_dict` was called.

        Raises:
            ValueError: It is not a state of a clock; the environment is then unchanged.
        """
        self.clock.load_state_dict(state)
        self._running = False

    def render(self) -> Any:
        """Return the current picture, or those since the last call.

        Returns:
            `rgb_array`: uint8 of shape `(height, width, 3)`; `rgb_array_list`: a list of them, one
            each 0.1 s; `human` and None: None, a window shows itself.

        Raises:
            gymnasium.error.ResetNeeded: There is nothing to show before the first `reset`.
            gymnasium.error.DependencyNotInstalled: pygame is missing.
        """
        if self.render_mode is None:
            gymnasium.logger.warn(
                "render() shows nothing: the environment was made without a render_mode"
            )
            return None
        if self._action is None and not self._running:
            raise ResetNeeded("there is nothing to render yet: call reset() first")
        if self.render_mode == "rgb_array":
            return self._draw().picture()
        if self.render_mode == "rgb_array_list":
            frames, self._frames = self._frames, []
            return frames
        self._show()
        return None

    def _show(self) -> None:
        """Draw a picture if the mode needs one each tick; a window waits for real time."""
        if self.render_mode == "human":
            self._draw().show(self.metadata["render_fps"])
        elif self.render_mode == "rgb_array_list":
            self._frames.append(self._draw().picture())

    def _draw(self) -> Viewer:
        if self._viewer is None:
            from serp_envs.soccer.rendering import Viewer

            self._viewer = Viewer(self.scenario.field)
        viewer, scenario = self._viewer, self.scenario
        viewer.draw(
            scenario.world,
            scenario.teams,
            words="" if self._action is None else scenario.actions[self._action],
            alarm=self._action in scenario.unsafe,
            status=f"game {self.clock.game + 1}   {_minutes(self._seconds())}",
            outcome="" if self._outcome == PLAYING else self._outcome,
        )
        return viewer

    def close(self) -> None:
        """Close the window."""
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None


def _minutes(seconds: float) -> str:
    whole = int(seconds)
    return f"{whole // 60}:{whole % 60:02d}"
