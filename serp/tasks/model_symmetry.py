"""Symmetries of a domain: permutations of objects and sign flips that map the model onto itself.

A symmetry σ maps a state s to σs and an action a to σa, and the model makes equal predictions for
both: step(σs, σa) = σ step(s, a), with equal rewards and flags.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from serp.model.flags import APPLICABLE, TERMINAL, UNSAFE
from serp.model.transition_model import TransitionModel, Vector

_TRANSITIONS = 4096
"""Number of predictions that are compared with those of their mirror images."""
_FLAGS = ((APPLICABLE, "applicable"), (UNSAFE, "unsafe"), (TERMINAL, "terminal"))
_TOLERANCE = 1e-6
"""Largest difference of two numbers that count as equal, relative to 1 or to their size."""


@dataclass(frozen=True)
class ModelSymmetry:
    """A symmetry of a domain: (σs)[i] = signs[i] · s[columns[i]], and σa = actions[a].

    Attributes:
        columns: A column of the state for each column.
        signs: 1.0 or -1.0 for each column.
        actions: The image of each ground action.
    """

    columns: tuple[int, ...]
    signs: tuple[float, ...]
    actions: tuple[int, ...]

    def of_state(self, state: Vector) -> Vector:
        """Return σs for a state `[F]`, or a batch `[..., F]`."""
        image: Vector = state[..., list(self.columns)] * np.array(self.signs)
        return image


def violation(model: TransitionModel, symmetry: ModelSymmetry) -> str | None:
    """Describe where a model contradicts a symmetry; None where it does not.

    Predictions in random states are compared with those in their mirror images, to float accuracy.
    The numbers are drawn near 0 and near the parameters, where conditions change.
    """
    rng = np.random.default_rng(0)
    count = len(model.actions)
    if not count:
        return None
    for state in _random_states(model, max(8, _TRANSITIONS // count), rng):
        image = symmetry.of_state(state)
        chosen = range(count)
        if count > _TRANSITIONS // 8:
            chosen = rng.choice(count, _TRANSITIONS // 8, replace=False).tolist()
        for action in chosen:
            found = _difference(model, symmetry, state, image, action)
            if found is not None:
                return found
    return None


def _random_states(model: TransitionModel, count: int, rng: np.random.Generator) -> Vector:
    numeric = np.array([fluent.numeric for fluent in model.fluents], dtype=np.bool_)
    shape = (count, len(numeric))
    scales = np.unique(np.abs(np.append(model.theta, 1.0)))
    # Continuous draws: exactly on a threshold, rounding would decide.
    near = rng.choice(scales, shape) * rng.uniform(0.5, 1.5, shape)
    numbers = np.where(rng.random(shape) < 0.5, near, rng.normal(size=shape))
    numbers *= rng.choice((-1.0, 1.0), shape)
    states: Vector = np.where(numeric, numbers, rng.integers(0, 2, shape))
    return states


def _difference(
    model: TransitionModel, symmetry: ModelSymmetry, state: Vector, image: Vector, action: int
) -> str | None:
    """Return a difference between the prediction of a step and that of its mirror image."""
    here, flags = model.transition(state.tolist(), action)
    there, image_flags = model.transition(image.tolist(), symmetry.actions[action])
    name, image_name = model.actions[action].name, model.actions[symmetry.actions[action]].name

    def differences() -> Iterator[str]:
        # Where a step has no result, its other flags may depend on the order of effects.
        both = flags & image_flags & APPLICABLE
        for bit, word in _FLAGS if both else _FLAGS[:1]:
            if (flags ^ image_flags) & bit:
                no = ("", "not ") if flags & bit else ("not ", "")
                yield f"`{name}` is {no[0]}{word}, `{image_name}` is {no[1]}{word}"
        if not both:
            return
        expected = symmetry.of_state(np.array(here[:-1]))
        for fluent, wanted, got in zip(model.fluents, expected.tolist(), there, strict=False):
            if not _same(wanted, got):
                yield (
                    f"after `{image_name}` the mirror image of `{name}` has "
                    f"`{fluent.name}` {wanted:.6g}, the domain predicts {got:.6g}"
                )
        if not _same(here[-1], there[-1]):
            yield f"`{name}` is worth {here[-1]:.6g}, `{image_name}` {there[-1]:.6g}"

    what = next(differences(), None)
    if what is None:
        return None
    shown = ", ".join(f"{k} {v:.4g}" for k, v in model.values(state).items())
    return f"{what}; seen from the state {shown} and its mirror image"


def _same(one: float, other: float) -> bool:
    return abs(one - other) <= _TOLERANCE * max(1.0, abs(one), abs(other))
