"""A model with certain additions, fitted to transitions: what it explains, and what it leaves."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from serp.model import ground as g
from serp.model.transition_model import TransitionModel, Vector
from serp.sysid.added_effects import AddedEffect, columns_of, with_additions
from serp.sysid.effect_search import LASTING, improvement_of, search
from serp.sysid.lifted_features import WORLD, Lifting
from serp.sysid.parameter_fit import ParameterEstimator, ParameterFit, Rows, whole_symbols
from serp.sysid.regression_data import Flow, RegressionData, predictions

_CERTAIN = 4.0  # standard errors of a term that stays
_AGREED = 2.0  # standard errors
_MOST = 2.0  # standard errors of a coin that shows which error is the smaller one
_CLEARLY = 0.9  # of the median error
_LEFT = 0.25  # of an effect
_AS_GOOD = 0.02  # of the squared error
_TRIMMED = 0.02  # of the rows


class _Estimator(ParameterEstimator):
    """Estimates literals and coefficients; the latter's derivatives need no second prediction."""

    def __init__(self, lifting: Lifting, additions: Sequence[AddedEffect], dt: float) -> None:
        super().__init__(with_additions(lifting, additions), dt)
        self.lifting = lifting
        self.additions = additions
        self._acts = Flow(self.ground, dt, processes=False)

    def after(self, sample: RegressionData, theta: Vector) -> Vector:
        """Return the states once the effects of the actions are applied, `[N, F]`."""
        return self._acts.predict_all(sample, theta)

    def slopes(self, sample: RegressionData, theta: Vector, predicted: Vector) -> dict[int, Vector]:
        """Return the derivatives by literals and coefficients, each `[N, F]`."""
        written = len(self.lifting.ground.parameters)
        own = self.influences
        found = {
            i.parameter.index: self.slope(sample, theta, predicted, i)
            for i in own
            if i.parameter.index < written
        }
        after = self.after(sample, theta) if any(i.actions is None for i in own) else sample.states
        for influence in own:
            index = influence.parameter.index
            if index >= written:
                addition = self.additions[index - written]
                unit = self.dt if addition.schema == WORLD else 1.0
                slope = np.zeros(sample.states.shape)
                for column, values in columns_of(
                    self.lifting, addition, sample.states, after, sample.actions
                ).items():
                    slope[:, column] = unit * values
                found[index] = slope
        return found


class EffectFit:
    """A model with certain additions, fitted.

    Args:
        model: The model as written.
        lifting: Its names.
        sample: At least one transition.
        additions: The terms that it has beside the file's.
        before: The trial with whose estimates the fit begins; None for those of the file.

    Attributes:
        lifting, sample, additions: The same.
        ground: The model with the additions.
        fit: All literals, those of the additions behind those of the file.
    """

    def __init__(
        self,
        model: TransitionModel,
        lifting: Lifting,
        sample: RegressionData,
        additions: Sequence[AddedEffect],
        before: EffectFit | None = None,
    ) -> None:
        self._model = model
        self.lifting = lifting
        self.sample = sample
        self.additions = tuple(additions)
        self._dt = model.dt
        self._estimator = _Estimator(lifting, self.additions, model.dt)
        self.ground = self._estimator.ground
        self._written = len(model.ground.parameters)
        written = np.array([p.value for p in self.ground.parameters])
        theta = written.copy()
        if before is None:
            self._kept = self._estimator.flow.undisturbed(sample, written)
        else:  # no addition counts for anything as written
            self._kept = before._kept
            theta[: self._written] = before.fit.theta[: self._written]
            found = before.coefficients
            theta[self._written :] = [found.get(addition, 0.0) for addition in self.additions]
        self.fit: ParameterFit = self._estimator.estimate(sample, theta, written, self._kept)

    def with_additions(self, additions: Sequence[AddedEffect]) -> EffectFit:
        """Return the same with other additions."""
        return EffectFit(self._model, self.lifting, self.sample, additions, self)

    @property
    def coefficients(self) -> dict[AddedEffect, float]:
        """The estimates of the additions."""
        estimates = self.fit.theta[self._written :].tolist()
        return dict(zip(self.additions, estimates, strict=True))

    @property
    def symbols(self) -> set[str]:
        """The functions whose changes are explained."""
        return set(self._estimator.symbols)

    def reads(self, symbol: str) -> set[str]:
        """Return the functions that actions change and processes that change the symbol read."""
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
        """Return further terms that pay, for some functions."""
        after = self._estimator.after(self.sample, self.fit.theta)
        whole = whole_symbols(self._estimator, self.sample)
        found: list[AddedEffect] = []
        for symbol, rows in self.fit.rows.items():
            if symbol in symbols and symbol not in whole:
                known = [*self.additions, *refused]
                own = [a for a in known if a.target.symbol == symbol]
                found += search(self.lifting, self.sample, after, rows, symbol, self._dt, own)
        return found

    def worst(self) -> AddedEffect | None:
        """Return the addition that pays least, if one does not pay; None where all do."""
        worst: tuple[float, AddedEffect] | None = None
        for rows in self.fit.rows.values():
            change = (self.sample.next_states - self.sample.states)[rows.rows, rows.fluents]
            for k, literal in enumerate(rows.owned):
                if literal < self._written:
                    continue
                addition = self.additions[literal - self._written]
                worth = _worth(self.fit, rows, change, k, addition)
                if worth < 1.0 and (worst is None or worth < worst[0]):
                    worst = worth, addition
        return None if worst is None else worst[1]

    def usually_better(self, without: EffectFit, symbol: str) -> bool:
        """Whether the additions of a function make most errors of it smaller, not only the largest.

        Where a line through a few large changes makes all the difference, the function has another
        form, and the line is wrong nearly everywhere. Where the file has effects on the function,
        their numbers alone have to fall clearly behind.

        Args:
            without: The same without these additions.
            symbol: The function.
        """
        columns = [f.index for f in self.ground.fluents if f.symbol == symbol]
        observed = self.sample.next_states[:, columns]
        ours, theirs = (
            np.abs(trial._predicted[:, columns] - observed) for trial in (self, without)
        )
        better, worse = int((ours < theirs).sum()), int((ours > theirs).sum())
        if better - worse <= _MOST * float(np.sqrt(better + worse)):
            return False
        differs = ours != theirs
        rivals = any(k < self._written for k in self.fit.rows[symbol].owned)
        most = _CLEARLY * float(np.median(theirs[differs]))
        return not rivals or float(np.median(ours[differs])) <= most

    def explains_away(self, without: EffectFit, symbol: str) -> bool:
        """Whether the additions of a function take away an effect of the file, or turn it round.

        Where the transitions alone do not say so, what leaves little of an effect goes with it by
        chance: it may predict the next step, and means nothing to a planner that asks what an
        action is good for.

        Args:
            without: The same without these additions.
            symbol: The function.
        """
        owned = [k for k in self.fit.rows[symbol].owned if k < self._written]
        sign = np.sign([self.ground.parameters[k].value for k in owned])
        size, alone = sign * self.fit.theta[owned], sign * without.fit.theta[owned]
        error, before = self.fit.errors[owned], without.fit.errors[owned]
        less = (size < _LEFT * alone) & (alone - size > _AGREED * np.hypot(error, before))
        turned = (size < -_CERTAIN * error) & (alone > -_AGREED * before)
        return bool((less & (alone > 0.0) | turned).any())

    @functools.cached_property
    def _predicted(self) -> Vector:
        """What the model says of the sample, events and all, `[N, F]`."""
        model = TransitionModel(self.ground, dt=self._dt, theta=self.fit.theta)
        return predictions(model, self.sample.states, self.sample.actions)

    def as_good_as(self, other: EffectFit) -> bool:
        """Whether it explains every function as well, but for what no term would be added for."""
        for symbol, rows in self.fit.rows.items():
            change = (self.sample.next_states - self.sample.states)[rows.rows, rows.fluents]
            spared = LASTING * float((change**2).sum())
            most = (1.0 + _AS_GOOD) * _squares(other.fit.rows[symbol]) + spared
            if _squares(rows) > most:
                return False
        return True


def _squares(rows: Rows) -> float:
    """Return the sum of squared errors, but for the largest, which may be anything."""
    squares = np.sort(rows.residuals**2)
    return float(squares[: len(squares) - int(_TRIMMED * len(squares))].sum())


def _worth(fit: ParameterFit, rows: Rows, change: Vector, k: int, addition: AddedEffect) -> float:
    """Return how far an addition is above what it has to be: from 1 on it pays."""
    literal = rows.owned[k]
    if not np.isfinite(fit.errors[literal]):
        return 0.0
    certain = abs(float(fit.theta[literal])) / max(_CERTAIN * float(fit.errors[literal]), 1e-300)
    column = rows.columns[:, k]
    touched = column != 0.0
    if not touched.any():
        return 0.0
    others = np.delete(rows.columns, k, axis=1)[touched]
    own = column[touched]
    if others.shape[1]:
        own = own - others @ np.linalg.lstsq(others, own, rcond=None)[0]
    gain = float(fit.theta[literal]) ** 2 * float((own**2).sum())
    typical = float((change[touched] ** 2).sum())
    share = gain / max(improvement_of(addition).change * typical, 1e-300)
    return min(certain, share)
