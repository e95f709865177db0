"""Scenarios as Gymnasium environments: decisions, the game clock, snapshots, pictures."""

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
from serp_envs.soccer.real_time import Pacer
from serp_envs.soccer.scenario import PLAYING, Ruling, Scenario

if TYPE_CHECKING:
    from serp_envs.soccer.rendering import Viewer

_EACH_TICK: Final = ("human", "rgb_array_list")
"""The render modes that draw a picture each tick, the other one when asked."""

_SNAPSHOT: Final = ("scenario", "field", "clock", "np_random", "actions")
"""The keys of a snapshot."""


class SoccerEnv(gymnasium.Env[NDArray[np.float32], np.int64]):
    """Episodes of one scenario, chained to games.

    `SoccerDefender` documents it for users; every scenario has its subclass.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012, Gymnasium declares it so
        "render_modes": ["human", "rgb_array", "rgb_array_list"],
        "render_fps": 1.0 / TICK,
    }

    def __init__(
        self, scenario: Scenario, render_mode: str | None = None, real_time: bool | None = None
    ) -> None:
        """Create an environment.

        Args:
            scenario: What is played.
            render_mode: One of `metadata["render_modes"]` or None.
            real_time: Whether a second takes a second; None for "with a window only".

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
        paced = render_mode == "human" if real_time is None else real_time
        self._pacer = Pacer() if paced else None
        self.caption = ""
        """A line of text for the pictures."""
        self._viewer: Viewer | None = None
        self._frames: list[NDArray[np.uint8]] = []
        self.clock = GameClock()
        """The game; it goes on from episode to episode."""
        self._generator: Mapping[str, Any] | None = None
        self._actions: list[int] | None = None
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
            options: `new_game`: True to begin with the kick-off of the next game. `game`: the
                number, from 0, of the game to begin with; with a seed the result equals that on a
                new object. At most one of the two.

        Returns:
            The observation and the info.

        Raises:
            ValueError: An option is not known, or there is no such game.
        """
        game = self._game_of(options or {})
        super().reset(seed=seed)
        if game is None:
            self.clock.start()
        else:
            self.clock.kick_off(game)
        self._begin()
        self._show(restart=True)
        return self.scenario.observe(), self._info()

    def _game_of(self, options: Mapping[str, Any]) -> int | None:
        """Return the game that the options of `reset` open; None for the current one."""
        unknown = set(options) - {"new_game", "game"}
        if unknown:
            raise ValueError(f"the options are new_game and game, not {', '.join(sorted(unknown))}")
        game = options.get("game")
        if game is None:
            return self.clock.game + 1 if options.get("new_game") else None
        if options.get("new_game"):
            raise ValueError("new_game and game exclude each other: give one of them")
        if isinstance(game, bool) or not isinstance(game, int) or game < 0:
            raise ValueError(f"game is the number of a game, from 0, not {game!r}")
        return game

    def _begin(self) -> None:
        """Start the next episode, by the clock and the generator."""
        self._generator = self.np_random.bit_generator.state
        self._actions = []
        self._outcome = PLAYING
        self._unsafe_choices = 0
        self._action = None
        self.scenario.start(self.np_random)

    def step(
        self, action: SupportsInt
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Do an action for 0.4 s, less when the episode ends before.

        Returns:
            The observation; the reward; whether the episode ended by its rules (terminated);
            whether it was cut off (truncated); the info.

        Raises:
            gymnasium.error.ResetNeeded: No episode is running.
            ValueError: There is no such action.
        """
        choice = self._checked(action)
        ruling = self._play(choice, show=True)
        reward = self.scenario.reward()
        if ruling is None:
            return self.scenario.observe(), reward, False, False, self._info()
        observation, info = self.scenario.observe(), self._info()
        self.clock.end(TICK * self.scenario.world.tick + ruling.dead_time)
        self._actions = None
        return observation, reward + ruling.reward, not ruling.truncated, ruling.truncated, info

    def _checked(self, action: SupportsInt) -> int:
        if self._actions is None:
            raise ResetNeeded("no episode is running: call reset() before step()")
        try:
            choice = int(action)
            known = choice == action and 0 <= choice < len(self.scenario.actions)
        except (TypeError, ValueError):
            known = False
        if not known:
            raise ValueError(
                f"an action is a number from 0 to {len(self.scenario.actions) - 1}, not {action!r}"
            )
        return choice

    def _play(self, action: int, show: bool) -> Ruling | None:
        """Execute an action until it or the episode ends."""
        assert self._actions is not None
        self._actions.append(action)
        scenario, rng = self.scenario, self.np_random
        self._action = action
        self._unsafe_choices += action in scenario.unsafe
        watched = show and (self._pacer is not None or self.render_mode in _EACH_TICK)
        command, advance, judge = scenario.command, scenario.world.advance, scenario.judge
        for _ in range(TICKS_PER_DECISION):
            command(action, rng)
            advance()
            ruling = judge()
            if ruling is not None:
                self._outcome = ruling.outcome
            if watched:
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
        """Return all that the rest of the episode and later episodes depend on.

        The physics cannot be copied, but it repeats exactly: of a running episode this keeps the
        state of the generator at its start and the actions since.

        Returns:
            Plain JSON values: names of scenario and field, the game clock, the state of the
            generator, the actions of the running episode or None between two.
        """
        between = self._actions is None
        return {
            "scenario": type(self.scenario).__name__,
            "field": self.scenario.field.name,
            "clock": self.clock.state_dict(),
            "np_random": self.np_random.bit_generator.state if between else self._generator,
            "actions": None if self._actions is None else list(self._actions),
        }

    def load_state_dict(self, snapshot: Mapping[str, Any]) -> None:
        """Continue where `state_dict` was called, on this object or on another.

        A running episode is replayed up to that point, without pictures and real time.

        Args:
            snapshot: What `state_dict` returned, also after conversion to JSON and back.

        Raises:
            ValueError: It is not a snapshot of this environment, which is then unchanged.
        """
        if set(snapshot) != set(_SNAPSHOT):
            raise ValueError(f"a snapshot has {_SNAPSHOT}, not {tuple(snapshot)}")
        theirs = (snapshot["scenario"], snapshot["field"])
        own = (type(self.scenario).__name__, self.scenario.field.name)
        if theirs != own:
            raise ValueError(f"the snapshot is of {theirs}, and this environment plays {own}")
        actions = snapshot["actions"]
        known = range(len(self.scenario.actions))
        if actions is not None and not (
            isinstance(actions, list)
            and all(isinstance(a, int) and not isinstance(a, bool) and a in known for a in actions)
        ):
            raise ValueError(f"actions must be null or a list of actions, not {actions!r}")
        if not isinstance(snapshot["clock"], Mapping):
            raise ValueError(f"clock must be a mapping, not {snapshot['clock']!r}")
        clock = GameClock()
        clock.load_state_dict(snapshot["clock"])
        generator = self.np_random.bit_generator
        # Every episode has its own world, referee and opponent: flat copies bring the old one back.
        before, own_scenario = dict(vars(self)), dict(vars(self.scenario))
        own_state = generator.state
        try:
            generator.state = snapshot["np_random"]
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            generator.state = own_state
            raise ValueError(f"np_random is not a state of {type(generator).__name__}") from error
        self.clock = clock
        self._actions = None
        self._frames = []
        if actions is None:
            return
        self._begin()
        for number, action in enumerate(actions, 1):
            if self._play(action, show=False) is not None:
                _put_back(self, before)
                _put_back(self.scenario, own_scenario)
                generator.state = own_state
                raise ValueError(
                    f"the episode ends with action {number} of the snapshot's {len(actions)}: "
                    "it is of another version or was changed"
                )

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
        if self._generator is None:
            raise ResetNeeded("there is nothing to render yet: call reset() first")
        if self.render_mode == "rgb_array":
            return self._picture()
        if self.render_mode == "rgb_array_list":
            frames, self._frames = self._frames, []
            return frames
        self._look()
        return None

    def _show(self, restart: bool = False) -> None:
        """Draw a picture if the mode needs one each tick, and wait in real time."""
        if self.render_mode == "human":
            self._look()
        elif self.render_mode == "rgb_array_list":
            if restart:
                self._frames = []
            self._frames.append(self._picture())
        if self._pacer is not None:
            self._pacer.restart() if restart else self._pacer.wait(TICK)

    def _draw(self) -> Viewer:
        if self._viewer is None:
            from serp_envs.soccer.rendering import Viewer  # needs pygame

            self._viewer = Viewer(self.scenario.field, window=self.render_mode == "human")
        viewer, scenario = self._viewer, self.scenario
        viewer.draw(
            scenario.world,
            scenario.teams,
            words="" if self._action is None else scenario.actions[self._action],
            alarm=self._action in scenario.unsafe,
            status=f"game {self.clock.game + 1}   {_minutes(self._seconds())}",
            outcome="" if self._outcome == PLAYING else self._outcome,
            caption=self.caption,
        )
        return viewer

    def _picture(self) -> NDArray[np.uint8]:
        return self._draw().picture()

    def _look(self) -> None:
        self._draw().show()

    def close(self) -> None:
        """Close the window."""
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None


def _put_back(thing: object, attributes: Mapping[str, Any]) -> None:
    """Set the attributes of an object to a copy made before."""
    vars(thing).clear()
    vars(thing).update(attributes)


def _minutes(seconds: float) -> str:
    whole = int(seconds)
    return f"{whole // 60}:{whole % 60:02d}"
