"""Everything that observed transitions say about a domain file."""

from __future__ import annotations

import dataclasses
from collections import Counter

import numpy as np

from serp.correction.additions import Addition
from serp.correction.applied import predictions_with
from serp.correction.experience import Experience
from serp.correction.explaining import Explanation, explain
from serp.correction.findings import (
    Findings,
    FluentFit,
    LiteralFinding,
    MissingEffect,
    Term,
)
from serp.correction.influence import influences
from serp.correction.lifting import WORLD, Lifted
from serp.correction.literals import LiteralEstimator, estimate_literals, whole_symbols
from serp.correction.outcomes import find_outcomes
from serp.correction.sample import Sample, predictions, take_sample
from serp.domain.model import TransitionModel, Vector

__all__ = ["estimate_literals", "findings"]

_MOST_ROWS = 4_000  # of a regression
_MOST_PAIRS = 20_000  # of transitions and objects, all of which say something of their type
_FEWEST_ROWS = 500
_MOST_COSTED = 2_000


def findings(model: TransitionModel, experience: Experience) -> Findings:
    """Return what the transitions say about the file, by regression and by counting.

    Literals and missing effects are estimated together. A pure function of its arguments.

    Args:
        model: The model as written, with the control period of the transitions.
        experience: The transitions.
    """
    sample = take_sample(model, experience.states, experience.actions, experience.next_states)
    if not len(sample):
        return Findings((), (), (), (), 0, sample.skipped)
    objects = max(Counter(f.symbol for f in model.fluents if f.numeric).values(), default=1)
    part = sample.part(max(_FEWEST_ROWS, min(_MOST_ROWS, _MOST_PAIRS // objects)))
    explanation = explain(model, part)
    costs = _Costs(model, explanation, sample.part(_MOST_COSTED))
    whole = whole_symbols(LiteralEstimator(model.ground, model.dt), sample)
    found = Findings(
        literals=_literals(model, explanation, costs),
        missing=_missing(model, explanation, costs, part),
        outcomes=find_outcomes(model, sample, whole),
        fits=(),
        samples=len(sample),
        skipped=sample.skipped,
    )
    return dataclasses.replace(found, fits=_fits(model, found, sample))


class _Costs:
    """What the prediction loses where one thing that was found is forgotten."""

    def __init__(self, model: TransitionModel, explanation: Explanation, sample: Sample) -> None:
        self._sample = sample
        self._theta = explanation.fit.theta
        self._model = TransitionModel(explanation.ground, dt=model.dt)
        self._least = self._error(self._theta)

    def of(self, literals: list[int], values: list[float]) -> float:
        """Return the cost of giving some literals other values; never negative."""
        theta = self._theta.copy()
        theta[literals] = values
        return max(0.0, self._error(theta) - self._least)

    def _error(self, theta: Vector) -> float:
        sample = self._sample
        predicted = predictions(self._model.replace(theta=theta), sample.states, sample.actions)
        off = (sample.next_states - predicted) / sample.scale
        return float(np.nansum(off**2)) / len(sample)


def _literals(
    model: TransitionModel, explanation: Explanation, costs: _Costs
) -> tuple[LiteralFinding, ...]:
    fit = explanation.fit
    found = []
    for influence in influences(model.ground):
        parameter = influence.parameter
        index = parameter.index
        if np.isfinite(fit.errors[index]):
            found.append(
                LiteralFinding(
                    parameter=parameter,
                    schema=influence.schema,
                    fluent=influence.symbol,
                    written=parameter.value,
                    estimate=float(fit.theta[index]),
                    error=float(fit.errors[index]),
                    samples=int(fit.samples[index]),
                    cost=costs.of([index], [parameter.value]),
                )
            )
    return tuple(sorted(found, key=lambda f: -f.cost))


def _missing(
    model: TransitionModel, explanation: Explanation, costs: _Costs, sample: Sample
) -> tuple[MissingEffect, ...]:
    fit, written = explanation.fit, len(model.ground.parameters)
    together: dict[tuple[str, Lifted], list[tuple[int, Addition]]] = {}
    for k, addition in enumerate(explanation.additions):
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
                    Term(
                        float(fit.theta[index]),
                        float(fit.errors[index]),
                        tuple(factor.name for factor in addition.factors),
                    )
                    for index, addition in terms
                ),
                rate=schema == WORLD,
                samples=int(fit.samples[indices].max()) if schema else len(sample),
                cost=costs.of(indices, [0.0] * len(indices)),
            )
        )
    return tuple(sorted(found, key=lambda f: -f.cost))


def _fits(model: TransitionModel, found: Findings, sample: Sample) -> tuple[FluentFit, ...]:
    written = predictions(model, sample.states, sample.actions)
    estimated = predictions_with(model, found, sample.states, sample.actions)
    fits = []
    for position, action in enumerate(model.actions):
        rows = sample.actions == position
        if not rows.any():
            continue
        observed = sample.next_states[rows]
        off = np.sqrt(np.nanmean((observed - written[rows]) ** 2, axis=0))
        left = np.sqrt(np.nanmean((observed - estimated[rows]) ** 2, axis=0))
        for fluent in model.fluents:
            k = fluent.index
            fits.append(
                FluentFit(
                    action=action.name,
                    fluent=fluent.name,
                    rmse_written=float(off[k]),
                    rmse_estimated=float(left[k]),
                    scale=float(sample.scale[k]),
                    samples=int(rows.sum()),
                )
            )
    return tuple(fits)
