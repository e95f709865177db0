"""Findings from observed transitions, by regression and by counting."""

from __future__ import annotations

from collections import Counter

import numpy as np

from serp.diagnosis.accuracy import Steps
from serp.diagnosis.findings import EffectTerm, Findings, MissingEffect, ParameterFinding
from serp.diagnosis.reward_rules import find_rules
from serp.diagnosis.stochastic_effects import find_stochastic_effects
from serp.model.transition_model import TransitionModel, Vector
from serp.sysid.added_effects import AddedEffect
from serp.sysid.effect_fit import EffectFit
from serp.sysid.joint_fit import fit_jointly
from serp.sysid.lifted_features import LiftedFluent
from serp.sysid.parameter_dependencies import parameter_dependencies
from serp.sysid.parameter_fit import function_columns, whole_symbols
from serp.sysid.regression_data import RegressionData, predictions
from serp.sysid.transitions import TransitionMemory

_MOST_ROWS = 4_000  # rows of a regression
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
    part = sample.part(max(_FEWEST_ROWS, min(_MOST_ROWS, _MOST_PAIRS // objects)))
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
