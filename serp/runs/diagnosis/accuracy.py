"""Accuracy of the one-step predictions of fluents, reward and end, relative to their changes.

The unit of an error is the root mean square of the change in a step. The squared errors of a
symbol, summed over its fluents, are then a fraction of its squared change.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from serp.model.learned.effect_search import LASTING
from serp.model.learned.parameter_fit import AddedEffect, with_effects
from serp.model.learned.regression_data import (
    WORLD,
    LiftedFluent,
    LiftedModel,
    RegressionData,
    predicted_steps,
    regression_data,
)
from serp.model.learned.robust_regression import CERTAIN
from serp.model.learned.transitions import TransitionMemory
from serp.model.transition_model import TransitionModel, Vector
from serp.pddl.syntax import REWARD, TERMINAL
from serp.runs.diagnosis.findings import (
    Findings,
    MissingEffect,
    ObservedOutcome,
    ParameterFinding,
    symbol_of,
)

WELL: Final = 0.1
"""A quantity is predicted well if its error is at most this share of its change."""

_ROUNDING: Final = 1e-9  # a change below this fraction of a value's size is rounding


def forecast_with(
    model: TransitionModel,
    findings: Findings,
    states: Vector,
    actions: NDArray[np.int64],
    observed: Vector | None = None,
) -> tuple[Vector, Vector]:
    """Return what the written model patched with findings predicts; see `predicted_steps`.

    It is the expected result, and its variance due to stochastic effects, `[N, F + 2]` each.
    """
    lifted = LiftedModel(model.ground)
    theta = model.theta.copy()
    for finding in findings.parameters:
        theta[finding.parameter.index] = finding.estimate
    terms = [(missing, term) for missing in findings.missing for term in missing.terms]
    added = [
        AddedEffect(m.schema, _lifted(m.fluent), tuple(map(_lifted, t.fluents))) for m, t in terms
    ]
    ground = with_effects(lifted, added)
    theta = np.concatenate((theta, [term.coefficient for _, term in terms]))
    patched = TransitionModel(ground, dt=model.dt, theta=theta)
    mean = predicted_steps(patched, states, actions, observed)
    variance = np.zeros(mean.shape)
    width = states.shape[1]
    instances = {(a.schema, a.arguments): k for k, a in enumerate(model.actions)}
    for stochastic in findings.stochastic:
        for action, binding in lifted.schema(stochastic.schema).bindings.items():
            rows = np.flatnonzero(actions == action)
            outcomes = [(o, _columns(lifted, o, binding)) for o in stochastic.outcomes]
            changed = sorted({column for _, changes in outcomes for column in changes})
            if not len(rows) or not changed:
                continue
            columns = np.array([*changed, width, width + 1])
            # Outcomes too rare to be listed count as no change; reward and end are then as usual.
            usual = mean[np.ix_(rows, columns)]
            usual[:, :-2] = states[rows][:, changed]
            results = [(1.0 - sum(outcome.probability for outcome, _ in outcomes), usual)]
            for outcome, changes in outcomes:
                after = usual.copy()
                after[:, :-2] += [changes.get(column, 0.0) for column in changed]
                like = instances.get((outcome.like, model.actions[action].arguments))
                if like is not None:
                    other = predicted_steps(patched, states[rows], np.full(len(rows), like))
                    after = np.where(np.isfinite(other[:, columns]), other[:, columns], usual)
                results.append((outcome.probability, after))
            average = sum(probability * after for probability, after in results)
            spread = sum(probability * (after - average) ** 2 for probability, after in results)
            mean[np.ix_(rows, columns)] = average
            variance[np.ix_(rows, columns)] += spread
    return mean, variance


def _columns(
    lifted: LiftedModel, outcome: ObservedOutcome, binding: Mapping[str, str]
) -> dict[int, float]:
    """Return the changes of an outcome: column → change; ambiguous names are left out."""
    changes = {}
    for name, change in outcome.changes:
        try:
            changes[lifted.column(_lifted(name), binding)] = change
        except KeyError:
            named = [f.index for f in lifted.ground.fluents if f.symbol == name]
            if len(named) == 1:
                changes[named[0]] = change
    return changes


def _lifted(name: str) -> LiftedFluent:
    """Parse the printed name of a fluent: `battery ?robot`."""
    symbol, *terms = name.strip("() ").split(" ")
    return LiftedFluent(symbol, tuple(terms))


class Steps(NamedTuple):
    """Observed steps, over the fluents, the reward and the end, `[N, F + 2]`, and predictions."""

    sample: RegressionData
    before: Vector  # reward and end are 0
    after: Vector  # the end is 1 where the environment ended the task, else 0
    predicted: Vector  # by the file; NaN where there is none
    units: Vector  # `[F + 2]`, of the errors

    @classmethod
    def of(cls, model: TransitionModel, experience: TransitionMemory) -> Self:
        """Compare an experience with a model as written."""
        sample = regression_data(
            model, experience.states, experience.actions, experience.next_states
        )
        rewards, over = experience.rewards[sample.positions], experience.over[sample.positions]
        before = np.column_stack((sample.states, np.zeros((len(sample), 2))))
        after: Vector = np.column_stack((sample.next_states, rewards, over))
        predicted = predicted_steps(model, sample.states, sample.actions, sample.next_states)
        return cls(sample, before, after, predicted, _units(model, before, after, predicted))


def _units(model: TransitionModel, before: Vector, after: Vector, predicted: Vector) -> Vector:
    """Return the unit of each column: the root mean square change of its symbol.

    A symbol that never changes is measured by its predicted change; one that is not predicted to
    change either has unit 1.
    """
    names = symbols_of(model)
    units = np.ones(len(names))
    largest = np.abs(np.concatenate((before, after))).max(axis=0, initial=0.0)
    for name in dict.fromkeys(names.tolist()):
        own = names == name
        for reached in (after, predicted):
            squares = (reached - before)[:, own] ** 2
            moved = float(np.sqrt(np.nansum(squares) / max(1, len(squares))))
            if moved > _ROUNDING * float(largest[own].max()):
                units[own] = moved
                break
    return units


def symbols_of(model: TransitionModel) -> NDArray[np.str_]:
    """Return the symbol of each column of `Steps`."""
    return np.array([*(fluent.symbol for fluent in model.fluents), REWARD, TERMINAL])


@dataclass(frozen=True)
class Quantity:
    """The accuracy of the predictions for the fluents of one symbol, the reward or the end.

    Its change is the root mean square of that in a step; for a predicate or an end the number of
    changes. A reward and an end count as changes. Squared errors are in units of its square.
    """

    name: str  # the symbol, `reward` or `terminal`
    shown: str  # how it is written: `(battery)`
    numeric: bool  # False for predicates and the end
    steps: int  # transitions compared
    change: float
    squared: float  # error of the file as written
    squared_left: float  # of the file patched with the findings worth mentioning
    squared_chance: float  # the part of it expected from the stochastic effects found
    action: str  # the ground action after which the error of the file is largest

    @property
    def error(self) -> float:
        """Error of the file relative to the change; "nothing ever changes" has an error of 1."""
        return self._share(self.squared)

    @property
    def error_left(self) -> float:
        """Error of the file patched with the findings worth mentioning."""
        return self._share(self.squared_left)

    @property
    def unexplained(self) -> float:
        """Error of the patched file without the expected error of the stochastic effects found."""
        return self._share(max(0.0, self.squared_left - self.squared_chance))

    def _share(self, squared: float) -> float:
        return math.sqrt(squared) if self.numeric else squared


def quantities_of(
    model: TransitionModel, steps: Steps, expected: Vector, variance: Vector
) -> tuple[Quantity, ...]:
    """Return all quantities that change or are predicted to, given what `forecast_with` returns."""
    names, units = symbols_of(model), steps.units
    predicates = {fluent.symbol for fluent in model.fluents if not fluent.numeric} | {TERMINAL}
    moves = steps.after - steps.before
    wrong, wrong_left = steps.after - steps.predicted, steps.after - expected
    squares = wrong**2, wrong_left**2, variance
    errors, left, chance = (np.nan_to_num(square) / units**2 for square in squares)
    number = max(1, len(moves))
    quantities = []
    for name in dict.fromkeys(names.tolist()):
        own, numeric = names == name, name not in predicates
        by_step = errors[:, own].sum(axis=1)
        squared = float(by_step.sum()) / number
        if not (np.abs(moves[:, own]) > _ROUNDING * units[own]).any() and squared <= _ROUNDING**2:
            continue
        by_action = np.bincount(steps.sample.actions, by_step, len(model.actions))
        change = np.sqrt(np.mean(moves[:, own] ** 2)) if numeric else (moves[:, own] != 0.0).sum()
        fluents = [fluent.name for fluent in model.fluents if fluent.symbol == name]
        quantities.append(
            Quantity(
                name=name,
                shown=f"({name} …)" if len(fluents) > 1 else f"({[*fluents, name][0]})",
                numeric=numeric,
                steps=len(moves),
                change=float(change),
                squared=squared,
                squared_left=float(left[:, own].sum()) / number,
                squared_chance=float(chance[:, own].sum()) / number,
                action=model.actions[int(by_action.argmax())].name,
            )
        )
    return tuple(quantities)


def worthwhile(
    findings: Findings, explained: tuple[Quantity, ...], processes: set[str]
) -> Findings:
    """Return the findings that are worth mentioning, given the accuracy with all of them.

    * Parameters and missing effects: certain (4 standard errors), with a cost above that of an
      error of 1 % of the change (0.3 % in a process: its errors add up, while those of actions
      cancel out), and above 0.2 % of the squared error that is left.
    * Stochastic effects: all; only frequent ones are found.
    * Lines on reward or end: if the other findings leave an error of more than 10 %, and the cost
      of the line exceeds that too.
    """
    left = {quantity.name: quantity.squared_left for quantity in explained}
    unsettled = {quantity.name for quantity in explained if quantity.unexplained > WELL}

    def pays(finding: ParameterFinding | MissingEffect) -> bool:
        lasting = finding.schema == WORLD or finding.schema in processes
        rest = 0.002 * left.get(symbol_of(finding.fluent), 0.0)
        return finding.cost > max(LASTING if lasting else 0.01**2, rest)

    def differs(finding: ParameterFinding) -> bool:
        gap = abs(finding.estimate - finding.written)
        rounding = 1e-9 * max(abs(finding.estimate), abs(finding.written))
        return gap > max(CERTAIN * finding.error, rounding)

    def certain(missing: MissingEffect) -> MissingEffect:
        terms = (term for term in missing.terms if abs(term.coefficient) > CERTAIN * term.error)
        return dataclasses.replace(missing, terms=tuple(terms))

    return dataclasses.replace(
        findings,
        parameters=tuple(f for f in findings.parameters if differs(f) and pays(f)),
        missing=tuple(m for m in map(certain, findings.missing) if m.terms and pays(m)),
        rules=tuple(r for r in findings.rules if r.fluent in unsettled and r.cost > WELL**2),
    )
