"""Rows of the design matrix of a regression, and what its weights predict from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp._util.saved_state import Arrays, Saved
from serp.model.ground_model import Fluent, GroundModel, GroundSchema
from serp.model.native import advanced, pointer_to
from serp.model.transition_model import Vector

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

Key = tuple[str, ...]


@dataclass(frozen=True)
class FeatureGroup:
    """Inputs and targets of a model of one ground action's effect on some objects.

    Groups with equal keys are instances of the same relation between different objects of the same
    types; they share one model.

    Attributes:
        key: Schema, roles of the objects, symbols of inputs and targets.
        inputs: Columns that the change may depend on, in an order that is the same for the key.
        targets: Columns of the numeric fluents that may change, likewise ordered.
        predicates: Columns of the predicates that may change, likewise ordered.
        predicate_inputs: Positions of predicates within `inputs`.
    """

    key: Key
    inputs: tuple[int, ...]
    targets: tuple[int, ...]
    predicates: tuple[int, ...]
    predicate_inputs: tuple[int, ...]


def feature_groups_of(model: GroundModel, action: GroundSchema) -> tuple[FeatureGroup, ...]:
    """Return the feature groups of a ground action.

    The first one is that of the action's own objects; there is another for each other tuple of
    objects with numeric fluents. Its inputs are all fluents of these objects and of the action's.
    Roles distinguish the objects: the position among the action's arguments, or in the tuple.
    """
    own = set(action.arguments)
    tuples: dict[tuple[str, ...], list[Fluent]] = {(): []}
    for fluent in model.fluents:
        objects = () if own.issuperset(fluent.arguments) else fluent.arguments
        tuples.setdefault(objects, []).append(fluent)
    return tuple(
        _group(model, action, objects, fluents)
        for objects, fluents in tuples.items()
        if (fluents if not objects else any(fluent.numeric for fluent in fluents))
    )


def _group(
    model: GroundModel, action: GroundSchema, objects: tuple[str, ...], changing: Sequence[Fluent]
) -> FeatureGroup:
    roles: dict[str, str] = {}
    for place, thing in enumerate(action.arguments):
        roles.setdefault(thing, f"a{place}")
    for place, thing in enumerate(objects):
        roles.setdefault(thing, f"t{place}")

    def by_roles(fluent: Fluent) -> str:
        return f"{fluent.symbol}({','.join(roles[thing] for thing in fluent.arguments)})"

    seen = sorted(
        (by_roles(fluent), fluent.index)
        for fluent in model.fluents
        if all(thing in roles for thing in fluent.arguments)
    )
    inputs = tuple(index for _, index in seen)
    ordered = sorted(changing, key=by_roles)
    key = (
        action.schema,
        ",".join(roles[thing] for thing in objects),
        ";".join(text for text, _ in seen),
        ";".join(map(by_roles, ordered)),
    )
    return FeatureGroup(
        key,
        inputs,
        tuple(fluent.index for fluent in ordered if fluent.numeric),
        tuple(fluent.index for fluent in ordered if not fluent.numeric),
        tuple(k for k, index in enumerate(inputs) if not model.fluents[index].numeric),
    )


RANGE: Final = 1.3
"""Normalised inputs larger than this are outside of the range of the data; if samples have them,
all are normalised anew."""
SMOOTH, FEATURES = 64, 256
"""Numbers of random Fourier features: of a smooth model and of a full one."""
MAX_INPUTS: Final = 96  # compiled code keeps them on the stack
MAX_COLUMNS: Final = 640
"""Most columns of the linear part of a regression, which is solved often."""

_WIDEST, _NARROWEST = 0.4, 1.2
"""Frequencies are drawn with standard deviations in this range, for normalised inputs: a mixture of
kernels."""

FILE, LINEAR, CURVED, FULL = range(4)
"""The predictor of a fluent: the file alone, or the file with a linear model, one with the
smoothest random features, or one with all of them."""

(
    R_HEADS, R_FEATURES, R_KNOWN, R_KINDS, R_LINEAR, R_AMPLITUDE, R_CENTRE, R_SHRINK, R_FREQUENCY,
    R_PHASE, R_INVERSE, R_TYPICAL, R_SCALE, HEADER,
) = range(14)  # fmt: skip


def entry(index: int, kind: Callable[[float], int]) -> Any:
    """Return a property that is stored as one float64 of the owner's `_header`."""

    def write(owner: Any, value: int) -> None:
        owner._header[index] = value

    return property(lambda owner: kind(owner._header[index]), write)


class RegressionParameters:
    """Views of the part of the buffer that belongs to one regression.

    Attributes:
        heads, depth, count: H (action schemas), d and T.
        features: Number of random features in use: 0 or `FEATURES`.
        known: Columns of `inverse` in use; 0 before the first solution.
        columns: Number of columns of the linear part of the design matrix.
        kinds: `[T]` the predictor in use.
        linear: `[H, 3, T, 1 + d]` weights of a constant and the normalised inputs, by kind.
        amplitude: `[2, T, FEATURES]` weights of the random features, by kind.
        centre, shrink: `[d]` normalised inputs are (x - centre) · shrink.
        frequency: `[d, FEATURES]`.
        phase: `[FEATURES]`.
        inverse: `[columns + SMOOTH, same]` inverse of the Cholesky factor of the smooth model.
        typical: `[H, T]` typical error of the predictor in use.
        scale: `[4, T]` typical error where nothing is known, typical change, and two sums that the
            first is computed from.
    """

    features, known = (entry(index, int) for index in (R_FEATURES, R_KNOWN))

    def __init__(self, buffer: Vector, start: int, group: FeatureGroup, heads: int) -> None:
        self._header = buffer[start : start + HEADER]
        self.heads, self.depth, self.count = heads, len(group.inputs), len(group.targets)
        self.columns = columns_of(group, heads)
        at = start + HEADER
        parts: dict[int, Vector] = {}
        for name, shape in _shapes(group, heads).items():
            size = int(np.prod(shape))
            self._header[name] = at
            parts[name] = buffer[at : at + size].reshape(shape)
            at += size
        self._header[R_HEADS] = heads
        self.kinds, self.linear = parts[R_KINDS], parts[R_LINEAR]
        self.amplitude, self.centre = parts[R_AMPLITUDE], parts[R_CENTRE]
        self.shrink, self.frequency = parts[R_SHRINK], parts[R_FREQUENCY]
        self.phase, self.inverse = parts[R_PHASE], parts[R_INVERSE]
        self.typical, self.scale = parts[R_TYPICAL], parts[R_SCALE]
        self._weights = buffer[start + HEADER : at]

    def draw(self, seed: np.random.SeedSequence) -> None:
        """Draw random features, the smoothest first."""
        random = np.random.default_rng(seed)
        width = np.exp(random.uniform(np.log(_WIDEST), np.log(_NARROWEST), FEATURES))
        frequency = width * random.standard_normal(self.frequency.shape)
        order = np.argsort((frequency**2).sum(axis=0), kind="stable")
        self.frequency[:] = frequency[:, order]
        self.phase[:] = random.uniform(0.0, 2.0 * np.pi, FEATURES)
        self.features = FEATURES

    def clear(self) -> None:
        """Use the file alone."""
        self._weights[:] = 0.0
        self.features = self.known = 0

    def contents(self) -> Arrays:
        """Return what is published."""
        return {"sizes": np.array([self.features, self.known]), "weights": self._weights.copy()}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Publish what `contents` returned; a `RunError` refuses what does not fit."""
        saved = Saved("adaptation", arrays, {})
        features, known = saved.array("sizes", np.int64, (2,)).tolist()
        weights = saved.array("weights", np.float64, self._weights.shape)
        kinds = weights[: self.kinds.size]
        if (
            features not in (0, FEATURES)
            or known not in (0, self.columns, self.columns + SMOOTH)
            or (known > self.columns and not features)
            or not np.isin(kinds, range(1 + FULL)).all()
        ):
            raise saved.wrong("random features or predictors are out of range")
        self._weights[:] = weights
        self.features, self.known = features, known


def columns_of(group: FeatureGroup, heads: int) -> int:
    """Return the number of columns of the linear part: shared by all heads, and of each head."""
    return (1 + heads) * (1 + len(group.inputs))


def learnable(group: FeatureGroup, heads: int) -> bool:
    """Return whether there are few enough inputs to learn from."""
    return len(group.inputs) <= MAX_INPUTS and columns_of(group, heads) <= MAX_COLUMNS


def size_of(group: FeatureGroup, heads: int) -> int:
    """Return the number of entries of a regression in the buffer."""
    return HEADER + sum(int(np.prod(shape)) for shape in _shapes(group, heads).values())


def _shapes(group: FeatureGroup, heads: int) -> dict[int, tuple[int, ...]]:
    depth, count = len(group.inputs), len(group.targets)
    size = columns_of(group, heads) + SMOOTH
    return {
        R_KINDS: (count,),
        R_LINEAR: (heads, 3, count, 1 + depth),
        R_AMPLITUDE: (2, count, FEATURES),
        R_CENTRE: (depth,),
        R_SHRINK: (depth,),
        R_FREQUENCY: (depth, FEATURES),
        R_PHASE: (FEATURES,),
        R_INVERSE: (size, size),
        R_TYPICAL: (heads, count),
        R_SCALE: (4, count),
    }


@cached_njit(nogil=True, forceinline=True)
def normalise(buffer, part, inputs, depth, state, u):
    """Write the normalised inputs of a state."""
    centre, shrink = int(buffer[part + R_CENTRE]), int(buffer[part + R_SHRINK])
    for i in range(depth):
        u[i] = (state[int(buffer[inputs + i])] - buffer[centre + i]) * buffer[shrink + i]


@cached_njit(nogil=True, forceinline=True)
def features_of(frequency, phase, u, depth, first, z):
    """Write a chunk of random features of normalised inputs, from position `first`, to `z`.

    A fast approximation of the cosine, accurate to 0.001, in loops that become vector code.
    """
    for k in range(SMOOTH):
        z[k] = phase[first + k]
    for i in range(depth):
        x, at = u[i], i * FEATURES + first
        for k in range(SMOOTH):
            z[k] += frequency[at + k] * x
    for k in range(SMOOTH):
        turns = z[k] * 0.15915494309189535 + 0.25
        turns -= np.floor(turns + 0.5)
        y = 8.0 * turns - 16.0 * turns * abs(turns)
        z[k] = 0.225 * (y * abs(y) - y) + y


@cached_njit(nogil=True, forceinline=True)
def dot_chunk(weights, z, scratch):
    """Return the product of two chunks, summed pairwise: in vector code, the same bits always."""
    for k in range(SMOOTH):
        scratch[k] = weights[k] * z[k]
    width = SMOOTH
    while width > 1:
        width //= 2
        for k in range(width):
            scratch[k] += scratch[k + width]
    return scratch[0]


@cached_njit(nogil=True, forceinline=True)
def linear_of(weights, u, depth):
    """Return a linear function of the normalised inputs."""
    total = weights[0]
    for i in range(depth):
        total += weights[1 + i] * u[i]
    return total


@cached_njit(nogil=True)
def rate_of(samples, memory):
    """Return the weight of the next sample; `memory` is that of the past in the long run.

    The n-th sample initially has the weight 3 / (2 + n), so that early samples soon lose weight.
    """
    return max(1.0 - memory, 3.0 / (3.0 + samples))


FEW, SETTLED = 5, 30
"""Samples before which nothing counts as an outlier, and before which only extreme inputs do."""
_FAR, _EXTREME = 8.0, 100.0
"""An input is an outlier so many half ranges from the middle of its range."""
_PATIENCE: Final = 3
"""After more successive outliers the environment is assumed to have changed."""


class Ranges:
    """The ranges of `d` inputs.

    Attributes:
        low, high: `[d]` ends of the ranges; infinite at first.
        outliers: Number of successive outliers.
    """

    def __init__(self, depth: int) -> None:
        self.low, self.high = np.empty(depth), np.empty(depth)
        self.clear()

    def clear(self) -> None:
        """Forget the ranges."""
        self.low[:], self.high[:] = np.inf, -np.inf
        self.outliers = 0

    def accept(self, x: Vector, seen: int) -> bool:
        """Widen the ranges to an input, or return False for an outlier; `seen` inputs were before.

        After several outliers in a row they are accepted.
        """
        far = False
        if seen >= FEW:
            centre, half = self.centre_and_half()
            limit = _FAR if seen >= SETTLED else _EXTREME
            far = bool((np.abs(x - centre) > limit * half).any())
        self.outliers = self.outliers + 1 if far else 0
        if 0 < self.outliers <= _PATIENCE:
            return False
        np.minimum(self.low, x, out=self.low)
        np.maximum(self.high, x, out=self.high)
        return True

    def centre_and_half(self) -> tuple[Vector, Vector]:
        """Return the centres of the ranges and half their widths, 1 for what never changed."""
        centre, half = (self.high + self.low) / 2, (self.high - self.low) / 2
        half[half <= 1e-9 * np.maximum(1.0, np.abs(centre))] = 1.0
        return centre, half

    def beyond(self, centre: Vector, shrink: Vector) -> bool:
        """Return whether a range is much wider than the one that inputs are normalised by."""
        ends = np.maximum(self.high - centre, centre - self.low) * shrink
        return not shrink.all() or bool((ends > RANGE).any())


@cached_njit(nogil=True)
def _fill(x, heads, weight, published, columns, features, out):
    """Fill rows of the design matrix, each times its weight; `out` `[n, D]` begins with zeros.

    `x` `[n, d]` are inputs, changed to normalised ones, `heads` `[n]` their heads; `published` are
    centre, shrink, frequency and phase.
    """
    centre, shrink, frequency, phase = published
    depth = x.shape[1]
    for k in range(x.shape[0]):
        u, w = x[k], weight[k]
        for i in range(depth):
            u[i] = (u[i] - centre[i]) * shrink[i]
        for start in (0, (1 + heads[k]) * (1 + depth)):
            out[k, start] = w
            for i in range(depth):
                out[k, start + 1 + i] = w * u[i]
        for first in range(0, features, SMOOTH):
            z = advanced(pointer_to(out[k], 0), columns + first)
            features_of(
                pointer_to(frequency, 0), pointer_to(phase, 0), pointer_to(u, 0), depth, first, z
            )
            for i in range(SMOOTH):
                z[i] *= w


def design_matrix(
    p: RegressionParameters, x: Vector, heads: NDArray[np.int64], weight: Vector
) -> Vector:
    """Return rows of the design matrix, each times its weight; `x` `[n, d]` is normalised."""
    out = np.zeros((len(x), p.columns + p.features))
    published = p.centre, p.shrink, p.frequency, p.phase
    _fill(x, heads, weight, published, p.columns, p.features, out)
    return out
