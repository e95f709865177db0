"""One step of the transition model: that of the file, or the adapted one.

The arithmetic is that of serp's compiled step, operation by operation, so that both give the same
bits. A state is a list of F floats.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .adaptation import Adaptation
from .outcomes import CountedOutcomes
from .program import Parameters, make_function
from .reading import Entry

APPLICABLE, UNSAFE, TERMINAL, UNDEFINED, RISKY = 1, 2, 4, 8, 16
RISK_SHIFT, RISK_UNIT = 8, 2.0**-24
"""Flags of a step; above them its risk, in units of 2⁻²⁴."""

State = list[float]


class FileStep:
    """The step of the domain file with some parameters.

    Args:
        policy: The policy.
        theta: Parameters.
        residual: `[A]` statements that are added to effects and processes; None for none.
    """

    def __init__(
        self, policy: Entry, theta: Sequence[float],
        residual: Sequence[list[Any] | None] | None = None,
    ) -> None:  # fmt: skip
        parameters, programs = Parameters(policy, theta), policy["programs"]
        actions = programs["actions"].items(len(policy["ground_actions"].items()))
        more = residual or [None] * len(actions)
        self._flow = [
            make_function(
                ["s"], [body, programs["drift"], *([Entry(added)] if added else [])], parameters
            )
            for body, added in zip(actions, more, strict=True)
        ]
        self._settle = make_function(["s", "flags", "out"], [programs["settle"]], parameters)

    def flow(self, state: State, action: int) -> tuple[State, int]:
        """Return the state after effects and processes with the reward, and the flags."""
        found: tuple[State, int] = self._flow[action](state)
        return found

    def settle(self, state: State, flags: int, out: State) -> tuple[State, int]:
        """Return the state after events, goal and metric with the reward, and the flags."""
        found: tuple[State, int] = self._settle(state, flags, out)
        return found

    def step(self, state: State, action: int) -> tuple[State, int]:
        """Return the next state with the reward, and the flags."""
        out, flags = self._flow[action](state)
        found: tuple[State, int]
        found = self._settle(state, flags, out) if flags & APPLICABLE else (out, flags)
        return found


class AdaptedStep:
    """The step of the file with revised parameters, a residual and counted outcomes.

    `UNSAFE` is set only where the file as written sets it; everything else is a risk.
    """

    def __init__(self, policy: Entry, learned: Adaptation, written: FileStep) -> None:
        self._written = written
        self._file = plain = FileStep(policy, learned.theta, learned.written_out)
        if any(learned.written_out):  # an outcome with another action's effects has no residual
            plain = FileStep(policy, learned.theta)
        self._known = learned.revised or learned.flagging
        self._residual, self._counted = learned.residual, learned.counted
        self._outcomes = CountedOutcomes(learned, plain)
        self._differs = [learned.changes(action) for action in range(len(learned.groups))]

    def step(self, state: State, action: int) -> tuple[State, int]:
        """Return the next state with the reward, and the flags with the risk."""
        if not self._differs[action]:
            return self._written.step(state, action)
        flagged = UNSAFE & self._written.step(state, action)[1] if self._known else 0
        out, flags = self.flow(state, action)
        risk = 0.0
        if flags & APPLICABLE:
            if self._counted[action]:
                out, flags, risk = self._outcomes.settle(state, action, flags, out)
            else:
                out, flags = self._file.settle(state, flags, out)
                risk = 1.0 if flags & UNSAFE else 0.0
        if not self._known:
            flagged = flags & UNSAFE
        flags = flags & ~UNSAFE | flagged
        if flags & APPLICABLE and not flagged:
            flags |= int(risk / RISK_UNIT + 0.5) << RISK_SHIFT
        return out, flags

    def flow(self, state: State, action: int) -> tuple[State, int]:
        """Return the state after effects, processes and residual, and the flags."""
        out, flags = self._file.flow(state, action)
        residual = self._residual[action]
        if flags & APPLICABLE and residual:
            before = out[:]
            for inputs, targets, regression, head, _, _ in residual:
                if regression is not None:
                    regression.add(inputs, targets, head, state, out)
            difference = 0.0
            for value in out[:-1]:
                difference += value - value
            if difference != 0.0:  # not finite: without the residual
                out = before
        return out, flags
