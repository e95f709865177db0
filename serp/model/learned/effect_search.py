"""The search for effects that a file lacks.

Forward selection by orthogonal projection (orthogonal least squares: Chen, Billings & Luo,
International Journal of Control 50, 1989). An effect of one action schema competes with the same
effect of the world, which also has one coefficient, so that a change under every action is found as
such.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from serp.model import ground_model as g
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
    LiftedScope,
    RegressionData,
    predictions,
)
from serp.model.learned.robust_regression import CERTAIN, independent, regress
from serp.model.transition_model import TransitionModel, Vector
from serp.pddl.syntax import Change, ChangeFunction, Kind

MIN_ROWS = 12
"""Fewest transitions in which an estimated effect applies."""


def candidate_effects(
    lifted: LiftedModel, states: Vector, after: Vector, rows: Rows, symbol: str, dt: float
) -> tuple[list[AddedEffect], Vector]:
    """Return candidates with the changes by coefficient 1: `[n, M]`.

    Candidates are constants, fluents, and products of two of the 12 fluents that correlate most
    with the residuals. `rows` are the residuals of the function `symbol`; `after` `[N, F]` are the
    states after the actions' effects, which processes read.
    """
    schemas = sorted({lifted.ground.actions[a].schema for a in np.unique(rows.groups).tolist()})
    effects: list[AddedEffect] = []
    columns: list[Vector] = []

    def offer(
        scope: LiftedScope, target: LiftedFluent, before: Vector, keys: NDArray[np.int64]
    ) -> None:
        unit = dt if scope.schema == WORLD else 1.0
        linear: list[tuple[float, LiftedFluent]] = []
        singles: dict[LiftedFluent, Vector] = {}
        if len(schemas) > 1 or scope.schema != WORLD:
            # With a single schema, a constant belongs to the action.
            effects.append(AddedEffect(scope.schema, target, ()))
            columns.append(unit * lifted.products(scope, (), before, keys))
        for factor in filter(lifted.numeric, scope.fluents):
            values = lifted.products(scope, (factor,), before, keys)
            spread = float(np.std(values[values != 0.0])) if values.any() else 0.0
            if spread > 1e-9 * float(np.abs(values).max(initial=0.0)):
                size = float(np.linalg.norm(values)) or 1.0
                linear.append((-abs(float(values @ rows.residuals)) / size, factor))
                singles[factor] = values
                effects.append(AddedEffect(scope.schema, target, (factor,)))
                columns.append(unit * values)
        strongest = sorted(factor for _, factor in sorted(linear)[:12])
        for pair in itertools.combinations_with_replacement(strongest, 2):
            effects.append(AddedEffect(scope.schema, target, pair))
            columns.append(unit * singles[pair[0]] * singles[pair[1]])

    world = lifted.world(symbol)
    offer(world, world.targets[0], after[rows.rows], rows.fluents)
    for name in schemas:
        scope = lifted.schema(name)
        for target in scope.targets:
            if target.symbol == symbol and may_change(lifted, scope, target):
                changed = {k: lifted.column(target, b) for k, b in scope.bindings.items()}
                fluent = np.array([changed.get(a, -1) for a in rows.groups.tolist()])
                keys = np.where(fluent == rows.fluents, rows.groups, -1)
                if (keys >= 0).sum() >= MIN_ROWS:
                    offer(scope, target, states[rows.rows], keys)
    return effects, np.stack(columns, axis=1) if columns else np.empty((len(rows.rows), 0))


def may_change(lifted: LiftedModel, scope: LiftedScope, target: LiftedFluent) -> bool:
    """Return whether an effect can be added to what an action schema does to a fluent.

    It cannot if the schema scales the fluent, or assigns it under a condition or another name: an
    increase would contradict that.
    """
    schemas = lifted.syntax.schemas
    schema = next(s for s in schemas if s.kind is Kind.ACTION and s.name == scope.schema)
    assigned = any(
        isinstance(effect, ChangeFunction)
        and effect.change is Change.ASSIGN
        and effect.function.name == target.symbol
        and tuple(term.name for term in effect.function.arguments) == target.terms
        for effect in schema.effects
    )
    return not any(
        isinstance(effect, g.SetNumber)
        and effect.target == lifted.column(target, binding)
        and effect.change not in (Change.INCREASE, Change.DECREASE)
        and not (
            assigned and effect.change is Change.ASSIGN and effect.condition == g.Constant(True)
        )
        for key, binding in scope.bindings.items()
        for effect in lifted.ground.actions[key].effects
    )


LASTING = 1e-5
"""Fraction of the squared change for an effect under every action, such as gravity: it adds up over
many steps, while the changes by actions cancel."""
_COLLINEAR = 1e-6
"""Fraction of a column's squares not explained by other columns; below it they are collinear."""


def _improvement_of(effect: AddedEffect) -> tuple[float, float]:
    """Return the least fractions of squared change and squared error that an effect explains.

    Both where the effect applies. They are lower for effects of the world, and for simple ones: a
    constant, or proportional to a fluent.
    """
    lasting = effect.schema == WORLD and len(effect.factors) < 2
    return LASTING if lasting else 1e-3, 0.1 if lasting or not effect.factors else 0.25


def search(
    lifted: LiftedModel,
    states: Vector,
    after: Vector,
    rows: Rows,
    symbol: str,
    dt: float,
    known: Sequence[AddedEffect],
) -> list[AddedEffect]:
    """Return effects that explain the residuals of one function, except those `known` before."""
    if len(rows.rows) < MIN_ROWS:
        return []
    candidates, columns = candidate_effects(lifted, states, after, rows, symbol, dt)
    fresh = [k for k, effect in enumerate(candidates) if effect not in known]
    if not fresh:
        return []
    candidates, columns = [candidates[k] for k in fresh], columns[:, fresh]
    base = rows.columns[:, independent(rows.columns, np.ones(rows.columns.shape[1]))]
    fit = regress(
        base,
        rows.residuals,
        centre=np.zeros(base.shape[1]),
        width=1e3 * rows.unit / np.maximum(np.sqrt(np.mean(base**2, axis=0)), 1e-300),
        groups=rows.groups,
        blocks=rows.blocks,
        unit=rows.unit,
        reject=False,
    )
    selection = _ForwardSelection(candidates, columns, rows, base, fit.weights, known)
    chosen: list[AddedEffect] = []
    while len(chosen) + len(known) < 12 and (best := selection.next()):
        chosen += [candidates[k] for k in best]
    # An effect of the world is dropped where every schema has an exception to it.
    schemas = {effect.schema for effect in candidates if effect.schema != WORLD}
    return [
        effect
        for effect in chosen
        if effect.schema != WORLD
        or sum(o.schema != WORLD and o.symbols == effect.symbols for o in chosen) < len(schemas)
    ]


class _ForwardSelection:
    """Forward selection by orthogonal projections of weighted columns.

    A choice may also be the same effect of several schemas, each with its own coefficient, or a
    line: a fluent with a constant beside it, because neither need explain anything alone. Choices
    are compared by the reduction of the logarithm of the squared error per coefficient, so one that
    explains everything is preferred to a simpler one that explains a part.
    """

    def __init__(
        self,
        candidates: Sequence[AddedEffect],
        columns: Vector,
        rows: Rows,
        base: Vector,
        weights: Vector,
        known: Sequence[AddedEffect],
    ) -> None:
        root = np.sqrt(weights)
        self._candidates, self._blocks = candidates, rows.blocks
        self._touched = columns != 0.0
        self._left = columns * root[:, None]
        self._full = (self._left**2).sum(0)
        self._error, self._change = rows.residuals * root, rows.change * root
        self._choices: list[tuple[int, ...]] = [(k,) for k in range(len(candidates))]
        alike: dict[tuple[str, tuple[str, ...]], list[int]] = {}
        for k, effect in enumerate(candidates):
            if effect.schema != WORLD:
                alike.setdefault(effect.symbols, []).append(k)
        # An effect of the world is not added to each schema again.
        general = {effect.symbols for effect in known if effect.schema == WORLD}
        self._choices += [
            tuple(ks) for symbols, ks in alike.items() if len(ks) > 1 and symbols not in general
        ]
        constants = {(e.schema, e.target): k for k, e in enumerate(candidates) if not e.factors}
        self._lines = {
            (k, constants[effect.schema, effect.target])
            for k, effect in enumerate(candidates)
            if len(effect.factors) == 1 and (effect.schema, effect.target) in constants
        }
        self._choices += sorted(self._lines)
        for column in np.linalg.qr(base * root[:, None])[0].T:
            self._project(column)

    def next(self) -> tuple[int, ...]:
        """Choose columns and project them out; return none where none pays."""
        total = float((self._error**2).sum())
        if total == 0.0:
            return ()
        size = (self._left**2).sum(0)
        fit = size > _COLLINEAR * np.maximum(self._full, 1e-300)
        gain = np.where(fit, (self._error @ self._left) ** 2 / np.where(fit, size, 1.0), 0.0)
        scores = []
        for choice in self._choices:
            together = gain[choice[0]] if len(choice) == 1 else self._together(choice)
            rest = max(1.0 - float(together) / total, 1e-6)
            scores.append(-np.log(rest) * self._preference(choice) / len(choice))
        for c in np.argsort(-np.array(scores), kind="stable")[:30].tolist():
            paying = self._paying(self._choices[c])
            if paying:
                for k in paying:
                    column = self._left[:, k].copy()
                    self._touched[:, k] = False
                    self._project(column)
                return paying
        return ()

    def _paying(self, choice: tuple[int, ...]) -> tuple[int, ...]:
        """Return the columns of a choice that pay; both of a line or none."""
        if choice not in self._lines:
            return tuple(k for k in choice if self._pays(k, self._left[:, k], self._error))
        pays = [
            self._pays(k, *(v - d * (d @ v) for v in (self._left[:, k], self._error)))
            for k, other in (choice, choice[::-1])
            for d in (self._left[:, other] / (np.linalg.norm(self._left[:, other]) or 1.0),)
        ]
        return choice if all(pays) else ()

    def _together(self, choice: tuple[int, ...]) -> float:
        """Return how much squared error several columns explain together."""
        columns = self._left[:, choice]
        with_error = columns.T @ self._error
        inverse = np.linalg.pinv(columns.T @ columns, rcond=_COLLINEAR, hermitian=True)
        return float(with_error @ inverse @ with_error)

    def _preference(self, choice: tuple[int, ...]) -> float:
        """Prefer the world and fewer factors among choices that explain about the same."""
        effect = self._candidates[choice[0]]
        return (1.1, 1.0, 0.8)[len(effect.factors)] * (1.05 if effect.schema == WORLD else 1.0)

    def _project(self, column: Vector) -> None:
        norm = float(np.linalg.norm(column))
        if norm == 0.0:
            return
        direction = column / norm
        # Twice: rounding errors of the first projection would appear as errors to explain.
        for _ in range(2):
            self._left -= np.outer(direction, direction @ self._left)
            self._error = self._error - direction * (direction @ self._error)

    def _pays(self, k: int, column: Vector, error: Vector) -> bool:
        """Return whether a column of what is left pays, given the errors to explain."""
        rows, size = self._touched[:, k], float((column**2).sum())
        if int(rows.sum()) < MIN_ROWS or size <= _COLLINEAR * float(self._full[k]):
            return False
        coefficient = float(error @ column) / size
        gain = coefficient**2 * size
        of_change, of_error = _improvement_of(self._candidates[k])
        least_of_change = of_change * float((self._change[rows] ** 2).sum())
        if gain == 0.0 or gain < max(least_of_change, of_error * float((error[rows] ** 2).sum())):
            return False
        scores = column * (error - coefficient * column)
        _, which = np.unique(self._blocks, return_inverse=True)
        # The larger of both: the sums of a few blocks may cancel by chance.
        sums = max(float((np.bincount(which, scores) ** 2).sum()), float((scores**2).sum()))
        return abs(coefficient) >= CERTAIN * (float(np.sqrt(sums)) / size)


class EffectFit:
    """The model as written with added effects (`ground`), fitted to at least one transition.

    The estimates of the fit `before` are the initial values, or the file's parameters. In `fit` the
    coefficients of the added effects follow the parameters of the file.
    """

    def __init__(
        self,
        model: TransitionModel,
        lifted: LiftedModel,
        data: RegressionData,
        added: Sequence[AddedEffect],
        before: EffectFit | None = None,
    ) -> None:
        self._model, self._data, self.lifted, self.added = model, data, lifted, tuple(added)
        self.ground = with_effects(lifted, self.added)
        self._whole = TransitionModel(self.ground, dt=model.dt)
        self._written = len(model.ground.parameters)
        theta = np.array([parameter.value for parameter in self.ground.parameters])
        if before is not None:
            theta[: self._written] = before.fit.theta[: self._written]
            found = dict(zip(before.added, before.fit.theta[self._written :], strict=True))
            theta[self._written :] = [found.get(effect, 0.0) for effect in self.added]
        self.fit: ParameterFit = ParameterEstimator(self._whole, data).estimate(theta)

    def with_effects(self, added: Sequence[AddedEffect]) -> EffectFit:
        """Return the fit of the same model with other effects."""
        return EffectFit(self._model, self.lifted, self._data, added, self)

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
        actions = dataclasses.replace(self.ground, processes=(), events=(), goal=None, metric=None)
        model = TransitionModel(actions, dt=self._model.dt, theta=self.fit.theta)
        after = predictions(model, self._data.states, self._data.actions)
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
        gap = size_before - size
        less = (size < 0.25 * size_before) & (gap > 2.0 * np.hypot(error, error_before))
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
    pending = set(function_columns(fit.ground))
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
