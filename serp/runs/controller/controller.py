"""The controller: a state and an observation in, the trained policy's action and its reason out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .adaptation import Adaptation
from .folder import Contents, ControllerError, read_folder
from .forecast import SAFE, EnvironmentActions, Prospects
from .lookahead import LeafValues, PathSearch, SearchLimits
from .network import Network
from .planner import FrozenPlanner
from .reading import Arrays, Entry
from .rows.lookahead import LayerSearch
from .rows.step import AdaptedRows, FileRows
from .step import APPLICABLE, RISKY, UNDEFINED, UNSAFE, AdaptedStep, FileStep, State

_SMALL_TREE = 300
"""Steps of the model in a lookahead up to which one state after the other takes less time."""
_WIDEST = 8
"""States in a layer of a larger one up to which it does."""
_DEEPEST = 200
"""Deepest lookahead that is searched depth first, by recursion."""

Grounding = Callable[[NDArray[np.float64]], "ArrayLike | Mapping[str, float]"]


class ControllerDecision(NamedTuple):
    """A decision.

    Attributes:
        action: Number of the environment action, from 0.
        name: Its name in the domain file.
        reason: Why it is executed, in the words of a run's `decisions.csv`.
        executed_by: `learner`, `planner`, or `fallback` where neither has a safe action.
        proposed: The proposed action; -1 if the planner had none.
        proposed_by: `learner` or `planner`.
        vetoed: Whether the learner's proposal was refused.
        outside: Whether the policy has solved states, and this is none of them, so that only the
            steps of the lookahead were seen.
    """

    action: int
    name: str
    reason: str
    executed_by: str
    proposed: int
    proposed_by: str
    vetoed: bool
    outside: bool = False


class Controller:
    """A policy that `serp export` wrote.

    Args:
        folder: The exported folder.
        ground: A function from an observation `[O]` to its state: numbers in the order of
            `fluents`, or a mapping from their names. Without it, `decide` needs the state.

    Attributes:
        fluents: Names of the numbers in a state, in order.
        actions: `[E]` names of the environment's actions.
        manifest: What the folder says of the policy, see its `manifest.json`.

    Raises:
        ControllerError: The folder is not one that `serp export` wrote, or it was changed.
    """

    def __init__(self, folder: str | Path, ground: Grounding | None = None) -> None:
        contents = read_folder(folder)
        self.manifest = contents.manifest
        self._ground = ground
        try:
            self._load(contents)
        except ControllerError as error:
            raise ControllerError(f"{contents.path}: {error}") from None

    def _load(self, contents: Contents) -> None:
        policy, arrays = Entry(contents.policy), Arrays(contents.arrays)
        self.fluents = [name.text() for name in policy["fluents"].items()]
        width = len(self.fluents)
        learner, arbiter = policy["learner"], policy["arbiter"]
        self._inputs = learner["inputs"].text()
        self._observation_size = learner["observation"].whole(0)
        observed = arrays.numbers("grounding.observation", None, self._observation_size)
        self._pairs = observed, arrays.numbers("grounding.state", len(observed), width)
        ground_actions = len(policy["ground_actions"].items())
        limits = SearchLimits.of(policy["planner"], ground_actions)
        theta: list[float] = arrays.numbers("written", None).tolist()
        written, rows = FileStep(policy, theta), FileRows(policy, theta)
        single, whole = PathSearch(limits, written.step), LayerSearch(limits, rows.step)
        if not policy["adaptation"].none:
            learned = Adaptation(policy["adaptation"], arrays, width, ground_actions)
            single = PathSearch(limits, AdaptedStep(policy, learned, written).step)
            whole = LayerSearch(limits, AdaptedRows(policy, learned, rows).step)
        widest = None if limits.tree <= _SMALL_TREE else _WIDEST

        def search(state: State, leaves: LeafValues | None) -> Prospects:
            return single.forecast(state, leaves, widest) or whole.forecast(state, leaves)

        actions = EnvironmentActions(policy["actions"], ground_actions)
        self.actions, self._actions = actions.names, actions
        self._learner_leads = arbiter["learner_leads"].truth()
        self._planner = FrozenPlanner(
            policy["planner"], arrays, search, limits, width, actions,
            learns=not self._learner_leads,
        )  # fmt: skip
        self._quick: PathSearch | None = None
        if actions.one_to_one and limits.unbounded and limits.depth <= _DEEPEST:
            self._quick = single
        r_min = arbiter["r_min"]
        self._r_min = -math.inf if r_min.none else r_min.number()
        self._looks_ahead = arbiter["looks_ahead"].truth()
        allowed = arbiter["allows_unmodelled"].truth()
        self._available = [not known and allowed for known in actions.modelled]
        seen = {"observation": self._observation_size, "state": width}
        seen["both"] = sum(seen.values())
        if self._inputs not in seen:
            raise learner["inputs"].wrong(f"it must be one of {', '.join(seen)}")
        size = seen[self._inputs]
        learner["input"].whole(size, size)
        self._network = Network(contents.network, size, len(actions.names))

    # Deciding ----------------------------------------------------------------------------------

    def decide(
        self, observation: ArrayLike | None = None, *, state: ArrayLike | None = None
    ) -> ControllerDecision:
        """Decide as the trained policy does.

        Args:
            observation: `[O]`, flat; needed where the learner sees it, or to ground it.
            state: `[F]` in the order of `fluents`; without it, `ground` computes it.

        Raises:
            ControllerError: One of them is missing, or has another shape, or is not finite.
        """
        seen = None
        if observation is not None:
            seen = self._vector(observation, self._observation_size, "an observation")
        if state is None:
            if self._ground is None or seen is None:
                raise ControllerError(
                    "give `state=`, or an observation and Controller(folder, ground=function)"
                )
            state = self._grounded(self._ground, seen)
        grounded = self._vector(state, len(self.fluents), "a state")
        values: State = grounded.tolist()
        found = self._planner.solved(values)
        decision = self._decided(seen, grounded, values, found)
        outside = found is None and self._planner.has_solved
        return decision._replace(outside=True) if outside else decision

    def _decided(
        self, seen: NDArray[np.float64] | None, grounded: NDArray[np.float64], values: State,
        found: Prospects | None,
    ) -> ControllerDecision:  # fmt: skip
        proposal = -1
        if self._learner_leads:
            proposal = self._network.best(self._input(seen, grounded))
            quick = self._quick if found is None else None
            if quick is not None and self._admits(values, proposal, quick):
                return self._made(proposal, "proposal accepted", "learner", proposal, "learner")
        if found is None:
            found = self._planner.forecast(values)
        if not self._learner_leads and found.indifferent:
            proposal = self._network.best(self._input(seen, grounded))
        return self._follow(found, proposal)

    def _input(
        self, observation: NDArray[np.float64] | None, state: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        if self._inputs == "state":
            return state
        if observation is None:
            raise ControllerError(
                f"the learner sees the observation: give its {self._observation_size} numbers"
            )
        return (
            observation if self._inputs == "observation" else np.concatenate((observation, state))
        )

    def _admits(self, state: State, action: int, search: PathSearch) -> bool:
        """Return whether a proposal is certainly admissible, without a plan for every action."""
        ground = self._actions.first[action]
        if ground < 0:
            return self._available[action]
        edge = search.edge(state, ground)
        if edge.flags & (APPLICABLE | UNSAFE | RISKY) != APPLICABLE:
            return False
        if edge.reward < self._r_min:
            return False
        return not self._looks_ahead or search.stays_safe(edge)

    def _follow(self, of: Prospects, proposal: int) -> ControllerDecision:
        """Execute a proposal unless it is refused; -1: it is the planner's turn."""
        if proposal < 0:
            return self._planner_acts(of, of.choice, "planner", "planner's turn")
        refusal = self._why_refused(of, proposal)
        if not refusal:
            return self._made(proposal, "proposal accepted", "learner", proposal, "learner")
        return self._planner_acts(of, proposal, "learner", refusal)

    def _why_refused(self, of: Prospects, action: int) -> str:
        """Return why an action is refused; empty if it is not."""
        if not self._actions.modelled[action]:
            return "" if self._available[action] else "proposal unknown to the model"
        flags = of.flags[action]
        if flags & UNSAFE:
            return "proposal predicted unsafe"
        if flags & RISKY:
            return "proposal predicted too risky"
        if flags & UNDEFINED:
            return "proposal has no defined result"
        if not flags & APPLICABLE:
            return "proposal not applicable"
        if of.reward[action] < self._r_min:
            return "proposal predicted below R_min"
        if self._looks_ahead and of.safe_steps[action] != SAFE:
            known = zip(of.safe_steps, self._actions.modelled, strict=True)
            if any(steps == SAFE for steps, modelled in known if modelled):
                return "proposal predicted to make an unsafe step unavoidable"
        return ""

    def _planner_acts(
        self, of: Prospects, proposed: int, proposed_by: str, reason: str
    ) -> ControllerDecision:
        action, executed_by = of.choice, "planner"
        flags = of.flags[action] if action >= 0 else 0
        if flags & UNSAFE:
            reason = "every action is predicted unsafe"
        elif flags & RISKY:
            reason = "every action is predicted too risky"
        elif action < 0:
            reason = "no action of the model is applicable"
        if action < 0 or flags & UNSAFE or flags >> 8 == 1 << 24:
            instead = self._fallback(of, proposed, action)
            if instead != action:
                action, executed_by = instead, "fallback"
        return self._made(action, reason, executed_by, proposed, proposed_by)

    def _fallback(self, of: Prospects, proposed: int, otherwise: int) -> int:
        """Return the action to execute when the planner's choice is certain to do damage, or -1."""
        kinds = [
            self._available,
            [flags & (UNDEFINED | UNSAFE) == UNDEFINED for flags in of.flags],
        ]
        if otherwise < 0:
            modelled = self._actions.modelled
            kinds.append([f == 0 and m for f, m in zip(of.flags, modelled, strict=True)])
        for kind in kinds:
            if any(kind):
                return proposed if proposed >= 0 and kind[proposed] else kind.index(True)
        return otherwise if otherwise >= 0 else max(proposed, 0)

    def _made(
        self, action: int, reason: str, executed_by: str, proposed: int, proposed_by: str
    ) -> ControllerDecision:
        vetoed = proposed_by == "learner" and reason != "proposal accepted"
        name = self.actions[action]
        return ControllerDecision(action, name, reason, executed_by, proposed, proposed_by, vetoed)

    # Inputs ------------------------------------------------------------------------------------

    def check_grounding(self, ground: Grounding, tolerance: float = 1e-6) -> int:
        """Compare a grounding with recorded pairs of observation and state.

        Args:
            ground: As in `Controller`.
            tolerance: Largest difference of a number, absolute and relative.

        Returns:
            The number of pairs.

        Raises:
            ControllerError: It gives another state; the message names the first fluent.
        """
        for k, (observation, state) in enumerate(zip(*self._pairs, strict=True)):
            found = self._grounded(ground, observation.copy())
            wrong = ~np.isclose(found, state, rtol=tolerance, atol=tolerance)
            if wrong.any():
                first = int(wrong.argmax())
                raise ControllerError(
                    f"the grounding differs in recorded pair {k}: `{self.fluents[first]}` is "
                    f"{found[first]:g}, and serp recorded {state[first]:g}, for the observation "
                    f"{observation.tolist()}"
                )
        return len(self._pairs[0])

    def _grounded(self, ground: Grounding, observation: NDArray[np.float64]) -> NDArray[np.float64]:
        found: Any = ground(observation)
        if isinstance(found, Mapping):
            if set(found) != set(self.fluents):
                odd = sorted(set(found) ^ set(self.fluents))
                raise ControllerError(f"the grounding must give every fluent, and no other: {odd}")
            found = [found[name] for name in self.fluents]
        return self._vector(found, len(self.fluents), "a grounded state")

    @staticmethod
    def _vector(values: ArrayLike | Sequence[float], size: int, what: str) -> NDArray[np.float64]:
        try:
            vector = np.asarray(values, dtype=np.float64)
        except (TypeError, ValueError):
            raise ControllerError(f"{what} has {size} numbers, not {values!r}") from None
        if vector.shape != (size,):
            raise ControllerError(f"{what} has {size} numbers, not shape {vector.shape}")
        if not np.isfinite(vector).all():
            raise ControllerError(f"{what} must not contain NaN or infinity: {vector.tolist()}")
        return vector
