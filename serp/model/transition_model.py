"""The transition model: (state, action) → next state, reward, unsafe, terminal, applicable."""

from __future__ import annotations

import copy
import math
import operator
from collections.abc import Collection, Mapping, Sequence
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from serp._util.text import did_you_mean, listed
from serp.errors import SerpError
from serp.model.emit import Site
from serp.model.flags import APPLICABLE, TERMINAL, UNSAFE, risk_of, risks_of
from serp.model.ground import (
    REWARD_TARGET,
    Constant,
    Fluent,
    GroundModel,
    GroundSchema,
    Parameter,
    SetBoolean,
    SetNumber,
)
from serp.model.program import Program

Vector = NDArray[np.float64]


class StateError(SerpError):
    """A state or an action does not fit the model."""


class Outcome(NamedTuple):
    """What the model predicts of one action, or of a batch of them.

    Attributes:
        state: Next state `[F]` (or `[B, F]`); the state itself where not applicable.
        reward: Change of `(reward)` in the step; 0 where not applicable.
        unsafe: Whether by the file as written `(unsafe)` became true in the step.
        terminal: Whether `(terminal)` became true or the problem's goal is reached.
        applicable: Whether the precondition holds, every condition that matters is true or false
            and every result is a finite number.
        risk: Probability, in [0, 1], that the step is unsafe; 1 where `unsafe`, else 0 unless the
            model has learned otherwise.
    """

    state: Vector
    reward: Any
    unsafe: Any
    terminal: Any
    applicable: Any
    risk: Any


class Judgement(NamedTuple):
    """What the domain says of a transition that was observed."""

    reward: float
    unsafe: bool
    terminal: bool


class TransitionModel:
    """A compiled domain.

    The model is a pure function of state, action, the literals θ and the control period Δt, with
    the meaning of one step as in the design: precondition, effects together, processes (explicit
    Euler over Δt), events, reward and flags. It runs in CPython (single states) and as machine
    code (batches); both give the same bits.

    Attributes:
        fluents: The columns of a state.
        actions: The ground actions, in file order.
        parameters: The literals of the files, with role and place; θ holds their values.
        theta: θ, float64 `[P]`; what reaching the goal is worth follows from the others.
        dt: Control period Δt in the time unit of the domain's rates (seconds by custom).
        initial_state: `[F]` where the problem gives a value to every fluent, else None.
    """

    def __init__(
        self, ground: GroundModel, *, dt: float = 1.0, theta: ArrayLike | None = None
    ) -> None:
        self.ground = ground
        self._program = Program(ground)
        self._index = {fluent.name: fluent.index for fluent in ground.fluents}
        self._actions = {action.name: k for k, action in enumerate(ground.actions)}
        self.initial_state: Vector | None = (
            None if ground.initial is None else np.array(ground.initial, dtype=np.float64)
        )
        if self.initial_state is not None:
            self.initial_state.flags.writeable = False
        written = [p.value for p in ground.parameters]
        self._set(written if theta is None else theta, dt)

    def _set(self, theta: ArrayLike, dt: float) -> None:
        vector = _numbers(theta, "theta").copy()
        if vector.shape != (len(self.ground.parameters),) or not np.isfinite(vector).all():
            raise StateError(f"theta must be {len(self.ground.parameters)} finite numbers")
        if isinstance(dt, bool) or not isinstance(dt, Real) or not 0.0 < float(dt) < math.inf:
            raise StateError(f"the control period must be a positive number, not {dt!r}")
        worth = self.ground.goal_worth
        if worth is not None:
            vector[worth.parameter] = worth.value(vector.tolist(), float(dt))
        vector.flags.writeable = False
        self.theta: Vector = vector
        self.dt: float = float(dt)
        self._theta_list: list[float] = vector.tolist()

    def replace(
        self, *, theta: ArrayLike | None = None, dt: float | None = None
    ) -> TransitionModel:
        """Return the same model with other literals or another control period.

        Nothing is compiled again.

        Raises:
            StateError: θ has the wrong length or a value is not finite.
        """
        other = copy.copy(self)
        other._set(self.theta if theta is None else theta, self.dt if dt is None else dt)
        return other

    @property
    def fluents(self) -> tuple[Fluent, ...]:
        """The columns of a state."""
        return self.ground.fluents

    @property
    def actions(self) -> tuple[GroundSchema, ...]:
        """The ground actions, in file order."""
        return self.ground.actions

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The literals of the files."""
        return self.ground.parameters

    @property
    def rewarding(self) -> bool:
        """Whether the domain gives reward: `(reward)` changes, or a metric, or a goal."""
        ground = self.ground
        schemas = (*ground.actions, *ground.processes, *ground.events)
        changed = any(e.target == REWARD_TARGET for s in schemas for e in s.effects)
        return changed or ground.metric is not None or ground.goal_rewarded

    # States ------------------------------------------------------------------------------------

    def state(self, values: Mapping[str, float | bool]) -> Vector:
        """Return the state with the named values.

        Args:
            values: Fluent name → value, for every fluent.

        Raises:
            StateError: A fluent is missing, unknown, or its value is no finite number.
        """
        if not isinstance(values, Mapping):
            raise StateError(f"a state is given as fluent name → value, not as {values!r}")
        if values.keys() != self._index.keys():
            self.check_names(values)
        state = np.empty(len(self.fluents))
        for name, value in values.items():
            try:
                if isinstance(value, _NO_NUMBERS):
                    raise TypeError
                state[self._index[name]] = value
            except (TypeError, ValueError):
                raise StateError(f"the value of fluent `{name}` is no number: {value!r}") from None
        return self.check_state(state)

    def check_names(self, names: Collection[str]) -> None:
        """Check that the names are those of the fluents.

        Raises:
            StateError: One is unknown, or fluents are missing; names them.
        """
        for name in names:
            if name not in self._index:
                raise StateError(self._unknown_fluent(str(name)))
        missing = listed(f.name for f in self.fluents if f.name not in names)
        if missing:
            raise StateError(
                f"no value for fluent {missing}; given are {listed(map(str, names)) or 'none'}"
            )

    def _unknown_fluent(self, name: str) -> str:
        if name in self.ground.static:
            return (
                f"`{name}` is fixed by the problem file and changed by no effect; "
                "leave it out, or take it out of :init"
            )
        return f"unknown fluent `{name}`; {did_you_mean(name, self._index)}"

    def check_state(self, state: ArrayLike) -> Vector:
        """Return the state as float64 `[F]`.

        Raises:
            StateError: The shape is wrong, or a value is NaN, infinite, or, for a predicate,
                neither 0 nor 1.
        """
        vector = self.check_shape(state)
        for fluent, value in zip(self.fluents, vector.tolist(), strict=True):
            if value - value != 0.0:
                raise StateError(f"the value of fluent `{fluent.name}` is {value}")
            if not fluent.numeric and value not in (0.0, 1.0):
                raise StateError(f"predicate `{fluent.name}` is 0 or 1, not {value}")
        return vector

    def check_shape(self, values: ArrayLike) -> Vector:
        """Return numbers as float64 `[F]`, whatever their values are.

        Raises:
            StateError: They are no numbers, or not one for every fluent; names those that have
                none.
        """
        state = _numbers(values, "a state")
        wanted = len(self.fluents)
        if state.shape == (wanted,):
            return state
        numbers = f"a state of this domain is {wanted} number{'' if wanted == 1 else 's'}"
        if state.ndim != 1:
            raise StateError(f"{numbers}, found shape {state.shape}")
        names = [f.name for f in self.fluents]
        if len(state) < wanted:
            what = f"there is none for {listed(names[len(state) :])}"
        else:
            what = f"{len(state) - wanted} more than the fluents {listed(names)}"
        raise StateError(f"{numbers} in the order of its fluents, found {len(state)}: {what}")

    def values(self, state: Sequence[float] | Vector) -> dict[str, float | bool]:
        """Return a state as fluent name → value (bool for predicates)."""
        return {
            f.name: float(state[f.index]) if f.numeric else bool(state[f.index])
            for f in self.fluents
        }

    def action_index(self, action: int | str) -> int:
        """Return the position of a ground action given by name or position.

        Raises:
            StateError: There is no such action.
        """
        if isinstance(action, bool | np.bool_):
            raise StateError(f"an action is a name or a position, not {action!r}")
        if isinstance(action, str):
            name = " ".join(action.lower().strip("() ").split())
            if name not in self._actions:
                raise StateError(f"unknown action `{name}`; {did_you_mean(name, self._actions)}")
            return self._actions[name]
        try:
            index = operator.index(action)
        except TypeError:
            raise StateError(f"an action is a name or a position, not {action!r}") from None
        if not 0 <= index < len(self.actions):
            raise StateError(f"action {index} is not one of the {len(self.actions)} from 0 on")
        return index

    # Prediction --------------------------------------------------------------------------------

    def step(self, state: ArrayLike, action: Any) -> Outcome:
        """Predict one step.

        Args:
            state: `[F]`, or a batch `[B, F]`.
            action: Position or name of a ground action; for a batch one of them, or `[B]`
                positions.

        Raises:
            StateError: State or action do not fit the model.
        """
        states = _numbers(state, "a state")
        if not np.isfinite(states).all():
            raise StateError("a state with NaN or infinity cannot be stepped")
        if states.ndim == 2:
            return self._step_batch(states, action)
        self.check_shape(states)
        values = states.tolist()
        out, flags = self.transition(values, self.action_index(action))
        if not flags & APPLICABLE:
            return Outcome(states.copy(), 0.0, False, False, False, 0.0)
        reward = out.pop()
        return Outcome(
            np.array(out), reward, bool(flags & UNSAFE), bool(flags & TERMINAL), True,
            risk_of(flags),
        )  # fmt: skip

    def transition(self, state: list[float], action: int) -> tuple[list[float], int]:
        """Predict one step on plain lists, for loops in Python that count microseconds.

        Args:
            state: F floats; unchanged.
            action: Position of a ground action.

        Returns:
            F + 1 floats (the next state and the reward; meaningless where not applicable) and
            the flags; see `serp.model.flags`.
        """
        out = [*state, 0.0]
        return out, self._program.step(state, action, self._theta_list, self.dt, out)

    @property
    def data(self) -> Vector:
        """What `native_step` reads beside the state: here the literals θ."""
        return self.theta

    def judge(self, state: Vector, action: int, next_state: Vector) -> Judgement:
        """Read reward and flags off an observed transition, R(s') in the paper's words.

        The action's own rewards are evaluated in `state`; processes and events are evaluated in
        the observed `next_state` instead of the predicted one. Goal and metric are those of
        `next_state` as it is, whatever events would make of it.

        Args:
            state: `[F]` before the action.
            action: Position of the ground action, or -1 where the model does not know it.
            next_state: `[F]` observed after it.

        Raises:
            StateError: There is no such action, or the reward is no finite number there, a
                condition has no truth value, or an event's effects contradict each other.
        """
        if not -1 <= action < len(self.actions):
            raise StateError(f"action {action} is not one of the {len(self.actions)} from 0 on")
        n = next_state.tolist()
        out = [*n, 0.0]
        flags = self._program.judge(state.tolist(), action, n, self._theta_list, self.dt, out)
        if not flags & APPLICABLE:
            site = self.trace_judged(state, action, next_state)[-1]
            raise StateError(
                f"an observed transition cannot be judged: {_without_result(site)}; "
                f"observed state: {self.values(next_state)}"
            )
        return Judgement(out[-1], bool(flags & UNSAFE), bool(flags & TERMINAL))

    def trace(self, state: ArrayLike, action: int) -> tuple[list[Site], int]:
        """Return which precondition failed, or which effects, rates and events took part.

        Returns:
            The sites passed, in order, and the flags.
        """
        values: list[float] = np.asarray(state, dtype=np.float64).tolist()
        return self._program.trace(values, action, self._theta_list, self.dt)

    def trace_judged(self, state: Vector, action: int, next_state: Vector) -> list[Site]:
        """Return which effects, rates and events take part where a transition is judged."""
        before, after = state.tolist(), next_state.tolist()
        return self._program.trace_judged(before, action, after, self._theta_list, self.dt)

    @property
    def compiles(self) -> bool:
        """Whether the model is small enough to be compiled to machine code in reasonable time.

        Larger ones run in CPython, with the same results.
        """
        return self._program.compiles

    @property
    def compiled(self) -> bool:
        """Whether `native_step` has been called already, so that it costs nothing to call again."""
        return self._program.compiled

    def native_step(self) -> Any:
        """Return the compiled C callback of `step` (numba), compiling it when first called."""
        return self._program.native

    def native_flow(self) -> Any:
        """Return the like of effects and processes alone, without events, goal and metric."""
        return self._program.native_flow

    def _step_batch(self, states: Vector, action: Any) -> Outcome:
        batch, width = states.shape
        if width != len(self.fluents):
            raise StateError(
                f"a state of this domain is {len(self.fluents)} numbers, found {width} columns"
            )
        if isinstance(action, str):
            action = self.action_index(action)
        given = np.asarray(action)
        if given.shape not in ((), (batch,)) or (given.size and given.dtype.kind not in "iu"):
            raise StateError(f"actions must be {batch} positions, found {action!r}")
        actions = np.broadcast_to(given.astype(np.int64), (batch,))
        if batch and (actions.min() < 0 or actions.max() >= len(self.actions)):
            raise StateError(f"actions must be among the {len(self.actions)} from 0 on")
        if not self.compiles:
            return self._step_rows(states, actions)
        from serp.model.native import address_of, step_batch

        flat = np.ascontiguousarray(states).reshape(-1)
        out = np.empty(batch * (width + 1))
        flags = np.empty(batch, dtype=np.int64)
        step_batch(
            address_of(self.native_step()),
            flat,
            np.ascontiguousarray(actions),
            self.data,
            self.dt,
            out,
            flags,
        )
        table = out.reshape(batch, width + 1)
        applicable = (flags & APPLICABLE) != 0
        return Outcome(
            state=np.where(applicable[:, None], table[:, :width], states),
            reward=np.where(applicable, table[:, width], 0.0),
            unsafe=applicable & ((flags & UNSAFE) != 0),
            terminal=(flags & TERMINAL) != 0,
            applicable=applicable,
            risk=np.where(applicable, risks_of(flags), 0.0),
        )

    def _step_rows(self, states: Vector, actions: NDArray[np.int64]) -> Outcome:
        rows = [self.step(s, a) for s, a in zip(states, actions.tolist(), strict=True)]
        return Outcome(
            state=np.array([r.state for r in rows]).reshape(states.shape),
            reward=np.array([r.reward for r in rows], dtype=np.float64),
            unsafe=np.array([r.unsafe for r in rows], dtype=np.bool_),
            terminal=np.array([r.terminal for r in rows], dtype=np.bool_),
            applicable=np.array([r.applicable for r in rows], dtype=np.bool_),
            risk=np.array([r.risk for r in rows], dtype=np.float64),
        )


def _numbers(values: ArrayLike, what: str) -> Vector:
    try:
        array = np.asarray(values)
    except ValueError:  # lists of different lengths
        array = np.asarray(None)
    if array.dtype.kind not in "biuf":
        raise StateError(f"{what} is numbers, found {values!r}")
    return array.astype(np.float64, copy=False)


_NO_NUMBERS = (str, bytes, complex, np.complexfloating)
"""What NumPy would make a number of all the same."""


def _without_result(site: Site) -> str:
    """Say where a step has no result, and why."""
    place = (
        site.item.place
        if site.item is not None and not isinstance(site.item, Constant)
        else (site.schema.place if site.schema is not None else None)
    )
    if site.what == "conflict":
        why = "contradicts another effect"
    elif isinstance(site.item, SetBoolean | SetNumber) or site.item is None:
        why = "gives no finite number"
    else:
        why = "is neither true nor false, it divides by zero"
    if place is None:
        return f"the reward {why}"
    return f"{place.source.name}:{place.line}:{place.column}: `{place.text}` {why}"
