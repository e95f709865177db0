"""Findings from observed transitions, by regression and by counting."""

from __future__ import annotations

import contextlib
import dataclasses
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.model import ground as g
from serp.model.emit import Site
from serp.model.learned.effect_fit import EffectFit, fit_jointly
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
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.pddl.source import Place
from serp.runs.diagnosis.accuracy import END, REWARD, Steps, forecast_with
from serp.runs.diagnosis.findings import (
    EffectTerm,
    Findings,
    MissingEffect,
    ObservedOutcome,
    ParameterFinding,
    RuleFinding,
    StochasticEffect,
)

_EQUAL = 0.1
"""A reward is as predicted if it differs by at most this fraction of the usual reward."""


class _Line(NamedTuple):
    schema: str
    place: Place | None


_NO_LINE = _Line("", None)


@dataclass
class _Count:
    """The steps of a line: those in which it was predicted, with sums of what was said and came."""

    predicted: int = 0
    came: int = 0
    unpredicted: int = 0
    expected: float = 0.0
    observed: float = 0.0
    unpredicted_sum: float = 0.0
    squares: float = 0.0

    @property
    def mean_observed(self) -> float:
        if self.predicted:
            return self.observed / self.predicted
        return self.unpredicted_sum / max(1, self.unpredicted)


def find_rules(model: TransitionModel, steps: Steps) -> tuple[RuleFinding, ...]:
    """Return the lines whose rewards or ends differ from the observed ones, the worst first."""
    sample, predicted, units = steps.sample, steps.predicted, steps.units
    width = len(model.fluents)
    rules = _Rules(model)
    counts: dict[str, dict[_Line, _Count]] = {REWARD: {}, END: {}}
    pairs = np.stack((predicted[:, width:], steps.after[:, width:]), axis=1)
    for row in np.flatnonzero((pairs != 0.0).any(axis=(1, 2)) & np.isfinite(pairs).all((1, 2))):
        state, action, after = sample.states[row], int(sample.actions[row]), sample.next_states[row]
        said = rules.predicted(state, action, pairs[row, 0])
        seen = rules.judged(state, action, after)
        for k, (fluent, own) in enumerate(counts.items()):
            expected, came = pairs[row, :, k].tolist()
            equal = _EQUAL * float(units[width + k])
            _count(own, said[fluent], seen[fluent], expected, came, equal)
    found = [
        RuleFinding(
            schema=line.schema,
            place=line.place,
            fluent=fluent,
            predicted=count.predicted,
            came=count.came,
            unpredicted=count.unpredicted,
            expected=count.expected / max(1, count.predicted),
            observed=count.mean_observed,
            samples=len(sample),
            cost=count.squares / float(units[width + k]) ** 2 / len(sample),
        )
        for k, (fluent, own) in enumerate(counts.items())
        for line, count in own.items()
        if count.squares > 0.0
    ]
    return tuple(
        sorted(found, key=lambda f: (-f.cost, f.fluent, -1 if f.place is None else f.place.start))
    )


def _count(
    lines: dict[_Line, _Count],
    said: set[_Line],
    seen: set[_Line],
    expected: float,
    came: float,
    equal: float,
) -> None:
    """Count a step by the lines said to apply, and those seen to; `equal` is no difference."""
    right, off = abs(came - expected) <= equal, (came - expected) ** 2
    for line in said:
        count = lines.setdefault(line, _Count())
        count.predicted += 1
        count.came += right
        count.expected += expected
        count.observed += came
    if not off:
        return
    if came == 0.0:  # a line that applies to the observed state cannot be the cause
        seen = seen & said
    blamed = said ^ seen or said or {_NO_LINE}
    for line in blamed:
        count = lines.setdefault(line, _Count())
        count.squares += off / len(blamed)
        if line not in said and not right:
            count.unpredicted += 1
            count.unpredicted_sum += came


class _Rules:
    """The lines of one model that give reward or end the task."""

    def __init__(self, model: TransitionModel) -> None:
        self._model = model
        ground = model.ground
        place = getattr(ground.goal, "place", None)
        self._goal = None if ground.goal is None else _Line("goal", place)
        self._metric = None if ground.metric is None else _Line("metric", None)

    def predicted(self, state: Vector, action: int, worth: Vector) -> dict[str, set[_Line]]:
        """Return the lines that are predicted to apply; `worth` is the predicted reward and end."""
        return self._applied(self._model.trace(state, action)[0], *worth.tolist())

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
        found: dict[str, set[_Line]] = {REWARD: set(), END: set()}
        for site in sites:
            effect = site.item
            if site.schema is None or site.what not in ("effect", "rate"):
                continue
            line = _Line(site.schema.schema, getattr(effect, "place", None))
            if isinstance(effect, g.SetNumber) and effect.target == g.REWARD_TARGET:
                found[REWARD].add(line)
            elif isinstance(effect, g.SetBoolean) and effect.target == g.TERMINAL_TARGET:
                found[END] |= {line} if effect.value else set()
        if end and not found[END] and self._goal is not None:
            found[END].add(self._goal)
        if reward and not found[REWARD] and (unwritten := self._metric or self._goal) is not None:
            found[REWARD].add(unwritten)
        return found


_MOST_ROWS = 4_000
_STATES = 500  # from which the usual change by an action is determined
_RARE = 0.02  # least share of the steps of an outcome that is worth mentioning
_CERTAIN = 3.0  # standard errors
_FEW = 5

Changes = tuple[tuple[str, float], ...]


def find_stochastic_effects(
    model: TransitionModel, steps: Steps, whole: Iterable[str]
) -> tuple[StochasticEffect, ...]:
    """Return the action schemas that have other outcomes than in the file.

    Args:
        model: The model as written.
        steps: The observed steps.
        whole: Functions whose values are a few whole numbers.
    """
    fluents, ground = model.fluents, model.ground
    schemas = (*ground.actions, *ground.processes, *ground.events)
    written = {target for schema in schemas for target in g.writes(schema)}
    numbers = np.array([fluent.symbol in set(whole) for fluent in fluents])
    counted = numbers | [not f.numeric and f.index in written for f in fluents]
    wrong = (steps.predicted != steps.after)[:, :-2]
    if not wrong[:, counted].any() or not model.has_own_code:
        return ()
    sample = steps.sample.part(_MOST_ROWS)
    over = steps.after[np.isin(steps.sample.positions, sample.positions), -1] != 0.0
    transitions = sample.states, sample.actions, sample.next_states, over
    found = [
        finding
        for counts in count_outcomes(model, transitions, counted, numbers)
        for finding in _finding(model, sample.states, counts)
    ]
    return tuple(_with_cost(model, steps, finding) for finding in found)


def _finding(
    model: TransitionModel, states: Vector, counted: CountedGroup
) -> Iterator[StochasticEffect]:
    """Yield the stochastic effect; nothing where the file is right."""
    action, group, counts, _ = counted
    samples = counts.samples
    if samples < _FEW:
        return
    shares, _, changes = counts.outcomes()
    sets, number = counts.explanations()
    own = model.actions[action]
    columns = np.array(group.inputs)[counts.places]
    # Outcomes that read the same are one.
    merged: dict[Changes, list[int]] = {}
    like: dict[Changes, str] = {}
    for kind, (effect, by) in enumerate(zip(counted.effects(action), changes, strict=True)):
        if effect >= 0:
            by = _usual_change(model, states, effect, columns)
        text = _named(model, action, columns, by)
        merged.setdefault(text, []).append(kind)
        like.setdefault(text, model.actions[effect].schema if effect >= 0 else "")
    shares = np.array([shares[kinds].sum() for kinds in merged.values()])
    sets = np.stack([sets[:, kinds].any(axis=1) for kinds in merged.values()], axis=1)
    errors = _errors(sets, number, shares)
    if 1.0 - shares[0] < max(_RARE, _CERTAIN * errors[0]):
        return
    outcomes = [
        ObservedOutcome(text, p, e, k == 0, like[text])
        for k, (text, p, e) in enumerate(zip(merged, shares.tolist(), errors.tolist(), strict=True))
        if k == 0 or p >= 0.5 / samples
    ]
    outcomes.sort(key=lambda o: (-o.probability, o.changes))
    yield StochasticEffect(own.schema, own.place, tuple(outcomes), samples, 0.0)


def _errors(sets: NDArray[np.bool_], number: Vector, shares: Vector) -> Vector:
    """Return the standard errors of maximum-likelihood shares `[K]` of outcomes.

    By the observed information along the directions that keep the sum of the shares.

    Args:
        sets: `[S, K]` outcomes that explain an observation together.
        number: `[S]` how often they did.
        shares: `[K]`.
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
    few = states[:: max(1, len(states) // _STATES)]
    changes = (predictions(model, few, np.full(len(few), action)) - few)[:, columns]
    changes = changes[np.isfinite(changes).all(axis=1) & changes.any(axis=1)]
    if not len(changes):
        return np.zeros(len(columns))
    rows, counts = np.unique(changes, axis=0, return_counts=True)
    usual: Vector = rows[counts.argmax()]
    return usual


def _named(
    model: TransitionModel, action: int, columns: NDArray[np.int64], changes: Vector
) -> Changes:
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


def _with_cost(model: TransitionModel, steps: Steps, finding: StochasticEffect) -> StochasticEffect:
    """Return a finding with the squared error that its mean saves."""
    own = [k for k, action in enumerate(model.actions) if action.schema == finding.schema]
    rows = np.isin(steps.sample.actions, own)
    states, actions = steps.sample.states[rows], steps.sample.actions[rows]
    mean = forecast_with(model, Findings(stochastic=(finding,)), states, actions).mean
    off, left = (
        np.nansum(((steps.after[rows] - said) / steps.units)[:, :-2] ** 2)
        for said in (steps.predicted[rows], mean)
    )
    return dataclasses.replace(finding, cost=max(0.0, float(off - left) / len(steps.sample)))


_MOST_ROWS_OF_ANALYSIS = 4_000  # rows of a regression
_MOST_PAIRS = 20_000  # rows over all objects: each object adds a row per transition
_FEWEST_ROWS = 500
_MOST_COSTED = 2_000


def findings(model: TransitionModel, experience: TransitionMemory) -> Findings:
    """Return the findings about a file.

    Parameters and missing effects are estimated jointly. A pure function of its arguments.

    Args:
        model: The model as written, with the control period of the transitions.
        experience: The transitions.
    """
    steps = Steps.of(model, experience)
    sample = steps.sample
    if not len(sample):
        return Findings()
    objects = max(Counter(f.symbol for f in model.fluents if f.numeric).values(), default=1)
    part = sample.part(max(_FEWEST_ROWS, min(_MOST_ROWS_OF_ANALYSIS, _MOST_PAIRS // objects)))
    explanation = fit_jointly(model, part)
    costs = _Costs(model, explanation, sample.part(_MOST_COSTED), steps.units)
    whole = whole_symbols(function_columns(model.ground), sample)
    return Findings(
        parameters=_parameters(model, explanation, costs),
        missing=_missing(model, explanation, costs, part),
        stochastic=find_stochastic_effects(model, steps, whole),
        rules=find_rules(model, steps),
        samples=len(sample),
    )


class _Costs:
    """The increase of the prediction error if one finding is dropped."""

    def __init__(
        self, model: TransitionModel, explanation: EffectFit, sample: RegressionData, units: Vector
    ) -> None:
        self._sample = sample
        self._units = units[:-2]
        self._symbols = [fluent.symbol for fluent in model.fluents]
        self._theta = explanation.fit.theta
        self._model = TransitionModel(explanation.ground, dt=model.dt)
        self._least = self._errors(self._theta)

    def of(self, parameters: list[int], value: float, symbol: str) -> float:
        """Return the cost for a function of setting parameters to a value; at least 0."""
        theta = self._theta.copy()
        theta[parameters] = value
        more = self._errors(theta) - self._least
        return max(0.0, float(more[[name == symbol for name in self._symbols]].sum()))

    def _errors(self, theta: Vector) -> Vector:
        sample = self._sample
        predicted = predictions(self._model.replace(theta=theta), sample.states, sample.actions)
        off = (sample.next_states - predicted) / self._units
        errors: Vector = np.nansum(off**2, axis=0) / len(sample)
        return errors


def _parameters(
    model: TransitionModel, explanation: EffectFit, costs: _Costs
) -> tuple[ParameterFinding, ...]:
    fit = explanation.fit
    found = []
    for dependency in parameter_dependencies(model.ground):
        parameter = dependency.parameter
        index = parameter.index
        if np.isfinite(fit.errors[index]):
            found.append(
                ParameterFinding(
                    parameter=parameter,
                    schema=dependency.schema,
                    fluent=dependency.symbol,
                    written=parameter.value,
                    estimate=float(fit.theta[index]),
                    error=float(fit.errors[index]),
                    samples=int(fit.samples[index]),
                    cost=costs.of([index], parameter.value, dependency.symbol),
                )
            )
    return tuple(sorted(found, key=lambda f: -f.cost))


def _missing(
    model: TransitionModel, explanation: EffectFit, costs: _Costs, sample: RegressionData
) -> tuple[MissingEffect, ...]:
    fit, written = explanation.fit, len(model.ground.parameters)
    together: dict[tuple[str, LiftedFluent], list[tuple[int, AddedEffect]]] = {}
    for k, addition in enumerate(explanation.added):
        if np.isfinite(fit.errors[written + k]):
            key = addition.schema, addition.target
            together.setdefault(key, []).append((written + k, addition))
    found = []
    for (schema, target), terms in together.items():
        indices = [index for index, _ in terms]
        place = next((a.place for a in model.actions if a.schema == schema), None)
        found.append(
            MissingEffect(
                schema=schema,
                place=place,
                fluent=target.name,
                terms=tuple(
                    EffectTerm(
                        float(fit.theta[index]),
                        float(fit.errors[index]),
                        tuple(factor.name for factor in addition.factors),
                    )
                    for index, addition in terms
                ),
                samples=int(fit.samples[indices].max()) if schema else len(sample),
                cost=costs.of(indices, 0.0, target.symbol),
            )
        )
    return tuple(sorted(found, key=lambda f: -f.cost))
