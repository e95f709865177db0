"""The file's literals and the effects that it leaves out, estimated together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from serp.correction.additions import Addition
from serp.correction.lifting import Lifting
from serp.correction.literals import LiteralFit
from serp.correction.merging import merged
from serp.correction.sample import Sample
from serp.correction.trial import Trial
from serp.domain import ground as g
from serp.domain.model import TransitionModel

_SWEEPS = 6


@dataclass(frozen=True)
class Explanation:
    """What is known of a model's changes once the transitions were looked at.

    Attributes:
        ground: The model with what was added; its literals are the file's, then one an addition.
        additions: The terms that were added.
        fit: All literals.
    """

    ground: g.GroundModel
    additions: tuple[Addition, ...]
    fit: LiteralFit


def explain(model: TransitionModel, sample: Sample) -> Explanation:
    """Estimate literals and missing terms together.

    Args:
        model: The model as written.
        sample: At least one transition.
    """
    lifting = Lifting(model.ground)
    refused: list[Addition] = []
    trial = Trial(model, lifting, sample, ())
    for turn in range(_SWEEPS):
        trial, more = _sweep(trial, refused)
        if more and turn < _SWEEPS - 1:
            continue
        # Not before: a term may need the ones beside it to be worth anything.
        pruned = _pruned(trial, refused)
        if pruned is trial:
            break
        trial = pruned
    trial = _simplified(trial)
    return Explanation(trial.ground, trial.additions, trial.fit)


def _sweep(trial: Trial, refused: Sequence[Addition]) -> tuple[Trial, bool]:
    """Look once at every function; return what was found, and whether that is more."""
    before = trial.additions
    pending = trial.symbols
    while pending:
        # What a process reads has to be right before it can be told what the process lacks.
        ready = {s for s in pending if not trial.reads(s) & pending - {s}} or set(pending)
        pending -= ready
        found = trial.search(ready, refused)
        if found:
            trial = trial.with_additions((*trial.additions, *found))
    return trial, trial.additions != before


def _pruned(trial: Trial, refused: list[Addition]) -> Trial:
    """Take away what does not pay after all, the least worthy first; note it as refused."""
    while (worst := trial.worst()) is not None:
        refused.append(worst)
        trial = trial.with_additions([a for a in trial.additions if a != worst])
    for symbol in dict.fromkeys(a.target.symbol for a in trial.additions):
        own = [a for a in trial.additions if a.target.symbol == symbol]
        without = trial.with_additions([a for a in trial.additions if a not in own])
        if trial.explains_away(without, symbol) or not trial.usually_better(without, symbol):
            refused += own
            trial = without
    return trial


def _simplified(trial: Trial) -> Trial:
    """Say once of the world what is said alike of several actions, where that is as good."""
    for several, one in merged(trial.lifting, trial.coefficients):
        simpler = trial.with_additions([a for a in (*trial.additions, one) if a not in several])
        if simpler.as_good_as(trial):
            trial = simpler
    return trial
