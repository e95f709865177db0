"""Macro-actions: controllers that run for several steps make a discrete environment."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from inspect import isgeneratorfunction
from typing import Any, TypeVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces

Observation = TypeVar("Observation")
Control = TypeVar("Control")
Option = Callable[[Observation], Generator[Control, Observation, None]]
"""A generator function: it is given the observation at which it begins, yields controls, is sent
the observation after each, also after one that ends the episode, and returns when it is done."""


def option(
    control: Callable[[Observation], Control] | Option[Observation, Control],
    *,
    steps: int,
    until: Callable[[Observation], bool] | None = None,
) -> Option[Observation, Control]:
    """Return the option that runs a controller for a number of steps, or until a condition holds.

    Args:
        control: Observation → control, which the environment's `step` takes; or a generator
            function, which yields one control after another and is sent the observations between.
        steps: Most steps, at least 1.
        until: Observation → whether to end; asked after every step.

    Raises:
        TypeError: `control` is not a function.
        ValueError: `steps` is not a number of steps.
    """
    if isinstance(steps, bool) or not isinstance(steps, int) or steps < 1:
        raise ValueError(f"an option must take at least 1 step, not {steps!r}")
    if not callable(control):
        raise TypeError(f"a controller must be a function of the observation, not {control!r}")
    generate = control if isgeneratorfunction(control) else _in_each_step(control)

    def run(observation: Observation) -> Generator[Control, Observation, None]:
        controls, sent = generate(observation), None
        for _ in range(steps):
            try:
                chosen = controls.send(sent)
            except StopIteration:
                return
            sent = yield chosen
            if until is not None and until(sent):
                return

    return run


def _in_each_step(control: Callable[[Any], Any]) -> Option[Any, Any]:
    """Return the option that asks a controller in each step, without end."""

    def run(observation: Any) -> Generator[Any, Any, None]:
        while True:
            observation = yield control(observation)

    return run


class MacroActions(gym.Wrapper[Any, Any, Any, Any]):
    """An environment whose actions are options (Sutton, Precup and Singh 1999) of another one.

    Action k runs the k-th option to its end, or to the end of the episode. A step has the
    observation, terminated, truncated and info of the last step that the option made, and the sum
    of the rewards of all. Its info has one more entry, `steps`: their number; and `unsafe` true if
    the info of any of them has that::

        MacroActions(
            gymnasium.make("Pendulum-v1"),
            {"left": option(lambda seen: [-1.0], steps=10), "right": ...},
        )

    Attributes:
        options: The options by name, in the order of the actions.

    Args:
        env: The environment, with any action space.
        options: The options by name; an option may be any generator function, see `Option`.

    Raises:
        ValueError: There are no options.
    """

    def __init__(self, env: gym.Env[Any, Any], options: Mapping[str, Option[Any, Any]]) -> None:
        super().__init__(env)
        if not options:
            raise ValueError("MacroActions needs at least one option")
        self.options = dict(options)
        self.action_space = spaces.Discrete(len(self.options))
        self._observation: Any = None
        modes = env.metadata.get("render_modes") or []
        if env.spec is not None and "rgb_array" in modes and "rgb_array_list" not in modes:
            # `gymnasium.make` collects a picture of every step that an option makes.
            self.metadata = {**env.metadata, "render_modes": [*modes, "rgb_array_list"]}

    def get_action_meanings(self) -> list[str]:
        """Return the names of the options, as environments of Atari games name their actions."""
        return [*self.options]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode."""
        self._observation, info = super().reset(seed=seed, options=options)
        return self._observation, info

    def step(self, action: np.int64 | int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Run an option.

        Raises:
            gymnasium.error.ResetNeeded: `reset` comes before `step`.
            gymnasium.error.InvalidAction: There is no such option.
            ValueError: The option ended without a control.
            TypeError: The option is a function that yields nothing.
        """
        if self._observation is None:
            raise gym.error.ResetNeeded("call reset() before step()")
        if not self.action_space.contains(action):
            raise gym.error.InvalidAction(f"{action!r} is not an action of {self.action_space}")
        name = list(self.options)[int(action)]
        answer = run_option(self.env, self.options[name], self._observation)
        if answer is None:
            raise ValueError(
                f"option `{name}` ended without a control; let it make one step or more"
            )
        self._observation = answer[0]
        return answer


def run_option(
    env: gym.Env[Any, Any], option: Option[Any, Any], observation: Any
) -> tuple[Any, float, bool, bool, dict[str, Any]] | None:
    """Run an option to its end or that of the episode.

    Returns:
        What `MacroActions.step` does; None if the option gave no control.
    """
    running = option(observation)
    if not isinstance(running, Generator):
        raise TypeError(
            f"an option yields controls, but this one returned {running!r}; write "
            "option(controller, steps=...) for a function from the observation to the control"
        )
    total, steps, unsafe = 0.0, 0, False
    try:
        control = next(running)
        while True:
            observation, reward, terminated, truncated, info = env.step(control)
            total, steps = total + float(reward), steps + 1
            unsafe = unsafe or bool(info.get("unsafe"))
            control = running.send(observation)
            if terminated or truncated:
                break
    except StopIteration:
        if not steps:
            return None
    finally:
        running.close()
    damage = {"unsafe": True} if unsafe else {}
    return observation, total, terminated, truncated, {**info, **damage, "steps": steps}
