"""Re-estimating the literals of a file from observed transitions.

A literal is fitted to the fluent whose change it describes: what follows from that change further
on is not its business. A wrong picture of the pole does not bend the numbers of the cart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from serp.model import ground as g
from serp.model.transition_model import TransitionModel, Vector
from serp.sysid.parameter_dependencies import ParameterDependency, parameter_dependencies
from serp.sysid.regression import Regression, independent, regress
from serp.sysid.regression_data import Flow, RegressionData, regression_data

_TURNS = 4
_LINEAR = 1e-6  # of a fluent's range: so little is the model off what its derivatives say
_STEP = 2.0**-10
_WIDE = 10.0  # the prior: a literal is of this many times the size that is written
_MOST = 0.9
_WHOLE = 1e-6
_MOST_VALUES = 64
_EXACT = 0.9  # of the rows: then a whole number follows a rule, and not a chance


@dataclass(frozen=True)
class ParameterFit:
    """The literals that the transitions speak about.

    Attributes:
        theta: `[P]`, as written where they say nothing.
        errors: `[P]` standard errors, infinite there.
        samples: `[P]` transitions that each estimate rests on.
        rows: Function symbol → the errors that are left.
    """

    theta: Vector
    errors: Vector
    samples: NDArray[np.int64]
    rows: Mapping[str, Rows]


@dataclass(frozen=True)
class Rows:
    """All (transition, fluent) pairs of one function symbol that can be compared.

    Attributes:
        rows: `[n]` positions in the sample.
        fluents: `[n]` columns of the state.
        groups: `[n]` the executed action.
        blocks: `[n]` number of the stretch of neighbouring transitions that a row belongs to.
        residuals: `[n]` observed less predicted.
        columns: `[n, K]` derivative of the prediction by the literals that change the symbol.
        owned: The K literals, positions in θ.
        unit: Observed range of the symbol's fluents.
    """

    rows: NDArray[np.int64]
    fluents: NDArray[np.int64]
    groups: NDArray[np.int64]
    blocks: NDArray[np.int64]
    residuals: Vector
    columns: Vector
    owned: tuple[int, ...]
    unit: float


class ParameterEstimator:
    """Estimates the literals of one ground model from samples.

    Args:
        ground: The model.
        dt: Control period.
        compiled: See `Flow`.

    Attributes:
        ground, dt: The same.
        flow: The model without its events.
        influences: The literals that can be estimated.
        symbols: Function symbol → columns of its fluents.
    """

    def __init__(
        self, ground: g.GroundModel, dt: float, compiled: TransitionModel | None = None
    ) -> None:
        self.ground = ground
        self.dt = dt
        self.influences = parameter_dependencies(ground)
        self.flow = Flow(ground, dt, compiled=compiled)
        symbols: dict[str, list[int]] = {}
        for fluent in ground.fluents:
            if fluent.numeric:
                symbols.setdefault(fluent.symbol, []).append(fluent.index)
        self.symbols = {name: tuple(columns) for name, columns in symbols.items()}

    def estimate(
        self,
        sample: RegressionData,
        theta: Vector,
        written: Vector,
        kept: NDArray[np.bool_] | None = None,
    ) -> ParameterFit:
        """Fit all literals at once.

        Args:
            sample: The transitions.
            theta: `[P]` where to begin.
            written: `[P]` where literals stay that the transitions do not speak about.
            kept: `[N, F]` the entries that are compared; None for those that no event of the
                model as written has changed.
        """
        theta = theta.copy()
        errors = np.full(len(theta), np.inf)
        counts = np.zeros(len(theta), dtype=np.int64)
        if kept is None:
            # By what is written: by the estimate, each would choose the rows for the next one.
            kept = self.flow.undisturbed(sample, written)
        whole = whole_symbols(self, sample)
        left: dict[str, Rows] = {}
        for _ in range(_TURNS):
            before = theta.copy()
            slopes = self.slopes(sample, theta, self.flow.predict_all(sample, theta))
            expected: dict[str, Vector] = {}
            for symbol, rows in self._rows(sample, theta, kept, slopes).items():
                width = _widths(rows, written, theta)
                active = independent(rows.columns, width)
                owned = [rows.owned[k] for k in active]
                if not owned:
                    continue
                columns = rows.columns[:, active]
                fit = regress(
                    columns,
                    rows.residuals + columns @ theta[owned],
                    centre=written[owned],
                    width=width[active],
                    groups=rows.groups,
                    blocks=rows.blocks,
                    unit=rows.unit,
                )
                if symbol in whole and not _follows_a_rule(fit, columns, rows.unit):
                    continue
                theta[owned] = fit.coefficients
                errors[owned] = fit.errors
                counts[owned] = (columns != 0.0).sum(0)
                expected[symbol] = rows.residuals - columns @ (theta - before)[owned]
            left = self._rows(sample, theta, kept, slopes)
            gaps = [_gap(left[symbol], residuals) for symbol, residuals in expected.items()]
            if max(gaps, default=0.0) <= _LINEAR:
                break
        return ParameterFit(theta, errors, counts, left)

    def _rows(
        self,
        sample: RegressionData,
        theta: Vector,
        kept: NDArray[np.bool_],
        slopes: Mapping[int, Vector],
    ) -> dict[str, Rows]:
        """Return, for each function symbol, residuals at some literals beside derivatives."""
        predicted = self.flow.predict_all(sample, theta)
        found = {}
        for symbol, fluents in self.symbols.items():
            owned = tuple(i.parameter.index for i in self.influences if i.symbol == symbol)
            row, which = np.nonzero(kept[:, fluents] & np.isfinite(predicted[:, fluents]))
            column = np.array(fluents, dtype=np.int64)[which]
            found[symbol] = Rows(
                rows=row,
                fluents=column,
                groups=sample.actions[row],
                blocks=sample.blocks[row],
                residuals=sample.next_states[row, column] - predicted[row, column],
                columns=np.stack([slopes[k][row, column] for k in owned], axis=1)
                if owned
                else np.empty((len(row), 0)),
                owned=owned,
                unit=float(sample.scale[list(fluents)].max()),
            )
        return found

    def slopes(self, sample: RegressionData, theta: Vector, predicted: Vector) -> dict[int, Vector]:
        """Return the derivatives by the literals: position in θ → `[N, F]`."""
        return {i.parameter.index: self.slope(sample, theta, predicted, i) for i in self.influences}

    def slope(
        self,
        sample: RegressionData,
        theta: Vector,
        predicted: Vector,
        influence: ParameterDependency,
    ) -> Vector:
        """Return the derivative by one literal, `[N, F]`; 0 but where it has a direct say."""
        slope = np.zeros(sample.states.shape)
        rows = np.arange(len(sample))
        if influence.actions is not None:
            rows = np.flatnonzero(np.isin(sample.actions, list(influence.actions)))
        if not len(rows):
            return slope
        index = influence.parameter.index
        step = _STEP * max(1.0, abs(theta[index]))
        moved = theta.copy()
        moved[index] += step
        change = self.flow.predict(sample.states[rows], sample.actions[rows], moved)
        change = (change - predicted[rows]) / step
        for column in influence.fluents:
            slope[rows, column] = np.nan_to_num(change[:, column], nan=0.0, posinf=0.0, neginf=0.0)
        return slope


def estimate_parameters(
    model: TransitionModel,
    states: Vector,
    actions: NDArray[np.int64],
    next_states: Vector,
    *,
    estimator: ParameterEstimator | None = None,
) -> tuple[Vector, Vector]:
    """Re-estimate the literals of effects and rates that change fluents.

    Args:
        model: The transition model; where it was given other literals than the file's, these are
            where the estimation begins.
        states: `[N, F]` before the actions, in order of time.
        actions: `[N]` positions of the executed ground actions, −1 for one that is none of them.
        next_states: `[N, F]` after them.
        estimator: One for the same ground model, where the same is estimated again and again.

    Returns:
        `[P]` literals, and `[P]` their standard errors; as written and infinite where the
        transitions say nothing: literals of rewards, conditions and events, of actions never
        executed, of fluents that jump between whole numbers by chance.
    """
    sample = regression_data(model, states, actions, next_states)
    written = np.array([p.value for p in model.parameters])
    if not len(sample):
        return written, np.full(len(written), np.inf)
    estimator = estimator or ParameterEstimator(model.ground, model.dt)
    fit = estimator.estimate(sample, model.theta, written)
    return np.where(np.isfinite(fit.errors), fit.theta, written), fit.errors


def _gap(rows: Rows, expected: Vector) -> float:
    """Return how far residuals are from those of a linear model, in ranges of the fluent.

    Rows that have no prediction any more say nothing.
    """
    if len(rows.residuals) != len(expected):
        return np.inf
    if not len(expected):
        return 0.0
    # A row that crosses a threshold jumps; nothing is to be gained by chasing it.
    return float(np.quantile(np.abs(rows.residuals - expected), _MOST)) / rows.unit


def whole_symbols(estimator: ParameterEstimator, sample: RegressionData) -> set[str]:
    """Return the functions whose observed values are a few whole numbers."""
    found = set()
    for symbol, fluents in estimator.symbols.items():
        values = np.unique(
            np.concatenate((sample.states[:, fluents], sample.next_states[:, fluents]))
        )
        if 1 < len(values) <= _MOST_VALUES and (values == np.round(values)).all():
            found.add(symbol)
    return found


def _widths(rows: Rows, written: Vector, theta: Vector) -> Vector:
    """Return the prior's width for each owned literal.

    It is as written, give or take ten times that, or what would move the fluent across its range.
    """
    owned = list(rows.owned)
    known = np.maximum(np.abs(written[owned]), np.abs(theta[owned]))
    slope = np.sqrt(np.mean(rows.columns**2, axis=0)) if len(rows.rows) else np.zeros(len(owned))
    usual = np.where(slope > 0, 0.1 * rows.unit / np.where(slope > 0, slope, 1.0), 0.0)
    widths: Vector = _WIDE * np.maximum(np.maximum(known, usual), 1e-12)
    return widths


def _follows_a_rule(fit: Regression, columns: Vector, unit: float) -> bool:
    """Whether the fit explains the changes of a whole number exactly, but for a few rows."""
    touched = (columns != 0.0).any(1)
    if not touched.any():
        return False
    exact = np.abs(fit.residuals[touched]) < _WHOLE * unit
    return bool(exact.mean() >= _EXACT)
