"""The corrected transition model: what the file says, and what it does not say beside it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from serp.adaptation import step_kernels as kernels
from serp.adaptation.feature_groups import FeatureGroup, feature_groups_of
from serp.adaptation.parameter_buffer import ParameterBuffer
from serp.model.emit import Site
from serp.model.flags import UNSAFE, risk_of
from serp.model.ground import UNSAFE_TARGET, GroundModel
from serp.model.native import address_of
from serp.model.transition_model import StateError, TransitionModel, Vector


class AdaptedModel(TransitionModel):
    """A transition model with a correction beside the file.

    Effects and processes are the file's, with its literals or re-estimated ones; a correction is
    added to the fluents; then the file's events look at the result. Of several outcomes that were
    counted, the likeliest is the next state, and the reward is what is expected of all of them.
    What the file as written flags unsafe is flagged, and nothing else. The rest is a risk
    (`serp.model.flags.risk_of`): the share of the counted outcomes that the file's events flag, or
    1 where they flag what is predicted without any.

    Args:
        written: The model as written.

    Attributes:
        written: The same.
        views: Of every ground action.
        block: What the compiled step reads; whoever writes there changes the model.
    """

    def __init__(self, written: TransitionModel) -> None:
        self.__dict__.update(written.__dict__)
        self.written = written
        self.views: tuple[tuple[FeatureGroup, ...], ...] = tuple(
            feature_groups_of(self.ground, action) for action in self.actions
        )
        program = self._program
        callbacks = (program.native, program.native_flow, program.native_settle)
        self.block = ParameterBuffer(
            self.views,
            len(self.fluents),
            self.theta,
            _judges(self.ground),
            [float(address_of(callback)) for callback in callbacks],
        )

    @property
    def data(self) -> Vector:
        """What `native_step` reads beside the state: the block."""
        return self.block.array

    def native_step(self) -> Any:
        """Return the compiled C callback of the corrected step."""
        return kernels.corrected_step()

    def replace(
        self, *, theta: ArrayLike | None = None, dt: float | None = None
    ) -> TransitionModel:
        """Refuse: a correction belongs to the literals and the period that it was learned with.

        Raises:
            StateError: Always.
        """
        raise StateError("a corrected model cannot be changed; change the one it corrects")

    def transition(self, state: list[float], action: int) -> tuple[list[float], int]:
        """Predict one step on plain lists; see `TransitionModel.transition`."""
        if not self.block.active:
            return self.written.transition(state, action)
        out = np.array([*state, 0.0])
        flags = kernels.step_row(self.block.array, action, np.array(state), self.dt, out)
        return out.tolist(), int(flags)

    def rehearse(self, state: Vector) -> None:
        """Call once, in a state `[F]`, what predicting and tracing a corrected step calls."""
        row, out = np.array(state), np.array([*state, 0.0])
        kernels.step_row(self.block.array, 0, row, self.dt, out)
        kernels.shares_row(self.block.array, 0, row, 0)
        kernels.amend_row(self.block.array, 0, row, out, 0, 0)

    def trace(self, state: ArrayLike, action: int) -> tuple[list[Site], int]:
        """Return which precondition failed, or which effects, rates and events took part.

        Where the file as written flags a step, it is what the file says. Where there is a risk, it
        is the likeliest of what is unsafe.
        """
        values: list[float] = np.asarray(state, dtype=np.float64).tolist()
        known = self.transition(values, action)[1] if self.block.active else UNSAFE
        if known & UNSAFE:
            return self.written.trace(state, action)
        found = self._trace(values, action, -1, 0)
        if risk_of(known) == 0.0 or found[1] & UNSAFE:
            return found
        most = 0.0
        for away in range(len(self.views[action])):
            shares = kernels.shares_row(self.block.array, action, np.array(values), away)
            for kind in np.flatnonzero(shares > most).tolist():
                other = self._trace(values, action, away, kind)
                if other[1] & UNSAFE and shares[kind] > most:
                    found, most = other, shares[kind]
        return found

    def _trace(
        self, state: list[float], action: int, away: int, kind: int
    ) -> tuple[list[Site], int]:
        def amend(state: list[float], action: int, out: list[float]) -> None:
            changed = np.array(out)
            kernels.amend_row(self.block.array, action, np.array(state), changed, away, kind)
            out[:] = changed.tolist()

        return self._program.trace(state, action, self.block.literals.tolist(), self.dt, amend)


def _judges(ground: GroundModel) -> bool:
    """Return whether any event has a say in what is unsafe."""
    effects = (effect for event in ground.events for effect in event.effects)
    return any(effect.target == UNSAFE_TARGET for effect in effects)
