"""One step of the transition model for many states at once; see `controller.step` for one.

States are arrays `[F, N]`, and results `[F + 1, N]`, the last row being the reward. They are
ordered by their actions: the states `bounds[a]` to `bounds[a + 1]` are followed by the action a.
All operations are those of `controller.step` in the same order, so that both give the same bits.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..adaptation import Adaptation
from ..program import Parameters
from ..reading import Entry
from ..step import APPLICABLE, RISK_SHIFT, RISK_UNIT, UNSAFE
from .outcomes import OutcomeRows
from .program import make_rows_function
from .residual import ResidualRows

Rows = NDArray[np.float64]
Flags = NDArray[np.int64]
Bounds = Sequence[int]


def slices_of(bounds: Bounds) -> Iterator[tuple[int, slice]]:
    """Yield each action that follows any state, and where these are."""
    for action, (first, last) in enumerate(pairwise(bounds)):
        if first < last:
            yield action, slice(first, last)


class FileRows:
    """The step of the domain file with some parameters; see `controller.step.FileStep`."""

    def __init__(
        self, policy: Entry, theta: Sequence[float],
        residual: Sequence[list[Any] | None] | None = None,
    ) -> None:  # fmt: skip
        parameters, programs = Parameters(policy, theta), policy["programs"]
        bodies = programs["actions"].items(len(policy["ground_actions"].items()))
        self._actions = [make_rows_function(body, parameters) for body in bodies]
        self._drift = make_rows_function(programs["drift"], parameters)
        self._settle = make_rows_function(programs["settle"], parameters)
        self._residual = [
            make_rows_function(Entry(added), parameters) if added else None
            for added in residual or []
        ]

    def flow(self, states: Rows, bounds: Bounds) -> tuple[Rows, Flags]:
        """Return the states after effects and processes with the rewards, and the flags."""
        out = np.empty((len(states) + 1, states.shape[1]))
        out[:-1], out[-1] = states, 0.0
        flags = np.ones(states.shape[1], np.int64)
        for action, part in slices_of(bounds):
            flags[part] = self._actions[action](states[:, part], flags[part], out[:, part])
        flags = self._drift(states, flags, out)
        if self._residual:
            for action, part in slices_of(bounds):
                add = self._residual[action]
                if add is not None:
                    add(states[:, part], flags[part], out[:, part])
        return out, flags

    def settle(self, states: Rows, flags: Flags, out: Rows) -> Flags:
        """Apply events, goal and metric to `out`; return the flags."""
        found: Flags = self._settle(states, flags, out)
        return found

    def step(self, states: Rows, bounds: Bounds) -> tuple[Rows, Flags]:
        """Return the next states with the rewards, and the flags."""
        out, flags = self.flow(states, bounds)
        return out, self.settle(states, flags, out)


class AdaptedRows:
    """The step of the file with revised parameters, a residual and counted outcomes."""

    def __init__(self, policy: Entry, learned: Adaptation, written: FileRows) -> None:
        self._written = written
        self._file = plain = FileRows(policy, learned.theta, learned.written_out)
        if any(learned.written_out):
            plain = FileRows(policy, learned.theta)
        self._known = learned.revised or learned.flagging
        self._residual = ResidualRows(learned.residual)
        self._outcomes = OutcomeRows(learned, plain) if any(learned.counted) else None

    def step(self, states: Rows, bounds: Bounds) -> tuple[Rows, Flags]:
        """Return the next states with the rewards, and the flags with the risks."""
        out, flags = self._file.flow(states, bounds)
        self._residual.add(states, bounds, out)
        if self._outcomes is None:
            flags = self._file.settle(states, flags, out)
            risk = np.where(flags & UNSAFE, 1.0, 0.0)
        else:
            flags, risk = self._outcomes.settle(states, bounds, flags, out)
        flagged = flags & UNSAFE
        if self._known:
            flagged = self._written.step(states, bounds)[1] & UNSAFE
        flags = flags & ~UNSAFE | flagged
        risky = (flags & APPLICABLE != 0) & (flagged == 0)
        shifted = (risk / RISK_UNIT + 0.5).astype(np.int64) << RISK_SHIFT
        return out, np.where(risky, flags | shifted, flags)
