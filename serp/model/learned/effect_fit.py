"""A model with given added effects, fitted to transitions."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from serp.model import ground as g
from serp.model.learned.effect_search import LASTING, improvement_of, search
from serp.model.learned.parameter_fit import (
    AddedEffect,
    ParameterEstimator,
    ParameterFit,
    Rows,
    function_columns,
    whole_symbols,
    with_effects,
)
from serp.model.learned.regression_data import (
    WORLD,
    LiftedFluent,
    LiftedModel,
    RegressionData,
    predictions,
)
from serp.model.learned.robust_regression import CERTAIN
from serp.model.transition_model import TransitionModel, Vector

_AGREE = 2.0  # standard errors within which two estimates agree
_SIGN_TEST = 2.0
"""Standard deviations of the sign test that decides which errors are usually smaller."""
_CLEARLY = 0.9  # largest ratio of median errors that counts as clearly smaller
_REMAINDER = 0.25  # least fraction of an effect of the file that remains beside an added effect
_AS_GOOD = 0.02  # relative increase of the squared error that is ignored
_TRIMMED = 0.02  # fraction of the rows, those with the largest errors, that a comparison ignores


class EffectFit:
    """The model as written with added effects, fitted to at least one transition.

    The estimates of the fit `before` are the initial values, or the file's parameters.

    Attributes:
        ground: The model with the added effects.
        fit: All parameters; the coefficients of the added effects follow those of the file.
    """

    def __init__(
        self,
        model: TransitionModel,
        lifted: LiftedModel,
        data: RegressionData,
        added: Sequence[AddedEffect],
        before: EffectFit | None = None,
    ) -> None:
        self._model = model
        self._data = data
        self.lifted = lifted
        self.added = tuple(added)
        self.ground = with_effects(lifted, self.added)
        self._whole = TransitionModel(self.ground, dt=model.dt)
        self._estimator = ParameterEstimator(self._whole, lifted, self.added)
        self._written = len(model.ground.parameters)
        theta = self._estimator.written.copy()
        if before is None:
            self._kept = self._estimator.flow.undisturbed(data, theta)
        else:  # an added effect with coefficient 0 changes nothing
            self._kept = before._kept
            theta[: self._written] = before.fit.theta[: self._written]
            found = before.coefficients
            theta[self._written :] = [found.get(effect, 0.0) for effect in self.added]
        self.fit: ParameterFit = self._estimator.estimate(data, theta, self._kept)

    def with_effects(self, added: Sequence[AddedEffect]) -> EffectFit:
        """Return the fit of the same model with other effects."""
        return EffectFit(self._model, self.lifted, self._data, added, self)

    @property
    def coefficients(self) -> dict[AddedEffect, float]:
        """The estimates of the added effects."""
        estimates = self.fit.theta[self._written :].tolist()
        return dict(zip(self.added, estimates, strict=True))

    @property
    def symbols(self) -> set[str]:
        """The functions whose changes are fitted."""
        return set(function_columns(self.ground))

    def reads(self, symbol: str) -> set[str]:
        """Return the functions that are changed by actions and read by processes of a symbol."""
        fluents = self.ground.fluents
        moved = {t for action in self.ground.actions for t in g.writes(action)}
        return {
            fluents[read].symbol
            for process in self.ground.processes
            if any(t >= 0 and fluents[t].symbol == symbol for t in g.writes(process))
            for read in g.reads(process)
            if read >= 0 and read in moved
        }

    def search(self, symbols: set[str], refused: Sequence[AddedEffect]) -> list[AddedEffect]:
        """Return further effects that improve the fit, for some functions."""
        after = self._estimator.after_actions(self._data, self.fit.theta)
        whole = whole_symbols(function_columns(self.ground), self._data)
        found: list[AddedEffect] = []
        for symbol, rows in self.fit.rows.items():
            if symbol in symbols and symbol not in whole:
                known = [*self.added, *refused]
                own = [effect for effect in known if effect.target.symbol == symbol]
                dt = self._model.dt
                found += search(self.lifted, self._data, after, rows, symbol, dt, own)
        return found

    def worst(self) -> AddedEffect | None:
        """Return the least useful added effect if it does not pay; None where all do."""
        worst: tuple[float, AddedEffect] | None = None
        for rows in self.fit.rows.values():
            change = self._change(rows)
            for k, parameter in enumerate(rows.owned):
                if parameter < self._written:
                    continue
                effect = self.added[parameter - self._written]
                worth = _worth(self.fit, rows, change, k, effect)
                if worth < 1.0 and (worst is None or worth < worst[0]):
                    worst = worth, effect
        return None if worst is None else worst[1]

    def usually_better(self, without: EffectFit, symbol: str) -> bool:
        """Return whether the added effects of a function make most of its errors smaller.

        If only a few large errors become smaller, the function has another form and the effects are
        wrong nearly everywhere. If the file has effects on the function, the median error must be
        clearly smaller as well.
        """
        columns = [f.index for f in self.ground.fluents if f.symbol == symbol]
        observed = self._data.next_states[:, columns]
        ours, theirs = (np.abs(fit._predicted[:, columns] - observed) for fit in (self, without))
        better, worse = int((ours < theirs).sum()), int((ours > theirs).sum())
        if better - worse <= _SIGN_TEST * float(np.sqrt(better + worse)):
            return False
        differs = ours != theirs
        rivals = any(k < self._written for k in self.fit.rows[symbol].owned)
        most = _CLEARLY * float(np.median(theirs[differs]))
        return not rivals or float(np.median(ours[differs])) <= most

    def explains_away(self, without: EffectFit, symbol: str) -> bool:
        """Return whether the added effects of a function cancel or reverse an effect of the file.

        Unless the transitions imply it without the added effects, that is a coincidence: it may
        improve one-step predictions, but it misrepresents the effect of an action to a planner.
        """
        owned = [k for k in self.fit.rows[symbol].owned if k < self._written]
        sign = np.sign([self.ground.parameters[k].value for k in owned])
        size, size_before = sign * self.fit.theta[owned], sign * without.fit.theta[owned]
        error, error_before = self.fit.errors[owned], without.fit.errors[owned]
        less = (size < _REMAINDER * size_before) & (
            size_before - size > _AGREE * np.hypot(error, error_before)
        )
        reversed_ = (size < -CERTAIN * error) & (size_before > -_AGREE * error_before)
        return bool((less & (size_before > 0.0) | reversed_).any())

    def as_good_as(self, other: EffectFit) -> bool:
        """Return whether it explains every function as well, up to errors that need no effect."""
        for symbol, rows in self.fit.rows.items():
            spared = LASTING * float((self._change(rows) ** 2).sum())
            most = (1.0 + _AS_GOOD) * _trimmed_squares(other.fit.rows[symbol]) + spared
            if _trimmed_squares(rows) > most:
                return False
        return True

    def _change(self, rows: Rows) -> Vector:
        return (self._data.next_states - self._data.states)[rows.rows, rows.fluents]

    @functools.cached_property
    def _predicted(self) -> Vector:
        """Next states as the whole model predicts them, `[N, F]`."""
        model = self._whole.replace(theta=self.fit.theta)
        return predictions(model, self._data.states, self._data.actions)


def _trimmed_squares(rows: Rows) -> float:
    """Return the sum of squared errors without the largest ones."""
    squares = np.sort(rows.residuals**2)
    return float(squares[: len(squares) - int(_TRIMMED * len(squares))].sum())


def _worth(fit: ParameterFit, rows: Rows, change: Vector, k: int, effect: AddedEffect) -> float:
    """Return what an added effect explains, relative to the threshold: from 1 on it pays."""
    index = rows.owned[k]
    if not np.isfinite(fit.errors[index]):
        return 0.0
    certain = abs(float(fit.theta[index])) / max(CERTAIN * float(fit.errors[index]), 1e-300)
    column = rows.columns[:, k]
    touched = column != 0.0
    if not touched.any():
        return 0.0
    others = np.delete(rows.columns, k, axis=1)[touched]
    own = column[touched]
    if others.shape[1]:
        own = own - others @ np.linalg.lstsq(others, own, rcond=None)[0]
    gain = float(fit.theta[index]) ** 2 * float((own**2).sum())
    typical = float((change[touched] ** 2).sum())
    return min(certain, gain / max(improvement_of(effect).change * typical, 1e-300))


_MAX_SWEEPS = 6
_EQUAL = 0.1  # coefficients that differ by less than this fraction of the larger one may be equal


def fit_jointly(model: TransitionModel, data: RegressionData) -> EffectFit:
    """Return the model as written with estimated parameters and the effects that it lacks."""
    refused: list[AddedEffect] = []
    fit = EffectFit(model, LiftedModel(model.ground), data, ())
    for turn in range(_MAX_SWEEPS):
        fit, more = _sweep(fit, refused)
        if more and turn < _MAX_SWEEPS - 1:
            continue
        # Only now: an effect may pay only together with others.
        pruned = _pruned(fit, refused)
        if pruned is fit:
            break
        fit = pruned
    return _simplified(fit)


def _sweep(fit: EffectFit, refused: Sequence[AddedEffect]) -> tuple[EffectFit, bool]:
    """Search every function once; return the fit, and whether effects were added."""
    before = fit.added
    pending = fit.symbols
    while pending:
        # The functions that a process reads must be right before effects are added to it.
        ready = {s for s in pending if not fit.reads(s) & pending - {s}} or set(pending)
        pending -= ready
        found = fit.search(ready, refused)
        if found:
            fit = fit.with_effects((*fit.added, *found))
    return fit, fit.added != before


def _pruned(fit: EffectFit, refused: list[AddedEffect]) -> EffectFit:
    """Remove effects that do not pay, the worst first; add them to `refused`."""
    while (worst := fit.worst()) is not None:
        refused.append(worst)
        fit = fit.with_effects([effect for effect in fit.added if effect != worst])
    for symbol in dict.fromkeys(effect.target.symbol for effect in fit.added):
        own = [effect for effect in fit.added if effect.target.symbol == symbol]
        without = fit.with_effects([effect for effect in fit.added if effect not in own])
        if fit.explains_away(without, symbol) or not fit.usually_better(without, symbol):
            refused += own
            fit = without
    return fit


def _simplified(fit: EffectFit) -> EffectFit:
    """Replace equal effects of several actions by one of the world, if that fits as well."""
    for several, one in shared_effects(fit.lifted, fit.coefficients):
        kept = [effect for effect in (*fit.added, one) if effect not in several]
        simpler = fit.with_effects(kept)
        if simpler.as_good_as(fit):
            fit = simpler
    return fit


def shared_effects(
    lifted: LiftedModel, coefficients: Mapping[AddedEffect, float]
) -> Iterator[tuple[list[AddedEffect], AddedEffect]]:
    """Yield nearly equal effects of different schemas, and the world's effect for all of them.

    The world's effect also applies after all other actions, so it need not fit.
    """
    groups: dict[tuple[str, tuple[str, ...]], list[AddedEffect]] = {}
    for effect in coefficients:
        groups.setdefault(effect.symbols, []).append(effect)

    def equal(effect: AddedEffect, group: list[AddedEffect]) -> list[AddedEffect]:
        value = coefficients[effect]
        most = {o: _EQUAL * max(abs(coefficients[o]), abs(value)) for o in group}
        return [other for other in group if abs(coefficients[other] - value) <= most[other]]

    for group in groups.values():
        if any(effect.schema == WORLD for effect in group):
            continue
        alike = max((equal(effect, group) for effect in group), key=len)
        general = _of_the_world(lifted, alike[0])
        if len({effect.schema for effect in alike}) > 1 and general is not None:
            yield alike, general


def _of_the_world(lifted: LiftedModel, effect: AddedEffect) -> AddedEffect | None:
    """Return the same effect of the world; None where its factors cannot be named there."""
    scope = lifted.world(effect.target.symbol)
    (target,) = scope.targets
    names = dict(zip(effect.target.terms, target.terms, strict=True))
    factors = tuple(
        LiftedFluent(factor.symbol, tuple(names.get(term, term) for term in factor.terms))
        for factor in effect.factors
    )
    if not set(factors) <= set(scope.fluents):
        return None
    return AddedEffect(WORLD, target, factors)
