"""Stochastic effects of actions on discrete fluents: their outcomes and probabilities.

The outcomes are those that a run counts when it adapts its model, see
`serp.adaptation.outcomes.outcome_counts`: what the file predicts for the action, what it predicts
for another one (a robot that slips does what another action does), or a change of the state.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from serp.adaptation.outcomes.recount import CountedGroup, count_outcomes
from serp.diagnosis.accuracy import Steps
from serp.diagnosis.findings import Findings, ObservedOutcome, StochasticEffect
from serp.diagnosis.patched_model import forecast_with
from serp.model import ground as g
from serp.model.transition_model import TransitionModel, Vector
from serp.sysid.lifted_features import LiftedModel
from serp.sysid.regression_data import predictions

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
