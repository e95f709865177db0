"""Predictions of a domain file that is patched with findings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.diagnosis.findings import Findings, ObservedOutcome
from serp.model.transition_model import TransitionModel, Vector
from serp.sysid.added_effects import AddedEffect, with_effects
from serp.sysid.lifted_features import LiftedFluent, LiftedModel
from serp.sysid.regression_data import predicted_steps


class PatchedForecast(NamedTuple):
    """The expected result of steps.

    Attributes:
        mean: `[N, F + 2]`: the fluents, the reward, the end; NaN in rows without a next state.
        variance: `[N, F + 2]` about the mean, due to the stochastic effects found.
    """

    mean: Vector
    variance: Vector


def forecast_with(
    model: TransitionModel, findings: Findings, states: Vector, actions: NDArray[np.int64]
) -> PatchedForecast:
    """Return the predictions of the patched model; for stochastic effects, mean and variance.

    Args:
        model: The model as written.
        findings: The findings to patch it with.
        states: `[N, F]`.
        actions: `[N]` positions of ground actions.
    """
    lifted = LiftedModel(model.ground)
    patched = _patched(model, findings, lifted)
    mean = predicted_steps(patched, states, actions)
    forecast = PatchedForecast(mean, np.zeros(mean.shape))
    if findings.stochastic:
        _average(patched, lifted, findings, states, actions, forecast)
    return forecast


def _patched(model: TransitionModel, findings: Findings, lifted: LiftedModel) -> TransitionModel:
    """Return the model with the estimated parameters and the missing effects."""
    theta = model.theta.copy()
    for finding in findings.parameters:
        theta[finding.parameter.index] = finding.estimate
    additions: list[AddedEffect] = []
    coefficients: list[float] = []
    for missing in findings.missing:
        for term in missing.terms:
            factors = tuple(lifted_fluent(name) for name in term.fluents)
            additions.append(AddedEffect(missing.schema, lifted_fluent(missing.fluent), factors))
            coefficients.append(term.coefficient)
    ground = with_effects(lifted, additions)
    return TransitionModel(ground, dt=model.dt, theta=np.concatenate((theta, coefficients)))


def _average(
    model: TransitionModel,
    lifted: LiftedModel,
    findings: Findings,
    states: Vector,
    actions: NDArray[np.int64],
    forecast: PatchedForecast,
) -> None:
    """Write mean and variance of stochastic effects into a forecast."""
    width = states.shape[1]
    instances = {(a.schema, a.arguments): k for k, a in enumerate(model.actions)}
    for finding in findings.stochastic:
        for action, binding in lifted.schema(finding.schema).bindings.items():
            rows = np.flatnonzero(actions == action)
            outcomes = [(o, _columns(lifted, o, binding)) for o in finding.outcomes]
            changed = sorted({column for _, changes in outcomes for column in changes})
            arguments = model.actions[action].arguments
            if not len(rows) or not changed:
                continue
            columns = np.array([*changed, width, width + 1])
            # Outcomes too rare to be listed count as no change; reward and end are then as usual.
            usual = forecast.mean[np.ix_(rows, columns)]
            usual[:, :-2] = states[rows][:, changed]
            kinds = [(1.0 - sum(outcome.probability for outcome, _ in outcomes), usual)]
            for outcome, changes in outcomes:
                after = usual.copy()
                after[:, :-2] += [changes.get(column, 0.0) for column in changed]
                like = instances.get((outcome.like, arguments))
                if like is not None:
                    others = np.full(len(rows), like)
                    said = predicted_steps(model, states[rows], others)[:, columns]
                    after = np.where(np.isfinite(said), said, usual)
                kinds.append((outcome.probability, after))
            mean = sum(probability * after for probability, after in kinds)
            spread = sum(probability * (after - mean) ** 2 for probability, after in kinds)
            forecast.mean[np.ix_(rows, columns)] = mean
            forecast.variance[np.ix_(rows, columns)] = spread


def _columns(
    lifted: LiftedModel, outcome: ObservedOutcome, binding: Mapping[str, str]
) -> dict[int, float]:
    """Return the changes of an outcome: column → change; ambiguous names are left out."""
    changes = {}
    for name, change in outcome.changes:
        try:
            changes[lifted.column(lifted_fluent(name), binding)] = change
        except KeyError:
            named = [f.index for f in lifted.ground.fluents if f.symbol == name]
            if len(named) == 1:
                changes[named[0]] = change
    return changes


def lifted_fluent(name: str) -> LiftedFluent:
    """Parse the printed name of a fluent: `battery ?robot`."""
    symbol, *terms = name.strip("() ").split(" ")
    return LiftedFluent(symbol, tuple(terms))
