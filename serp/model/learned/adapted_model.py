"""The adapted transition model: the model of the file with learned parts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from serp.model.emit import Passage
from serp.model.flags import UNSAFE, risk_of
from serp.model.ground_model import UNSAFE_TARGET, GroundSchema
from serp.model.learned import adapted_step as kernels
from serp.model.learned.parameter_buffer import ParameterBuffer
from serp.model.learned.residual_features import FeatureGroup, feature_groups_of
from serp.model.native import OUTCOMES, address_of
from serp.model.transition_model import TransitionModel, Vector


class AdaptedModel(TransitionModel):
    """A transition model that is adapted to observed transitions.

    A step applies the file's effects and processes with the parameters in use, adds a residual,
    replaces counted fluents by their likeliest outcome, and applies the file's events. The reward
    is its expectation over the counted outcomes. `UNSAFE` is set only where the file as written
    sets it; everything else is a risk (`serp.model.flags.risk_of`): the probability that the file's
    events flag an outcome.

    Attributes:
        written: The model as written.
        feature_groups: Feature groups of every ground action.
        buffer: The memory that the compiled step reads; writing to it changes the model.
        revision: As in `TransitionModel`.
    """

    def __init__(self, written: TransitionModel) -> None:
        super().__init__(written.ground, dt=written.dt, theta=written.theta)
        self.program = program = written.program  # generated and compiled once
        self._written = written
        self.feature_groups: tuple[tuple[FeatureGroup, ...], ...] = tuple(
            feature_groups_of(self.ground, action) for action in self.actions
        )
        callbacks = [program.native(part) for part in ("step", "flow", "settle")]
        events = (effect for event in self.ground.events for effect in event.effects)
        self.buffer = ParameterBuffer(
            self.feature_groups,
            same_arguments(self.actions),
            len(self.fluents),
            self.theta,
            any(effect.target == UNSAFE_TARGET for effect in events),
            [float(address_of(callback)) for callback in callbacks],
        )

    @property
    def written(self) -> TransitionModel:
        """The model as the file has it."""
        return self._written

    @property
    def as_written(self) -> bool:
        """Whether nothing learned is in use."""
        return not self.buffer.active

    @property
    def data(self) -> Vector:
        """The data that `native_step` reads beside the state: the buffer."""
        return self.buffer.array

    def native_step(self) -> Any:
        """Return the compiled C callback of the adapted step."""
        return kernels.adapted_step()

    def native_outcomes(self) -> Any:
        """Return the compiled C callback of all outcomes; see `TransitionModel.native_outcomes`."""
        return kernels.adapted_outcomes()

    def uncertainty(self, state: Vector) -> Vector:
        """Return how little is known `[A]`; see `TransitionModel.uncertainty`."""
        actions = range(len(self.actions))
        return np.array([kernels.uncertainty(self.data, k, state) for k in actions])

    def native_uncertainty(self) -> Any:
        """Return the compiled C callback; see `TransitionModel.native_uncertainty`."""
        return kernels.native_uncertainty()

    def replace(
        self, *, theta: ArrayLike | None = None, dt: float | None = None
    ) -> TransitionModel:
        """Return the model as written with other parameters or another control period.

        Learned parts are dropped: they are valid only for their own parameters and period.
        """
        return self._written.replace(theta=theta, dt=dt)

    def transition(self, state: list[float], action: int) -> tuple[list[float], int]:
        """Predict one step on plain lists; see `TransitionModel.transition`."""
        if not self.buffer.active:
            return self._written.transition(state, action)
        out = np.array([*state, 0.0])
        flags = kernels.step_row(self.data, action, np.array(state), self.dt, out)
        return out.tolist(), int(flags)

    def precompile(self, state: Vector) -> None:
        """Compile the functions for predicting and tracing a step, by one call in a state `[F]`."""
        row, out = np.array(state), np.array([*state, 0.0])
        kernels.step_row(self.data, 0, row, self.dt, out)
        self._branches(row, 0)
        self.uncertainty(row)

    def passages(self, state: ArrayLike, action: int) -> tuple[list[Passage], int]:
        """Return which precondition failed, or which effects, rates and events took part.

        If the file as written flags the step unsafe, the trace is the file's; if there is a risk,
        it is that of the likeliest unsafe outcome.
        """
        values: list[float] = np.asarray(state, dtype=np.float64).tolist()
        flags = self.transition(values, action)[1] if self.buffer.active else UNSAFE
        if flags & UNSAFE:
            return self._written.passages(state, action)
        likeliest = None
        for branch in self._branches(np.array(values), action):
            trace = self._trace_with(values, action, branch)
            likeliest = likeliest or trace
            if risk_of(flags) == 0.0 or trace[1] & UNSAFE:
                return trace
        return likeliest or self._trace_with(values, action, None)

    def _branches(self, state: Vector, action: int) -> Vector:
        """Return the outcomes `[n, F + 1]` before events, with the reward, the likeliest first."""
        rows = np.zeros((OUTCOMES, len(state) + 3))
        count = kernels.branch_rows(self.data, action, state, self.dt, rows.reshape(-1))
        return rows[np.argsort(-rows[:count, -1], kind="stable"), :-2]

    def _trace_with(
        self, state: list[float], action: int, branch: Vector | None
    ) -> tuple[list[Passage], int]:
        """Trace a step in which effects, processes and what is learned have a given result."""

        def amend(state: list[float], action: int, out: list[float]) -> None:
            if branch is not None:
                out[:] = branch.tolist()

        theta = self.buffer.parameters.tolist()
        _, flags, passages = self.traced(state, action, theta=theta, amend=amend)
        return passages, flags


def same_arguments(actions: Sequence[GroundSchema]) -> NDArray[np.int64]:
    """Return `[A, S]` the ground action of each schema with the same arguments.

    It is -1 where there is none, and for the action itself.
    """
    schemas = {name: k for k, name in enumerate(dict.fromkeys(a.schema for a in actions))}
    alike: dict[tuple[str, ...], list[int]] = {}
    for k, action in enumerate(actions):
        alike.setdefault(action.arguments, []).append(k)
    others = np.full((len(actions), len(schemas)), -1, dtype=np.int64)
    for group in alike.values():
        for k in group:
            for other in group:
                if other != k:
                    others[k, schemas[actions[other].schema]] = other
    return others
