"""Ridge regression on random Fourier features of the inputs, beside the inputs themselves.

Rahimi & Recht, Random Features for Large-Scale Kernel Machines, NeurIPS 2007.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import LARGEST, Saved
from serp.adaptation.parameter_buffer import FOURIER, MODES, GroupParameters
from serp.adaptation.residual.candidates import FORGET
from serp.adaptation.residual.prediction import fourier_features
from serp.adaptation.residual.solvers import accumulate_fourier
from serp.model.transition_model import Vector

RIDGE: Final = 1e-3
_FOURIER_RIDGE: Final = 1e-2
_KEPT: Final = 4_000  # samples that are kept to learn from again when ranges have grown
_GROWN: Final = 1.3  # growth of a range at which the features are drawn anew


class FourierRegression:
    """The regression of one group, whose features and weights `parameters` receives.

    `features` are those of the last input, see `evaluate`. Unless `enabled`, nothing is stored.
    """

    def __init__(
        self,
        parameters: GroupParameters,
        depth: int,
        count: int,
        seed: np.random.SeedSequence,
        enabled: bool,
    ) -> None:
        self.enabled = enabled
        self.features = np.zeros(FOURIER)
        self._parameters = parameters
        self._random = np.random.default_rng(seed)
        size = 1 + depth + FOURIER if enabled else 0
        self._gram, self._moment = np.zeros((size, size)), np.zeros((size, count))
        self._drawn_for = np.zeros((2, depth))  # centre and half range of the inputs
        self._x = np.zeros((_KEPT if enabled else 0, depth))
        self._y = np.zeros((len(self._x), count))
        self._kept = 0

    def evaluate(self, x: Vector) -> bool:
        """Compute `features` of an input; return False before features are drawn."""
        of = self._parameters
        if of.fourier:
            fourier_features(x, of.centre, of.shrink, of.frequency, of.phase, self.features)
        return bool(of.fourier)

    def add(self, x: Vector, origin_x: Vector, y: Vector, evaluated: bool) -> None:
        """Add a sample; `origin_x` is x less the origin, `features` are those of x if evaluated."""
        self._x[self._kept % _KEPT], self._y[self._kept % _KEPT] = x, y
        self._kept += 1
        if evaluated:
            accumulate_fourier(origin_x, y, self.features, self._gram, self._moment)

    def fade(self) -> None:
        """Reduce the weight of old samples, because the environment has changed."""
        self._gram *= FORGET
        self._moment *= FORGET
        self._kept = 0

    def clear(self) -> None:
        """Reset everything but the random generator."""
        for array in (self._gram, self._moment, self._drawn_for, self._x, self._y):
            array[:] = 0.0
        self._kept = 0

    def draw(self, centre: Vector, half: Vector, origin: Vector) -> bool:
        """Draw features if there are none or ranges have grown; return whether there were none."""
        of = self._parameters
        first = not of.fourier
        if first:
            of.frequency[:] = self._random.standard_normal(of.frequency.shape)
            of.phase[:] = self._random.uniform(0.0, 2.0 * np.pi, FOURIER)
        elif not (half > _GROWN * self._drawn_for[1]).any():
            return False
        of.fourier = FOURIER
        of.centre[:], of.shrink[:] = centre, 1.0 / half
        self._drawn_for[:] = centre, half
        self._gram[:] = 0.0
        self._moment[:] = 0.0
        for x, y in zip(self._x[: self._kept], self._y[: self._kept], strict=True):
            self.evaluate(x)
            accumulate_fourier(x - origin, y, self.features, self._gram, self._moment)
        return first

    def solve(self, centre: Vector, half: Vector, origin: Vector) -> None:
        """Publish the weights; without a finite solution they are unchanged."""
        depth = len(centre)
        away = centre - origin
        matrix = self._gram + np.tril(self._gram, -1).T
        right = self._moment.copy()
        # Statistics of the normalised inputs, from those of the inputs.
        linear = slice(1, 1 + depth)
        matrix[linear] = (matrix[linear] - away[:, None] * matrix[0]) / half[:, None]
        matrix[:, linear] = (matrix[:, linear] - matrix[:, :1] * away) / half
        right[linear] = (right[linear] - away[:, None] * right[0]) / half[:, None]
        ridge = np.full(len(matrix), _FOURIER_RIDGE)
        ridge[: 1 + depth] = RIDGE
        matrix[np.diag_indices_from(matrix)] += ridge
        solution = np.linalg.solve(matrix, right)
        solution[linear] /= half[:, None]
        solution[0] -= away @ solution[linear]
        if np.isfinite(solution).all():
            self._parameters.linear[1 + MODES] = relative_to(-origin, solution[: 1 + depth].T)
            self._parameters.amplitude[:] = solution[1 + depth :].T

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays = {
            "x": self._x[: self._kept].copy(),
            "y": self._y[: self._kept].copy(),
            "drawn_for": self._drawn_for.copy(),
        }
        if self._parameters.fourier:
            arrays |= {"gram": self._gram.copy(), "moment": self._moment.copy()}
        return arrays, {"kept": self._kept, "random": self._random.bit_generator.state}

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned, after the buffer; `RunError` if it does not fit."""
        saved = Saved("residual", arrays, meta)
        self._kept = saved.whole("kept")
        self._random.bit_generator.state = saved.generator_state("random", self._random)
        rows = min(self._kept, len(self._x))
        for name in ("x", "y", "drawn_for", "gram", "moment"):
            own = getattr(self, f"_{name}")
            if name in ("gram", "moment") and not self._parameters.fourier:
                own[:] = 0.0
                continue
            # Sums may overflow for huge observations; `solve` handles that.
            low = -LARGEST if name == "drawn_for" else None
            count = rows if name in ("x", "y") else len(own)
            own[:count] = saved.array(name, np.float64, (count, *own.shape[1:]), low)


def relative_to(origin: Vector, weights: NDArray[np.floating[Any]]) -> Vector:
    """Convert weights `[T, 1 + d]` of inputs to weights of the inputs minus an origin."""
    moved = np.array(weights, dtype=np.float64)
    moved[:, 0] += weights[:, 1:] @ origin
    return moved
