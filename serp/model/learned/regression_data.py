"""Observed transitions prepared for regression, and predictions of them without events.

Events clamp, assign and reset fluents after effects and rates have changed them. Predictions for a
regression are therefore those of effects and processes only, and entries that an event changes are
left out.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from serp.model import ground_model as g
from serp.model.flags import TERMINAL
from serp.model.transition_model import TransitionModel, Vector
from serp.pddl.syntax import Change, Kind

WORLD = ""
"""In place of an action schema's name: an effect under every action, as of a process."""


@dataclass(frozen=True, order=True)
class LiftedFluent:
    """A function or predicate applied to variables (`?robot`) and constants."""

    symbol: str
    terms: tuple[str, ...]

    @property
    def name(self) -> str:
        """As it is printed: `battery ?robot`."""
        return " ".join((self.symbol, *self.terms))


@dataclass(frozen=True)
class LiftedScope:
    """The fluents that can be named in an action schema, or in the world (`WORLD`).

    `bindings` map variables to objects for each ground action, by position; for the world, for
    each fluent that changes, by column. `targets` are the fluents that an effect can change.
    """

    schema: str
    bindings: Mapping[int, Mapping[str, str]]
    fluents: tuple[LiftedFluent, ...]
    targets: tuple[LiftedFluent, ...]


class LiftedModel:
    """Maps between the fluents of a ground model and the lifted fluents of its domain file."""

    def __init__(self, ground: g.GroundModel) -> None:
        self.ground = ground
        self.syntax = ground.syntax
        self._index = {fluent.key: fluent.index for fluent in ground.fluents}
        self.schema = functools.cache(self._schema)
        self.world = functools.cache(self._world)

    def column(self, fluent: LiftedFluent, binding: Mapping[str, str]) -> int:
        """Return the column of the state that a lifted fluent denotes under a binding."""
        return self._index[fluent.symbol, *(binding.get(t, t) for t in fluent.terms)]

    def numeric(self, fluent: LiftedFluent) -> bool:
        """Return whether it is a function, not a predicate."""
        return self.syntax.declarations[fluent.symbol].numeric

    def products(
        self,
        scope: LiftedScope,
        factors: tuple[LiftedFluent, ...],
        states: Vector,
        keys: NDArray[np.int64],
    ) -> Vector:
        """Return the product of factors in states `[n, F]`, `[n]`; 0 where a key has no binding."""
        values = np.zeros(len(states))
        for key in np.unique(keys):
            binding = scope.bindings.get(int(key))
            if binding is not None:
                rows = keys == key
                columns = [self.column(factor, binding) for factor in factors]
                values[rows] = states[rows][:, columns].prod(1)
        return values

    def _schema(self, name: str) -> LiftedScope:
        """Return the scope of an action schema."""
        schemas = self.syntax.schemas
        schema = next(s for s in schemas if s.kind is Kind.ACTION and s.name == name)
        variables = [v.name for v in schema.parameters]
        bindings = {
            position: dict(zip(variables, action.arguments, strict=True))
            for position, action in enumerate(self.ground.actions)
            if action.schema == name
        }
        fluents = self._fluents(variables, bindings)
        return LiftedScope(name, bindings, fluents, tuple(f for f in fluents if self.numeric(f)))

    def _world(self, symbol: str) -> LiftedScope:
        """Return the scope of a process that changes the fluents of a function."""
        variables = [p.name for p in self.syntax.declarations[symbol].parameters]
        bindings = {
            f.index: dict(zip(variables, f.arguments, strict=True))
            for f in self.ground.fluents
            if f.symbol == symbol
        }
        fluents = self._fluents(variables, bindings)
        return LiftedScope(WORLD, bindings, fluents, (LiftedFluent(symbol, tuple(variables)),))

    def _fluents(
        self, variables: Sequence[str], bindings: Mapping[int, Mapping[str, str]]
    ) -> tuple[LiftedFluent, ...]:
        """Return the fluents under every binding, those with the fewest terms first."""
        arity = {f.symbol: len(f.arguments) for f in self.ground.fluents}
        lifted = (
            LiftedFluent(symbol, terms)
            for symbol, number in sorted(arity.items(), key=lambda item: item[1])
            for terms in itertools.product((*variables, *self.syntax.constants), repeat=number)
            if all(
                (symbol, *(binding.get(t, t) for t in terms)) in self._index
                for binding in bindings.values()
            )
        )
        return tuple(itertools.islice(lifted, 60))  # the search for effects is quadratic in them


_BLOCK = 20  # number of consecutive transitions whose errors are assumed to be correlated


@dataclass(frozen=True)
class RegressionData:
    """N transitions with which a model can be compared.

    `blocks` `[N]` numbers the blocks of `_BLOCK` neighbouring transitions, `scale` `[F]` is the
    observed range of each fluent, 1 where it never varied, and `positions` `[N]` are those of the
    rows among all transitions. `left_out` counts the others by reason.
    """

    states: Vector
    actions: NDArray[np.int64]
    next_states: Vector
    blocks: NDArray[np.int64]
    scale: Vector
    positions: NDArray[np.intp]
    left_out: Mapping[str, int]

    def __len__(self) -> int:
        return len(self.actions)

    def part(self, most: int) -> RegressionData:
        """Return about `most` rows at most: whole blocks, evenly spread."""
        if len(self) <= most:
            return self
        number = int(self.blocks[-1]) + 1
        chosen = np.unique(np.linspace(0, number - 1, max(1, most // _BLOCK)).astype(np.int64))
        rows = np.isin(self.blocks, chosen)
        names = "states", "actions", "next_states", "blocks", "positions"
        return dataclasses.replace(self, **{name: getattr(self, name)[rows] for name in names})


def regression_data(
    model: TransitionModel, states: Vector, actions: NDArray[np.int64], next_states: Vector
) -> RegressionData:
    """Return the transitions, in order of time, with which the model can be compared."""
    rows, left_out = usable_rows(model, states, actions, next_states)
    if any(action.preconditions for action in model.actions):
        predicted = predictions(without_events(model), states[rows], actions[rows])
        applicable = np.isfinite(predicted).all(1)
        left_out["an action that the file does not allow"] = int((~applicable).sum())
        rows = rows[applicable]
    seen = np.concatenate((states[rows], next_states[rows]))
    scale = np.ptp(seen, axis=0) if len(rows) else np.ones(states.shape[1])
    return RegressionData(
        states=states[rows],
        actions=actions[rows],
        next_states=next_states[rows],
        blocks=rows // _BLOCK,
        scale=np.where(scale > 0, scale, 1.0),
        positions=rows,
        left_out={reason: count for reason, count in left_out.items() if count},
    )


def usable_rows(
    model: TransitionModel, states: Vector, actions: NDArray[np.int64], next_states: Vector
) -> tuple[NDArray[np.intp], dict[str, int]]:
    """Return the rows without faults whose action the model knows, and the others by reason."""
    known = (actions >= 0) & (actions < len(model.actions))
    finite = np.isfinite(states).all(1) & np.isfinite(next_states).all(1)
    rows = np.flatnonzero(known & finite)
    plausible = rows[_plausible(states[rows]) & _plausible(next_states[rows])]
    return plausible, {
        "an action that the file does not know": int((~known).sum()),
        "a value that is not a finite number": int((known & ~finite).sum()),
        "a value far beyond all others of its fluent": len(rows) - len(plausible),
    }


def _plausible(values: Vector) -> NDArray[np.bool_]:
    """Return which rows `[n]` have no value five ranges (of 99 % of them) from the median."""
    if not len(values):
        return np.ones(0, dtype=np.bool_)
    low, middle, high = np.quantile(values, (0.005, 0.5, 0.995), axis=0)
    span = np.where(high > low, high - low, np.inf)
    plausible: NDArray[np.bool_] = np.all(np.abs(values - middle) <= 5.0 * span, axis=1)
    return plausible


def without_events(model: TransitionModel) -> TransitionModel:
    """Return a model with its effects and processes alone."""
    bare = dataclasses.replace(model.ground, events=(), goal=None, metric=None)
    return TransitionModel(bare, dt=model.dt, theta=model.theta)


def undisturbed(model: TransitionModel, data: RegressionData) -> NDArray[np.bool_]:
    """Return which entries of the next states no event has changed, `[N, F]`.

    Excluded are entries that the model's events change in its prediction, and those observed at a
    value that an event assigns. If fewer than 12 remain for an action, the model is wrong, and only
    the latter are excluded.
    """
    free = np.ones(data.states.shape, dtype=np.bool_)
    events = model.ground.events
    if not events:
        return free
    for effect in (effect for event in events for effect in event.effects):
        if (
            isinstance(effect, g.SetNumber)
            and effect.target >= 0
            and effect.change is Change.ASSIGN
            and isinstance(effect.value, g.ParameterRef)
        ):
            column, value = effect.target, model.theta[effect.value.parameter]
            gap = np.abs(data.next_states[:, column] - value)
            free[:, column] &= gap > 1e-9 * data.scale[column]
    before = predictions(without_events(model), data.states, data.actions)
    after = predictions(model, data.states, data.actions)
    kept: NDArray[np.bool_] = free & (before == after)
    for action in np.unique(data.actions):
        rows = data.actions == action
        scarce = rows[:, None] & (kept[rows].sum(0) < 12)
        kept[scarce] = free[scarce]
    return kept


def predictions(model: TransitionModel, states: Vector, actions: NDArray[np.int64]) -> Vector:
    """Return the next states `[N, F]` that a model predicts; NaN where there is none."""
    return predicted_steps(model, states, actions)[:, :-2]


def predicted_steps(
    model: TransitionModel,
    states: Vector,
    actions: NDArray[np.int64],
    observed: Vector | None = None,
) -> Vector:
    """Return predicted next states, rewards and ends (0 or 1), `[N, F + 2]`; NaN without any.

    Of an action with chance the likeliest outcome is predicted; with the `observed` next states
    `[N, F]` the outcome that fits them best, for which one it is the file cannot know.
    """
    finite = np.isfinite(states)
    step = model.step(np.where(finite, states, 0.0), actions)
    ahead = np.column_stack((step.state, step.reward, step.terminal))
    chance = np.array([bool(action.outcomes) for action in model.actions] or [False])
    if observed is not None and chance.any():
        core = model.written_core()
        for row in np.flatnonzero(chance[actions] & (actions >= 0) & finite.all(1)):
            action = int(actions[row])
            outcome = core.outcome_of(states[row], action, np.nan_to_num(observed[row]))
            out, flags = core.step_of_outcome(states[row], action, outcome)
            ahead[row] = *out, bool(flags & TERMINAL)
    ahead[~(finite.all(1) & step.applicable)] = np.nan
    return ahead
