"""A model with given added effects, fitted to transitions."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from serp.model import ground as g
from serp.model.learned.effect_search import search
from serp.model.learned.parameter_fit import (
    AddedEffect,
    ParameterEstimator,
    ParameterFit,
    function_columns,
    whole_symbols,
    with_effects,
)
from serp.model.learned.regression_data import (
    LiftedModel,
    RegressionData,
    predictions,
)
from serp.model.learned.robust_regression import CERTAIN
from serp.model.transition_model import TransitionModel, Vector


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
        for symbol in self.fit.rows:
            if symbol in symbols and symbol not in whole:
                known = [e for e in (*self.added, *refused) if e.target.symbol == symbol]
                rows, dt = self.fit.rows[symbol], self._model.dt
                found += search(self.lifted, self._data.states, after, rows, symbol, dt, known)
        return found

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
        if better - worse <= 2.0 * float(np.sqrt(better + worse)):  # a sign test
            return False
        differs = ours != theirs
        rivals = any(k < self._written for k in self.fit.rows[symbol].owned)
        return not rivals or bool(np.median(ours[differs]) <= 0.9 * np.median(theirs[differs]))

    def explains_away(self, without: EffectFit, symbol: str) -> bool:
        """Return whether the added effects of a function cancel or reverse an effect of the file.

        Unless the transitions imply it without the added effects, that is a coincidence: it may
        improve one-step predictions, but it misrepresents the effect of an action to a planner.
        """
        owned = [k for k in self.fit.rows[symbol].owned if k < self._written]
        sign = np.sign([self.ground.parameters[k].value for k in owned])
        size, size_before = sign * self.fit.theta[owned], sign * without.fit.theta[owned]
        error, error_before = self.fit.errors[owned], without.fit.errors[owned]
        less = (size < 0.25 * size_before) & (
            size_before - size > 2.0 * np.hypot(error, error_before)
        )
        reversed_ = (size < -CERTAIN * error) & (size_before > -2.0 * error_before)
        return bool((less & (size_before > 0.0) | reversed_).any())

    @functools.cached_property
    def _predicted(self) -> Vector:
        """Next states as the whole model predicts them, `[N, F]`."""
        model = self._whole.replace(theta=self.fit.theta)
        return predictions(model, self._data.states, self._data.actions)


def fit_jointly(model: TransitionModel, data: RegressionData) -> EffectFit:
    """Return the model as written with estimated parameters and the effects that it lacks."""
    refused: list[AddedEffect] = []
    fit = EffectFit(model, LiftedModel(model.ground), data, ())
    for turn in range(6):
        before = fit.added
        fit = _sweep(fit, refused)
        if fit.added != before and turn < 5:
            continue
        # Only now: an effect may pay only together with others.
        pruned = _pruned(fit, refused)
        if pruned is fit:
            break
        fit = pruned
    return fit


def _sweep(fit: EffectFit, refused: Sequence[AddedEffect]) -> EffectFit:
    """Search every function once."""
    pending = fit.symbols
    while pending:
        # The functions that a process reads must be right before effects are added to it.
        ready = {s for s in pending if not fit.reads(s) & pending - {s}} or set(pending)
        pending -= ready
        found = fit.search(ready, refused)
        if found:
            fit = fit.with_effects((*fit.added, *found))
    return fit


def _pruned(fit: EffectFit, refused: list[AddedEffect]) -> EffectFit:
    """Remove the effects of functions that they do not make better; add them to `refused`."""
    for symbol in dict.fromkeys(effect.target.symbol for effect in fit.added):
        own = [effect for effect in fit.added if effect.target.symbol == symbol]
        without = fit.with_effects([effect for effect in fit.added if effect not in own])
        if fit.explains_away(without, symbol) or not fit.usually_better(without, symbol):
            refused += own
            fit = without
    return fit
