"""Counting what comes of an action where fluents jump: by chance, or otherwise than written.

What happened is told in the file's own words first: an action that slips usually does what
another action is said to do, walls and all. So every transition is compared with what each action
would do in its state. At a wall several say the same; how often each thing happens is then a
matter of likelihood.
"""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from serp.diagnosis.expectation_maximisation import likeliest
from serp.diagnosis.findings import ObservedOutcome, OutcomeFinding
from serp.model import ground as g
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.transition_model import TransitionModel, Vector
from serp.sysid.lifted_features import Lifting
from serp.sysid.regression_data import RegressionData

_MOST_ROWS = 4_000
_MOST_ACTIONS = 40
_MOST_OTHERS = 6
_RARE = 0.02  # so seldom does something else come that it is not worth telling
_FEW = 5
_ENOUGH = 30
_CERTAIN = 3.0  # standard errors

Changes = tuple[tuple[str, float], ...]
Mask = NDArray[np.bool_]


def find_outcomes(
    model: TransitionModel, sample: RegressionData, whole: Iterable[str], units: Vector
) -> tuple[OutcomeFinding, ...]:
    """Return the actions of which something else comes than the file says, by schema.

    Args:
        model: The model as written.
        sample: The transitions.
        whole: Functions whose values are a few whole numbers.
        units: `[F + 2]` what errors are measured by; see `serp.diagnosis.error_scales`.
    """
    sample = sample.part(_MOST_ROWS)
    columns = _jumping(model.ground, set(whole))
    if not len(columns) or not len(sample):
        return ()
    lifting = Lifting(model.ground)
    names = dict.fromkeys(action.schema for action in model.actions)
    schemas = [_Schema(model, lifting, sample, columns, units[columns], name) for name in names]
    told = [schema for schema in schemas if schema.surprising]
    # Who falls may be seen where the fall ends, or back at the start, as any move would end there.
    strange = any(schema.ends_strangely for schema in told)
    found = [schema.finding(without_ends=strange) for schema in told]
    return tuple(finding for finding in found if finding is not None)


def _jumping(ground: g.GroundModel, whole: set[str]) -> NDArray[np.int64]:
    """Return the columns of whole numbers, and of predicates that the file has an effect on."""
    schemas = (*ground.actions, *ground.processes, *ground.events)
    written = {target for schema in schemas for target in g.writes(schema)}
    return np.array(
        [
            f.index
            for f in ground.fluents
            if (f.symbol in whole if f.numeric else f.index in written)
        ],
        dtype=np.int64,
    )


@dataclass
class _Kind:
    """One kind of outcome: where it fits what was observed, and what it makes of each state.

    Where the episode ends by it, what comes after is anybody's guess: a fall may be seen where it
    ends, or back at the start.
    """

    changes: Changes
    fits: Mask
    after: Vector
    ends: Mask
    written: bool


class _Schema:
    """The transitions of one action schema."""

    def __init__(
        self,
        model: TransitionModel,
        lifting: Lifting,
        sample: RegressionData,
        columns: NDArray[np.int64],
        units: Vector,
        schema: str,
    ) -> None:
        self.model = model
        self.columns = columns
        self.schema = schema
        self.total = len(sample)
        self.bindings = lifting.schema(schema).bindings
        rows = np.isin(sample.actions, list(self.bindings))
        self.actions = sample.actions[rows]
        self.states = sample.states[rows]
        self.before = self.states[:, columns]
        self.observed = sample.next_states[rows][:, columns]
        self.units = units

    @functools.cached_property
    def surprising(self) -> bool:
        """Whether something else than written comes often enough."""
        if len(self.actions) < _FEW:
            return False
        return bool((self._written[0] == self.observed).all(1).mean() < 1.0 - _RARE)

    @functools.cached_property
    def ends_strangely(self) -> bool:
        """Whether ends of the episode are not seen as predicted."""
        strange = self._ends & ~np.logical_or.reduce([kind.fits for kind in self._usual_kinds])
        return bool(strange.sum() > _RARE * self._ends.sum())

    def finding(self, *, without_ends: bool) -> OutcomeFinding | None:
        """Return what is to be told; None where the file says what happens.

        Args:
            without_ends: Leave out all states from which the action may end the episode. Which
                states are looked at is no matter of what came of it.
        """
        written, kinds = self._written[0], self._kinds
        fits = np.stack([kind.fits for kind in kinds], axis=1)
        rows = ~self._ends
        if not without_ends or rows.sum() < _ENOUGH:
            rows = np.ones(len(fits), dtype=np.bool_)
        shares, errors = likeliest(fits[rows])
        at = next(k for k, kind in enumerate(kinds) if kind.written)
        if 1.0 - shares[at] < max(_RARE, _CERTAIN * errors[at]):
            return None
        mean = sum(p * kind.after for p, kind in zip(shares, kinds, strict=True))
        mean = mean + max(0.0, 1.0 - float(shares.sum())) * self.observed
        off = ((self.observed - written) / self.units) ** 2
        left = ((self.observed - mean) / self.units) ** 2
        outcomes = [
            ObservedOutcome(kind.changes, float(p), float(e), kind.written)
            for kind, p, e in zip(kinds, shares, errors, strict=True)
            if kind.written or p >= 0.5 / len(self.actions)
        ]
        place = self.model.actions[next(iter(self.bindings))].place
        return OutcomeFinding(
            self.schema,
            place,
            tuple(sorted(outcomes, key=lambda o: (-o.probability, o.changes))),
            len(self.actions),
            max(0.0, float((off - left).sum()) / self.total),
        )

    @functools.cached_property
    def _written(self) -> tuple[Vector, Mask]:
        return self._predicted(self.actions)

    @functools.cached_property
    def _usual_kinds(self) -> list[_Kind]:
        shares, _ = likeliest(np.stack([kind.fits for kind in self._kinds], axis=1))
        return [k for k, p in zip(self._kinds, shares, strict=True) if k.written or p >= _RARE]

    @functools.cached_property
    def _ends(self) -> Mask:
        """The states from which something that usually comes ends the episode."""
        ends: Mask = np.logical_or.reduce([kind.ends for kind in self._usual_kinds])
        return ends

    def _predicted(self, actions: NDArray[np.int64]) -> tuple[Vector, Mask]:
        """Return the fluents looked at after one step, `[n, D]`, and whether it is the last."""
        after = np.full(self.before.shape, np.nan)
        ends = np.zeros(len(after), dtype=np.bool_)
        for row, (state, action) in enumerate(
            zip(self.states.tolist(), actions.tolist(), strict=True)
        ):
            out, flags = self.model.transition(state, action)
            if flags & APPLICABLE:
                after[row] = [out[column] for column in self.columns]
                ends[row] = bool(flags & TERMINAL)
        return after, ends

    @functools.cached_property
    def _kinds(self) -> list[_Kind]:
        """The kinds of outcomes, what is written first."""
        written, ends = self._written
        own = self._usual(written)
        kinds = {own: _Kind(own, (written == self.observed).all(1), written, ends, True)}
        others = range(len(self.model.actions))
        for other in others if len(others) <= _MOST_ACTIONS else ():
            after, ends = self._predicted(np.full(len(self.actions), other, dtype=np.int64))
            for action in self.bindings:
                own_rows = self.actions == action
                if other == action or not own_rows.any():
                    continue
                here = np.where(own_rows[:, None], after, np.nan)
                self._add(kinds, self._usual(here), here, ends & own_rows)
        missed = ~np.logical_or.reduce([kind.fits for kind in kinds.values()])
        for changes in self._commonest(missed):
            self._add(kinds, changes, self._changed(changes), np.zeros(len(missed), np.bool_))
        found = [k for k in kinds.values() if k.written or k.fits.any()]
        return found if () in kinds else self._with_nothing(found)

    def _with_nothing(self, kinds: list[_Kind]) -> list[_Kind]:
        """Return the kinds and that nothing changes, where this explains what others do not.

        A lamp that does not light up looks like one that is put out; but one that is lit would go
        out then.
        """
        stays = np.zeros(len(self.before), dtype=np.bool_)
        nothing = _Kind((), (self.observed == self.before).all(1), self.before, stays, False)
        shares, errors = likeliest(np.stack([k.fits for k in (*kinds, nothing)], axis=1))
        frequent = shares[-1] >= max(_RARE, _CERTAIN * errors[-1])
        return [*kinds, nothing] if frequent else kinds

    def _add(
        self, kinds: dict[Changes, _Kind], changes: Changes, after: Vector, ends: Mask
    ) -> None:
        """Add an outcome; NaN in `after` where it says nothing."""
        if not changes and not np.isfinite(after).any():
            return
        fits = (after == self.observed).all(1)
        known = kinds.get(changes)
        if known is None:
            # What it says nothing of stays, for the mean.
            known = kinds[changes] = _Kind(changes, fits, self.before.copy(), ends, False)
        elif known.written:
            known.fits |= fits
            return
        known.fits |= fits
        known.ends |= ends
        said = np.isfinite(after).all(1)
        known.after[said] = after[said]

    def _usual(self, after: Vector) -> Changes:
        """Return the change that is made most often where one is made."""
        said: Mask = np.all(np.isfinite(after), axis=1)
        return next(iter(self._counted(after, said)), ())

    def _counted(self, after: Vector, rows: Mask) -> list[Changes]:
        """Return the changes in some rows, those most often made first."""
        counts: Counter[Changes] = Counter()
        for row in np.flatnonzero(rows & (after != self.before).any(1)).tolist():
            counts[self._named(row, after[row] - self.before[row])] += 1
        return [changes for changes, _ in sorted(counts.items(), key=lambda c: (-c[1], c[0]))]

    def _commonest(self, missed: Mask) -> list[Changes]:
        found = self._counted(self.observed, missed)[:_MOST_OTHERS]
        if (self.observed[missed] == self.before[missed]).all(1).any():
            found.append(())
        return found

    def _named(self, row: int, change: Vector) -> Changes:
        """Return a change with the names that the schema gives to the fluents."""
        names = {o: variable for variable, o in self._binding(row).items()}
        told = []
        for column, by in zip(self.columns.tolist(), change.tolist(), strict=True):
            if by != 0.0:
                fluent = self.model.fluents[column]
                terms = (names.get(argument, argument) for argument in fluent.arguments)
                told.append((" ".join((fluent.symbol, *terms)), by))
        return tuple(told)

    def _changed(self, changes: Changes) -> Vector:
        """Return every state with a change made."""
        after = self.before.copy()
        index = {self.model.fluents[c].name: k for k, c in enumerate(self.columns.tolist())}
        for row in range(len(after)):
            binding = self._binding(row)
            for name, by in changes:
                symbol, *terms = name.split(" ")
                at = index.get(" ".join((symbol, *(binding.get(t, t) for t in terms))))
                if at is not None:
                    after[row, at] += by
        return after

    def _binding(self, row: int) -> Mapping[str, str]:
        return self.bindings[int(self.actions[row])]
