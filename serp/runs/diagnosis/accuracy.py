"""Accuracy of the one-step predictions of fluents, reward and end, relative to their changes.

The unit of an error is the root mean square of the change in a step. The squared errors of a
symbol, summed over its fluents, are then a fraction of its squared change.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from serp.model import ground as g
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
from serp.model.learned.transitions import TransitionMemory
from serp.model.transition_model import TransitionModel, Vector
from serp.runs.diagnosis.findings import (
    Findings,
    MissingEffect,
    ObservedOutcome,
    ParameterFinding,
    symbol_of,
)


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


REWARD: Final = "reward"
END: Final = "terminal"
"""Names of the quantities beside the fluents."""

_ROUNDING: Final = 1e-9
"""A change below this fraction of a value's size counts as rounding."""

WELL: Final = 0.1
"""A quantity is predicted well if its error is at most this share of its change."""


class Steps(NamedTuple):
    """Observed steps, over the fluents, the reward and the end, and what the file predicts.

    Attributes:
        sample: The transitions that the file is compared with.
        before: `[N, F + 2]`; reward and end are 0.
        after: `[N, F + 2]`; the end is 1 where the environment ended the task, else 0.
        predicted: `[N, F + 2]` predictions of the file; NaN where there is none.
        units: `[F + 2]` units of the errors.
    """

    sample: RegressionData
    before: Vector
    after: Vector
    predicted: Vector
    units: Vector

    @classmethod
    def of(cls, model: TransitionModel, experience: TransitionMemory) -> Self:
        """Compare an experience with a model as written."""
        sample = regression_data(
            model, experience.states, experience.actions, experience.next_states
        )
        rewards, over = experience.rewards[sample.positions], experience.over[sample.positions]
        before = np.column_stack((sample.states, np.zeros((len(sample), 2))))
        after: Vector = np.column_stack((sample.next_states, rewards, over))
        predicted = predicted_steps(model, sample.states, sample.actions)
        return cls(sample, before, after, predicted, _units(model, before, after, predicted))


@dataclass(frozen=True)
class Quantity:
    """The accuracy of the predictions for the fluents of one symbol, the reward or the end.

    Attributes:
        name: The symbol; `reward`, or `terminal` for the end.
        shown: How it is written: `(battery)`.
        numeric: False for predicates and the end.
        written: Whether any effect of the file changes it.
        steps: Transitions compared.
        change: Root mean square of the change in a step; for a predicate or an end the number of
            changes. A reward and an end count as changes.
        said: Number of predicted changes of a predicate, or of predicted ends.
        right: Number of these that were observed.
        squared: Squared error of the file as written.
        squared_left: The same of the file patched with the findings worth mentioning.
        squared_chance: The part of `squared_left` expected from the stochastic effects found.
        action: The ground action after which the error of the file is largest.
        most: The fraction of the error after that action.
    """

    name: str
    shown: str
    numeric: bool
    written: bool
    steps: int
    change: float
    said: int
    right: int
    squared: float
    squared_left: float
    squared_chance: float
    action: str
    most: float

    @property
    def off(self) -> float:
        """Error of the file relative to the change; "nothing ever changes" has an error of 1.

        A ratio of root mean squares, or of numbers of steps for predicates and ends.
        """
        return self._share(self.squared)

    @property
    def off_left(self) -> float:
        """Error of the file patched with the findings worth mentioning."""
        return self._share(self.squared_left)

    @property
    def unexplained(self) -> float:
        """Error of the patched file without the expected error of the stochastic effects found."""
        return self._share(max(0.0, self.squared_left - self.squared_chance))

    def _share(self, squared: float) -> float:
        return math.sqrt(squared) if self.numeric else squared


def _units(model: TransitionModel, before: Vector, after: Vector, predicted: Vector) -> Vector:
    """Return the unit of each column: the root mean square change of its symbol.

    A symbol that never changes is measured by its predicted change; one that is not predicted to
    change either has unit 1.
    """
    names = _symbols(model)
    units = np.ones(len(names))
    largest = np.abs(np.concatenate((before, after))).max(axis=0, initial=0.0)
    for name in dict.fromkeys(names.tolist()):
        own = names == name
        least = _ROUNDING * float(largest[own].max())
        for reached in (after, predicted):
            squares = (reached - before)[:, own] ** 2
            moved = float(np.sqrt(np.nansum(squares) / max(1, len(squares))))
            if moved > least:
                units[own] = moved
                break
    return units


def quantities_of(
    model: TransitionModel, steps: Steps, found: PatchedForecast
) -> tuple[Quantity, ...]:
    """Return all quantities that change or are predicted to, in the order of the file.

    Reward and end are last.

    Args:
        model: The model as written.
        steps: The observed steps.
        found: The predictions of the model patched with findings.
    """
    names = _symbols(model)
    predicates = {fluent.symbol for fluent in model.fluents if not fluent.numeric} | {END}
    predicted, units = steps.predicted, steps.units
    moves, says = steps.after - steps.before, predicted - steps.before
    errors, left, chance = (
        np.nan_to_num(square) / units**2
        for square in (
            (steps.after - predicted) ** 2, (steps.after - found.mean) ** 2, found.variance
        )
    )  # fmt: skip
    number = max(1, len(moves))
    written = _written_symbols(model)
    quantities = []
    for name in dict.fromkeys(names.tolist()):
        own, counts = names == name, name in predicates
        changed, said = np.abs(moves[:, own]) > 0.5, np.abs(says[:, own]) > 0.5
        by_step = errors[:, own].sum(axis=1)
        squared = float(by_step.sum()) / number
        if not (np.abs(moves[:, own]) > _ROUNDING * units[own]).any() and squared <= _ROUNDING**2:
            continue
        by_action = np.bincount(steps.sample.actions, by_step, len(model.actions))
        quantities.append(
            Quantity(
                name=name,
                shown=_shown(model, name),
                numeric=not counts,
                written=name in written,
                steps=len(moves),
                change=float(changed.sum() if counts else np.sqrt(np.mean(moves[:, own] ** 2))),
                said=int(said.sum()) if counts else 0,
                right=int((said & changed).sum()) if counts else 0,
                squared=squared,
                squared_left=float(left[:, own].sum()) / number,
                squared_chance=float(chance[:, own].sum()) / number,
                action=model.actions[int(by_action.argmax())].name,
                most=float(by_action.max()) / (squared * number) if squared else 0.0,
            )
        )
    return tuple(quantities)


def _symbols(model: TransitionModel) -> NDArray[np.str_]:
    """Return the symbol of each column of `Steps`."""
    return np.array([*(fluent.symbol for fluent in model.fluents), REWARD, END])


def _written_symbols(model: TransitionModel) -> set[str]:
    """Return the symbols that an effect of the file changes, with `reward` and `terminal`."""
    ground = model.ground
    schemas = (*ground.actions, *ground.processes, *ground.events)
    targets = {effect.target for schema in schemas for effect in schema.effects}
    written = {fluent.symbol for fluent in model.fluents if fluent.index in targets}
    written |= {REWARD} if model.rewarding else set()
    ends = ground.goal is not None or g.TERMINAL_TARGET in targets
    return written | ({END} if ends else set())


def _shown(model: TransitionModel, name: str) -> str:
    """Return how a symbol is written, with dots where it has several fluents."""
    own = [fluent.name for fluent in model.fluents if fluent.symbol == name]
    return f"({own[0] if len(own) == 1 else name + ' …' if own else name})"


CERTAIN: Final = 4.0
"""Standard errors. A file has many parameters, so false findings must be rare."""
_CHANGE: Final = 1e-4
"""Least cost: an error of 1 % of the change."""
_LEFT: Final = 0.002
"""Least cost as a fraction of the squared error that is left with all findings."""


def worthwhile(findings: Findings, explained: Sequence[Quantity], processes: set[str]) -> Findings:
    """Return the findings that are worth mentioning.

    * Parameters and missing effects: certain (4 standard errors), with a cost above that of an
      error of 1 % of the change (0.3 % in a process: its errors add up, while those of actions
      cancel out), and above 0.2 % of the squared error that is left.
    * Stochastic effects: all; only frequent ones are found.
    * Lines on reward or end: if the other findings leave an error of more than 10 %, and the cost
      of the line exceeds that too.

    Args:
        findings: All findings.
        explained: The accuracy with all findings.
        processes: Names of the processes of the file.
    """
    left = {quantity.name: quantity.squared_left for quantity in explained}
    unsettled = {quantity.name for quantity in explained if quantity.unexplained > WELL}

    def pays(finding: ParameterFinding | MissingEffect) -> bool:
        lasting = finding.schema == WORLD or finding.schema in processes
        rest = _LEFT * left.get(symbol_of(finding.fluent), 0.0)
        return finding.cost > max(LASTING if lasting else _CHANGE, rest)

    def certain(missing: MissingEffect) -> MissingEffect:
        terms = (term for term in missing.terms if abs(term.coefficient) > CERTAIN * term.error)
        return dataclasses.replace(missing, terms=tuple(terms))

    return dataclasses.replace(
        findings,
        parameters=tuple(f for f in findings.parameters if differs(f, CERTAIN) and pays(f)),
        missing=tuple(m for m in map(certain, findings.missing) if m.terms and pays(m)),
        rules=tuple(r for r in findings.rules if r.fluent in unsettled and r.cost > WELL**2),
    )


def without(findings: Findings, some: Findings) -> Findings:
    """Return the findings that are not in `some`."""
    parameters = {finding.parameter.index for finding in some.parameters}
    missing = {(finding.schema, finding.fluent) for finding in some.missing}
    return dataclasses.replace(
        findings,
        parameters=tuple(f for f in findings.parameters if f.parameter.index not in parameters),
        missing=tuple(f for f in findings.missing if (f.schema, f.fluent) not in missing),
        stochastic=tuple(f for f in findings.stochastic if f not in some.stochastic),
        rules=tuple(f for f in findings.rules if f not in some.rules),
    )


def differs(finding: ParameterFinding, errors: float) -> bool:
    """Return whether a parameter is that many standard errors from its estimate."""
    gap = abs(finding.estimate - finding.written)
    rounding = 1e-9 * max(abs(finding.estimate), abs(finding.written))
    return gap > max(errors * finding.error, rounding)
