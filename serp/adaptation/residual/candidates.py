"""The candidates that may predict a target: their losses, and the choice among them.

Candidates are the file only and three residuals, see `serp.adaptation.parameter_buffer`: linear,
linear with random features, linear and separate for the mode. Each is evaluated on a sample before
it learns from it (prequential loss: Dawid, Journal of the Royal Statistical Society A 147, 1984).

Shapes: d inputs, T targets, S = 1 + MODES sets of statistics (set 0 over all modes).
"""

from __future__ import annotations

from typing import NamedTuple

from serp._util.compilation import cached_njit
from serp.adaptation import parameter_buffer as b
from serp.adaptation.moving_average import rate_of
from serp.adaptation.residual.outliers import EXTREME, FAR, FEW, HUGE, PATIENCE, SETTLED
from serp.model.transition_model import Vector

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

MEMORY = 0.995
"""Weight of the past in the losses, per step."""
FORGET = 0.95
"""Weight of the past in the statistics of the regression during drift, per step."""
_RECENT = 0.9
_DRIFT = 6.0
_LASTING = 0.7
_MIN_SURPRISE = 0.01
"""Drift is assumed if the recent squared error is this many times the loss. A permanent change is
assumed if this fraction of recent steps are surprises: steps whose squared error is this many times
the baseline and more than this fraction of the squared change."""
_FOURIER_GAIN, _FOURIER_KEPT = 0.7, 0.85
"""Random features cost a hundred times as much as a linear model, so they must reduce its loss to
these fractions to be chosen, and to be kept."""
_BETTER = 0.9  # fraction of the loss to which another candidate must reduce it to replace one
_PREDICTED, _CERTAIN = 0.5, 0.02
"""Largest fraction of the squared change, or of the file's squared error, left by a candidate."""
_MIN_MODE_SAMPLES = 10.0  # samples of a mode before which it follows the choice over all modes


class Statistics(NamedTuple):
    """Statistics of the samples of one group.

    Attributes:
        gram: `[S, T, 1 + d, 1 + d]` of the regression.
        moment: `[S, T, 1 + d]` of the regression.
        samples: `[S, T]` in them.
        loss: `[S, 4, T]` moving averages of the squared errors of the candidates.
        seen: `[S, T]` number of samples in the losses.
        typical: `[S, T]` moving average of |error| of the predictor in use.
        recent: `[T]` its squared error over the last few steps.
        baseline: `[T]` the same over many steps; surprises have little weight.
        surprises: `[T]` fraction of the last few steps that were surprises.
        streak: `[S, T]` successive outliers.
        spread: `[T]` moving average of the squared change.
    """

    gram: Vector
    moment: Vector
    samples: Vector
    loss: Vector
    seen: Vector
    typical: Vector
    recent: Vector
    baseline: Vector
    surprises: Vector
    streak: Vector
    spread: Vector


@cached_njit(nogil=True)
def account(sample, mode, features, fourier, published, statistics):
    """Add one sample to the losses and then to the statistics of the regression.

    A sample is the inputs `[d]`; the same less the origin of the statistics; `[T]` observed next
    value less that of effects and processes; `[T]` whether that is observed; `[T]` the change.
    `mode` is its set besides set 0, 0 for none. `features` are valid if `fourier`. `published` are
    `linear`, `amplitude` and `kinds` of `GroupParameters`.

    Returns:
        Whether every target was used, and whether a permanent change is assumed.
    """
    x, away, y, valid, change = sample
    linear, amplitude, kinds = published
    gram, moment, samples, loss, seen, typical, recent, baseline, surprises, streak, spread = (
        statistics
    )
    depth = x.shape[0]
    complete, changed = True, False
    for t in range(y.shape[0]):
        if not valid[t] or not abs(y[t]) < HUGE:
            complete = False
            continue
        plain = linear[0, t, 0]
        nonlinear = linear[1 + b.MODES, t, 0]
        own = linear[mode, t, 0]
        for i in range(depth):
            plain += linear[0, t, 1 + i] * x[i]
            nonlinear += linear[1 + b.MODES, t, 1 + i] * x[i]
            own += linear[mode, t, 1 + i] * x[i]
        if fourier:
            for k in range(features.shape[0]):
                nonlinear += amplitude[t, k] * features[k]
        else:
            nonlinear = plain
        errors = (y[t], y[t] - plain, y[t] - nonlinear, y[t] - own)
        kind = kinds[mode, t]
        error = errors[0]
        if kind == b.LINEAR:
            error = errors[1]
        elif kind == b.NONLINEAR:
            error = errors[2]
        elif kind == b.OWN:
            error = errors[3]
        size = abs(error)
        drifting = False
        for which in range(2):
            s = 0 if which == 0 else mode
            if which == 1 and mode == 0:
                break
            # An outlier among all samples may be normal in a rare mode.
            settled = seen[s, t] >= SETTLED
            least = 1e-9 * (1.0 + abs(y[t]))
            outlier = settled and size > FAR * typical[s, t] + least
            # Relative to the prediction: an observation beyond all bounds would excuse itself.
            if seen[s, t] >= FEW and typical[s, t] > 1e-9 * (1.0 + abs(y[t] - error)):
                outlier = outlier or size > EXTREME * typical[s, t]
            if outlier:
                streak[s, t] += 1.0
                if streak[s, t] <= PATIENCE:
                    complete = complete and s > 0
                    continue
            else:
                streak[s, t] = 0.0
            known = settled and streak[s, t] == 0.0
            limited = min(size, 4.0 * typical[s, t] + 1e-12) if known else size
            rate = 0.02 if settled else 1.0 / (1.0 + seen[s, t])
            typical[s, t] += rate * (limited - typical[s, t])
            if s == 0:
                slow = max(0.005, 1.0 / (1.0 + seen[0, t]))
                spread[t] += slow * (change[t] * change[t] - spread[t])
                squared = error * error
                recent[t] = _RECENT * recent[t] + (1.0 - _RECENT) * squared
                surprise = squared > max(_DRIFT * baseline[t], _MIN_SURPRISE * spread[t])
                surprises[t] = _RECENT * surprises[t] + (
                    1.0 - _RECENT if surprise and settled else 0.0
                )
                baseline[t] += slow * (
                    (min(squared, 4.0 * baseline[t]) if settled else squared) - baseline[t]
                )
                drifting = (
                    settled
                    and kind != b.FILE
                    and seen[0, t] > 2.0 / (1.0 - MEMORY)
                    and recent[t] > _DRIFT * loss[0, int(kinds[0, t]), t] + 1e-18
                )
                if surprises[t] > _LASTING:
                    drifting = changed = True
            seen[s, t] += 1.0
            # Losses of candidates with few samples soon lose weight.
            rate = rate_of(seen[s, t] - 1.0, MEMORY)
            for candidate in range(4):
                squared = errors[candidate] * errors[candidate]
                if candidate != b.FILE and seen[s, t] <= FEW:
                    squared = min(squared, errors[0] * errors[0])
                    if seen[s, t] == 2.0:
                        loss[s, candidate, t] = squared
                        continue
                loss[s, candidate, t] += rate * (squared - loss[s, candidate, t])
            keep = FORGET if drifting else 1.0
            samples[s, t] = keep * samples[s, t] + 1.0
            for i in range(1 + depth):
                a = 1.0 if i == 0 else away[i - 1]
                moment[s, t, i] = keep * moment[s, t, i] + a * y[t]
                for j in range(1 + depth):
                    other = 1.0 if j == 0 else away[j - 1]
                    gram[s, t, i, j] = keep * gram[s, t, i, j] + a * other
    return complete, changed


@cached_njit(nogil=True)
def choose(loss, seen, spread, fourier, modes, kinds, enabled):
    """Choose the predictor of each target in each mode; return whether any is a residual.

    The file is used until a candidate predicts clearly better, and at least half of the change: the
    mean of widely scattered values is not one of them, and no basis for a plan. Among the other
    candidates the best one is chosen, with some hysteresis.

    `fourier`: whether there are random features; `modes`: how many are in use; `enabled`
    `[T]`: whether a residual may predict the target; `kinds` `[1 + MODES, T]`
    receives the choice.
    """
    residual = False
    for s in range(modes + 1):
        for t in range(kinds.shape[1]):
            if not enabled[t]:
                kinds[s, t] = b.FILE
                continue
            of = s if s == 0 or seen[s, t] >= _MIN_MODE_SAMPLES else 0
            now = int(kinds[of, t]) if of == s else int(kinds[0, t])
            best, least = b.FILE, _BETTER * loss[of, b.FILE, t]
            worth = max(_PREDICTED * spread[t], _CERTAIN * loss[of, b.FILE, t])
            least = min(least, worth) if seen[0, t] >= 2.0 else -1.0
            if loss[of, b.LINEAR, t] < least:
                best, least = b.LINEAR, loss[of, b.LINEAR, t]
            if fourier and loss[of, b.NONLINEAR, t] < _FOURIER_GAIN * least:
                best, least = b.NONLINEAR, loss[of, b.NONLINEAR, t]
            if of > 0 and loss[of, b.OWN, t] < least:
                best, least = b.OWN, loss[of, b.OWN, t]
            kept = now != b.FILE and not (now == b.OWN and of == 0)
            if now == b.NONLINEAR:
                limit = _FOURIER_KEPT * loss[of, b.LINEAR, t]
                kept = kept and fourier and not loss[of, b.NONLINEAR, t] > limit
            if (
                kept
                and best != now
                and best != b.FILE
                and loss[of, best, t] > _BETTER * loss[of, now, t]
                and loss[of, now, t] < _BETTER * loss[of, b.FILE, t]
            ):
                best = now
            kinds[s, t] = best
            residual = residual or best != b.FILE
    return residual
