"""One step of the transition model for many states at once; see `step` for one.

States are arrays `[F, N]`, and results `[F + 1, N]`, the last row being the reward. All operations
are those of `step` in the same order, so that both give the same bits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .folder import Contents
from .residual import Residual
from .rows_outcomes import OutcomeRows
from .rows_program import make_rows_function
from .step import APPLICABLE, RISK_SHIFT, RISK_UNIT, UNSAFE

Rows = NDArray[np.float64]
Flags = NDArray[np.int64]


class FileRows:
    """The step of the domain file with some parameters."""

    def __init__(self, contents: Contents, theta: list[float]) -> None:
        policy = contents.policy
        width, self.theta, self.dt = len(policy["fluents"]), theta, float(policy["dt"])
        sizes = {"s": width, "out": width + 1, "theta": len(theta)}
        programs = policy["programs"]
        self._actions = [
            make_rows_function(("s", "theta", "dt", "out"), body, sizes)
            for body in programs["actions"]
        ]
        later = ("s", "flags", "theta", "dt", "out")
        self._drift = make_rows_function(later, programs["drift"], sizes)
        self._settle = make_rows_function(later, programs["settle"], sizes)

    def flow(self, states: Rows, action: int) -> tuple[Rows, Flags]:
        """Return the states after effects and processes with the rewards, and the flags."""
        count = states.shape[1]
        out = np.vstack((states, np.zeros(count)))
        begun = np.ones(count, np.bool_), np.zeros(count, np.int64)
        flags = self._actions[action](states, self.theta, self.dt, out, *begun)
        return out, self._drift(states, flags, self.theta, self.dt, out, flags & 1 != 0, flags)

    def settle(self, states: Rows, flags: Flags, out: Rows) -> Flags:
        """Apply events, goal and metric to `out`; return the flags."""
        found: Flags = self._settle(states, flags, self.theta, self.dt, out, flags & 1 != 0, flags)
        return found

    def step(self, states: Rows, action: int) -> tuple[Rows, Flags]:
        """Return the next states with the rewards, and the flags."""
        out, flags = self.flow(states, action)
        return out, self.settle(states, flags, out)


class AdaptedRows:
    """The step of the file with revised parameters, a residual and counted outcomes."""

    def __init__(self, contents: Contents, written: FileRows) -> None:
        data: dict[str, Any] = contents.policy["adaptation"]
        self._written = written
        self._file = FileRows(contents, contents.arrays["theta"].tolist())
        self._revised, self._flagging = bool(data["revised"]), bool(data["flagging"])
        self._residual = Residual(data, contents.arrays)
        self._outcomes: OutcomeRows | None = None
        self._counted = [False] * len(data["actions"])
        if data["stochastic"]:
            self._outcomes = OutcomeRows(data, contents.arrays, self._file)
            self._counted = self._outcomes.counted

    def step(self, states: Rows, action: int) -> tuple[Rows, Flags]:
        """Return the next states with the rewards, and the flags with the risks."""
        residual, counted = self._residual.used[action], self._counted[action]
        if not (self._revised or residual or counted):
            return self._written.step(states, action)
        known = self._revised or self._flagging
        out, flags = self._file.flow(states, action)
        if residual:
            before = out.copy()
            self._residual.add_rows(states, action, out)
            wrong = ~np.isfinite(out[:-1]).all(axis=0)
            out[:, wrong] = before[:, wrong]
        if self._outcomes is not None and counted:
            flags, risk = self._outcomes.settle(states, action, flags, out)
        else:
            flags = self._file.settle(states, flags, out)
            risk = np.where(flags & UNSAFE, 1.0, 0.0)
        flagged = self._written.step(states, action)[1] & UNSAFE if known else flags & UNSAFE
        flags = flags & ~UNSAFE | flagged
        risky = (flags & APPLICABLE != 0) & (flagged == 0)
        shifted = (risk / RISK_UNIT + 0.5).astype(np.int64) << RISK_SHIFT
        return out, np.where(risky, flags | shifted, flags)
