"""Looking for changes that happen and that the file does not mention.

Forward selection of terms. A term of one action schema competes with the same term of all actions
alike, which costs one number as well: so what the world does by itself is found as such. What was
chosen has to pay in transitions that it was not chosen by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from serp.model.transition_model import Vector
from serp.sysid.added_effects import AddedEffect
from serp.sysid.candidate_effects import FEW, candidates
from serp.sysid.lifted_features import WORLD, Lifting
from serp.sysid.parameter_fit import Rows
from serp.sysid.regression import independent, regress
from serp.sysid.regression_data import RegressionData

_MOST_TERMS = 12  # of one function
_TRIED = 30
_CERTAIN = 4.0  # standard errors
_SAME = 1e-6  # squared share of a column that the others do not explain
_WORLD_FIRST = 1.05
_BY_FACTORS = (1.1, 1.0, 0.8)  # between equals, the plainer one
_ALL = 1e-6  # of the squared error: what is left where a choice explains everything


@dataclass(frozen=True)
class Improvement:
    """How much a term has to explain to be worth a line.

    Attributes:
        change: Share of the mean squared change of the fluent, where the term applies.
        error: Share of the squared error that is left there.
    """

    change: float
    error: float


LASTING = 1e-5
"""Share of the mean squared change that pays where it goes on whatever the action, as gravity does:
it adds up over many steps, while the actions' own changes cancel out."""

_OWN = 1e-3
_PLAIN, _INVOLVED = 0.1, 0.25


def improvement_of(addition: AddedEffect) -> Improvement:
    """Return what a term has to explain.

    More where it is no lasting change, but one of one action; and more where it is not plain, a
    constant or a number in proportion to another.
    """
    factors = len(addition.factors)
    lasting = addition.schema == WORLD and factors < 2
    plain = lasting or factors == 0
    return Improvement(change=LASTING if lasting else _OWN, error=_PLAIN if plain else _INVOLVED)


def search(
    lifting: Lifting,
    sample: RegressionData,
    after: Vector,
    rows: Rows,
    symbol: str,
    dt: float,
    known: Sequence[AddedEffect],
) -> list[AddedEffect]:
    """Return terms that explain what is left of the error of one function.

    Args:
        lifting: The names of the file.
        sample: The transitions.
        after: `[N, F]` states once the action's effects are applied, which processes read.
        rows: The function's errors, and what its literals can explain of them.
        symbol: The function.
        dt: Control period.
        known: Terms found before, or refused.
    """
    if len(rows.rows) < FEW:
        return []
    additions, columns = candidates(lifting, sample, after, rows, symbol, dt, known)
    if not additions:
        return []
    base = rows.columns[:, independent(rows.columns, np.ones(rows.columns.shape[1]))]
    fit = regress(
        base,
        rows.residuals,
        centre=np.zeros(base.shape[1]),
        width=1e3 * rows.unit / np.maximum(np.sqrt(np.mean(base**2, axis=0)), 1e-300),
        groups=rows.groups,
        blocks=rows.blocks,
        unit=rows.unit,
        reject=False,
    )
    change = (sample.next_states - sample.states)[rows.rows, rows.fluents]
    root = np.sqrt(fit.weights)
    choice = _Selection(
        additions, columns, root, rows.residuals, change * root, rows.blocks, base, known
    )
    chosen: list[AddedEffect] = []
    while len(chosen) + len(known) < _MOST_TERMS and (best := choice.next()):
        chosen += [additions[k] for k in best]
    return _told_apart(chosen, len(choice.schemas))


class _Selection:
    """Forward selection by orthogonal projections of weighted columns.

    The same term of several schemas, each with a coefficient of its own, is one choice as well. It
    has to earn what it costs: choices are compared by how far they lower the logarithm of the
    squared error, a number. One that explains everything is found even where another, cheaper one
    happens to explain a good part.
    """

    def __init__(
        self,
        additions: Sequence[AddedEffect],
        columns: Vector,
        root: Vector,
        residuals: Vector,
        change: Vector,
        blocks: NDArray[np.int64],
        base: Vector,
        known: Sequence[AddedEffect],
    ) -> None:
        self.additions = additions
        self.touched = columns != 0.0
        self.left = columns * root[:, None]
        self.full = (self.left**2).sum(0)
        self.error = residuals * root
        self.change = change
        self.blocks = blocks
        self.even = blocks // 2 % 2 == 0
        self.schemas = {a.schema for a in additions if a.schema != WORLD}
        self.choices: list[tuple[int, ...]] = [(k,) for k in range(len(additions))]
        alike: dict[tuple[str, tuple[str, ...]], list[int]] = {}
        for k, addition in enumerate(additions):
            if addition.schema != WORLD:
                symbols = tuple(f.symbol for f in addition.factors)
                alike.setdefault((addition.target.symbol, symbols), []).append(k)
        # What is said of all alike is not said of each once more.
        general = {
            (a.target.symbol, tuple(f.symbol for f in a.factors))
            for a in known
            if a.schema == WORLD
        }
        self.choices += [
            tuple(ks) for key, ks in alike.items() if len(ks) > 1 and key not in general
        ]
        for column in np.linalg.qr(base * root[:, None])[0].T:
            self._project(column)

    def next(self) -> tuple[int, ...]:
        """Choose columns and project them out; none where none pays."""
        total = float((self.error**2).sum())
        if total == 0.0:
            return ()
        size = (self.left**2).sum(0)
        fit = size > _SAME * np.maximum(self.full, 1e-300)
        gain = np.where(fit, (self.error @ self.left) ** 2 / np.where(fit, size, 1.0), 0.0)
        scores = []
        for choice in self.choices:
            together = gain[choice[0]] if len(choice) == 1 else self._together(choice)
            rest = max(1.0 - float(together) / total, _ALL)
            scores.append(-np.log(rest) * self._preference(choice) / len(choice))
        for c in np.argsort(-np.array(scores), kind="stable")[:_TRIED].tolist():
            paying = tuple(
                k
                for k in self.choices[c]
                if gain[k] > 0.0 and self._pays(k, float(gain[k]), float(size[k]))
            )
            if paying:
                for k in paying:
                    column = self.left[:, k].copy()
                    self.touched[:, k] = False
                    self._project(column)
                return paying
        return ()

    def _together(self, choice: tuple[int, ...]) -> float:
        """Return how much squared error several columns explain together."""
        columns = self.left[:, choice]
        with_error = columns.T @ self.error
        gram = columns.T @ columns
        return float(with_error @ np.linalg.pinv(gram, rcond=_SAME, hermitian=True) @ with_error)

    def _preference(self, choice: tuple[int, ...]) -> float:
        addition = self.additions[choice[0]]
        plain = _BY_FACTORS[len(addition.factors)]
        return plain * (_WORLD_FIRST if addition.schema == WORLD else 1.0)

    def _project(self, column: Vector) -> None:
        norm = float(np.linalg.norm(column))
        if norm == 0.0:
            return
        direction = column / norm
        # Twice: rounding of the first time would be taken for something left to explain.
        for _ in range(2):
            self.left -= np.outer(direction, direction @ self.left)
            self.error = self.error - direction * (direction @ self.error)

    def _pays(self, k: int, gain: float, size: float) -> bool:
        rows, column = self.touched[:, k], self.left[:, k]
        if int(rows.sum()) < FEW:
            return False
        worth = improvement_of(self.additions[k])
        if gain < worth.change * float((self.change[rows] ** 2).sum()):
            return False
        if gain < worth.error * float((self.error[rows] ** 2).sum()):
            return False
        coefficient = float(self.error @ column) / size
        scores = column * (self.error - coefficient * column)
        _, which = np.unique(self.blocks, return_inverse=True)
        # A few blocks may cancel out by chance: the larger of both.
        sums = max(float((np.bincount(which, scores) ** 2).sum()), float((scores**2).sum()))
        deviation = float(np.sqrt(sums)) / size
        if abs(coefficient) < _CERTAIN * deviation:
            return False
        return min(self._held_out(column, self.even), self._held_out(column, ~self.even)) > (
            0.1 * gain
        )

    def _held_out(self, column: Vector, fitted: NDArray[np.bool_]) -> float:
        """Return how much squared error the column explains in the other rows."""
        own = float((column[fitted] ** 2).sum())
        if own == 0.0:
            return 0.0
        coefficient = float((column * self.error)[fitted].sum()) / own
        error, rest = self.error[~fitted], column[~fitted]
        return float((error**2).sum() - ((error - coefficient * rest) ** 2).sum())


def _told_apart(chosen: list[AddedEffect], schemas: int) -> list[AddedEffect]:
    """Drop what is said of all actions alike where every one of them is an exception to it."""
    return [
        addition
        for addition in chosen
        if addition.schema != WORLD
        or sum(a.schema != WORLD and _alike(a, addition) for a in chosen) < schemas
    ]


def _alike(one: AddedEffect, other: AddedEffect) -> bool:
    symbols = [tuple(f.symbol for f in a.factors) for a in (one, other)]
    return one.target.symbol == other.target.symbol and symbols[0] == symbols[1]
