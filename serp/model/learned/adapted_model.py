"""The adapted transition model: the model of the file with learned parts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from serp import _core
from serp.model import ground_model as g
from serp.model.flags import UNSAFE, risk_of
from serp.model.instructions import contested
from serp.model.learned.feature_groups import FeatureGroup, Key, feature_groups_of, learnable
from serp.model.traced_step import Passage
from serp.model.transition_model import TransitionModel, Vector
from serp.pddl.syntax import Change, nodes_in


class AdaptedModel(TransitionModel):
    """A transition model that is adapted to observed transitions.

    A step applies the file's effects and processes with the parameters in use, adds a residual,
    replaces counted fluents by their likeliest outcome, and applies the file's events. The reward
    is its expectation over the counted outcomes. `UNSAFE` is set only where the file as written
    sets it; everything else is a risk (`serp.model.flags.risk_of`): the probability that the file's
    events flag an outcome.

    Last, reward and end are corrected, within the range of the data. An end has a chance then
    (`serp.model.flags.going_on`). One that the file foresees remains `TERMINAL`, unless it is
    doubtful and the reward is corrected, too: or else it might be earned again and again. A step
    that is flagged `UNSAFE` remains as it is.

    Attributes:
        written: The model as written.
        feature_groups: Feature groups of every ground action.
        shared: Key of a feature group → what is learned of the groups that have it.
        regressions: Key without the schema → the regression of their residual.
        worth: The regression of reward and end, with a head for each ground action; None where
            there are too many fluents or actions to learn it. Its inputs are all fluents, then
            reward and end as predicted without it.
        core: The compiled model, which reads what is learned.
        revision: As in `TransitionModel`.
    """

    def __init__(self, written: TransitionModel) -> None:
        super().__init__(written.ground, dt=written.dt, theta=written.theta)
        self._written = written
        self.feature_groups: tuple[tuple[FeatureGroup, ...], ...] = tuple(
            feature_groups_of(self.ground, action) for action in self.actions
        )
        self.regressions, self.shared = _parameters_of(self.feature_groups)
        depth, heads = len(self.fluents) + 2, len(self.actions)
        self.worth = _core.Regression(heads, depth, 2) if learnable(depth, heads) else None
        self._adapted_core = _core.AdaptedModel(
            written.written_core(),
            same_arguments(self.actions),
            _flagging(self.ground),
            [[(f.inputs, f.targets, self.shared[f.key]) for f in of] for of in self.feature_groups],
            self.worth,
        )

    @property
    def core(self) -> _core.AdaptedModel:
        """The compiled model."""
        return self._adapted_core

    @property
    def written(self) -> TransitionModel:
        """The model as the file has it."""
        return self._written

    @property
    def as_written(self) -> bool:
        """Whether nothing learned is in use."""
        return not self.core.active

    def uncertainty(self, state: Vector) -> Vector:
        """Return how far the step of each action `[A]` is from the data: about 1 / (like samples).

        1 where there are none, and 0 where the file alone predicts.
        """
        return self.core.uncertainty(state)

    def replace(
        self, *, theta: ArrayLike | None = None, dt: float | None = None
    ) -> TransitionModel:
        """Return the model as written, for which learned parts do not hold, with other numbers."""
        return self.written.replace(theta=theta, dt=dt)

    def passages(self, state: ArrayLike, action: int) -> tuple[list[Passage], int]:
        """Return which precondition failed, or which effects, rates and events took part.

        If the file as written flags the step unsafe, the trace is the file's; if there is a risk,
        it is that of the likeliest unsafe outcome.
        """
        if self.actions[action].outcomes:  # of these the file's own outcomes are told
            return self.written.passages(state, action)
        values: list[float] = np.asarray(state, dtype=np.float64).tolist()
        flags = UNSAFE if self.as_written else self.transition(values, action)[1]
        if flags & UNSAFE:
            return self.written.passages(state, action)
        # Outcomes before events; without any, the trace says why there is no step.
        rows = self.core.branches_of(np.array(values), action)
        likeliest_first = np.argsort(-rows[:, -1], kind="stable")
        branches: list[Vector | None] = [*rows[likeliest_first, :-2]]
        traces = (self._trace_with(values, action, branch) for branch in branches or [None])
        likeliest = next(traces)
        if risk_of(flags) == 0.0 or likeliest[1] & UNSAFE:
            return likeliest
        return next((trace for trace in traces if trace[1] & UNSAFE), likeliest)

    def _trace_with(
        self, state: list[float], action: int, branch: Vector | None
    ) -> tuple[list[Passage], int]:
        """Trace a step in which effects, processes and what is learned have a given result."""

        def amend(state: list[float], action: int, out: list[float]) -> None:
            if branch is not None:
                out[:] = branch.tolist()

        theta = self.core.parameters.tolist()
        _, flags, passages = self.traced(state, action, theta=theta, amend=amend)
        return passages, flags


def _flagging(ground: g.GroundModel) -> bool:
    """Whether events, goal or metric can make a step unsafe, or leave it without a result.

    An overflow does not count: it takes numbers that no robot has.
    """
    effects = [effect for event in ground.events for effect in event.effects]
    calculated = nodes_in(ground.events, ground.goal, ground.metric)
    numbers = [effect for effect in effects if isinstance(effect, g.SetNumber)]
    return (
        any(effect.target == g.UNSAFE_TARGET for effect in effects)
        or any(map(_may_fail, calculated))
        or any(effect.change is Change.SCALE_DOWN for effect in numbers)
        or bool(contested(numbers))
    )


def _may_fail(node: object) -> bool:
    """Whether an operation is a root, or a division by what varies."""
    if isinstance(node, g.Operation):
        return node.operator == "/" and bool([*g.fluents_of(node.right)])
    return isinstance(node, g.Unary) and node.operator == "sqrt"


def _parameters_of(
    groups: Sequence[Sequence[FeatureGroup]],
) -> tuple[dict[Key, _core.Regression], dict[Key, _core.GroupParameters]]:
    """Return the regressions of keys without the schema, one head each, and what groups share."""
    keys = {group.key: group for of_action in groups for group in of_action}
    heads: dict[Key, list[FeatureGroup]] = {}
    for key, group in keys.items():
        heads.setdefault(key[1:], []).append(group)
    regressions = {
        roles: _core.Regression(len(alike), len(alike[0].inputs), len(alike[0].targets))
        for roles, alike in heads.items()
        if alike[0].targets and learnable(len(alike[0].inputs), len(alike))
    }
    return regressions, {
        group.key: _core.GroupParameters(regressions.get(roles), head)
        for roles, alike in heads.items()
        for head, group in enumerate(alike)
    }


def same_arguments(actions: Sequence[g.GroundSchema]) -> NDArray[np.int64]:
    """Return `[A, S]` the other ground action of each schema with the same arguments; -1: none."""
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
