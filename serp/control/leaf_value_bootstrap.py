"""Bootstraps the leaves of the lookahead with the learner's values, once they predict well.

A lookahead does not see beyond its horizon. The learner's Q estimates the return of the rest of an
episode. With the learner's values at the leaves, a plan accounts for rewards beyond the horizon, as
in AlphaZero (Silver et al. 2018) and POLO (Lowrey et al. 2019, arXiv 1811.01848).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp._util.saved_state import Arrays, Saved
from serp.control.protocols import LeafValuePlanner, Learner
from serp.control.step_record import StepRecord
from serp.planning.leaf_value import LeafValue, value_at

_PERIOD: Final = 500
"""Env steps between two fits to the learner's values."""
_SAMPLES: Final = 1_000
"""Number of newest states that the fit uses."""
_REST: Final = 0.05
"""Discount at the end of the window of rewards that are compared with a value."""
_LONGEST: Final = 300
"""Largest length of that window."""
_MEMORY: Final = 0.998
"""Decay of the moving averages per comparison."""
_LEAST: Final = 200
"""Comparisons before the values are used."""
_EXPLAINED: Final = 0.5
"""Share of the variance of the rewards that the values must explain."""
_OTHERS: Final = 0.01
"""Share of the steps in which the rewards of file and learner may differ."""

_HELD, _COMPARED = 0, 1


@cached_njit(nogil=True)
def _follow(packed, state, next_state, reward, terminated, discount, window, count, means):  # type: ignore[no-untyped-def]
    """Add an env step to the window, and compare the values whose rewards are now complete.

    `window` `[2, n]` holds values and rewards of the last steps, the oldest first; `count` the
    length of the window in use and the comparisons made; `means` the moving averages of the return,
    its square, the error and its square.
    """
    length, width = window.shape[1], state.shape[0]
    held = count[_HELD]
    window[0, held], window[1, held] = value_at(packed, state, 0, width), reward
    held += 1
    end = 0.0 if terminated else value_at(packed, next_state, 0, width)
    complete = held if terminated else (1 if held == length else 0)
    for first in range(complete):
        received, weight = 0.0, 1.0
        for k in range(first, held):
            received += weight * window[1, k]
            weight *= discount
        error = received - (window[0, first] - weight * end)
        if math.isfinite(received * received) and math.isfinite(error * error):
            count[_COMPARED] += 1
            rate = max(1.0 - _MEMORY, 1.0 / count[_COMPARED])
            means[0] += rate * (received - means[0])
            means[1] += rate * (received * received - means[1])
            means[2] += rate * (error - means[2])
            means[3] += rate * (error * error - means[3])
    for k in range(held - complete):
        window[0, k], window[1, k] = window[0, k + complete], window[1, k + complete]
    count[_HELD] = held - complete


class LeafValueBootstrap:
    """Gives a lookahead the learner's values at its leaves while they predict the rewards well.

    The values V of a state and of the state n steps later predict the rewards in between:
    V(s) - γⁿ V(s′), or V(s) if the episode has terminated. The prediction is compared with the
    rewards received. Each value is computed when its state is visited, so that it is tested on new
    data. The values are used while they explain at least half of the variance of the rewards. They
    are never used if the learner learns from other rewards than the planner plans with. Each input
    of the learner has to end with the state.
    """

    def __init__(
        self, planner: LeafValuePlanner, learner: Learner, seed: np.random.SeedSequence
    ) -> None:
        self._planner = planner
        self._learner = learner
        self._fluents = len(planner.model.fluents)
        self._value = LeafValue(self._fluents, seed)
        self._discount = learner.settings.discount
        length = 1
        if self._discount > 0.0:
            length = min(_LONGEST, math.ceil(math.log(_REST) / math.log(self._discount)))
        self._window = np.zeros((2, length))
        self._count = np.zeros(2, dtype=np.int64)
        self._means = np.zeros(4)
        self._steps = self._others = 0

    @property
    def explained(self) -> float:
        """Share of the variance of the rewards received that the values explain; at most 1."""
        received, square, error, error_square = self._means.tolist()
        variance = square - received * received
        if self._count[_COMPARED] < _LEAST or variance <= 1e-9 * square:
            return 0.0
        return float(1.0 - (error_square - error * error) / variance)

    @property
    def proven(self) -> bool:
        """Whether the lookahead uses the learner's values."""
        return self._alike and self._value.fitted and self.explained >= _EXPLAINED

    @property
    def _alike(self) -> bool:
        """Whether planner and learner use the same rewards."""
        return self._others <= _OTHERS * self._steps

    def observe(self, step: StepRecord) -> None:
        """Process an env step of training."""
        reward = step.domain_reward
        self._steps += 1
        self._others += not math.isclose(reward, step.reward, rel_tol=1e-6, abs_tol=1e-9)
        if (step.truncated and not step.terminated) or not self._alike:
            self._count[_HELD] = 0
        elif self._value.fitted:
            _follow(
                self._value.packed, step.state, step.next_state, reward, step.terminated,
                self._discount, self._window, self._count, self._means,
            )  # fmt: skip
        if self._steps % _PERIOD == 0 and self._alike and self._learner.updates:
            self._fit()
        self._publish()

    def precompile(self) -> None:
        """Compile what `observe` calls after the first fit; the state does not change."""
        state, value = np.zeros(self._fluents), LeafValue(self._fluents, np.random.SeedSequence(0))
        value.fit(np.zeros((1, self._fluents)), np.zeros(1))
        _follow(
            value.packed, state, state, 0.0, False, self._discount,
            np.zeros_like(self._window), np.zeros_like(self._count), np.zeros_like(self._means),
        )  # fmt: skip

    def _publish(self) -> None:
        self._planner.leaves = self._value.packed if self.proven else np.zeros(0)

    def _fit(self) -> None:
        inputs, values = self._learner.newest_values(_SAMPLES)
        if len(values):
            states = inputs[:, inputs.shape[1] - self._fluents :]
            self._value.fit(states.astype(np.float64), values)

    def state_dict(self) -> tuple[Arrays, dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores, between episodes."""
        arrays = {"packed": self._value.packed.copy(), "means": self._means.copy()}
        compared = int(self._count[_COMPARED])
        return arrays, {"steps": self._steps, "others": self._others, "compared": compared}

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned."""
        saved = Saved("leaf values", arrays, meta)
        packed = saved.array("packed", np.float64, (-1,))
        means = saved.array("means", np.float64, self._means.shape)
        steps, compared = saved.whole("steps"), saved.whole("compared")
        others = saved.whole("others", 0, steps)
        try:
            self._value.restore(packed)
        except ValueError as error:
            raise saved.wrong(f"packed has {error}") from None
        self._steps, self._others = steps, others
        self._means[:] = means
        self._count[:] = 0, compared
        self._publish()
