"""One step of the transition model: that of the file, or the adapted one.

The arithmetic is that of serp's compiled step, operation by operation, so that both give the same
bits. A state is a list of F floats.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .folder import Contents, ControllerError
from .outcomes import CountedOutcomes
from .program import Function, make_function
from .residual import Residual

APPLICABLE, UNSAFE, TERMINAL, UNDEFINED, RISKY = 1, 2, 4, 8, 16
RISK_SHIFT, RISK_UNIT = 8, 2.0**-24
"""Flags of a step; above them its risk, in units of 2⁻²⁴."""

State = list[float]


class FileStep:
    """The step of the domain file with some parameters.

    Attributes:
        theta: Parameters.
        dt: Control period.
    """

    def __init__(self, contents: Contents, theta: Sequence[float]) -> None:
        policy = contents.policy
        width, self.theta, self.dt = len(policy["fluents"]), list(theta), float(policy["dt"])
        sizes = {"s": width, "out": width + 1, "theta": len(self.theta)}
        programs = policy["programs"]
        if len(programs["actions"]) != len(policy["ground_actions"]):
            raise ControllerError("the model of the policy is damaged: it lacks actions")
        self._actions = [
            make_function(("s", "theta", "dt", "out"), body, sizes) for body in programs["actions"]
        ]
        later = ("s", "flags", "theta", "dt", "out")
        self._drift = make_function(later, programs["drift"], sizes)
        self._settle: Function = make_function(later, programs["settle"], sizes)

    def flow(self, state: State, action: int) -> tuple[State, int]:
        """Return the state after effects and processes with the reward, and the flags."""
        out = [*state, 0.0]
        flags = self._actions[action](state, self.theta, self.dt, out)
        if flags & APPLICABLE:
            flags = self._drift(state, flags, self.theta, self.dt, out)
        return out, flags

    def settle(self, state: State, flags: int, out: State) -> int:
        """Apply events, goal and metric to `out`; return the flags."""
        return self._settle(state, flags, self.theta, self.dt, out)

    def step(self, state: State, action: int) -> tuple[State, int]:
        """Return the next state with the reward, and the flags."""
        out, flags = self.flow(state, action)
        return (out, self.settle(state, flags, out)) if flags & APPLICABLE else (out, flags)


class AdaptedStep:
    """The step of the file with revised parameters, a residual and counted outcomes.

    `UNSAFE` is set only where the file as written sets it; everything else is a risk.
    """

    def __init__(self, contents: Contents, written: FileStep) -> None:
        data: dict[str, Any] = contents.policy["adaptation"]
        self._written = written
        self._file = FileStep(contents, contents.arrays["theta"].tolist())
        self._revised, self._flagging = bool(data["revised"]), bool(data["flagging"])
        self._residual = Residual(data, contents.arrays)
        self._outcomes: CountedOutcomes | None = None
        counted = [False] * len(data["actions"])
        if data["stochastic"]:
            self._outcomes = CountedOutcomes(data, contents.arrays, self._file)
            counted = self._outcomes.counted
        self._differs = [
            self._revised or one or other
            for one, other in zip(self._residual.used, counted, strict=True)
        ]

    def step(self, state: State, action: int) -> tuple[State, int]:
        """Return the next state with the reward, and the flags with the risk."""
        if not self._differs[action]:
            return self._written.step(state, action)
        known = self._revised or self._flagging
        flagged = UNSAFE & self._written.step(state, action)[1] if known else 0
        out, flags = self.flow(state, action)
        risk = 0.0
        if flags & APPLICABLE:
            if self._outcomes is not None and self._outcomes.counted[action]:
                flags, risk = self._outcomes.settle(state, action, flags, out)
            else:
                flags = self._file.settle(state, flags, out)
                risk = 1.0 if flags & UNSAFE else 0.0
        if not known:
            flagged = flags & UNSAFE
        flags = flags & ~UNSAFE | flagged
        if flags & APPLICABLE and not flagged:
            flags |= int(risk / RISK_UNIT + 0.5) << RISK_SHIFT
        return out, flags

    def flow(self, state: State, action: int) -> tuple[State, int]:
        """Return the state after effects, processes and residual, and the flags."""
        out, flags = self._file.flow(state, action)
        if flags & APPLICABLE and self._residual.used[action]:
            before = out[:]
            self._residual.add(state, action, out)
            difference = 0.0
            for value in out[:-1]:
                difference += value - value
            if difference != 0.0:  # not finite: without the residual
                out = before
        return out, flags
