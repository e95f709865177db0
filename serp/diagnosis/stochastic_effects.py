"""Stochastic effects of actions on discrete fluents: their outcomes and probabilities.

An outcome is described by an action of the file where possible: a robot that slips usually has the
effect of another action, with its conditions. Each transition is therefore compared with the effect
of every action in its state. Several outcomes may fit one transition, at a wall for example, so
expectation-maximisation estimates the probabilities.
"""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from serp.diagnosis.accuracy import Steps
from serp.diagnosis.expectation_maximisation import estimate_probabilities
from serp.diagnosis.findings import ObservedOutcome, StochasticEffect
from serp.model import ground as g
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.transition_model import TransitionModel, Vector
from serp.sysid.lifted_features import LiftedModel
from serp.sysid.regression_data import RegressionData

_MOST_ROWS = 4_000
_MOST_ACTIONS = 40
_MOST_OTHERS = 6
_RARE = 0.02  # least share of the steps of an outcome that is worth mentioning
_FEW = 5
_ENOUGH = 30
_CERTAIN = 3.0  # standard errors

Changes = tuple[tuple[str, float], ...]
Mask = NDArray[np.bool_]


def find_stochastic_effects(
    model: TransitionModel, steps: Steps, whole: Iterable[str]
) -> tuple[StochasticEffect, ...]:
    """Return the action schemas that have other outcomes than in the file.

    Args:
        model: The model as written.
        steps: The observed steps.
        whole: Functions whose values are a few whole numbers.
    """
    sample = steps.sample.part(_MOST_ROWS)
    columns = _discrete(model.ground, set(whole))
    if not len(columns) or not len(sample):
        return ()
    lifted = LiftedModel(model.ground)
    names = dict.fromkeys(action.schema for action in model.actions)
    schemas = [
        _Schema(model, lifted, sample, columns, steps.units[columns], name) for name in names
    ]
    surprising = [schema for schema in schemas if schema.surprising]
    # An environment may show the state after the last step of an episode, or the next start.
    strange = any(schema.ends_strangely for schema in surprising)
    found = [schema.finding(without_ends=strange) for schema in surprising]
    return tuple(finding for finding in found if finding is not None)


def _discrete(ground: g.GroundModel, whole: set[str]) -> NDArray[np.int64]:
    """Return the columns of whole numbers, and of predicates that effects of the file change."""
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
class _Candidate:
    """One candidate outcome; the observation after an end of the episode is unreliable."""

    changes: Changes  # where it has any
    fits: Mask  # [n], whether it fits the observed next state
    after: Vector  # [n, D], the next states that it predicts
    ends: Mask  # [n], whether it ends the episode
    written: bool  # whether it is the action's effect in the file


class _Schema:
    """The transitions of one action schema."""

    def __init__(
        self,
        model: TransitionModel,
        lifted: LiftedModel,
        sample: RegressionData,
        columns: NDArray[np.int64],
        units: Vector,
        schema: str,
    ) -> None:
        self.model = model
        self.columns = columns
        self.schema = schema
        self.total = len(sample)
        self.bindings = lifted.schema(schema).bindings
        rows = np.isin(sample.actions, list(self.bindings))
        self.actions = sample.actions[rows]
        self.states = sample.states[rows]
        self.before = self.states[:, columns]
        self.observed = sample.next_states[rows][:, columns]
        self.units = units

    @functools.cached_property
    def surprising(self) -> bool:
        """Whether outcomes other than the written one are frequent."""
        if len(self.actions) < _FEW:
            return False
        return bool((self._written[0] == self.observed).all(1).mean() < 1.0 - _RARE)

    @functools.cached_property
    def ends_strangely(self) -> bool:
        """Whether states after ends of episodes differ from the prediction."""
        strange = self._ends & ~_fits_of(self._usual_candidates).any(1)
        return bool(strange.sum() > _RARE * self._ends.sum())

    def finding(self, *, without_ends: bool) -> StochasticEffect | None:
        """Return the stochastic effect; None where the file is right.

        Args:
            without_ends: Leave out all states from which the action may end the episode. The
                selection depends only on the states, not on the outcomes, so it causes no bias.
        """
        written, candidates = self._written[0], self._candidates
        fits = _fits_of(candidates)
        rows = ~self._ends
        if not without_ends or rows.sum() < _ENOUGH:
            rows = np.ones(len(fits), dtype=np.bool_)
        shares, errors = estimate_probabilities(fits[rows])
        at = next(k for k, candidate in enumerate(candidates) if candidate.written)
        if 1.0 - shares[at] < max(_RARE, _CERTAIN * errors[at]):
            return None
        mean = sum(p * k.after for p, k in zip(shares, candidates, strict=True))
        mean = mean + max(0.0, 1.0 - float(shares.sum())) * self.observed
        off = ((self.observed - written) / self.units) ** 2
        left = ((self.observed - mean) / self.units) ** 2
        outcomes = [
            ObservedOutcome(candidate.changes, float(p), float(e), candidate.written)
            for candidate, p, e in zip(candidates, shares, errors, strict=True)
            if candidate.written or p >= 0.5 / len(self.actions)
        ]
        place = self.model.actions[next(iter(self.bindings))].place
        return StochasticEffect(
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
    def _usual_candidates(self) -> list[_Candidate]:
        shares, _ = estimate_probabilities(_fits_of(self._candidates))
        return [k for k, p in zip(self._candidates, shares, strict=True) if k.written or p >= _RARE]

    @functools.cached_property
    def _ends(self) -> Mask:
        """The states from which a usual outcome ends the episode."""
        ends: Mask = np.any([candidate.ends for candidate in self._usual_candidates], axis=0)
        return ends

    def _predicted(self, actions: NDArray[np.int64]) -> tuple[Vector, Mask]:
        """Return the discrete fluents after one step, `[n, D]`, and whether the episode ends."""
        after = np.full(self.before.shape, np.nan)
        ends = np.zeros(len(after), dtype=np.bool_)
        for row, state in enumerate(self.states.tolist()):
            out, flags = self.model.transition(state, int(actions[row]))
            if flags & APPLICABLE:
                after[row] = [out[column] for column in self.columns]
                ends[row] = bool(flags & TERMINAL)
        return after, ends

    @functools.cached_property
    def _candidates(self) -> list[_Candidate]:
        """Return the candidates, the written outcome first."""
        written, ends = self._written
        own = self._usual(written)
        candidates = {own: _Candidate(own, (written == self.observed).all(1), written, ends, True)}
        others = range(len(self.model.actions))
        for other in others if len(others) <= _MOST_ACTIONS else ():
            after, ends = self._predicted(np.full(len(self.actions), other, dtype=np.int64))
            for action in self.bindings:
                own_rows = self.actions == action
                if other == action or not own_rows.any():
                    continue
                here = np.where(own_rows[:, None], after, np.nan)
                self._add(candidates, self._usual(here), here, ends & own_rows)
        missed: Mask = np.all(~_fits_of(candidates.values()), axis=1)
        commonest = self._counted(self.observed, missed)[:_MOST_OTHERS]
        if (self.observed[missed] == self.before[missed]).all(1).any():
            commonest.append(())
        for changes in commonest:
            self._add(candidates, changes, self._changed(changes), np.zeros(len(missed), np.bool_))
        found = [k for k in candidates.values() if k.written or k.fits.any()]
        return found if () in candidates else self._with_nothing(found)

    def _with_nothing(self, candidates: list[_Candidate]) -> list[_Candidate]:
        """Return the candidates, with "nothing changes" where it explains what others do not.

        "Not switched on" and "switched off" differ only in states in which the lamp is on.
        """
        stays = np.zeros(len(self.before), dtype=np.bool_)
        nothing = _Candidate((), (self.observed == self.before).all(1), self.before, stays, False)
        shares, errors = estimate_probabilities(_fits_of([*candidates, nothing]))
        frequent = shares[-1] >= max(_RARE, _CERTAIN * errors[-1])
        return [*candidates, nothing] if frequent else candidates

    def _add(
        self, candidates: dict[Changes, _Candidate], changes: Changes, after: Vector, ends: Mask
    ) -> None:
        """Add a candidate; `after` is NaN where it has no prediction."""
        if not changes and not np.isfinite(after).any():
            return
        fits = (after == self.observed).all(1)
        known = candidates.get(changes)
        if known is None:
            # Without a prediction the state is unchanged, for the mean.
            known = candidates[changes] = _Candidate(changes, fits, self.before.copy(), ends, False)
        elif known.written:
            known.fits |= fits
            return
        known.fits |= fits
        known.ends |= ends
        said = np.isfinite(after).all(1)
        known.after[said] = after[said]

    def _usual(self, after: Vector) -> Changes:
        """Return the most frequent change other than none."""
        said: Mask = np.all(np.isfinite(after), axis=1)
        return next(iter(self._counted(after, said)), ())

    def _counted(self, after: Vector, rows: Mask) -> list[Changes]:
        """Return the changes in some rows, the most frequent first."""
        counts: Counter[Changes] = Counter()
        for row in np.flatnonzero(rows & (after != self.before).any(1)).tolist():
            counts[self._named(row, after[row] - self.before[row])] += 1
        return [changes for changes, _ in sorted(counts.items(), key=lambda c: (-c[1], c[0]))]

    def _named(self, row: int, change: Vector) -> Changes:
        """Return a change with the fluents' names in the schema."""
        names = {o: variable for variable, o in self.bindings[int(self.actions[row])].items()}
        named = []
        for column, by in zip(self.columns.tolist(), change.tolist(), strict=True):
            if by != 0.0:
                fluent = self.model.fluents[column]
                terms = (names.get(argument, argument) for argument in fluent.arguments)
                named.append((" ".join((fluent.symbol, *terms)), by))
        return tuple(named)

    def _changed(self, changes: Changes) -> Vector:
        """Return all states with a change applied."""
        after = self.before.copy()
        index = {self.model.fluents[c].name: k for k, c in enumerate(self.columns.tolist())}
        for row in range(len(after)):
            binding = self.bindings[int(self.actions[row])]
            for name, by in changes:
                symbol, *terms = name.split(" ")
                at = index.get(" ".join((symbol, *(binding.get(t, t) for t in terms))))
                if at is not None:
                    after[row, at] += by
        return after


def _fits_of(candidates: Iterable[_Candidate]) -> Mask:
    """Return which candidates fit each transition, `[n, K]`."""
    return np.stack([candidate.fits for candidate in candidates], axis=1)
