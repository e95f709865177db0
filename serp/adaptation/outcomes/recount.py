"""Outcomes counted anew from recorded transitions, as a run that adapts counts them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp.adaptation.adapted_model import AdaptedModel, same_arguments
from serp.adaptation.feature_groups import FeatureGroup, Key
from serp.adaptation.file_step import observed_step
from serp.adaptation.outcomes.outcome_counts import OutcomeCounts
from serp.model.transition_model import TransitionModel, Vector
from serp.sysid.regression_data import predicted_steps

Mask = NDArray[np.bool_]
Transitions = tuple[Vector, NDArray[np.int64], Vector, Mask]
"""States `[N, F]`, ground actions `[N]`, next states `[N, F]`, whether that ended the episode."""


_RARE: Final = 0.02  # less frequent outcomes are not asked for ends
_ENOUGH: Final = 30  # steps of an action


class CountedGroup(NamedTuple):
    """The counts of all groups of one key, with the ground action of the first of these groups.

    `others` `[A, S]` are those of `same_arguments`.
    """

    action: int
    group: FeatureGroup
    counts: OutcomeCounts
    others: NDArray[np.int64]

    def effects(self, action: int) -> list[int]:
        """Return the ground action whose effect each outcome of an action is; -1 for a change."""
        schemas = self.counts.outcomes()[1].tolist()
        return [action, *(int(self.others[action, k]) if k >= 0 else -1 for k in schemas[1:])]

    def usual_effects(self, action: int) -> set[int]:
        """Return the ground actions whose effects are frequent outcomes of an action."""
        if self.counts.table is None:
            return {action}
        shares = self.counts.outcomes()[0]
        frequent = zip(self.effects(action), shares >= _RARE, strict=True)
        return {action, *(other for other, usual in frequent if usual and other >= 0)}


def count_outcomes(
    model: TransitionModel,
    transitions: Transitions,
    counted: Mask,
    whole: Mask,
) -> list[CountedGroup]:
    """Return the counts of all groups that the model does not predict exactly.

    All outcomes are found first, and then counted, so that it does not matter when each came first.
    States from which one of them may end the episode are not counted, if there are enough others:
    an environment may show something else after an end. As they are left out by the state, and not
    by what came, there is no bias.

    Args:
        model: A model that can be compiled, as written.
        transitions: Observed transitions.
        counted: `[F]`, which fluents are counted.
        whole: `[F]`, which functions are whole numbers.
    """
    adapted = AdaptedModel(model)
    groups = [[_counted(group, counted) for group in groups] for groups in adapted.feature_groups]
    found: dict[Key, CountedGroup] = {}
    others = same_arguments(model.actions)
    for action, of_action in enumerate(groups):
        for group in of_action:
            if group.key not in found:
                counter = OutcomeCounts(group, others.shape[1])
                found[group.key] = CountedGroup(action, group, counter, others)
    _learn(adapted, groups, found, transitions, whole)
    states, actions, after, over = transitions
    rows = _away_from_ends(model, groups, found, states, actions)
    for each in found.values():
        each.counts.count_again()
    some = states[rows], actions[rows], after[rows], over[rows]
    _learn(adapted, groups, found, some, whole)
    return [each for each in found.values() if each.counts.table is not None]


def _away_from_ends(
    model: TransitionModel,
    groups: list[list[FeatureGroup]],
    found: Mapping[Key, CountedGroup],
    states: Vector,
    actions: NDArray[np.int64],
) -> Mask:
    """Return the steps `[N]` from whose states no usual outcome ends the episode.

    All steps of an action schema that has too few of them are returned.
    """
    ends = np.zeros(len(actions), dtype=np.bool_)
    for action in np.unique(actions).tolist():
        rows = np.flatnonzero(actions == action)
        for other in {k for g in groups[action] for k in found[g.key].usual_effects(action)}:
            said = predicted_steps(model, states[rows], np.full(len(rows), other))
            ends[rows] |= said[:, -1] == 1.0
    for schema in dict.fromkeys(action.schema for action in model.actions):
        own = np.array([action.schema == schema for action in model.actions])[actions]
        if (own & ~ends).sum() < _ENOUGH:
            ends[own] = False
    return ~ends


def _learn(
    adapted: AdaptedModel,
    groups: list[list[FeatureGroup]],
    found: Mapping[Key, CountedGroup],
    transitions: Transitions,
    whole: Mask,
) -> None:
    whole = whole.copy()
    for state, action, after, over in zip(*transitions, strict=True):
        step = observed_step(adapted.data, adapted.dt, state, int(action), after, bool(over))
        if step is None:
            continue
        for position, group in enumerate(groups[action]):
            counts, inputs = found[group.key].counts, np.array(group.inputs, dtype=np.int64)
            if not counts.learn((adapted.data, position, adapted.dt), inputs, step, whole):
                whole[list(group.targets)] = False


def _counted(group: FeatureGroup, counted: Mask) -> FeatureGroup:
    targets, predicates = (
        tuple(column for column in columns if counted[column])
        for columns in (group.targets, group.predicates)
    )
    return dataclasses.replace(group, targets=targets, predicates=predicates)
