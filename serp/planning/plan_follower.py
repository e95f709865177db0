"""Monitor-replanning for planners that return whole plans: a plan is kept while it holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import MOST, Arrays, Saved, nested
from serp.errors import TaskError
from serp.model.flags import APPLICABLE, TERMINAL, risk_of
from serp.model.learned.transitions import TransitionMemory
from serp.model.state_space import StateError
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.far_sight import FarSightPlanner
from serp.planning.forecast import Forecast, advised
from serp.planning.lookahead import Lookahead, near_lookahead
from serp.settings import PlannerSettings

Advise = Callable[[Mapping[str, float | bool]], Any]
"""Fluent → value, and returned: the name or position of a ground action, None for no advice."""


class AdvisedPlanner:
    """Follows advice where the lookahead predicts no more risk of it than of other actions.

    A `TaskError` says that the function of the fluents' values fails or names no ground action.
    """

    def __init__(self, model: TransitionModel, settings: PlannerSettings, advise: Advise) -> None:
        self.model = model
        self._near = Lookahead(model, settings)
        self._advise, self._name = advise, settings.name

    def forecast(self, state: Vector) -> Forecast:
        """Return the forecast for a state `[F]`."""
        try:
            action = self._advise(self.model.values(state))
        except Exception as error:
            raise TaskError(f"planner `{self._name}`: {type(error).__name__}: {error}") from error
        try:
            position = -1 if action is None else self.model.action_index(action)
        except StateError as error:
            raise TaskError(f"planner `{self._name}` advises {action!r}: {error}") from None
        return advised(self._near.forecast(state), position)


MOST_NUMBERS: Final = 10_000_000
"""Most numbers in all predicted states that are kept: 80 MB."""
FindPlan = Callable[[Vector], Sequence[int] | None]
"""State `[F]` → positions of the ground actions of a plan to the goal; None where none is found."""


class PlanFollower:
    """Follows a plan to the goal, and asks for another one where it does not hold any more.

    Nothing is believed unchecked. A plan is followed only if, by the model, each of its actions is
    applicable and of accepted risk, none before the last ends the task, and the goal holds at its
    end (in a problem without one: the last action ends the task with a reward). While the observed
    state is one of those that were predicted, the plan goes on from there, so an action that failed
    is repeated. Of several plans through a state the newest is followed, so that they never lead in
    a circle. In any other state the shortest rest of the newest plan that leads to the goal is
    followed (the triangle tables of Fikes, Hart & Nilsson, 1972). Without a plan the planner
    `far-sight` decides, and the next plan is asked for after twice as many decisions as before.

    While a plan is followed a lookahead says what is unsafe ahead. It follows few edges, because a
    symbolic domain has thousands of actions; where these are spent by one layer, it is one step.

    Attributes:
        searches: How often a plan was asked for.
    """

    def __init__(
        self, model: TransitionModel, settings: PlannerSettings, find_plan: FindPlan
    ) -> None:
        self.model = model
        self.searches = 0
        self._accepted = settings.accepted_risk
        self._find_plan = find_plan
        self._near = near_lookahead(model, settings)
        self._fallback = FarSightPlanner(model, settings)
        self._plan: list[int] = []
        self._actions: dict[bytes, tuple[int, float]] = {}
        """State that was predicted → the action that a plan takes in it, and the plan's return."""
        self._discount = settings.discount
        self._most = MOST_NUMBERS // max(1, len(model.fluents))
        self._revision = model.revision
        self._wait = self._patience = 0

    @property
    def visited(self) -> TransitionMemory | None:
        """The visited states, which the planner `far-sight` uses."""
        return self._fallback.visited

    @visited.setter
    def visited(self, visited: TransitionMemory | None) -> None:
        self._fallback.visited = visited

    def begin_episode(self) -> None:
        """Say that another episode begins, in which a plan is asked for at once."""
        self._wait = self._patience = 0
        self._fallback.begin_episode()

    @property
    def plan(self) -> tuple[int, ...]:
        """Positions of the ground actions of the newest plan; empty for none."""
        return tuple(self._plan)

    def forecast(self, state: Vector) -> Forecast:
        """Return the forecast for a state `[F]`."""
        found = self._next(state)
        if found is None:
            return self._fallback.forecast(state)
        return advised(self._near.forecast(state), *found)

    def _next(self, state: Vector) -> tuple[int, float] | None:
        """Return the action that a plan takes in a state, and its return; None for no plan."""
        if self.model.at_goal(state):
            return None
        if self.model.revision != self._revision:
            self._revision = self.model.revision
            self._actions = {}  # the states were predicted by the model as it was
        key = state.tobytes()
        if key not in self._actions and not self._resume(state) and not self._replan(state):
            return None
        return self._actions[key]

    def _resume(self, state: Vector) -> bool:
        """Follow the shortest rest of the plan that leads from a state to the goal, if any does."""
        length = len(self._plan)
        return any(self._follow(state, self._plan[k:]) for k in range(length - 1, -1, -1))

    def _replan(self, state: Vector) -> bool:
        """Ask for a plan, unless that failed not long ago; return whether one is followed."""
        if self._wait > 0:
            self._wait -= 1
            return False
        self.searches += 1
        found = self._find_plan(state)
        if found is not None and self._follow(state, found):
            self._patience = 0
            return True
        self._patience = min(2 * self._patience + 1, MOST)
        self._wait = self._patience
        return False

    def _follow(self, state: Vector, plan: Sequence[int]) -> bool:
        """Follow a plan from a state, if it holds there by the model; return whether it does."""
        model, now = self.model, state.tolist()
        states: list[bytes] = []
        rewards: list[float] = []
        success = False
        for action in plan:
            states.append(np.array(now).tobytes())
            out, flags = model.transition(now, action)
            if not flags & APPLICABLE or risk_of(flags) > self._accepted:
                return False
            now = out[:-1]
            rewards.append(out[-1])
            if flags & TERMINAL and len(states) < len(plan):
                return False
            success = model.ground.goal is None and flags & TERMINAL != 0 and out[-1] > 0.0
        if not states or not (success or model.at_goal(np.array(now))):
            return False
        if len(self._actions) + len(plan) > self._most:
            self._actions = {}
        self._plan = list(plan)
        worth = [0.0]
        for reward in reversed(rewards):
            worth.append(reward + self._discount * worth[-1])
        # Of a state that the plan passes twice, the later entry counts: it leads out of the circle.
        self._actions.update(zip(states, zip(self._plan, worth[:0:-1], strict=True), strict=True))
        return True

    # State -------------------------------------------------------------------------------------

    def state_dict(self) -> tuple[Arrays, dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        width = len(self.model.fluents)
        states = np.frombuffer(b"".join(self._actions)).reshape(len(self._actions), width)
        arrays: Arrays = {
            "plan": np.array(self._plan, dtype=np.int64),
            "states": states.copy(),
            "actions": np.array([a for a, _ in self._actions.values()], dtype=np.int64),
            "worth": np.array([worth for _, worth in self._actions.values()]),
        }
        meta: dict[str, Any] = {
            "searches": self.searches, "wait": self._wait, "patience": self._patience,
            "revision": self._revision,
        }  # fmt: skip
        below, meta["fallback"] = self._fallback.state_dict()
        return arrays | nested("fallback", below), meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: It is damaged.
        """
        saved = Saved("planner", arrays, meta)
        last = len(self.model.actions) - 1
        self._plan = saved.array("plan", np.int64, (-1,), 0, last).tolist()
        actions = saved.array("actions", np.int64, (-1,), 0, last)
        states = saved.array("states", np.float64, (len(actions), len(self.model.fluents)))
        worth = saved.array("worth", np.float64, (len(actions),))
        found = zip(actions.tolist(), worth.tolist(), strict=True)
        self._actions = dict(zip((state.tobytes() for state in states), found, strict=True))
        self.searches, self._wait = saved.whole("searches"), saved.whole("wait")
        self._patience, self._revision = saved.whole("patience"), saved.whole("revision")
        self._fallback.load_state_dict(*saved.part("fallback"))
