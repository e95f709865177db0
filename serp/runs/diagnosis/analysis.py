"""Findings from observed transitions, by regression and by counting."""

from __future__ import annotations

import contextlib
import dataclasses
from collections import Counter
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.model import ground_model as g
from serp.model.learned.effect_search import EffectFit, fit_jointly
from serp.model.learned.outcome_counts import CountedGroup, count_outcomes
from serp.model.learned.parameter_fit import (
    AddedEffect,
    function_columns,
    parameter_dependencies,
    whole_symbols,
)
from serp.model.learned.regression_data import (
    LiftedFluent,
    LiftedModel,
    RegressionData,
    predictions,
)
from serp.model.learned.transitions import TransitionMemory
from serp.model.traced_step import Site
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.pddl.source import Place
from serp.pddl.syntax import REWARD, TERMINAL
from serp.runs.diagnosis.accuracy import Steps, forecast_with
from serp.runs.diagnosis.findings import (
    EffectTerm,
    Findings,
    MissingEffect,
    ObservedOutcome,
    ParameterFinding,
    RuleFinding,
    StochasticEffect,
)

_MOST_ROWS = 4_000  # of a regression and of a count


def findings(model: TransitionModel, experience: TransitionMemory) -> Findings:
    """Return the findings about a file: a pure function of the model as written and transitions.

    The model has the control period of the transitions. Parameters and missing effects are
    estimated jointly.
    """
    steps = Steps.of(model, experience)
    sample = steps.sample
    if not len(sample):
        return Findings()
    objects = max(Counter(f.symbol for f in model.fluents if f.numeric).values(), default=1)
    # Each object adds a row per transition.
    part = sample.part(max(500, min(_MOST_ROWS, 20_000 // objects)))
    fit = fit_jointly(model, part)
    costs = _Costs(model, fit, sample.part(_MOST_ROWS // 2), steps.units)
    return Findings(
        parameters=_parameters(model, fit, costs),
        missing=_missing(model, fit, costs, len(part)),
        stochastic=_stochastic_effects(model, steps),
        rules=_rules(model, steps),
    )


class _Costs:
    """The increase of the prediction error if one finding is dropped."""

    def __init__(
        self, model: TransitionModel, fit: EffectFit, sample: RegressionData, units: Vector
    ) -> None:
        self._sample = sample
        self._units = units[:-2]
        self._symbols = np.array([fluent.symbol for fluent in model.fluents])
        self._theta = fit.fit.theta
        self._model = TransitionModel(fit.ground, dt=model.dt)
        self._least = self._errors(self._theta)

    def of(self, parameters: list[int], value: float, symbol: str) -> float:
        """Return the cost for a function of setting parameters to a value; at least 0."""
        theta = self._theta.copy()
        theta[parameters] = value
        more = self._errors(theta) - self._least
        return max(0.0, float(more[self._symbols == symbol].sum()))

    def _errors(self, theta: Vector) -> Vector:
        sample = self._sample
        predicted = predictions(self._model.replace(theta=theta), sample.states, sample.actions)
        off = (sample.next_states - predicted) / self._units
        errors: Vector = np.nansum(off**2, axis=0) / len(sample)
        return errors


def _parameters(
    model: TransitionModel, effects: EffectFit, costs: _Costs
) -> tuple[ParameterFinding, ...]:
    fit, found = effects.fit, []
    for own in parameter_dependencies(model.ground):
        k, written = own.parameter.index, own.parameter.value
        if np.isfinite(fit.errors[k]):
            estimate = float(fit.theta[k]), float(fit.errors[k]), int(fit.samples[k])
            cost = costs.of([k], written, own.symbol)
            finding = own.parameter, own.schema, own.symbol, written, *estimate, cost
            found.append(ParameterFinding(*finding))
    return tuple(sorted(found, key=lambda f: -f.cost))


def _missing(
    model: TransitionModel, effects: EffectFit, costs: _Costs, rows: int
) -> tuple[MissingEffect, ...]:
    fit = effects.fit
    by_target: dict[tuple[str, LiftedFluent], list[tuple[int, AddedEffect]]] = {}
    for index, effect in enumerate(effects.added, len(model.parameters)):
        if np.isfinite(fit.errors[index]):
            by_target.setdefault((effect.schema, effect.target), []).append((index, effect))
    found = []
    for (schema, target), terms in by_target.items():
        indices = [index for index, _ in terms]
        summands = []
        for k, effect in terms:
            names = tuple(factor.name for factor in effect.factors)
            summands.append(EffectTerm(float(fit.theta[k]), float(fit.errors[k]), names))
        place = next((a.place for a in model.actions if a.schema == schema), None)
        samples = int(fit.samples[indices].max()) if schema else rows
        cost = costs.of(indices, 0.0, target.symbol)
        found.append(MissingEffect(schema, place, target.name, tuple(summands), samples, cost))
    return tuple(sorted(found, key=lambda f: -f.cost))


def _stochastic_effects(model: TransitionModel, steps: Steps) -> tuple[StochasticEffect, ...]:
    """Return the action schemas that have other outcomes than in the file."""
    fluents, ground = model.fluents, model.ground
    whole = whole_symbols(function_columns(ground), steps.sample)
    schemas = (*ground.actions, *ground.processes, *ground.events)
    written = {target for schema in schemas for target in g.writes(schema)}
    numbers = np.array([fluent.symbol in whole for fluent in fluents])
    counted = numbers | [not f.numeric and f.index in written for f in fluents]
    wrong = (steps.predicted != steps.after)[:, :-2]
    if not wrong[:, counted].any():
        return ()
    sample = steps.sample.part(_MOST_ROWS)
    over = steps.after[np.isin(steps.sample.positions, sample.positions), -1] != 0.0
    transitions = sample.states, sample.actions, sample.next_states, over
    effects = (
        _stochastic_effect(model, sample.states, counts)
        for counts in count_outcomes(model, transitions, counted, numbers)
    )
    return tuple(_with_cost(model, steps, effect) for effect in effects if effect is not None)


def _stochastic_effect(
    model: TransitionModel, states: Vector, counted: CountedGroup
) -> StochasticEffect | None:
    """Return the stochastic effect of a group of fluents; None where the file is right."""
    action, group, counts, _ = counted
    if counts.samples < 5:
        return None
    shares, _, changes = counts.outcomes()
    sets, number = counts.explanations()
    own = model.actions[action]
    columns = np.array(group.inputs)[counts.places]
    # Outcomes that read the same are one.
    merged: dict[tuple[tuple[str, float], ...], list[int]] = {}
    like: dict[tuple[tuple[str, float], ...], str] = {}
    for kind, (effect, by) in enumerate(zip(counted.effects(action), changes, strict=True)):
        if effect >= 0:
            by = _usual_change(model, states, effect, columns)
        text = _named(model, action, columns, by)
        merged.setdefault(text, []).append(kind)
        like.setdefault(text, model.actions[effect].schema if effect >= 0 else "")
    shares = np.array([shares[kinds].sum() for kinds in merged.values()])
    sets = np.stack([sets[:, kinds].any(axis=1) for kinds in merged.values()], axis=1)
    errors = _standard_errors(sets, number, shares)
    # Other outcomes that are rarer than 2 % are not worth mentioning.
    if 1.0 - shares[0] < max(0.02, 3.0 * errors[0]):
        return None
    outcomes = [
        ObservedOutcome(text, p, e, k == 0, like[text])
        for k, (text, p, e) in enumerate(zip(merged, shares.tolist(), errors.tolist(), strict=True))
        if k == 0 or p >= 0.5 / counts.samples
    ]
    outcomes.sort(key=lambda o: (-o.probability, o.changes))
    return StochasticEffect(own.schema, own.place, tuple(outcomes), counts.samples, 0.0)


def _standard_errors(sets: NDArray[np.bool_], number: Vector, shares: Vector) -> Vector:
    """Return the standard errors of maximum-likelihood shares `[K]` of outcomes.

    By the observed information along the directions that keep the sum of the shares; see
    `OutcomeCounts.explanations`.
    """
    scores = sets / np.maximum(sets @ shares, 1e-12)[:, None]
    alive = shares > 1e-6
    along = np.eye(len(shares))[:, alive] - alive[:, None] / alive.sum()
    information = along.T @ (scores.T * number) @ scores @ along
    covariance = along @ np.linalg.pinv(information, hermitian=True) @ along.T
    errors: Vector = np.sqrt(np.maximum(np.diag(covariance), 0.0) + 1.0 / number.sum() ** 2)
    return errors


def _usual_change(
    model: TransitionModel, states: Vector, action: int, columns: NDArray[np.int64]
) -> Vector:
    """Return the most frequent change by an action other than none, of some columns."""
    few = states[:: max(1, len(states) // 500)]
    changes = (predictions(model, few, np.full(len(few), action)) - few)[:, columns]
    changes = changes[np.isfinite(changes).all(axis=1) & changes.any(axis=1)]
    if not len(changes):
        return np.zeros(len(columns))
    rows, counts = np.unique(changes, axis=0, return_counts=True)
    usual: Vector = rows[counts.argmax()]
    return usual


def _named(
    model: TransitionModel, action: int, columns: NDArray[np.int64], changes: Vector
) -> tuple[tuple[str, float], ...]:
    """Return changes with the fluents' names in the schema; other objects are `?other`."""
    lifted = LiftedModel(model.ground).schema(model.actions[action].schema)
    names = {thing: variable for variable, thing in lifted.bindings[action].items()}
    named = []
    for column, by in zip(columns.tolist(), changes.tolist(), strict=True):
        if by != 0.0:
            fluent = model.fluents[column]
            terms = (names.get(argument, "?other") for argument in fluent.arguments)
            named.append((" ".join((fluent.symbol, *terms)), by))
    return tuple(named)


def _with_cost(model: TransitionModel, steps: Steps, effect: StochasticEffect) -> StochasticEffect:
    """Return an effect with the squared error that its mean saves."""
    own = [k for k, action in enumerate(model.actions) if action.schema == effect.schema]
    rows = np.isin(steps.sample.actions, own)
    states, actions = steps.sample.states[rows], steps.sample.actions[rows]
    after = steps.sample.next_states[rows]
    mean, _ = forecast_with(model, Findings(stochastic=(effect,)), states, actions, after)
    error, left = (
        np.nansum(((steps.after[rows] - forecast) / steps.units)[:, :-2] ** 2)
        for forecast in (steps.predicted[rows], mean)
    )
    return dataclasses.replace(effect, cost=max(0.0, float(error - left) / len(steps.sample)))


class _Line(NamedTuple):
    schema: str
    place: Place | None


class _Case(NamedTuple):
    """A step in which a line was predicted to apply, or is to blame for what was observed."""

    predicted: bool
    expected: float
    observed: float
    blame: float


def _rules(model: TransitionModel, steps: Steps) -> tuple[RuleFinding, ...]:
    """Return the lines whose rewards or ends differ from the observed ones, the worst first."""
    sample, lines = steps.sample, _Lines(model)
    cases: dict[str, dict[_Line, list[_Case]]] = {REWARD: {}, TERMINAL: {}}
    pairs = np.stack((steps.predicted[:, -2:], steps.after[:, -2:]), axis=1)
    for row in np.flatnonzero((pairs != 0.0).any(axis=(1, 2)) & np.isfinite(pairs).all((1, 2))):
        state, action = sample.states[row], int(sample.actions[row])
        after = sample.next_states[row]
        predicted = lines.predicted(state, action, after, pairs[row, 0])
        judged = lines.judged(state, action, after)
        for name, (expected, observed) in zip(cases, pairs[row].T.tolist(), strict=True):
            said, seen = predicted[name], judged[name]
            if observed == 0.0:  # a line that applies to the observed state cannot be the cause
                seen = seen & said
            squared = (observed - expected) ** 2
            blamed = (said ^ seen or said or {_Line("", None)}) if squared else set()
            for line in said | blamed:
                blame = squared / len(blamed) if line in blamed else 0.0
                case = _Case(line in said, expected, observed, blame)
                cases[name].setdefault(line, []).append(case)
    units = dict(zip(cases, steps.units[-2:].tolist(), strict=True))
    found = [
        _rule(name, line, _Case(*np.array(own).T), units[name], len(sample))
        for name, by_line in cases.items()
        for line, own in by_line.items()
        if any(case.blame for case in own)
    ]
    return tuple(
        sorted(found, key=lambda f: (-f.cost, f.fluent, -1 if f.place is None else f.place.start))
    )


def _rule(name: str, line: _Line, cases: Any, unit: float, samples: int) -> RuleFinding:
    """Return the finding on a line; `cases` has a column `[N]` for each field of `_Case`."""
    said = cases.predicted > 0.0
    right = np.abs(cases.observed - cases.expected) <= 0.1 * unit
    unpredicted = ~said & ~right
    counted = said if said.any() else unpredicted
    return RuleFinding(
        schema=line.schema,
        place=line.place,
        fluent=name,
        predicted=int(said.sum()),
        correct=int((said & right).sum()),
        unpredicted=int(unpredicted.sum()),
        expected=float(cases.expected[said].sum()) / max(1, int(said.sum())),
        observed=float(cases.observed[counted].sum()) / max(1, int(counted.sum())),
        samples=samples,
        cost=float(cases.blame.sum()) / unit**2 / samples,
    )


class _Lines:
    """The lines of a model that give reward or end the task, for single transitions."""

    def __init__(self, model: TransitionModel) -> None:
        self._model = model
        goal, metric = model.ground.goal, model.ground.metric
        self._goal = None if goal is None else _Line("goal", getattr(goal, "place", None))
        self._metric = None if metric is None else _Line("metric", None)

    def predicted(
        self, state: Vector, action: int, next_state: Vector, worth: Vector
    ) -> dict[str, set[_Line]]:
        """Return the lines that are predicted to apply; `worth` is the predicted reward and end."""
        outcome = self._model.written_core().outcome_of(state, action, next_state)
        passages = self._model.traced(state.tolist(), action, outcome=outcome).passages
        return self._applied([passage.site for passage in passages], *worth.tolist())

    def judged(self, state: Vector, action: int, next_state: Vector) -> dict[str, set[_Line]]:
        """Return the lines that apply to an observed transition."""
        reward = end = 0.0
        if self._goal or self._metric:
            with contextlib.suppress(StateError):
                judged = self._model.judge(state, action, next_state)
                reward, end = judged.reward, float(judged.terminal)
        passed = self._model.judged_passages(state, action, next_state)
        return self._applied([passage.site for passage in passed], reward, end)

    def _applied(self, sites: Iterable[Site], reward: float, end: float) -> dict[str, set[_Line]]:
        """Return the lines among the sites; goal or metric where there are none."""
        found: dict[str, set[_Line]] = {REWARD: set(), TERMINAL: set()}
        for site in sites:
            effect = site.item
            if site.schema is None or site.what not in ("effect", "rate"):
                continue
            line = _Line(site.schema.schema, getattr(effect, "place", None))
            if isinstance(effect, g.SetNumber) and effect.target == g.REWARD_TARGET:
                found[REWARD].add(line)
            elif isinstance(effect, g.SetBoolean) and effect.target == g.TERMINAL_TARGET:
                found[TERMINAL] |= {line} if effect.value else set()
        if end and not found[TERMINAL] and self._goal is not None:
            found[TERMINAL].add(self._goal)
        if reward and not found[REWARD] and (unwritten := self._metric or self._goal) is not None:
            found[REWARD].add(unwritten)
        return found
