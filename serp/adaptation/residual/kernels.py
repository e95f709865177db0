"""The compiled loops of the online regression.

Shapes: d inputs, T targets, S = 1 + MODES sets of statistics (entry 0 over all modes), four
candidates (see `serp.adaptation.parameter_buffer`: the file alone, linear, wavy, the mode's own).
"""

from __future__ import annotations

from serp._util.compilation import cached_njit
from serp.adaptation import parameter_buffer as b
from serp.adaptation.moving_average import rate_of
from serp.adaptation.residual.outliers import HUGE

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

_FILE, _LINEAR, _WAVY, _OWN, _MODES = b.FILE, b.LINEAR, b.WAVY, b.OWN, b.MODES

SETTLED = 30
"""Before so many samples it is not known what is usual."""
FAR = 8.0
"""So many times the usual error is an outlier."""
PATIENCE = 3
"""So many outliers in a row are no outliers: the world has changed."""
FIRST = 5
"""Before so many samples nothing is an outlier, before `SETTLED` only what is `WILD`."""
WILD = 100.0
"""So many times the usual error, or the known range of an input, is beyond all measure."""
MEMORY = 0.995
"""Weight of the past in the losses that candidates are compared by, a step."""
_RECENT = 0.9
"""Weight of the past in the loss that shows that the world drifts, a step."""
_DRIFTING = 6.0
_MUCH = 0.7
"""Random features cost a hundred times as much; they have to leave so much less."""
_STILL = 0.85
"""The same of those that are in use."""
_FORESEEN = 0.5
"""Share of the squared change that may be left of a target for it to be corrected."""
_CERTAIN = 0.02
"""The same of the file's squared error, whatever changes."""
JUDGED_FROM = 120
"""Before so many samples of an action nobody knows whether a target can be foreseen."""
_CHANGED = 0.7
"""Where such a share of the last ten samples or so is odd, the world has changed for good."""
_AMISS = 0.01
"""Share of the squared change that an error is to be to count as odd there."""
FORGET = 0.95
"""Weight of the past in the statistics, a step, while the world drifts."""


@cached_njit(nogil=True)
def find_mode(x, bits, codes, modes):
    """Return the code of the predicates that hold, and which mode has it; 0: none.

    Args:
        x: `[d]` inputs.
        bits: Positions of the predicates within them.
        codes: `[1 + MODES]` of the modes, from entry 1 on.
        modes: How many there are.
    """
    code, weight = 0.0, 1.0
    for k in range(bits.shape[0]):
        if x[bits[k]] != 0.0:
            code += weight
        weight *= 2.0
    for mode in range(1, modes + 1):
        if codes[mode] == code:
            return code, mode
    return code, 0


@cached_njit(nogil=True)
def account(x, away, y, valid, change, mode, features, waves, linear, amplitude, kinds,
            gram, moment, count, loss, seen, usual, recent, calm, odd, streak,
            spread):  # fmt: skip
    """Take one sample into account, losses first: they are of data not seen before.

    Args:
        x: `[d]` inputs.
        away: `[d]` the same less the origin that statistics are about.
        y: `[T]` observed next value less what effects and processes make of the old one.
        valid: `[T]` whether `y` says anything.
        change: `[T]` observed change.
        mode: Which set it belongs to besides set 0; 0 for none.
        features: `[WAVES]` random features, where `waves`.
        waves: Whether there are any.
        linear: As published, see `GroupMemory`.
        amplitude: The same.
        kinds: The same.
        gram: `[S, T, 1 + d, 1 + d]` statistics.
        moment: `[S, T, 1 + d]` statistics.
        count: `[S, T]` samples in them.
        loss: `[S, 4, T]` decayed mean squared errors of the candidates.
        seen: `[S, T]` samples that the losses are of.
        usual: `[S, T]` decayed mean |error| of who predicts.
        recent: `[T]` decayed squared error of who predicts, of the last few steps.
        calm: `[T]` the same over many steps; what is odd counts for little.
        odd: `[T]` share of the last few steps that were odd by that.
        streak: `[S, T]` outliers in a row.
        spread: `[T]` decayed squared change.

    Returns:
        Whether every target was taken, and whether the world has changed for good.
    """
    depth = x.shape[0]
    complete, changed = True, False
    for t in range(y.shape[0]):
        if not valid[t] or not abs(y[t]) < HUGE:
            complete = False
            continue
        plain = linear[0, t, 0]
        wavy = linear[1 + _MODES, t, 0]
        own = linear[mode, t, 0]
        for i in range(depth):
            plain += linear[0, t, 1 + i] * x[i]
            wavy += linear[1 + _MODES, t, 1 + i] * x[i]
            own += linear[mode, t, 1 + i] * x[i]
        if waves:
            for k in range(features.shape[0]):
                wavy += amplitude[t, k] * features[k]
        else:
            wavy = plain
        errors = (y[t], y[t] - plain, y[t] - wavy, y[t] - own)
        kind = kinds[mode, t]
        error = errors[0]
        if kind == _LINEAR:
            error = errors[1]
        elif kind == _WAVY:
            error = errors[2]
        elif kind == _OWN:
            error = errors[3]
        size = abs(error)
        drifting = False
        for which in range(2):
            s = 0 if which == 0 else mode
            if which == 1 and mode == 0:
                break
            # What is odd among all samples may be what always happens in a mode seldom met.
            settled = seen[s, t] >= SETTLED
            least = 1e-9 * (1.0 + abs(y[t]))
            outlier = settled and size > FAR * usual[s, t] + least
            # By what was predicted: a number beyond all measure would excuse itself.
            if seen[s, t] >= FIRST and usual[s, t] > 1e-9 * (1.0 + abs(y[t] - error)):
                outlier = outlier or size > WILD * usual[s, t]
            if outlier:
                streak[s, t] += 1.0
                if streak[s, t] <= PATIENCE:
                    complete = complete and s > 0
                    continue
            else:
                streak[s, t] = 0.0
            known = settled and streak[s, t] == 0.0
            limited = min(size, 4.0 * usual[s, t] + 1e-12) if known else size
            rate = 0.02 if settled else 1.0 / (1.0 + seen[s, t])
            usual[s, t] += rate * (limited - usual[s, t])
            if s == 0:
                slow = max(0.005, 1.0 / (1.0 + seen[0, t]))
                spread[t] += slow * (change[t] * change[t] - spread[t])
                squared = error * error
                recent[t] = _RECENT * recent[t] + (1.0 - _RECENT) * squared
                amiss = squared > max(_DRIFTING * calm[t], _AMISS * spread[t])
                odd[t] = _RECENT * odd[t] + (1.0 - _RECENT if amiss and settled else 0.0)
                calm[t] += slow * ((min(squared, 4.0 * calm[t]) if settled else squared) - calm[t])
                normal = loss[0, int(kinds[0, t]), t]
                drifting = (
                    settled
                    and kind != _FILE
                    and seen[0, t] > 2.0 / (1.0 - MEMORY)
                    and recent[t] > _DRIFTING * normal + 1e-18
                )
                if odd[t] > _CHANGED:
                    drifting = changed = True
            seen[s, t] += 1.0
            # What the candidates predicted before they knew anything is soon forgotten.
            rate = rate_of(seen[s, t] - 1.0, MEMORY)
            for candidate in range(4):
                squared = errors[candidate] * errors[candidate]
                if candidate != _FILE and seen[s, t] <= FIRST:
                    # Nobody knew anything before the first sample, and little before the next.
                    squared = min(squared, errors[0] * errors[0])
                    if seen[s, t] == 2.0:
                        loss[s, candidate, t] = squared
                        continue
                loss[s, candidate, t] += rate * (squared - loss[s, candidate, t])
            keep = FORGET if drifting else 1.0
            count[s, t] = keep * count[s, t] + 1.0
            for i in range(1 + depth):
                a = 1.0 if i == 0 else away[i - 1]
                moment[s, t, i] = keep * moment[s, t, i] + a * y[t]
                for j in range(1 + depth):
                    other = 1.0 if j == 0 else away[j - 1]
                    gram[s, t, i, j] = keep * gram[s, t, i, j] + a * other
    return complete, changed


@cached_njit(nogil=True)
def choose(loss, seen, spread, waves, modes, kinds, enabled):
    """Choose who predicts each target in each mode; return whether anybody but the file does.

    The file stays until somebody has predicted clearly better, and at least half of what happens:
    the mean of things that differ widely is nothing that happens, and no plan can be built on it.
    Of the others the best one is followed, with some inertia.
    """
    anybody = False
    for s in range(modes + 1):
        for t in range(kinds.shape[1]):
            if not enabled[t]:
                kinds[s, t] = _FILE
                continue
            # A mode that was hardly seen follows what is known over all modes.
            of = s if s == 0 or seen[s, t] >= 10.0 else 0
            now = int(kinds[of, t]) if of == s else int(kinds[0, t])
            best, least = _FILE, 0.9 * loss[of, _FILE, t]
            worth = max(_FORESEEN * spread[t], _CERTAIN * loss[of, _FILE, t])
            least = min(least, worth) if seen[0, t] >= 2.0 else -1.0
            if loss[of, _LINEAR, t] < least:
                best, least = _LINEAR, loss[of, _LINEAR, t]
            if waves and loss[of, _WAVY, t] < _MUCH * least:
                best, least = _WAVY, loss[of, _WAVY, t]
            if of > 0 and loss[of, _OWN, t] < least:
                best, least = _OWN, loss[of, _OWN, t]
            if (
                best != now
                and now != _FILE
                and best != _FILE
                and not (now == _WAVY and not waves)
                and not (now == _WAVY and loss[of, _WAVY, t] > _STILL * loss[of, _LINEAR, t])
                and not (now == _OWN and of == 0)
                and loss[of, best, t] > 0.9 * loss[of, now, t]
                and loss[of, now, t] < 0.9 * loss[of, _FILE, t]
            ):
                best = now
            kinds[s, t] = best
            anybody = anybody or best != _FILE
    return anybody


@cached_njit(nogil=True)
def judge(loss, seen, spread, waves, enabled, left, change):
    """Judge whether targets can be foreseen, once there are enough samples to tell.

    Adds to `left` `[T]` what the best candidate leaves of each, to `change` `[T]` what it may leave
    at most by `choose`; both are sums over the samples that the losses remember.
    """
    for t in range(spread.shape[0]):
        if not enabled[t] or seen[0, t] < JUDGED_FROM:
            continue
        least = min(loss[0, _FILE, t], loss[0, _LINEAR, t])
        if waves:
            least = min(least, loss[0, _WAVY, t])
        samples = min(seen[0, t], 1.0 / (1.0 - MEMORY))
        left[t] += samples * least
        change[t] += samples * max(_FORESEEN * spread[t], _CERTAIN * loss[0, _FILE, t])
