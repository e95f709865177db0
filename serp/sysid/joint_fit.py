"""The file's literals and the effects that it leaves out, estimated together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from serp.model import ground as g
from serp.model.transition_model import TransitionModel
from serp.sysid.added_effects import AddedEffect
from serp.sysid.effect_fit import EffectFit
from serp.sysid.lifted_features import Lifting
from serp.sysid.parameter_fit import ParameterFit
from serp.sysid.regression_data import RegressionData
from serp.sysid.shared_effects import merged

_SWEEPS = 6


@dataclass(frozen=True)
class JointFit:
    """What is known of a model's changes once the transitions were looked at.

    Attributes:
        ground: The model with what was added; its literals are the file's, then one an addition.
        additions: The terms that were added.
        fit: All literals.
    """

    ground: g.GroundModel
    additions: tuple[AddedEffect, ...]
    fit: ParameterFit


def explain(model: TransitionModel, sample: RegressionData) -> JointFit:
    """Estimate literals and missing terms together.

    Args:
        model: The model as written.
        sample: At least one transition.
    """
    lifting = Lifting(model.ground)
    refused: list[AddedEffect] = []
    trial = EffectFit(model, lifting, sample, ())
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
    return JointFit(trial.ground, trial.additions, trial.fit)


def _sweep(trial: EffectFit, refused: Sequence[AddedEffect]) -> tuple[EffectFit, bool]:
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


def _pruned(trial: EffectFit, refused: list[AddedEffect]) -> EffectFit:
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


def _simplified(trial: EffectFit) -> EffectFit:
    """Say once of the world what is said alike of several actions, where that is as good."""
    for several, one in merged(trial.lifting, trial.coefficients):
        simpler = trial.with_additions([a for a in (*trial.additions, one) if a not in several])
        if simpler.as_good_as(trial):
            trial = simpler
    return trial
