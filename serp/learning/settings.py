"""The settings of the learner: every choice of the paper and of what is known to work better."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

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
    `serp.learning.bounds`."""

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
        # A tuple of Python numbers whatever came, so that settings read from JSON are equal ones.
        if isinstance(self.hidden, list):
            object.__setattr__(self, "hidden", tuple(self.hidden))
        if not isinstance(self.hidden, tuple) or not all(_whole(n, 1) for n in self.hidden):
            self._refuse("hidden", "whole numbers ≥ 1, such as [64, 64]")
        for name in ("layer_norm", "double", "clip_targets", "mask_targets"):
            if not isinstance(getattr(self, name), bool):
                self._refuse(name, "true or false")
        for name in ("members", "batch_size", "n_step", "buffer_size", "failing_window"):
            self._whole(name, 1)
        for name in (
            "epsilon_steps",
            "learning_starts",
            "protected_early",
            "protected_failing",
            "pretrain_updates",
        ):
            self._whole(name, 0)
        if self.target_period is not None and not _whole(self.target_period, 1):
            self._refuse("target_period", "a whole number ≥ 1, or none")
        for name in ("epsilon_start", "epsilon_end", "protected_share"):
            if not (_number(value := getattr(self, name)) and 0 <= value <= 1):
                self._refuse(name, "a number from 0 to 1")
        for name in ("learning_rate", "reward_scale"):
            if not (_number(value := getattr(self, name)) and value > 0):
                self._refuse(name, "a number > 0")
        if not (_number(self.discount) and 0 <= self.discount < 1):
            self._refuse("discount", "a number from 0 to below 1")
        if not (_number(self.updates_per_step) and self.updates_per_step >= 0):
            self._refuse("updates_per_step", "a number ≥ 0")
        if self.gradient_clip is not None and not (
            _number(self.gradient_clip) and self.gradient_clip > 0
        ):
            self._refuse("gradient_clip", "a number > 0, or none")
        if self.target_polyak is not None and not (
            _number(self.target_polyak) and 0 < self.target_polyak <= 1
        ):
            self._refuse("target_polyak", "a number above 0 and up to 1, or none")
        if self.loss not in ("mse", "huber"):
            self._refuse("loss", '"mse" or "huber"')
        if self.target_period is not None and self.target_polyak is not None:
            self._refuse("target_polyak", f"none while target_period is {self.target_period}")
        if self.failing_window > self.buffer_size:
            self._refuse("failing_window", f"at most buffer_size, which is {self.buffer_size}")

    @property
    def has_target(self) -> bool:
        """Whether there is a target network."""
        return self.target_period is not None or self.target_polyak is not None

    def _whole(self, name: str, least: int) -> None:
        if not _whole(getattr(self, name), least):
            self._refuse(name, f"a whole number ≥ {least}")

    def _refuse(self, name: str, allowed: str) -> None:
        value = getattr(self, name)
        raise SettingsError(f"learner setting {name} is {value!r}, but must be {allowed}")


def _whole(value: Any, least: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= least


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
