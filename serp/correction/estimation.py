"""Everything that observed transitions say about a domain file."""

from __future__ import annotations

from collections import Counter

import numpy as np

from serp.correction.additions import Addition
from serp.correction.experience import Experience
from serp.correction.explaining import Explanation, explain
from serp.correction.findings import (
    Findings,
    LiteralFinding,
    MissingEffect,
    Term,
)
from serp.correction.influence import influences
from serp.correction.lifting import WORLD, Lifted
from serp.correction.literals import LiteralEstimator, estimate_literals, whole_symbols
from serp.correction.outcomes import find_outcomes
from serp.correction.rules import find_rules
from serp.correction.sample import Sample, predicted_steps, predictions, take_sample
from serp.correction.units import Steps, units_of
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
    steps = Steps.of(experience, sample)
    predicted = predicted_steps(model, sample.states, sample.actions)
    units = units_of(model, steps, predicted)
    costs = _Costs(model, explanation, sample.part(_MOST_COSTED), units)
    whole = whole_symbols(LiteralEstimator(model.ground, model.dt), sample)
    return Findings(
        literals=_literals(model, explanation, costs),
        missing=_missing(model, explanation, costs, part),
        outcomes=find_outcomes(model, sample, whole, units),
        rules=find_rules(model, sample, steps, predicted, units),
        samples=len(sample),
        skipped=sample.skipped,
    )


class _Costs:
    """What the prediction loses where one thing that was found is forgotten."""

    def __init__(
        self, model: TransitionModel, explanation: Explanation, sample: Sample, units: Vector
    ) -> None:
        self._sample = sample
        self._units = units[:-2]
        self._symbols = [fluent.symbol for fluent in model.fluents]
        self._theta = explanation.fit.theta
        self._model = TransitionModel(explanation.ground, dt=model.dt)
        self._least = self._errors(self._theta)

    def of(self, literals: list[int], values: list[float], symbol: str) -> float:
        """Return what giving some literals other values costs a function; never negative."""
        theta = self._theta.copy()
        theta[literals] = values
        more = self._errors(theta) - self._least
        return max(0.0, float(more[[name == symbol for name in self._symbols]].sum()))

    def _errors(self, theta: Vector) -> Vector:
        sample = self._sample
        predicted = predictions(self._model.replace(theta=theta), sample.states, sample.actions)
        off = (sample.next_states - predicted) / self._units
        errors: Vector = np.nansum(off**2, axis=0) / len(sample)
        return errors


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
                    cost=costs.of([index], [parameter.value], influence.symbol),
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
                cost=costs.of(indices, [0.0] * len(indices), target.symbol),
            )
        )
    return tuple(sorted(found, key=lambda f: -f.cost))
