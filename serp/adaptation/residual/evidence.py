"""Evidence for the predictors of a target: their losses on samples not learned yet.

Predictors are the file alone and three residuals, see `serp.adaptation.residual.parameters`. Each
is evaluated on a sample before it learns from it, and the best one is used (prequential choice:
Dawid, Journal of the Royal Statistical Society A 147, 1984). The loss is the mean absolute error,
that of Laplace's distribution: a few impacts do not hide what is predicted in all other steps.

Shapes: d inputs, T targets, R rows of the regression; losses are over all rows, so that an action
with few samples is predicted as well as the others.
"""

from __future__ import annotations

import math

import numpy as np

from serp._util.compilation import cached_njit
from serp.adaptation.adoption import BETTER
from serp.adaptation.moving_average import rate_of
from serp.adaptation.residual import parameters as r
from serp.adaptation.residual.features import dot_chunk, features_of, linear_of
from serp.adaptation.residual.leverage import columns_in_use, leverage
from serp.model.native import advanced, pointer_to

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

HUGE = 1e60
"""Numbers of at least this size are not used; sums of their squares would overflow."""
FEW, SETTLED = 5, 30
"""Samples before which nothing counts as an outlier, and before which nothing is a surprise."""

_MEMORY = 0.999  # weight of the past in the losses, per step
_ROBUST = 5.0
"""Errors of more standard deviations weigh less, as under Student's t: by their square (Lange,
Little & Taylor, Journal of the American Statistical Association 84, 1989)."""
_NOTICED, _RECENT, _LASTING = 0.1, 0.85, 0.7
"""A surprise is such an error of more than this fraction of the change. The world
may have changed if this fraction of recent steps are surprises."""
_FINE = 1e-2  # the least that features have to explain, as a fraction of the change


@cached_njit(nogil=True)
def update_whole(state, next_state, numeric, whole):
    """Update which fluents were always `whole` `[F]`; return whether none is NaN or huge."""
    for i in range(state.shape[0]):
        if not (abs(state[i]) < HUGE and abs(next_state[i]) < HUGE):
            return False
    for i in range(state.shape[0]):
        if numeric[i] and next_state[i] != np.floor(next_state[i]):
            whole[i] = False
    return True


@cached_njit(nogil=True)
def account(sample, row, head, published, sizes, statistics):
    """Add a sample to the losses.

    A sample is the inputs `[d]`, `[T]` observed next values less those of effects and processes,
    `[T]` whether that is observed, and `[T]` the change. `published` are views of
    `RegressionParameters`; `sizes` are its features, known columns, columns and heads.
    `statistics` are `[4, T]` moving averages of errors by predictor, `[T]` samples in them,
    `[T]` the mean change, `[R, T]` samples of each row, `[1]` the fraction of surprises.

    Returns:
        The weight of the sample in the regression, and whether the world may have changed.
    """
    x, y, valid, change = sample
    centre, shrink, frequency, phase, linear, amplitude, kinds, inverse, typical, scale = published
    features, known, columns, heads = sizes
    loss, seen, spread, samples, surprises = statistics
    depth, count = x.shape[0], y.shape[0]
    room = np.empty(depth + 2 * r.SMOOTH + 4 * count)
    u, z = pointer_to(room, 0), pointer_to(room, depth)
    scratch = pointer_to(room, depth + r.SMOOTH)
    errors = room[depth + 2 * r.SMOOTH :].reshape(4, count)
    for i in range(depth):
        u[i] = (x[i] - centre[i]) * shrink[i]
    for t in range(count):
        errors[r.FILE, t] = y[t]
        for kind in range(3):
            errors[1 + kind, t] = y[t] - linear_of(pointer_to(linear[row, kind, t], 0), u, depth)
    share = 1.0
    known = columns_in_use(known, columns, kinds.max())
    for chunk in range(max(1, features // r.SMOOTH)):
        if features > 0:
            first = chunk * r.SMOOTH
            features_of(pointer_to(frequency, 0), pointer_to(phase, 0), u, depth, first, z)
            for t in range(count):
                for kind in range(1 if chunk > 0 else 0, 2):
                    weights = advanced(pointer_to(amplitude[kind, t], 0), first)
                    errors[r.CURVED + kind, t] -= dot_chunk(weights, z, scratch)
        if chunk == 0:
            share = leverage(
                pointer_to(inverse, 0), inverse.shape[0], known, columns, heads, row, head, u,
                depth, z,
            )  # fmt: skip
    worst, surprise = 0.0, False
    for t in range(count):
        if valid[t] and samples[row, t] >= FEW:
            error = errors[int(kinds[t]), t]
            least = 1e-9 * (1.0 + abs(y[t] - error))
            variance = typical[row, t] ** 2 + share * scale[0, t] ** 2 + least * least
            ratio = error * error / variance
            worst = max(worst, ratio)
            if ratio > _ROBUST * _ROBUST and abs(error) > _NOTICED * spread[t]:
                surprise = surprise or samples[row, t] >= SETTLED
    weight = 1.0 if worst <= _ROBUST * _ROBUST else _ROBUST * _ROBUST / worst
    surprises[0] = _RECENT * surprises[0] + (1.0 - _RECENT if surprise else 0.0)
    for t in range(count):
        if not valid[t]:
            continue
        error = errors[int(kinds[t]), t]
        size = abs(error)
        samples[row, t] += 1.0
        if samples[row, t] > SETTLED:
            limited = min(size, 4.0 * typical[row, t] + 1e-12)
            typical[row, t] += 0.02 * weight * (limited - typical[row, t])
        else:
            typical[row, t] += (size * weight - typical[row, t]) / samples[row, t]
        rate = rate_of(seen[t], _MEMORY) * weight  # hardly any for far outliers
        # Over all samples: where a robot keeps still, little changes, and noise is most of it.
        spread[t] += weight / (1.0 + seen[t]) * (abs(change[t]) - spread[t])
        seen[t] += 1.0
        for kind in range(4):
            off = abs(errors[kind, t])
            if kind != r.FILE and seen[t] <= FEW:
                off = min(off, abs(errors[r.FILE, t]))
                if seen[t] == 2.0:
                    loss[kind, t] = off
                    continue
            loss[kind, t] += rate * (off - loss[kind, t])
        # The error where nothing is known, as far as it was seen: at first that of the file.
        scale[2, t] = _MEMORY * scale[2, t] + weight * share
        limit = 4.0 * scale[0, t] ** 2 if seen[t] > SETTLED else np.inf
        scale[3, t] = _MEMORY * scale[3, t] + weight * share * min(error * error, limit)
        scale[0, t] = math.sqrt((scale[3, t] + loss[r.FILE, t] ** 2) / (scale[2, t] + 1.0))
        scale[1, t] = spread[t]
    return weight, surprise and surprises[0] > _LASTING


@cached_njit(nogil=True)
def choose(statistics, features, kinds, enabled):
    """Choose the predictor of each target; return whether any is a residual.

    Of the file and the residuals, the simplest one that no other beats clearly. One that is in use
    is kept until it is beaten at all.

    `statistics` are those of `account`; `features`: whether there are random features; `enabled`
    `[T]`: whether a residual may predict the target; `kinds` `[T]` receives the choice.
    """
    loss, seen, spread, _, _ = statistics
    residual = False
    for t in range(kinds.shape[0]):
        best = r.FILE
        if enabled[t] and seen[t] >= 2.0:
            now, least = int(kinds[t]), loss[r.FILE, t]
            for kind in range(1, 4 if features else 2):
                factor = 1.0 if kind == now else BETTER
                fine = 0.0 if best == r.FILE else _FINE * spread[t]
                if loss[kind, t] < factor * least - fine:
                    best, least = kind, loss[kind, t]
        kinds[t] = best
        residual = residual or best != r.FILE
    return residual
