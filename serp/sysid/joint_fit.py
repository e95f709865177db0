"""Joint estimation of the file's parameters and of the effects that it lacks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from serp.model.transition_model import TransitionModel
from serp.sysid.added_effects import AddedEffect
from serp.sysid.effect_fit import EffectFit
from serp.sysid.lifted_features import WORLD, LiftedFluent, LiftedModel
from serp.sysid.regression_data import RegressionData

_MAX_SWEEPS = 6
_EQUAL = 0.1  # coefficients that differ by less than this fraction of the larger one may be equal


def fit_jointly(model: TransitionModel, data: RegressionData) -> EffectFit:
    """Return the model as written with estimated parameters and the effects that it lacks."""
    refused: list[AddedEffect] = []
    fit = EffectFit(model, LiftedModel(model.ground), data, ())
    for turn in range(_MAX_SWEEPS):
        fit, more = _sweep(fit, refused)
        if more and turn < _MAX_SWEEPS - 1:
            continue
        # Only now: an effect may pay only together with others.
        pruned = _pruned(fit, refused)
        if pruned is fit:
            break
        fit = pruned
    return _simplified(fit)


def _sweep(fit: EffectFit, refused: Sequence[AddedEffect]) -> tuple[EffectFit, bool]:
    """Search every function once; return the fit, and whether effects were added."""
    before = fit.added
    pending = fit.symbols
    while pending:
        # The functions that a process reads must be right before effects are added to it.
        ready = {s for s in pending if not fit.reads(s) & pending - {s}} or set(pending)
        pending -= ready
        found = fit.search(ready, refused)
        if found:
            fit = fit.with_effects((*fit.added, *found))
    return fit, fit.added != before


def _pruned(fit: EffectFit, refused: list[AddedEffect]) -> EffectFit:
    """Remove effects that do not pay, the worst first; add them to `refused`."""
    while (worst := fit.worst()) is not None:
        refused.append(worst)
        fit = fit.with_effects([effect for effect in fit.added if effect != worst])
    for symbol in dict.fromkeys(effect.target.symbol for effect in fit.added):
        own = [effect for effect in fit.added if effect.target.symbol == symbol]
        without = fit.with_effects([effect for effect in fit.added if effect not in own])
        if fit.explains_away(without, symbol) or not fit.usually_better(without, symbol):
            refused += own
            fit = without
    return fit


def _simplified(fit: EffectFit) -> EffectFit:
    """Replace equal effects of several actions by one of the world, if that fits as well."""
    for several, one in shared_effects(fit.lifted, fit.coefficients):
        kept = [effect for effect in (*fit.added, one) if effect not in several]
        simpler = fit.with_effects(kept)
        if simpler.as_good_as(fit):
            fit = simpler
    return fit


def shared_effects(
    lifted: LiftedModel, coefficients: Mapping[AddedEffect, float]
) -> Iterator[tuple[list[AddedEffect], AddedEffect]]:
    """Yield nearly equal effects of different schemas, and the world's effect for all of them.

    The world's effect also applies after all other actions, so it need not fit.
    """
    groups: dict[tuple[str, tuple[str, ...]], list[AddedEffect]] = {}
    for effect in coefficients:
        groups.setdefault(effect.symbols, []).append(effect)

    def equal(effect: AddedEffect, group: list[AddedEffect]) -> list[AddedEffect]:
        value = coefficients[effect]
        most = {o: _EQUAL * max(abs(coefficients[o]), abs(value)) for o in group}
        return [other for other in group if abs(coefficients[other] - value) <= most[other]]

    for group in groups.values():
        if any(effect.schema == WORLD for effect in group):
            continue
        alike = max((equal(effect, group) for effect in group), key=len)
        general = _of_the_world(lifted, alike[0])
        if len({effect.schema for effect in alike}) > 1 and general is not None:
            yield alike, general


def _of_the_world(lifted: LiftedModel, effect: AddedEffect) -> AddedEffect | None:
    """Return the same effect of the world; None where its factors cannot be named there."""
    scope = lifted.world(effect.target.symbol)
    (target,) = scope.targets
    names = dict(zip(effect.target.terms, target.terms, strict=True))
    factors = tuple(
        LiftedFluent(factor.symbol, tuple(names.get(term, term) for term in factor.terms))
        for factor in effect.factors
    )
    if not set(factors) <= set(scope.fluents):
        return None
    return AddedEffect(WORLD, target, factors)
