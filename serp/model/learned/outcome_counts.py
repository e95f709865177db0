"""Counts of the outcomes of an action, for predicates and whole numbers.

An outcome is what the file predicts for the action or for another action with the same arguments,
or a change of the state. Outcomes are counted by action schema, over all states and in contexts:
states with the same predicates and whole numbers; see `outcome_counts.hpp`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._core import GroupParameters, ObservedStep, OutcomeTable
from serp._util.saved_state import MOST, Arrays, Saved
from serp.model.learned.adapted_model import AdaptedModel, same_arguments
from serp.model.learned.adoption import TrackRecord
from serp.model.learned.feature_groups import FeatureGroup, Key
from serp.model.learned.regression_data import predicted_steps
from serp.model.transition_model import TransitionModel, Vector

_MIN_SAMPLES, _BETTER = 5, 0.95
"""Counts are used after so many samples where their Brier score (Monthly Weather Review 78, 1950)
is smaller than this fraction of the file's."""
_CHANGE: Final = -1
"""In place of an action schema: the outcome is a change."""
_LEAST: Final = 1e-6
"""Least evidence for an expert of the counts, and least trust in one."""


class OutcomeCounts:
    """Counts the outcomes of the ground actions that share the key of a feature group.

    `places` are the positions of the counted fluents within the inputs.
    """

    def __init__(self, group: FeatureGroup, schemas: int) -> None:
        self._schemas = schemas
        self._depth = len(group.inputs)
        where = {column: place for place, column in enumerate(group.inputs)}
        self._predicates = np.array([where[column] for column in group.predicates], dtype=np.int64)
        self._numbers = np.array([where[column] for column in group.targets], dtype=np.int64)
        self._bits = np.array(group.predicate_inputs, dtype=np.int64)
        self.table: OutcomeTable | None = None
        self.places = self._context = np.zeros(0, dtype=np.int64)
        self.samples = self._strays = 0
        self._given_up = False

    @property
    def used(self) -> bool:
        """Whether counts have predicted new samples better than the file."""
        return (
            self.table is not None
            and not self._given_up
            and self.samples >= _MIN_SAMPLES
            and bool(self.table.scores[1] < _BETTER * self.table.scores[0])
        )

    def publish(self, shared: GroupParameters) -> None:
        """Let the model use the counts, or stop using them."""
        table = self.table if self.used else None
        if table is not shared.outcomes:
            shared.outcomes = table

    def track_record(self, schema: str) -> TrackRecord:
        """Return what is known of the counts, after actions of a schema."""
        written, learned = (0.0, 0.0) if self.table is None else self.table.scores.tolist()
        hindrance = "too many different outcomes to count" if self._given_up else ""
        return TrackRecord(schema, self.used, self.samples, written, learned, hindrance)

    def count_again(self) -> None:
        """Forget all counts; keep the outcomes, with "nothing changes" among them."""
        if (table := self.table) is not None:
            self._begin(self.places)
            self.table = table.emptied()

    def explanations(self) -> tuple[NDArray[np.bool_], Vector]:
        """Return sets of outcomes `[S, K]`, and how often each explained an observation `[S]`."""
        table = self.table
        assert table is not None
        members = table.members[: table.sets, None] >> np.arange(table.kinds) & 1
        return members == 1, table.numbers[: table.sets]

    def outcomes(self) -> tuple[Vector, NDArray[np.int64], Vector]:
        """Return the K outcomes: probabilities over all contexts, schemas and changes.

        The probabilities are `[K]`; `[K]` are positions of action schemas, -1 for the file's
        prediction (the first) and for a change; changes are `[K, places]`.
        """
        table = self.table
        assert table is not None
        shares = table.counts[0, : table.kinds] / max(1.0, table.totals[0])
        return shares, table.schemas[: table.kinds], table.changes[: table.kinds]

    def learn(
        self, inputs: NDArray[np.int64], step: ObservedStep, whole: NDArray[np.bool_]
    ) -> bool:
        """Count a sample; return False where there are too many different outcomes to count.

        `inputs` `[d]` are columns of the feature group in states `[F]`. `whole` `[F]`: whether a
        fluent has always been whole. The end of an episode is counted as one of the outcomes that
        end it, if there are any; that of another action may be the first thing to count.
        """
        if step.over:
            table = self.table
            if table is None and len(self.places) and not step.predicted(inputs[self.places]):
                table = self._first_table(inputs, whole)
            if table is not None:
                table.count(step, inputs, self.samples)
                if table.kinds > 1:
                    self.table = table
                    self.samples += 1
            return True
        if self._given_up:
            return False
        numbers = self._numbers[whole[inputs[self._numbers]]]
        if len(numbers) + len(self._predicates) != len(self.places):
            self._begin(np.sort(np.concatenate((self._predicates, numbers))))
        if not len(self.places):
            return True
        if self.table is None:
            # While the file is right there is nothing to count.
            if step.predicted(inputs[self.places]):
                self.samples += 1
                return True
            self.table = self._first_table(inputs, whole)
        self.samples += 1
        if not self.table.count(step, inputs, self.samples - 1):
            self._strays += 1
            if self.samples >= 50 and self._strays > 0.2 * self.samples:
                # Without the numbers, the predicates may have few outcomes.
                self._given_up = not len(numbers)
                self._begin(self._predicates)
                return False
        return True

    def _first_table(self, inputs: NDArray[np.int64], whole: NDArray[np.bool_]) -> OutcomeTable:
        """Return a table for the first sample that is not as in the file."""
        self._context = np.union1d(self._bits, np.flatnonzero(whole[inputs]))
        table = OutcomeTable(self.places, self._context)
        table.start(self.samples)
        return table

    def _begin(self, places: NDArray[np.int64]) -> None:
        self.places = places
        self.table = None
        self.samples = self._strays = 0

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays = {"places": self.places.copy(), "context": self._context.copy()}
        counts = {"samples": self.samples, "strays": self._strays}
        meta: dict[str, Any] = {**counts, "given_up": self._given_up}
        if self.table is not None:
            sizes = {name: getattr(self.table, name) for name in _SIZES}
            arrays |= {k: array.copy() for k, array in _arrays(self.table, **sizes).items()}
            meta |= sizes
        return arrays, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned; a `RunError` refuses what does not fit."""
        saved = Saved("outcome counts", arrays, meta)
        places, context = (
            saved.array(name, np.int64, (-1,), 0, self._depth - 1).copy()
            for name in ("places", "context")
        )
        samples, given_up = saved.whole("samples"), saved.truth("given_up")
        strays = saved.whole("strays", 0, samples)
        try:
            table = OutcomeTable(places, context)
            if saved.has("kinds"):
                most = {name: len(getattr(table, of)) for name, of in _SIZES.items()}
                sizes = {name: saved.whole(name, 1, most[name]) for name in _SIZES}
                bounds = {**_BOUNDS, "schemas": (_CHANGE, self._schemas - 1)}
                for name, own in _arrays(table, **sizes).items():
                    own[:] = saved.array(name, own.dtype, own.shape, *bounds.get(name, (0.0, MOST)))
                table.restore(**sizes)
        except ValueError as error:
            raise saved.wrong(str(error)) from None
        self.places, self._context = places, context
        self.table = table if saved.has("kinds") else None
        self.samples, self._strays, self._given_up = samples, strays, given_up


_SIZES: Final = {"kinds": "schemas", "sets": "members", "rows": "codes"}
"""Numbers of outcomes, sets and rows in use, each with an array that has room for all there are."""
# Probabilities are counts divided by totals, and shares of evidence and trust.
_BOUNDS: Final = {"scores": (), "changes": (), "trust": (_LEAST, MOST), "evidence": (_LEAST,)}
"""Least and largest values of the arrays of a table, of others 0 and `MOST`."""


def _arrays(table: OutcomeTable, kinds: int, sets: int, rows: int) -> Arrays:
    """Return views of so much of the arrays of a table, by their names in a checkpoint."""
    used = {
        "scores": None, "trust": None, "schemas": kinds, "changes": kinds, "members": sets,
        "numbers": sets, "codes": rows, "counts": rows, "totals": rows, "evidence": rows,
    }  # fmt: skip
    return {name: getattr(table, name)[:size] for name, size in used.items()}


Mask = NDArray[np.bool_]
Transitions = tuple[Vector, NDArray[np.int64], Vector, Mask]
"""States `[N, F]`, ground actions `[N]`, next states `[N, F]`, whether that ended the episode."""


class CountedGroup(NamedTuple):
    """The counts of all groups of one key, with the ground action of the first of these groups."""

    action: int
    group: FeatureGroup
    counts: OutcomeCounts
    others: NDArray[np.int64]  # `[A, S]`, see `same_arguments`

    def effects(self, action: int) -> list[int]:
        """Return the ground action whose effect each outcome of an action is; -1 for a change."""
        schemas = self.counts.outcomes()[1].tolist()
        return [action, *(int(self.others[action, k]) if k >= 0 else -1 for k in schemas[1:])]

    def usual_effects(self, action: int) -> set[int]:
        """Return the ground actions whose effects are at least 2 % of the outcomes of an action."""
        if self.counts.table is None:
            return {action}
        shares = self.counts.outcomes()[0]
        frequent = zip(self.effects(action), shares >= 0.02, strict=True)
        return {action, *(other for other, usual in frequent if usual and other >= 0)}


def count_outcomes(
    model: TransitionModel, transitions: Transitions, counted: Mask, whole: Mask
) -> list[CountedGroup]:
    """Return the counts of all groups that the model does not predict exactly.

    All outcomes are found first, and then counted, so that it does not matter when each came first.
    States from which one of them may end the episode are not counted, if there are enough others:
    an environment may show something else after an end. As they are left out by the state, and not
    by what came, there is no bias. `counted` and `whole` `[F]` are the fluents that are counted,
    and the functions that are whole numbers.
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
    """Return the steps `[N]` from which no usual outcome ends the episode; all if there are few."""
    ends = np.zeros(len(actions), dtype=np.bool_)
    for action in np.unique(actions).tolist():
        rows = np.flatnonzero(actions == action)
        for other in {k for g in groups[action] for k in found[g.key].usual_effects(action)}:
            said = predicted_steps(model, states[rows], np.full(len(rows), other))
            ends[rows] |= said[:, -1] == 1.0
    for schema in dict.fromkeys(action.schema for action in model.actions):
        own = np.array([action.schema == schema for action in model.actions])[actions]
        if (own & ~ends).sum() < 30:
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
        step = adapted.core.observe(state, int(action), after, bool(over))
        if step is None:
            continue
        for group in groups[action]:
            counts, inputs = found[group.key].counts, np.array(group.inputs, dtype=np.int64)
            if not counts.learn(inputs, step, whole):
                whole[list(group.targets)] = False


def _counted(group: FeatureGroup, counted: Mask) -> FeatureGroup:
    targets, predicates = (
        tuple(column for column in columns if counted[column])
        for columns in (group.targets, group.predicates)
    )
    return dataclasses.replace(group, targets=targets, predicates=predicates)
