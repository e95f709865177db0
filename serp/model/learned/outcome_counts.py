"""Counts of the outcomes of an action, for predicates and whole numbers.

An outcome is what the file predicts for the action or for another action with the same arguments,
or a change of the state. Outcomes are counted by action schema, over all states and in contexts:
states with the same predicates and whole numbers; see `serp.model.learned.outcome_table`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._util.compilation import cached_njit
from serp._util.saved_state import LARGEST, MOST, Saved
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.learned import outcome_table as c
from serp.model.learned import parameter_buffer as b
from serp.model.learned.adapted_model import AdaptedModel, same_arguments
from serp.model.learned.adoption import BETTER, TrackRecord
from serp.model.learned.outcome_table import (
    CHANGE,
    ENDS,
    FIT,
    SCRATCH,
    STEP,
    alike,
    predict,
    put,
    room_for,
)
from serp.model.learned.parameter_buffer import ObservedStep, observed_step, settle
from serp.model.learned.regression_data import predicted_steps
from serp.model.learned.residual_features import FeatureGroup, Key, rate_of
from serp.model.native import advanced, pointer_to
from serp.model.transition_model import TransitionModel, Vector

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"

IMPOSSIBLE, POSSIBLE, FITS = range(3)
"""How an outcome fits an observation; one without a prediction is impossible."""


@cached_njit(nogil=True)
def _compare(buffer, table, kind, inputs, state, flow, observed, dt, room):
    """Return whether an outcome, after events, is the one observed; and whether it is an end.

    `flow` is the state `[F + 1]` after effects and processes, and the flags so far.
    """
    width = int(buffer[b.WIDTH])
    flowed, flags = flow
    out = advanced(room, STEP * c.KINDS)
    for i in range(width + 1):
        out[i] = flowed[i]
    put(buffer, table, kind, inputs, room, out)
    settled = settle(buffer, state, flags, dt, out)
    if not settled & APPLICABLE:
        return False, False
    places = int(table[c.T_PLACES])
    for k in range(int(table[c.T_COLUMNS])):
        column = int(inputs[int(table[places + k])])
        if out[column] != observed[column]:
            return False, settled & TERMINAL != 0
    return True, settled & TERMINAL != 0


@cached_njit(nogil=True)
def _fit_all(buffer, action, table, inputs, state, flow, observed, over, dt, room):
    """Write how each outcome fits an observation; return how many explain it.

    After the end of an episode, a state need not be what the file says: an end is explained by the
    outcomes that end the episode, and by those of them that predict the state, if any do.
    """
    fits, ends = advanced(room, FIT * c.KINDS), advanced(room, ENDS * c.KINDS)
    exact, ending, kinds = 0, 0, int(table[c.T_KINDS])
    for kind in range(kinds):
        fits[kind], ends[kind] = IMPOSSIBLE, 0.0
        if not predict(buffer, action, table, kind, inputs, state, flow[0], dt, room):
            continue
        same, end = _compare(buffer, table, kind, inputs, state, flow, observed, dt, room)
        same = same and (end or not over)
        fits[kind], ends[kind] = FITS if same else POSSIBLE, 1.0 if end else 0.0
        exact += same
        ending += end
    if exact > 0 or not over:
        return exact
    for kind in range(kinds):
        if ends[kind] != 0.0:
            fits[kind] = FITS
    return ending


@cached_njit(nogil=True)
def _find_new(buffer, action, table, inputs, state, flow, observed, over, dt, room):
    """Add outcomes that explain an observation, those of other actions first; return the number."""
    schemas, fits = int(table[c.T_SCHEMAS]), advanced(room, FIT * c.KINDS)
    before = int(table[c.T_KINDS])
    for schema in range(int(buffer[b.SCHEMAS])):
        kind = int(table[c.T_KINDS])
        if kind == c.KINDS:
            break
        known = False
        for other in range(1, before):
            known = known or table[schemas + other] == schema
        if known:
            continue
        table[schemas + kind] = schema
        if predict(buffer, action, table, kind, inputs, state, flow[0], dt, room):
            same, end = _compare(buffer, table, kind, inputs, state, flow, observed, dt, room)
            if same and (end or not over):
                fits[kind] = FITS
                table[c.T_KINDS] = kind + 1
    kind, columns = int(table[c.T_KINDS]), int(table[c.T_COLUMNS])
    if kind == before and kind < c.KINDS and not over:
        table[schemas + kind] = CHANGE
        fits[kind] = FITS
        changes, places = int(table[c.T_CHANGES]) + kind * columns, int(table[c.T_PLACES])
        for k in range(columns):
            column = int(inputs[int(table[places + k])])
            table[changes + k] = observed[column] - state[column]
        table[c.T_KINDS] = kind + 1
    return int(table[c.T_KINDS]) - before


@cached_njit(nogil=True, forceinline=True)
def _score(table, room, width):
    """Return the Brier score of the probabilities, of outcomes told apart by what they predict."""
    probabilities, fits = room, advanced(room, FIT * c.KINDS)
    score, right, left, columns = 1.0, 0.0, 0.0, int(table[c.T_COLUMNS])
    kinds = int(table[c.T_KINDS])
    for kind in range(kinds):
        if fits[kind] != IMPOSSIBLE:
            left += probabilities[kind]
    if left <= 0.0:
        return 2.0
    for kind in range(kinds):
        if fits[kind] == IMPOSSIBLE:
            continue
        p = probabilities[kind] / left
        if fits[kind] == FITS:
            right += p
        for other in range(kinds):
            if fits[other] != IMPOSSIBLE and alike(room, width, columns, kind, other):
                score += p * probabilities[other] / left
    return score - 2.0 * right


@cached_njit(nogil=True)
def _judge(table, row, room, known):
    """Compute the probabilities of the outcomes; where `known`, weigh experts by what came."""
    c.fill_broadest(table, room)
    if known:
        c.weigh_experts(table, row, room, advanced(room, FIT * c.KINDS))
    c.refine(table, row, room)


@cached_njit(nogil=True)
def _add(table, row, room):
    """Divide a sample among the outcomes that fit, by their probabilities."""
    probabilities, fits = room, advanced(room, FIT * c.KINDS)
    total, members, kinds = 0.0, 0, int(table[c.T_KINDS])
    for kind in range(kinds):
        if fits[kind] == FITS:
            probabilities[kind] += c.LEAST
            total += probabilities[kind]
            members |= 1 << kind
    for kind in range(kinds):
        if fits[kind] == FITS and row > 0:
            c.add_share(table, row, kind, probabilities[kind] / total)
    c.share_sets(table, members, advanced(room, SCRATCH * c.KINDS))


@cached_njit(nogil=True)
def _count(buffer, position, table, sample, flow, dt, losses, rate, room):
    """Update the losses with a new sample, and then count it; all arguments are arrays.

    `position` is that of the group among those of the action. `sample` is (state `[F]`, action, the
    observed next state, whether the episode is over), `flow` (state and reward after effects and
    processes, the flags of these). `losses` `[2]` are moving averages of the
    Brier scores (Monthly Weather Review 78, 1950) of the file and of the counts, `rate` the weight
    of this sample in them. `room` is scratch memory: pointers into an array keep it alive only
    where the array is an argument.

    Returns:
        False where it is no outcome, and there is no room for another.
    """
    state, action, observed, over = sample
    flowed, flags = flow
    base, counts = pointer_to(buffer, 0), pointer_to(table, 0)
    source, target = pointer_to(state, 0), pointer_to(observed, 0)
    scratch, seen = pointer_to(room, 0), (pointer_to(flowed, 0), flags)
    group = int(base[int(base[b.TABLE]) + 2 * action + 1]) + position * b.GROUP
    inputs, width = advanced(base, int(base[group + b.G_INPUTS])), state.shape[0]
    fitting = _fit_all(base, action, counts, inputs, source, seen, target, over, dt, scratch)
    fits, before = advanced(scratch, FIT * c.KINDS), int(counts[c.T_KINDS])
    row = c.find_or_enter(counts, inputs, source)
    _judge(counts, row, scratch, fitting > 0)
    if fitting > 0 or not over:
        score = _score(counts, scratch, width)
        losses[0] += rate * ((0.0 if fits[0] == FITS else 2.0) - losses[0])
        losses[1] += rate * (score - losses[1])
    if fitting == 0:
        found = _find_new(base, action, counts, inputs, source, seen, target, over, dt, scratch)
        if found == 0:
            return over
        for kind in range(before, before + found):
            scratch[kind] = 1.0
    _add(counts, row, scratch)
    return True


_MEMORY: Final = 0.995  # weight of the past in the scores, per step
_MIN_SAMPLES: Final = 5
"""Counts are used after so many samples where their Brier score (Monthly Weather Review 78, 1950)
is smaller than `BETTER` times the file's."""
Place = tuple[Vector, int, float]
"""Buffer of the model, position of the group among those of the action, and control period."""


class OutcomeCounts:
    """Counts the outcomes of the ground actions that share the key of a feature group.

    Args:
        group: Any feature group of the key.
        schemas: Number of action schemas.

    Attributes:
        table: The counts, see `serp.model.learned.outcome_table`; None before the first
            error.
        places: Positions of the counted fluents within the inputs.
        samples: Number of samples since counting began.
    """

    def __init__(self, group: FeatureGroup, schemas: int) -> None:
        self._schemas = schemas
        self._depth = len(group.inputs)
        where = {column: place for place, column in enumerate(group.inputs)}
        self._predicates = np.array([where[column] for column in group.predicates], dtype=np.int64)
        self._numbers = np.array([where[column] for column in group.targets], dtype=np.int64)
        self._bits = np.array(group.predicate_inputs, dtype=np.int64)
        self.table: Vector | None = None
        self.places = self._context = np.zeros(0, dtype=np.int64)
        self._scores = np.zeros(2)
        self.samples = self._strays = 0
        self._given_up = False

    @property
    def used(self) -> bool:
        """Whether counts have predicted new samples better than the file."""
        return (
            self.table is not None
            and not self._given_up
            and self.samples >= _MIN_SAMPLES
            and bool(self._scores[1] < BETTER * self._scores[0])
        )

    def track_record(self, schema: str) -> TrackRecord:
        """Return what is known of the counts, after actions of a schema."""
        written, learned = self._scores.tolist()
        hindrance = "too many different outcomes to count" if self._given_up else ""
        return TrackRecord(schema, self.used, self.samples, written, learned, hindrance)

    def count_again(self) -> None:
        """Forget all counts; keep the outcomes, with "nothing changes" among them."""
        if self.table is None:
            return
        old, kinds = _parts(self.table), int(self.table[c.T_KINDS])
        self._begin(self.places)
        self.table = new_table(self.places, self._context)
        nothing = (old["schemas"] == CHANGE) & (old["changes"] == 0.0).all(axis=1)
        self.table[c.T_KINDS] = min(c.KINDS, kinds + (not nothing[1:].any()))
        new = _parts(self.table)
        for name in ("schemas", "changes"):
            new[name][:kinds] = old[name]

    def explanations(self) -> tuple[NDArray[np.bool_], Vector]:
        """Return sets of outcomes `[S, K]`, and how often each explained an observation `[S]`."""
        assert self.table is not None
        members, number = _parts(self.table)["sets"].T
        kinds = range(int(self.table[c.T_KINDS]))
        return np.stack([members.astype(np.int64) >> k & 1 for k in kinds], axis=1) == 1, number

    def outcomes(self) -> tuple[Vector, NDArray[np.int64], Vector]:
        """Return the K outcomes: probabilities over all contexts, schemas and changes.

        The probabilities are `[K]`; `[K]` are positions of action schemas, -1 for the file's
        prediction (the first) and for a change; changes are `[K, places]`.
        """
        assert self.table is not None
        parts = _parts(self.table)
        counts = parts["counts"][0, : len(parts["schemas"])]
        shares = counts / max(1.0, parts["totals"][0])
        return shares, parts["schemas"].astype(np.int64), parts["changes"]

    def learn(
        self,
        place: Place,
        inputs: NDArray[np.int64],
        step: ObservedStep,
        whole: NDArray[np.bool_],
    ) -> bool:
        """Count a sample; return False where there are too many different outcomes to count.

        `inputs` `[d]` are columns of the feature group in states `[F]`. `whole` `[F]`: whether a
        fluent has always been whole. The end of an episode is counted as one of the outcomes that
        end it, if there are any.
        """
        if step.over:
            if self.table is not None:
                self.samples += 1
                self._count(place, step)
            return True
        if self._given_up:
            return False
        numbers = self._numbers[whole[inputs[self._numbers]]]
        if len(numbers) + len(self._predicates) != len(self.places):
            self._begin(np.sort(np.concatenate((self._predicates, numbers))))
        if not len(self.places):
            return True
        columns = inputs[self.places]
        self.samples += 1
        if self.table is None:
            # While the file is right there is nothing to count.
            if (step.next_state[columns] == step.settled[columns]).all():
                return True
            self._context = np.union1d(self._bits, np.flatnonzero(whole[inputs]))
            self.table = new_table(self.places, self._context)
            # All samples so far were as in the file.
            sets, totals = int(self.table[c.T_ALTERNATIVES]), int(self.table[c.T_TOTALS])
            self.table[c.T_SETS], self.table[sets : sets + 2] = 1, (1, self.samples - 1)
            self.table[int(self.table[c.T_COUNTS])] = self.table[totals] = self.samples - 1
        if not self._count(place, step):
            self._strays += 1
            if self.samples >= 50 and self._strays > 0.2 * self.samples:
                # Without the numbers, the predicates may have few outcomes.
                self._given_up = not len(numbers)
                self._begin(self._predicates)
                return False
        return True

    def _count(self, place: Place, step: ObservedStep) -> bool:
        buffer, position, dt = place
        assert self.table is not None
        rate = rate_of(self.samples - 1, _MEMORY)
        flow, room = (step.flowed, step.flags), np.empty(room_for(len(step.state)))
        return bool(
            _count(buffer, position, self.table, step[:4], flow, dt, self._scores, rate, room)
        )

    def _begin(self, places: NDArray[np.int64]) -> None:
        self.places = places
        self.table = None
        self._scores[:] = 0.0
        self.samples = self._strays = 0

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays: dict[str, NDArray[Any]] = {
            "places": self.places.copy(),
            "context": self._context.copy(),
            "scores": self._scores.copy(),
        }
        if self.table is not None:
            arrays |= {name: part.copy() for name, part in _parts(self.table).items()}
        return arrays, {
            "samples": self.samples,
            "strays": self._strays,
            "given_up": self._given_up,
        }

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned; a `RunError` refuses what does not fit."""
        saved = Saved("outcome counts", arrays, meta)
        places, context = (self._positions(saved, name) for name in ("places", "context"))
        scores = saved.array("scores", np.float64, self._scores.shape)
        samples, given_up = saved.whole("samples"), saved.truth("given_up")
        strays = saved.whole("strays", 0, samples)
        table = self._table_of(saved, places, context) if saved.has("codes") else None
        self.places, self._context = places, context
        self._scores[:] = scores
        self.table = table
        self.samples, self._strays, self._given_up = samples, strays, given_up

    def _positions(self, saved: Saved, name: str) -> NDArray[np.int64]:
        positions = saved.array(name, np.int64, (-1,), 0, self._depth - 1)
        if (np.diff(positions) <= 0).any():
            raise saved.wrong(f"{name} are not in order")
        return positions.copy()

    def _table_of(
        self, saved: Saved, places: NDArray[np.int64], context: NDArray[np.int64]
    ) -> Vector:
        """Return a new table with the saved counts."""
        table = new_table(places, context)
        codes = saved.array("codes", np.float64, (-1,), 0, MOST - 1)
        rows = len(codes)
        if not 1 <= rows <= c.ROWS or len(np.unique(codes[1:])) < rows - 1 or (codes % 1.0).any():
            raise saved.wrong("codes are not distinct whole numbers, or too many")
        schemas = saved.array("schemas", np.float64, (-1,), CHANGE, self._schemas - 1)
        if not 1 <= len(schemas) <= c.KINDS or (schemas % 1.0).any():
            raise saved.wrong(f"schemas are of {len(schemas)} outcomes, or no whole numbers")
        sets = saved.array("sets", np.float64, (-1, 2), 0, MOST)
        members = sets[:, 0]
        if not 1 <= len(sets) <= c.SETS or not np.isin(members, range(1, 2 ** len(schemas))).all():
            raise saved.wrong("sets are too many, or of unknown outcomes")
        table[c.T_KINDS], table[c.T_ROWS], table[c.T_SETS] = len(schemas), rows, len(sets)
        for row in range(1, rows):
            c.enter(table, codes[row], row)
        for name, part in _parts(table).items():
            # Probabilities are counts divided by totals, and shares of evidence and trust.
            low = {"changes": -LARGEST, "schemas": CHANGE}.get(name, 0.0)
            low = c.LEAST if name in ("evidence", "trust") else low
            high = MOST if name in ("counts", "totals", "codes", "trust") else LARGEST
            part[:] = saved.array(name, np.float64, part.shape, low, high)
        if not table[int(table[c.T_TOTALS])] > 0.0:
            raise saved.wrong("totals are of no sample")
        return table


def _parts(table: Vector) -> dict[str, Vector]:
    """Return views of what is saved of R rows: the layout and the hash table follow from it."""
    kinds, rows, columns = (int(table[k]) for k in (c.T_KINDS, c.T_ROWS, c.T_COLUMNS))
    shapes = {
        "schemas": (c.T_SCHEMAS, (kinds,)),
        "changes": (c.T_CHANGES, (kinds, columns)),
        "trust": (c.T_TRUST, (c.EXPERTS,)),
        "sets": (c.T_ALTERNATIVES, (int(table[c.T_SETS]), 2)),
        "codes": (c.T_CODES, (rows,)),
        "counts": (c.T_COUNTS, (rows, c.KINDS)),
        "totals": (c.T_TOTALS, (rows,)),
        "evidence": (c.T_EVIDENCE, (rows, c.EXPERTS)),
    }
    return {
        name: table[int(table[start]) :][: int(np.prod(shape))].reshape(shape)
        for name, (start, shape) in shapes.items()
    }


def new_table(places: NDArray[np.int64], context: NDArray[np.int64]) -> Vector:
    """Return an empty table for the counted fluents, and those of a context.

    Both are positions within the inputs.
    """
    parts = {
        c.T_PLACES: len(places),
        c.T_CONTEXT: len(context),
        c.T_SCHEMAS: c.KINDS,
        c.T_CHANGES: c.KINDS * len(places),
        c.T_TRUST: c.EXPERTS,
        c.T_ALTERNATIVES: 2 * c.SETS,
        c.T_CODES: c.ROWS,
        c.T_SLOTS: c.SLOTS,
        c.T_COUNTS: c.ROWS * c.KINDS,
        c.T_TOTALS: c.ROWS,
        c.T_EVIDENCE: c.ROWS * c.EXPERTS,
    }
    table = np.zeros(c.TABLE + sum(parts.values()))
    starts = np.cumsum([c.TABLE, *parts.values()])[:-1]
    table[list(parts)] = starts
    table[c.T_COLUMNS], table[c.T_KINDS], table[c.T_ROWS] = len(places), 1, 1
    table[c.T_COUNT] = len(context)
    at = dict(zip(parts, starts.tolist(), strict=True))
    table[at[c.T_PLACES] :][: len(places)] = places
    table[at[c.T_CONTEXT] :][: len(context)] = context
    table[at[c.T_SCHEMAS] :][: c.KINDS] = CHANGE
    table[at[c.T_TRUST] :][: c.EXPERTS] = table[at[c.T_EVIDENCE] :][: c.EXPERTS] = 1.0
    return table


Mask = NDArray[np.bool_]
Transitions = tuple[Vector, NDArray[np.int64], Vector, Mask]
"""States `[N, F]`, ground actions `[N]`, next states `[N, F]`, whether that ended the episode."""


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
        """Return the ground actions whose effects are at least 2 % of the outcomes of an action."""
        if self.counts.table is None:
            return {action}
        shares = self.counts.outcomes()[0]
        frequent = zip(self.effects(action), shares >= 0.02, strict=True)
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

    All steps of an action schema that has fewer than 30 of them are returned.
    """
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
