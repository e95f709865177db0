"""The transition model: (state, action) → next state, reward, unsafe, terminal, applicable."""

from __future__ import annotations

import copy
import functools
import math
from numbers import Real
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from serp import _core
from serp.model.flags import APPLICABLE, TERMINAL, UNSAFE, risk_of, risks_of
from serp.model.ground_model import REWARD_TARGET, GroundModel
from serp.model.grounder import GoalValue
from serp.model.instructions import instruction_table
from serp.model.state_space import StateError, StateSpace, Vector, numbers
from serp.model.traced_step import Amendment, Passage, Site, Traced, TracedStep

__all__ = ["Judgement", "Outcome", "StateError", "TransitionModel", "Vector"]


class Outcome(NamedTuple):
    """The prediction for one action, or for a batch of actions.

    Attributes:
        state: Next state `[F]` (or `[B, F]`); the state itself where not applicable.
        reward: Change of `(reward)` in the step; 0 where not applicable.
        unsafe: Whether the file as written made `(unsafe)` true in the step.
        terminal: Whether `(terminal)` became true or the problem's goal is reached.
        applicable: Whether the precondition holds and the step has a result.
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
    """Reward and flags of an observed transition, by the domain file."""

    reward: float
    unsafe: bool
    terminal: bool


UNKNOWN: Final = 0.5
"""Uncertainty from which on nothing is known of a step: the data say less than the prior."""


class TransitionModel(StateSpace):
    """A compiled domain: a pure function of state, action, parameters θ and control period Δt.

    A step is precondition, effects together, processes (explicit Euler over Δt), events, reward
    and flags. The fast step and the traced one give the same bits.

    Args:
        ground: The model.
        dt: Control period Δt > 0 in the time unit of the domain's rates (seconds by custom).
        theta: Parameters `[P]`; None: as written.

    Attributes:
        ground: The model.
        theta: θ, float64 `[P]`; the reward for reaching the goal follows from the other entries.
        dt: Control period.
        initial_state: `[F]` where the problem gives a value to every fluent, else None.
        revision: A number that changes whenever predictions may have changed noticeably.
    """

    revision: int = 0

    def __init__(
        self, ground: GroundModel, *, dt: float = 1.0, theta: ArrayLike | None = None
    ) -> None:
        super().__init__(ground)
        # Made when they are first used, and shared by all copies that `replace` makes.
        self._compiled = functools.cache(lambda: _core.Program(*instruction_table(ground)))
        self._traced = functools.cache(functools.partial(TracedStep, ground))
        valued = ground.goal_parameter is not None and ground.metric is not None
        self._goal_value = GoalValue(ground) if valued else None
        self.initial_state: Vector | None = None
        if ground.initial is not None:
            self.initial_state = np.array(ground.initial, dtype=np.float64)
            self.initial_state.flags.writeable = False
        self._set([p.value for p in ground.parameters] if theta is None else theta, dt)

    def _set(self, theta: ArrayLike, dt: float) -> None:
        vector = numbers(theta, "theta").copy()
        if vector.shape != (len(self.parameters),) or not np.isfinite(vector).all():
            raise StateError(f"theta must be {len(self.parameters)} finite numbers")
        if isinstance(dt, bool) or not isinstance(dt, Real) or not 0.0 < float(dt) < math.inf:
            raise StateError(f"the control period must be a positive number, not {dt!r}")
        if self._goal_value is not None:
            value = self._goal_value.value(vector.tolist(), float(dt))
            vector[self.ground.goal_parameter] = value
        vector.flags.writeable = False
        self.theta: Vector = vector
        self._core: _core.WrittenModel | None = None
        self.dt: float = float(dt)
        self._theta_list: list[float] = vector.tolist()

    def replace(
        self, *, theta: ArrayLike | None = None, dt: float | None = None
    ) -> TransitionModel:
        """Return the same model with other parameters or another control period.

        Nothing is recompiled.

        Raises:
            StateError: θ has the wrong length, or a value is not finite.
        """
        other = copy.copy(self)
        other._set(self.theta if theta is None else theta, self.dt if dt is None else dt)
        return other

    @property
    def as_written(self) -> bool:
        """Whether predictions are those of the file, with these parameters."""
        return True

    @property
    def rewarding(self) -> bool:
        """Whether the domain defines a reward: by effects on `(reward)`, a metric, or a goal."""
        ground = self.ground
        changed = any(e.target == REWARD_TARGET for s in ground.schemas for e in s.possible_effects)
        return changed or ground.metric is not None or ground.goal_rewarded

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
        states = numbers(state, "a state")
        if not np.isfinite(states).all():
            raise StateError("a state must not contain NaN or infinity")
        if states.ndim == 2:
            return self._step_batch(states, self.check_batch(states, action))
        self.check_shape(states)
        out, flags = self.transition(states.tolist(), self.action_index(action))
        if not flags & APPLICABLE:
            return Outcome(states.copy(), 0.0, False, False, False, 0.0)
        reward = out.pop()
        return Outcome(
            np.array(out), reward, bool(flags & UNSAFE), bool(flags & TERMINAL), True,
            risk_of(flags),
        )  # fmt: skip

    def transition(self, state: list[float], action: int) -> tuple[list[float], int]:
        """Predict one step on plain lists of F floats, for fast loops in Python.

        Action -1 is none, in a model that is not adapted. Returned are the next state and the
        reward (meaningless where not applicable), and the flags of `serp.model.flags`.
        """
        out, flags = self.core.step(np.array(state, dtype=np.float64), action)
        return out.tolist(), flags

    def at_goal(self, state: Vector) -> bool:
        """Return whether the problem's goal holds in a state `[F]`; False where there is none."""
        return self._traced().at_goal(state.tolist(), self._theta_list, self.dt)

    def _step_batch(self, states: Vector, actions: NDArray[np.int64]) -> Outcome:
        width = states.shape[1]
        table, flags = self.core.step_batch(states, actions)
        applicable = (flags & APPLICABLE) != 0
        return Outcome(
            state=np.where(applicable[:, None], table[:, :width], states),
            reward=np.where(applicable, table[:, width], 0.0),
            unsafe=applicable & ((flags & UNSAFE) != 0),
            terminal=(flags & TERMINAL) != 0,
            applicable=applicable,
            risk=np.where(applicable, risks_of(flags), 0.0),
        )

    def uncertainty(self, state: Vector) -> Vector:
        """Return how far the step of each action `[A]` is from the data, see `UNKNOWN`."""
        return np.zeros(len(self.actions))

    @property
    def core(self) -> _core.Model:
        """The compiled model, as planners take it."""
        return self.written_core()

    def written_core(self) -> _core.WrittenModel:
        """Return the compiled model as the file has it."""
        if self._core is None:
            self._core = _core.WrittenModel(self._compiled(), self.theta, self.dt)
        return self._core

    # Observed transitions ----------------------------------------------------------------------

    def judge(self, state: Vector, action: int, next_state: Vector) -> Judgement:
        """Return reward and flags of an observed transition, the paper's R(s').

        A transition to exactly the predicted state has the predicted reward and flags, so an event
        counts whose effects end its condition. For any other, the action's own rewards are
        evaluated in `state`; where its precondition does not hold there, it has no effects, while
        the world goes on. Processes and events are evaluated in the observed `next_state`, goal and
        metric in the same before any event. Action -1 is one that the model does not know.

        Raises:
            StateError: There is no such action, or the reward is not a finite number there, a
                condition has no truth value, or an event's effects contradict each other.
        """
        self.check_action(action, -1)
        out, flags = self.written_core().judge(state, action, next_state)
        if not flags & APPLICABLE:
            site = self.judged_passages(state, action, next_state)[-1].site
            raise StateError(
                f"an observed transition cannot be judged: {site.without_result}; "
                f"observed state: {self.values(next_state)}"
            )
        return Judgement(float(out[-1]), bool(flags & UNSAFE), bool(flags & TERMINAL))

    # Explanations ------------------------------------------------------------------------------

    @property
    def written(self) -> TransitionModel:
        """The model as the file has it, without anything learned."""
        return self

    def trace(self, state: ArrayLike, action: int) -> tuple[list[Site], int]:
        """Return the sites that a step passes, and its flags."""
        passages, flags = self.passages(state, action)
        return [passage.site for passage in passages], flags

    def passages(self, state: ArrayLike, action: int) -> tuple[list[Passage], int]:
        """Return which precondition failed, or what took part in a step, and its flags.

        Of an action with chance they are those of the likeliest outcome, or where there is a risk
        of the likeliest unsafe one.
        """
        values: list[float] = np.asarray(state, dtype=np.float64).tolist()
        chances = self.ground.actions[action].outcomes if action >= 0 else ()
        if not chances:
            _, flags, passages = self.traced(values, action)
            return passages, flags
        traces = [self.traced(values, action, outcome=k) for k in range(1 + len(chances))]
        flags = self.core.step(np.array(values), action)[1]
        told = next((t for t in traces if t.flags & UNSAFE and risk_of(flags)), traces[0])
        return told.passages, flags

    def traced(
        self,
        state: list[float],
        action: int,
        *,
        theta: list[float] | None = None,
        amend: Amendment | None = None,
        outcome: int = 0,
    ) -> Traced:
        """Return the step of an outcome of an action by the file, and what was passed, in order.

        `theta` are other parameters; `amend` changes the result before events are evaluated.
        """
        parameters = self._theta_list if theta is None else theta
        return self._traced().step(state, action, parameters, self.dt, amend, outcome)

    def judged_passages(self, state: Vector, action: int, next_state: Vector) -> list[Passage]:
        """Return what the judgement of a transition passes."""
        values, after = state.tolist(), next_state.tolist()
        outcome = self.written_core().outcome_of(state, action, next_state)
        traced = self._traced().judge(values, action, after, self._theta_list, self.dt, outcome)
        return traced.passages
