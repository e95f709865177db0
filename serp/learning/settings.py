"""The settings of the learner: every choice of the paper and of what is known to work better."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, NoReturn

import numpy as np

from serp._util.numbers import COUNTED, SIZE, real, truth, whole
from serp.errors import SettingsError


@dataclass(frozen=True, kw_only=True)
class DQNSettings:
    """All that can be chosen about a `serp.learning.DQN`.

    The defaults are a recipe that works on small control tasks. The paper's learner (section 4)
    is ``DQNSettings(learning_rate=0.001, discount=0.9, target_period=None, target_polyak=None,
    double=False, n_step=1, clip_targets=False, loss="mse", gradient_clip=None,
    epsilon_start=0.3, epsilon_end=0.3, protected_share=0.0)``.

    Raises:
        SettingsError: a value is outside its range, or two of them contradict each other.
    """

    hidden: tuple[int, ...] = (64, 64)
    """Neurons of each hidden layer, each ≥ 1; an empty tuple makes Q linear in the input."""

    layer_norm: bool = False
    """LayerNorm (arXiv 1607.06450) in every hidden layer, before its ReLU."""

    members: int = 1
    """Networks side by side, ≥ 1. Each learns from batches of its own; Q is their mean."""

    symmetry: bool = False
    """Use the task's symmetries, where it has any: every sample drawn is mirrored at random, and Q
    is averaged with its mirror images."""

    learning_rate: float = 0.001
    """Step size of Adam, > 0."""

    discount: float = 0.97
    """γ, 0 ≤ γ < 1: what the reward of the next step is worth now."""

    batch_size: int = 64
    """Samples in one gradient update of one network, ≥ 1."""

    updates_per_step: float = 1.0
    """Gradient updates in one call of `learn`, ≥ 0; 0.5 is one in every second call."""

    target_period: int | None = 200
    """Copy the network to the target network every so many gradient updates, ≥ 1; None: never."""

    target_polyak: float | None = None
    """Move the target network towards the network by this share after every gradient update,
    0 < τ ≤ 1; None: don't. At most one of `target_period` and `target_polyak` is given; with
    neither there is no target network, as in the paper's equation 3."""

    double: bool = True
    """Choose the next action by the network, value it by the target network (arXiv 1509.06461).
    Without a target network both are the same."""

    n_step: int = 3
    """Rewards summed before the value of a later state is estimated, ≥ 1."""

    clip_targets: bool = True
    """Keep estimated values between the smallest and the largest possible return; see
    `serp.learning.return_bounds`."""

    mask_targets: bool = True
    """Value the next state by its best *allowed* action (what no veto refuses); False: by its best
    action, as in the paper's equation 3."""

    loss: Literal["mse", "huber"] = "mse"
    """Loss of one sample: squared error (paper, equation 2), or Huber with its corner at 1."""

    reward_scale: float = 1.0
    """Rewards are multiplied by it, > 0; Q-values are in these scaled units."""

    gradient_clip: float | None = 10.0
    """Largest Euclidean norm of the gradient of one network, > 0; None: unlimited."""

    epsilon_start: float = 1.0
    """Probability of exploring in the first env step, between 0 and 1."""

    epsilon_end: float = 0.05
    """Probability of exploring from env step `epsilon_steps` on, between 0 and 1."""

    epsilon_steps: int = 4000
    """Env steps in which the probability moves in a straight line between the two, ≥ 0."""

    buffer_size: int = 50_000
    """Samples in the replay memory, ≥ 1; the oldest is overwritten."""

    learning_starts: int = 200
    """`learn` does nothing before so many env steps, ≥ 0."""

    protected_share: float = 0.1
    """Share of every batch that comes from the protected memory, between 0 and 1: half from early
    samples, half from failing ones, all from the one that is there. 0: none is kept."""

    protected_early: int = 1000
    """The first so many samples are kept for ever, ≥ 0."""

    protected_failing: int = 1000
    """So many failing samples are kept, ≥ 0; the oldest of *them* is overwritten."""

    failing_window: int = 10
    """Samples of so many last env steps up to a failure are failing ones,
    1 ≤ failing_window ≤ buffer_size."""

    pretrain_updates: int = 0
    """Gradient updates on the first data D₀ before anything else, ≥ 0 (Algorithm 1, line 1)."""

    def __post_init__(self) -> None:
        # Python's numbers and a tuple whatever came, so that settings read from JSON are equal.
        self._take("hidden", f"whole numbers from 1 to {SIZE:,}, such as [64, 64]", _sizes)
        for name in ("layer_norm", "symmetry", "double", "clip_targets", "mask_targets"):
            self._take(name, "true or false", truth)
        for name, (least, most) in _WHOLE.items():
            allowed = f"a whole number from {least} to {most:,}"
            self._take(name, allowed, partial(whole, least=least, most=most))
        for name in ("epsilon_start", "epsilon_end", "protected_share"):
            self._take(name, "a number from 0 to 1", _number(lambda x: 0 <= x <= 1))
        for name in ("learning_rate", "reward_scale"):
            self._take(name, "a number > 0", _number(lambda x: x > 0))
        self._take("discount", "a number from 0 to below 1", _number(lambda x: 0 <= x < 1))
        self._take("updates_per_step", "a number ≥ 0", _number(lambda x: x >= 0))
        if self.target_period is not None:
            self._take("target_period", "a whole number ≥ 1, or none", partial(whole, least=1))
        if self.gradient_clip is not None:
            self._take("gradient_clip", "a number > 0, or none", _number(lambda x: x > 0))
        if self.target_polyak is not None:
            self._take(
                "target_polyak",
                "a number above 0 and up to 1, or none",
                _number(lambda x: 0 < x <= 1),
            )
        if not isinstance(self.loss, str) or self.loss not in ("mse", "huber"):
            self._refuse("loss", '"mse" or "huber"')
        if self.target_period is not None and self.target_polyak is not None:
            self._refuse("target_polyak", f"none while target_period is {self.target_period}")
        if self.failing_window > self.buffer_size:
            self._refuse("failing_window", f"at most buffer_size, which is {self.buffer_size}")

    @property
    def has_target(self) -> bool:
        """Whether there is a target network."""
        return self.target_period is not None or self.target_polyak is not None

    def _take(self, name: str, allowed: str, accept: Callable[[Any], Any]) -> None:
        """Put Python's own value in the place of an accepted one; `accept` gives None for others.

        Raises:
            SettingsError: it is not accepted.
        """
        value = accept(getattr(self, name))
        if value is None:
            self._refuse(name, allowed)
        object.__setattr__(self, name, value)

    def _refuse(self, name: str, allowed: str) -> NoReturn:
        value = getattr(self, name)
        raise SettingsError(f"learner setting {name} is {value!r}, but must be {allowed}")


_WHOLE = {
    "members": (1, SIZE),
    "batch_size": (1, SIZE),
    "n_step": (1, 10_000),
    "buffer_size": (1, 10**14),
    "failing_window": (1, SIZE),
    "epsilon_steps": (0, COUNTED),
    "learning_starts": (0, COUNTED),
    "protected_early": (0, SIZE),
    "protected_failing": (0, SIZE),
    "pretrain_updates": (0, COUNTED),
}
"""Setting → its least and its largest value."""


def _number(within: Callable[[float], bool]) -> Callable[[Any], float | None]:
    def accept(value: Any) -> float | None:
        number = real(value)
        return number if number is not None and within(number) else None

    return accept


def _sizes(value: Any) -> tuple[int, ...] | None:
    if not isinstance(value, list | tuple | np.ndarray) or np.ndim(value) != 1:
        return None
    sizes = [whole(size, 1, SIZE) for size in value]
    return None if None in sizes else tuple(size for size in sizes if size is not None)
