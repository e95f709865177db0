"""R-Max: what is unknown is worth the most, so that the shortest way leads to it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from serp._util.saved_state import Saved
from serp.agent.decision import Decision
from serp.agent.protocols import Mask, Proposer
from serp.agent.step_record import StepRecord
from serp.agent.strategy import Lesson, Seed, Situation
from serp.learning.dqn import Proposal
from serp.model.transition_model import Vector
from serp.settings import Settings
from serp_adapters.guides.shared import Planned

KNOWN: Final = 5
"""An action is known in a state after so many tries."""
_SWEEPS: Final = 1000
_CLOSE: Final = 1e-3
"""Values are settled when no sweep changes one by more than this share of the largest."""


class RMax(Planned):
    """A table of observed steps decides; unknown actions have the highest value in it (R-Max).

    Brafman and Tennenholtz 2002, "R-MAX - a general polynomial time algorithm for near-optimal
    reinforcement learning", JMLR 3. States are told apart by their fluents, exactly, so that the
    method is one for finite tasks. The largest reward is not known beforehand: the largest one seen
    stands for it, 1 before one is positive. Among unknown actions the original draws; here the
    planner's choice comes first, and where a state is unknown the trained policy follows the
    planner. The learner learns beside it, and is not asked.
    """

    def __init__(self, settings: Settings, seed: Seed = 0) -> None:
        super().__init__(settings, seed)
        self._numbers: dict[bytes, int] = {}
        self._states: list[Vector] = []
        self._open: list[bool] = []
        """State → whether an action is unknown there that was admissible at the last visit."""
        self._rows: dict[tuple[int, int, int], list[float]] = {}
        """(state, action, next state; -1: the end) → number of times, sum of the rewards."""
        self._tries: dict[tuple[int, int], int] = {}
        """(state, action) → number of times."""
        self._largest = 0.0
        self._q: dict[tuple[int, int], float] | None = None
        """Values of known actions; None: to be computed."""

    @property
    def choice(self) -> str:
        """In words: what `propose_greedily` returns."""
        return "the table's best known action, or the planner's where the state is unknown"

    def propose(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return an unknown action if there is one, the planner's before others; else the best."""
        unknown = self._unknown_in(situation)
        if not unknown.any():
            return self._best(situation)
        choice = situation.forecast.choice
        return None if unknown[choice] else Proposal(int(unknown.argmax()), True)

    def propose_greedily(self, situation: Situation, learner: Proposer) -> Proposal | None:
        """Return the best action where all are known, else None."""
        return None if self._unknown_in(situation).any() else self._best(situation)

    def lesson(self, step: StepRecord, following: Decision | None) -> Lesson:
        """Add the step to the table."""
        state, action = self._number(step.state), step.decision.action
        after = -1 if step.terminated else self._number(step.next_state)
        row = self._rows.setdefault((state, action, after), [0, 0.0])
        row[0] += 1
        row[1] += step.reward
        tries = self._tries[state, action] = self._tries.get((state, action), 0) + 1
        self._open[state] = bool(self._unknown(state, step.decision.admissible).any())
        if tries == KNOWN or step.reward > self._largest:
            self._q = None
        self._largest = max(self._largest, step.reward)
        return super().lesson(step, following)

    def _number(self, state: Vector) -> int:
        number = self._numbers.setdefault(state.tobytes(), len(self._states))
        if number == len(self._states):
            self._states.append(state)
            self._open.append(True)
        return number

    def _unknown(self, number: int, admissible: Mask) -> Mask:
        """Return `[E]` the admissible actions that were tried too rarely in a state."""
        tries = [self._tries.get((number, action), 0) for action in range(len(admissible))]
        return admissible & (np.array(tries) < KNOWN)

    def _unknown_in(self, situation: Situation) -> Mask:
        number = self._numbers.get(situation.state.tobytes(), -1)
        return self._unknown(number, situation.admissible)

    def _best(self, situation: Situation) -> Proposal | None:
        if not situation.admissible.any():
            return None
        if self._q is None:
            self._q = self._solve()
        number, q = self._numbers[situation.state.tobytes()], self._q
        actions = np.flatnonzero(situation.admissible).tolist()
        return Proposal(max(actions, key=lambda action: q[number, action]), False)

    def _solve(self) -> dict[tuple[int, int], float]:
        """Return the value of each known action by value iteration in the table."""
        gamma = self._settings.planner.discount
        known = [pair for pair, tries in self._tries.items() if tries >= KNOWN]
        place = {pair: k for k, pair in enumerate(known)}
        rows = [(place[s, a], after, *row) for (s, a, after), row in self._rows.items()
                if (s, a) in place]  # fmt: skip
        pair, after, times, sums = (np.array(column) for column in zip(*rows, strict=True))
        tries = np.bincount(pair, times)
        reward, share = np.bincount(pair, sums) / tries, times / tries[pair]
        state = np.array([s for s, _ in known])
        unknown = np.array([*self._open, False])
        most = (self._largest or 1.0) / (1.0 - gamma)
        value = np.where(unknown, most, 0.0)  # the last one is the end, worth 0
        floor = value.copy()
        floor[state[~unknown[state]]] = -np.inf
        for _ in range(_SWEEPS):
            q = reward + gamma * np.bincount(pair, share * value[after])
            new = floor.copy()
            np.maximum.at(new, state, np.minimum(q, most))
            moved, value = np.abs(new - value).max(), new
            if moved <= _CLOSE * abs(most):
                break
        return dict(zip(known, q.tolist(), strict=True))

    def state_dict(self) -> dict[str, Any]:
        """Return JSON values that `load_state_dict` restores exactly."""
        keys, rows = list(self._rows), list(self._rows.values())
        return {
            "count": len(self._states),
            "width": len(self._states[0]) if self._states else 0,
            "values": [value for state in self._states for value in state.tolist()],
            "open": list(self._open),
            "rows": len(rows),
            **{name: [key[k] for key in keys] for k, name in enumerate(("of", "action", "after"))},
            "times": [int(times) for times, _ in rows],
            "rewards": [float(rewards) for _, rewards in rows],
            "largest": self._largest,
        }

    def load_state_dict(self, meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned, or raise a RunError if it is damaged."""
        saved = Saved(type(self).__name__, {}, meta)
        count, width, rows = saved.whole("count"), saved.whole("width"), saved.whole("rows")
        values, open_ = saved.reals("values", count * width), saved.truths("open", count)
        keys = zip(
            saved.wholes("of", rows, 0, count - 1),
            saved.wholes("action", rows),
            saved.wholes("after", rows, -1, count - 1),
            strict=True,
        )
        times = saved.wholes("times", rows, 1)
        sums = zip(times, saved.reals("rewards", rows), strict=True)
        largest = saved.real("largest", 0.0)
        states = list(np.array(values).reshape(count, width))
        numbers = {state.tobytes(): number for number, state in enumerate(states)}
        table = {key: [*row] for key, row in zip(keys, sums, strict=True)}
        if len(numbers) < count or len(table) < rows:
            raise saved.wrong("a state or a transition occurs twice")
        self._numbers, self._states, self._open = numbers, states, open_
        self._rows, self._largest, self._q = table, largest, None
        self._tries = {}
        for (state, action, _), tries in zip(table, times, strict=True):
            self._tries[state, action] = self._tries.get((state, action), 0) + tries
