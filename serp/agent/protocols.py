"""The protocols of planners and learners, which are found by name through entry points.

`serp.planners` holds functions of `MakePlanner`, `serp.learners` functions of `MakeLearner`,
`serp.strategies` classes derived from `serp.agent.strategy.Strategy`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from serp.errors import SettingsError
from serp.learning.dqn import Proposal
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.forecast import Forecast
from serp.settings import LearnerSettings, PlannerSettings

Mask = NDArray[np.bool_]
Values = NDArray[np.float32]


@runtime_checkable
class Stateful(Protocol):
    """What has a state that is saved in a checkpoint."""

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned."""


class Planner(Protocol):
    """A planner forecasts the consequences of each ground action; `serp.Lookahead` is one.

    A function that takes a `serp.TransitionModel` and the `planner` section of the settings, and
    returns a planner, is found by name through the entry-point group `serp.planners`. A forecast
    depends on nothing but the state, the model, what a `Stateful` planner saves and `visited`.

    A planner may have an attribute `visited`, which is set to the visited states, a
    `serp.model.learned.transitions.TransitionMemory`; a method `begin_episode()`, called where an
    episode begins, perhaps in another world; a method `prefetch(states)`, which returns a context
    in whose body the forecasts for these states are at hand; and a method `check_safety(state)`, a
    faster forecast for where the learner leads, see `Lookahead.check_safety`.
    """

    def forecast(self, state: Vector) -> Forecast:
        """Return the predictions for every ground action in a state `[F]`."""


@contextmanager
def undisturbed(planner: Planner) -> Iterator[None]:
    """Restore, at the end, what a planner kept from one decision to the next."""
    if not isinstance(planner, Stateful):
        yield
        return
    state = planner.state_dict()
    try:
        yield
    finally:
        planner.load_state_dict(*state)


MakePlanner = Callable[[TransitionModel, PlannerSettings], Planner]


class Proposer(Protocol):
    """A learner with an input, in the form that strategies use."""

    def propose(self, explorable: Mask | None) -> Proposal:
        """Propose an action; explore among `explorable` `[E]`, None for all."""

    def propose_greedily(self) -> Proposal:
        """Propose the action with the largest value."""

    def values(self) -> Values:
        """Return the values of the actions `[M, E]`: a row for each network of an ensemble."""


class Learner(Stateful, Protocol):
    """A learner of the values of E environment actions; `serp.learning.dqn.DQN` is one.

    A function that makes one is found by name through the entry-point group `serp.learners`; it
    takes the arguments of `serp.learning.dqn.DQN`. It may have a method `values(x)`, which returns
    the values of the actions `[M, E]` for an input `[F]`, a row for each network of an ensemble;
    strategies that compare values need it.

    Attributes:
        input_size: Length of an input, F.
        action_count: Number of environment actions, E.
        settings: The settings.
        imitates: Whether it can imitate the planner.
        imitation_weight: Weight of the imitation loss in the next updates.
        env_index: Environment, from 0, that the next env steps to remember come from. Those of one
            environment are consecutive.
    """

    input_size: int
    action_count: int
    settings: LearnerSettings
    imitates: bool
    imitation_weight: float
    env_index: int

    @property
    def epsilon(self) -> float:
        """The probability that the next proposal explores."""

    def propose(self, x: Vector, explorable: Mask | None) -> Proposal:
        """Propose an action for an input `[F]`, with exploration; see `Proposer.propose`."""

    def propose_greedily(self, x: Vector) -> Proposal:
        """Propose the action with the largest value for an input `[F]`."""

    def remember(
        self,
        observation: Vector,
        action: int,
        reward: float,
        next_observation: Vector,
        terminated: bool,
        truncated: bool,
        imitated: int = -1,
        allowed: Mask | None = None,
    ) -> None:
        """Store an env step in the replay memory.

        Observations are inputs `[F]`; `action` is the executed environment action. `imitated` is
        the planner's action, to be imitated; -1: none. `allowed` `[E]` are the actions that may be
        executed after the step; None: all.
        """

    def learn(self) -> float | None:
        """Make the updates of one env step; return their mean loss, None for none."""

    def pretrain(self, updates: int) -> float | None:
        """Make gradient updates on the initial data D₀; return their mean loss, None for none."""


MakeLearner = Callable[..., Learner]  # with the arguments of `DQN`; equal seeds give equal bits


class LearnerProposer:
    """The proposals of a learner for one input `[F]`."""

    def __init__(self, learner: Learner, x: Vector) -> None:
        self._learner = learner
        self._x = x

    def propose(self, explorable: Mask | None) -> Proposal:
        """Propose an action, with exploration."""
        return self._learner.propose(self._x, explorable)

    def propose_greedily(self) -> Proposal:
        """Propose the action with the largest value."""
        return self._learner.propose_greedily(self._x)

    def values(self) -> Values:
        """Return the values of the actions `[M, E]`, or raise a SettingsError if it has none."""
        if not hasattr(self._learner, "values"):
            raise SettingsError(
                f"guide.strategy: this strategy compares the learner's values, but "
                f"{self._learner!r} has no method `values(x)`; add one, or choose another strategy"
            )
        values: Values = self._learner.values(self._x)
        return values
