"""What an adapted model saves of itself, and what it refuses to restore."""

import numpy as np
import pytest

from serp._core import AdaptedModel as Core
from serp._core import GroupParameters, OutcomeTable, Regression, RegressionSamples
from serp.errors import RunError
from serp.model.learned.adaptation import ModelAdaptation
from serp.model.learned.adapted_model import AdaptedModel
from serp.model.learned.feature_groups import FEATURES, FULL, SMOOTH
from serp.settings import AdaptationSettings
from tests.serp.model.learned import worlds
from tests.serp.model.learned.rolls import from_text
from tests.serp.model.learned.worlds import FLEET, ICE, MILD, PLANE, adaptation, publish


def bits(of):
    return {name: array.tobytes() for name, array in of.state_dict()[0].items()}


def adaptation_of(model):
    return ModelAdaptation(model, AdaptationSettings(mode="full"), np.random.SeedSequence(0))


@pytest.mark.parametrize("text", [PLANE, ICE])
def test_what_belongs_to_another_domain_is_refused_and_changes_nothing(text):
    of = adaptation(text)
    publish(of.model, np.random.default_rng(1), MILD)
    before = bits(of)
    for other in (from_text(FLEET).model, worlds.shipped("cartpole"), worlds.shipped("cliff")):
        with pytest.raises(RunError, match="another domain|the domain, task or settings"):
            of.load_state_dict(*adaptation_of(other).state_dict())
    assert bits(of) == before
    # Nor may the file have other numbers: steps would be flagged by what another file says.
    written = worlds.shipped("cartpole")
    other = written.replace(theta=1.5 * written.theta)
    with pytest.raises(RunError, match="another domain|the domain, task or settings"):
        adaptation_of(written).load_state_dict(*adaptation_of(other).state_dict())


def test_each_number_that_is_saved_is_checked():
    of = adaptation_of(worlds.shipped("soccer"))
    (saved, meta), before = of.state_dict(), bits(of)
    for name, array in saved.items():
        for value in (-1.0, 2.0**45, np.nan):
            if not array.size or array.dtype == np.bool_:
                continue
            whole = array.dtype.kind in "iu"
            forged = {**saved, name: np.full_like(array, np.nan_to_num(value) if whole else value)}
            if whole and value != value:  # zeros
                continue
            try:
                of.load_state_dict(forged, meta)
            except RunError:
                continue
            assert name == "visits" or (not whole and np.isfinite(value)), (name, value)
            for part in of.model.regressions.values():
                assert part.known in (0, part.columns, part.columns + SMOOTH)
                assert np.isfinite(part.linear).all()
        of.load_state_dict(saved, meta)
    assert bits(of) == before
    for name in ("features", "known"):
        for number in (-1, 1, 2**45):
            with pytest.raises(RunError, match=name if number != 1 else "columns|features"):
                forged = {**meta, "residual0": {**meta["residual0"], name: number}}
                of.load_state_dict(saved, forged)
    # A truth value may be saved with any bits; compiled code takes 0 and 1.
    of.load_state_dict({**saved, "whole": (saved["whole"] * np.uint8(2)).view(np.bool_)}, meta)
    assert bits(of) == before
    for name in saved:
        with pytest.raises(RunError):
            of.load_state_dict({key: array for key, array in saved.items() if key != name}, meta)


def test_the_core_refuses_what_does_not_fit():
    part = Regression(2, 3, 1)
    for wrong in (-1, 4):
        with pytest.raises(ValueError, match="predictor"):
            part.kinds = np.array([wrong])
    for kinds in (np.zeros(0, np.int64), np.full(2, FULL)):
        with pytest.raises(ValueError, match="predictor"):
            part.kinds = kinds
    with pytest.raises(ValueError, match="features"):
        part.features = FEATURES - 1
    with pytest.raises(ValueError, match="columns"):
        part.known = part.columns + SMOOTH
    with pytest.raises(ValueError, match="head"):
        part.design_matrix(np.zeros((1, 3)), np.array([2]), np.ones(1))
    with pytest.raises(ValueError, match="inputs"):
        part.design_matrix(np.zeros((1, 2)), np.array([0]), np.ones(1))
    samples = RegressionSamples(part)
    step = AdaptedModel(worlds.shipped("cartpole")).core.observe(np.zeros(4), 0, np.zeros(4), False)
    three, first, whole = np.arange(3), np.zeros(1, np.int64), np.zeros(4, np.bool_)
    with pytest.raises(ValueError, match="head"):
        samples.learn(-1, step, three, first, whole)
    with pytest.raises(ValueError, match="targets"):
        samples.learn(0, step, three, three, whole)
    for wrong in (-1, 4):
        with pytest.raises(ValueError, match="fluent"):
            samples.learn(0, step, three, first + wrong, whole)
        with pytest.raises(ValueError, match="fluent"):
            step.predicted(first + wrong)
    with pytest.raises(ValueError, match="samples"):
        samples.number = -1
    written, none = worlds.shipped("cartpole").core, np.zeros((9, 1), np.int64)
    for head, inputs, targets in ((2, [0, 1, 2], [0]), (0, [0, 1], [0]), (0, [0, 1, 9], [0])):
        of = [[(inputs, targets, GroupParameters(part, head))]] + [[]] * (written.actions - 1)
        with pytest.raises(ValueError, match="shape|fluents"):
            Core(written, none[: written.actions] - 1, False, of)
    with pytest.raises(ValueError, match="inputs"):
        GroupParameters(None, 0).outcomes = OutcomeTable(np.array([7]), np.zeros(0, np.int64))
