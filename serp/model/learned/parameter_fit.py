"""Estimation of the parameters of a file from observed transitions, offline and during a run.

A parameter is fitted to the fluent whose change it describes, and not to later consequences of that
change: a wrong model of the pole does not distort the parameters of the cart.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp.model import ground_model as g
from serp.model.learned.regression_data import (
    WORLD,
    LiftedFluent,
    LiftedModel,
    RegressionData,
    predictions,
    regression_data,
    undisturbed,
    usable_rows,
    without_events,
)
from serp.model.learned.robust_regression import Regression, independent, regress
from serp.model.learned.transitions import TransitionMemory
from serp.model.transition_model import TransitionModel, Vector
from serp.pddl.syntax import Change, Kind, nodes_in

_ALWAYS = g.Constant(True)


@dataclass(frozen=True, order=True)
class AddedEffect:
    """One added term: the change of a fluent by a coefficient times the product of the factors.

    `schema` is an action schema, or `WORLD` for a process; without factors, it is a constant.
    """

    schema: str
    target: LiftedFluent
    factors: tuple[LiftedFluent, ...]

    @property
    def symbols(self) -> tuple[str, tuple[str, ...]]:
        """The symbols of target and factors: equal for the same term of different schemas."""
        return self.target.symbol, tuple(f.symbol for f in self.factors)


def with_effects(lifted: LiftedModel, added: Sequence[AddedEffect]) -> g.GroundModel:
    """Return the ground model with further effects, one new parameter each, whose value is 0.

    The new parameters follow those of the file, in the order of the effects. An effect is added to
    every instance of its schema; an effect of the world becomes a process for every fluent of its
    symbol.
    """
    ground = lifted.ground
    parameters, actions = list(ground.parameters), list(ground.actions)
    processes = list(ground.processes)
    for term in added:
        world = term.schema == WORLD
        scope = lifted.world(term.target.symbol) if world else lifted.schema(term.schema)
        index = len(parameters)
        place = ground.actions[0 if world else next(iter(scope.bindings))].place
        parameters.append(g.Parameter(index, 0.0, "rate" if world else "effect", place))
        for key, binding in scope.bindings.items():
            value: g.Value = g.ParameterRef(index)
            for factor in term.factors:
                value = g.Operation("*", value, g.Read(lifted.column(factor, binding)))
            target = lifted.column(term.target, binding)
            effect = g.SetNumber(target, Change.INCREASE, value, _ALWAYS, place)
            if world:
                name = f"added {index} {ground.fluents[target].name}"
                process = g.GroundSchema(Kind.PROCESS, name, WORLD, (), (), (effect,), place)
                processes.append(process)
            else:
                effects = _with_change(actions[key].effects, effect)
                actions[key] = dataclasses.replace(actions[key], effects=effects)
    return dataclasses.replace(
        ground, parameters=tuple(parameters), actions=tuple(actions), processes=tuple(processes)
    )


def _with_change(
    effects: tuple[g.GroundEffect, ...], more: g.SetNumber
) -> tuple[g.GroundEffect, ...]:
    """Return effects with another one, which goes into an assignment of its fluent, if any."""
    assigned = more.target, Change.ASSIGN
    for k, own in enumerate(effects):
        if isinstance(own, g.SetNumber) and (own.target, own.change) == assigned:
            own = dataclasses.replace(own, value=g.Operation("+", own.value, more.value))
            return (*effects[:k], own, *effects[k + 1 :])
    return (*effects, more)


@dataclass(frozen=True)
class ParameterDependency:
    """The direct dependencies on one parameter of a schema."""

    parameter: g.Parameter
    schema: str
    symbol: str  # the function that its effect changes
    fluents: frozenset[int]  # columns of that function
    actions: frozenset[int] | None  # positions of ground actions; None for a process


def parameter_dependencies(ground: g.GroundModel) -> tuple[ParameterDependency, ...]:
    """Return the dependencies on parameters of effects and rates, in the order of θ.

    Parameters of rewards, flags, conditions and events have none: the expert sets them. Static
    values of a problem have none: conditions may read them.
    """
    fluents: dict[int, set[int]] = {}
    actions: dict[int, set[int]] = {}
    first: dict[int, tuple[g.GroundSchema, int]] = {}
    barred: set[int] = set()
    for position, schema in enumerate((*ground.actions, *ground.processes)):
        values = [(e.target, e.value) for e in schema.effects if isinstance(e, g.SetNumber)]
        read = [(target, node) for target, value in values for node in nodes_in(value)]
        for target, index in ((t, n.parameter) for t, n in read if isinstance(n, g.ParameterRef)):
            if target < 0:
                barred.add(index)
                continue
            first.setdefault(index, (schema, target))
            fluents.setdefault(index, set()).add(target)
            if schema.kind is not Kind.PROCESS:
                actions.setdefault(index, set()).add(position)
    return tuple(
        ParameterDependency(
            ground.parameters[index],
            schema.schema,
            ground.fluents[target].symbol,
            frozenset(fluents[index]),
            None if schema.kind is Kind.PROCESS else frozenset(actions[index]),
        )
        for index, (schema, target) in sorted(first.items(), key=lambda item: item[0])
        if index not in barred and ground.parameters[index].role in ("effect", "rate")
    )


@dataclass(frozen=True)
class Rows:
    """All n (transition, fluent) pairs of one function symbol that can be compared."""

    rows: NDArray[np.int64]  # `[n]` positions in the data
    fluents: NDArray[np.int64]  # `[n]` columns of the state
    groups: NDArray[np.int64]  # `[n]` the executed action
    blocks: NDArray[np.int64]  # `[n]` of neighbouring transitions, see `RegressionData`
    residuals: Vector  # `[n]` observed − predicted
    change: Vector  # `[n]` observed
    columns: Vector  # `[n, K]` derivatives of the prediction by the parameters that change it
    owned: tuple[int, ...]  # the K parameters, positions in θ
    unit: float  # observed range of the symbol's fluents


@dataclass(frozen=True)
class ParameterFit:
    """Estimated parameters, `[P]` each.

    `theta` is the written value where the transitions hold no information, and its standard error
    infinite; `samples` counts the transitions used. `rows` has the residuals by function symbol.
    """

    theta: Vector
    errors: Vector
    samples: NDArray[np.int64]
    rows: Mapping[str, Rows]


class ParameterEstimator:
    """Estimates the parameters of a model from transitions."""

    def __init__(self, model: TransitionModel, data: RegressionData) -> None:
        self._data = data
        self._flow = without_events(model)
        self._written = np.array([parameter.value for parameter in model.parameters])
        self._dependencies = parameter_dependencies(model.ground)
        self._columns = function_columns(model.ground)
        # By the written values, so that an estimate does not select the rows of the next one.
        self._kept = undisturbed(model.replace(theta=self._written), data)

    def estimate(self, theta: Vector) -> ParameterFit:
        """Fit all parameters at once, by at most four Gauss-Newton iterations from `theta`."""
        theta = theta.copy()
        errors = np.full(len(theta), np.inf)
        counts = np.zeros(len(theta), dtype=np.int64)
        whole = whole_symbols(self._columns, self._data)
        predicted = self._predict(theta)
        for _ in range(4):
            before = theta.copy()
            slopes = {
                d.parameter.index: self._slope(theta, predicted, d) for d in self._dependencies
            }
            expected: dict[str, Vector] = {}
            for symbol, rows in self._rows(predicted, slopes).items():
                width = _widths(rows, self._written, theta)
                active = independent(rows.columns, width)
                owned = [rows.owned[k] for k in active]
                if not owned:
                    continue
                columns = rows.columns[:, active]
                fit = regress(
                    columns,
                    rows.residuals + columns @ theta[owned],
                    centre=self._written[owned],
                    width=width[active],
                    groups=rows.groups,
                    blocks=rows.blocks,
                    unit=rows.unit,
                )
                if not np.isfinite(fit.coefficients).all():  # the numbers are too large
                    continue
                if symbol in whole and not _is_deterministic(fit, columns, rows.unit):
                    continue
                theta[owned] = fit.coefficients
                errors[owned] = fit.errors
                counts[owned] = (columns != 0.0).sum(0)
                expected[symbol] = rows.residuals - columns @ (theta - before)[owned]
            predicted = self._predict(theta)
            left = self._rows(predicted, slopes)
            if all(_is_linear(left[symbol], residuals) for symbol, residuals in expected.items()):
                break
        return ParameterFit(theta, errors, counts, left)

    def _predict(self, theta: Vector, rows: Any = slice(None)) -> Vector:
        """Return the next states of some rows without events, `[n, F]`."""
        model = self._flow.replace(theta=theta)
        return predictions(model, self._data.states[rows], self._data.actions[rows])

    def _rows(self, predicted: Vector, slopes: Mapping[int, Vector]) -> dict[str, Rows]:
        """Return residuals and derivatives for each function symbol."""
        data = self._data
        found = {}
        for symbol, fluents in self._columns.items():
            owned = tuple(d.parameter.index for d in self._dependencies if d.symbol == symbol)
            row, which = np.nonzero(self._kept[:, fluents] & np.isfinite(predicted[:, fluents]))
            column = np.array(fluents)[which]
            columns = np.empty((len(row), len(owned)))
            for place, k in enumerate(owned):
                columns[:, place] = slopes[k][row, column]
            found[symbol] = Rows(
                rows=row,
                fluents=column,
                groups=data.actions[row],
                blocks=data.blocks[row],
                residuals=data.next_states[row, column] - predicted[row, column],
                change=data.next_states[row, column] - data.states[row, column],
                columns=columns,
                owned=owned,
                unit=float(data.scale[fluents].max()),
            )
        return found

    def _slope(self, theta: Vector, predicted: Vector, dependency: ParameterDependency) -> Vector:
        """Return the derivative by one parameter, `[N, F]`; 0 where nothing depends on it."""
        actions = self._data.actions
        slope = np.zeros(predicted.shape)
        rows = np.arange(len(actions))
        if dependency.actions is not None:
            rows = np.flatnonzero(np.isin(actions, list(dependency.actions)))
        if not len(rows):
            return slope
        index = dependency.parameter.index
        step = 2.0**-10 * max(1.0, abs(theta[index]))  # of the finite differences
        moved = theta.copy()
        moved[index] += step
        change = (self._predict(moved, rows) - predicted[rows]) / step
        for column in dependency.fluents:
            slope[rows, column] = np.nan_to_num(change[:, column], nan=0.0, posinf=0.0, neginf=0.0)
        return slope


def estimate_parameters(
    model: TransitionModel, states: Vector, actions: NDArray[np.int64], next_states: Vector
) -> tuple[Vector, Vector]:
    """Return the parameters of effects and rates that change fluents, and their standard errors.

    The written value and infinity where the transitions hold no information: for parameters of
    rewards, conditions and events, of actions never executed, and of fluents with random whole
    numbers. θ of the model are the initial values; the transitions `[N]` are in order of time.
    """
    data = regression_data(model, states, actions, next_states)
    written = np.array([parameter.value for parameter in model.parameters])
    if not len(data):
        return written, np.full(len(written), np.inf)
    fit = ParameterEstimator(model, data).estimate(model.theta)
    return np.where(np.isfinite(fit.errors), fit.theta, written), fit.errors


def function_columns(ground: g.GroundModel) -> dict[str, list[int]]:
    """Return the columns of the fluents of each function."""
    columns: dict[str, list[int]] = {}
    for fluent in ground.fluents:
        if fluent.numeric:
            columns.setdefault(fluent.symbol, []).append(fluent.index)
    return columns


def _is_linear(rows: Rows, expected: Vector) -> bool:
    """Return whether most residuals are those of a linear model; a row at a threshold may jump."""
    if len(rows.residuals) != len(expected):
        return False  # a row no longer has a prediction
    gaps = np.abs(rows.residuals - expected)
    return not len(gaps) or float(np.quantile(gaps, 0.9)) <= 1e-6 * rows.unit


def whole_symbols(functions: Mapping[str, list[int]], data: RegressionData) -> set[str]:
    """Return the functions, by their columns, with 2 to 64 values, all of them whole numbers."""
    found = set()
    for symbol, fluents in functions.items():
        values = np.unique((data.states[:, fluents], data.next_states[:, fluents]))
        if 1 < len(values) <= 64 and (values == np.round(values)).all():
            found.add(symbol)
    return found


def _widths(rows: Rows, written: Vector, theta: Vector) -> Vector:
    """Return the prior's standard deviations: ten times the written value, or across the range."""
    owned = list(rows.owned)
    known = np.maximum(np.abs(written[owned]), np.abs(theta[owned]))
    slope = np.sqrt(np.mean(rows.columns**2, axis=0)) if len(rows.rows) else np.zeros(len(owned))
    usual = np.where(slope > 0, 0.1 * rows.unit / np.where(slope > 0, slope, 1.0), 0.0)
    widths: Vector = 10.0 * np.maximum(np.maximum(known, usual), 1e-12)
    return widths


def _is_deterministic(fit: Regression, columns: Vector, unit: float) -> bool:
    """Return whether the fit explains the changes of a whole number exactly in 90 % of its rows."""
    touched = (columns != 0.0).any(1)
    exact = np.abs(fit.residuals[touched]) < 1e-6 * unit
    return bool(touched.any()) and bool(exact.mean() >= 0.9)


_LEAST: Final = 0.25
"""Least fraction of a written value that a bounded estimate keeps. The mean of a rare effect is
small and never observed itself; a plan with the mean would ignore the effect."""


class ParameterEstimation:
    """Decides which parameters to use.

    Parameters that change the fluents of one function are adopted together, and only if estimates
    from the first 70 % of the newest 4,000 transitions predict the others better than the
    parameters in use: by 10 % where these are as written.

    An estimate may have any value if it leaves less than half of the squared change, or 2 % of the
    squared error of the parameters in use; otherwise it is bounded, see `_LEAST`.
    """

    def __init__(self, written: TransitionModel) -> None:
        self._written = written
        self._columns = function_columns(written.ground)
        self._owned: dict[str, list[int]] = {}
        for dependency in parameter_dependencies(written.ground):
            self._owned.setdefault(dependency.symbol, []).append(dependency.parameter.index)

    def reconsider(self, experience: TransitionMemory, theta: Vector) -> Vector:
        """Return the parameters to use from now on, instead of `theta` `[P]`."""
        newest = slice(-4_000, None)
        states, next_states = experience.states[newest], experience.next_states[newest]
        actions = experience.actions[newest]
        first = int(0.7 * len(actions))
        model = self._written.replace(theta=theta)
        (earlier, _), (latest, errors) = (
            estimate_parameters(model, states[:n], actions[:n], next_states[:n])
            for n in (first, len(actions))
        )
        rows, _ = usable_rows(self._written, states, actions, next_states)
        rows = rows[rows >= first]
        now, free, bounded, change = self._errors(
            (theta, earlier, self._bounded(earlier)), states[rows], actions[rows], next_states[rows]
        )
        adopted = theta.copy()
        for symbol, owned in self._owned.items():
            columns = self._columns.get(symbol, [])
            known = [k for k in owned if np.isfinite(errors[k])]
            if not known:
                continue
            in_use = now[columns].sum()
            enough = max(0.5 * change[columns].sum(), 0.02 * in_use)
            believed = free[columns].sum() < enough
            error = (free if believed else bounded)[columns].sum()
            estimated = (theta[owned] != self._written.theta[owned]).any()
            if error < (1.0 if estimated else 0.9) * in_use:
                news = (latest if believed else self._bounded(latest))[known]
                # A change resets everything that was learned beside the parameters.
                least = np.maximum(errors[known], 0.01 * np.abs(theta[known]))
                changed = (np.abs(news - theta[known]) > least).any()
                if changed and np.isfinite(news).all():
                    adopted[known] = news
        return adopted

    def _bounded(self, theta: Vector) -> Vector:
        """Return parameters `[P]` with at least the written sign and a fraction of the size."""
        written = self._written.theta
        sign = np.where(written < 0.0, -1.0, 1.0)
        bounded: Vector = sign * np.maximum(sign * theta, _LEAST * np.abs(written))
        return np.where(written == 0.0, theta, bounded)

    def _errors(
        self,
        candidates: Sequence[Vector],
        states: Vector,
        actions: NDArray[np.int64],
        next_states: Vector,
    ) -> Vector:
        """Return sums of squared errors of C candidates and of "nothing changes", `[C + 1, F]`.

        All sums are over the same steps. A candidate without a prediction for a step that the first
        candidate predicts has an infinite error; fewer predictions must not be an advantage.
        """
        models = (self._written.replace(theta=theta) for theta in candidates)
        guesses = [*(predictions(model, states, actions) for model in models), states]
        squared = (next_states - np.array(guesses)) ** 2
        # Steps that all candidates predict badly do not distinguish them.
        best = np.where(np.isfinite(squared), squared, 0.0).min(axis=0)
        if len(best):
            squared[:, best > 25.0 * np.quantile(best, 0.98, axis=0)] = 0.0
        known = np.isfinite(squared)
        errors = np.where(known, squared, np.inf)
        errors[:, ~known[0]] = 0.0
        sums: Vector = errors.sum(axis=1)
        return sums
