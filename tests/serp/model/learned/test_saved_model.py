"""What an adapted model saves of itself, and what it refuses to restore."""

import numpy as np
import pytest

from serp._core import AdaptedModel as Core
from serp._core import GroupParameters, OutcomeTable, Regression, RegressionSamples
from serp.errors import RunError
from serp.model.learned.adapted_model import AdaptedModel
from serp.model.learned.feature_groups import FEATURES, FULL, SMOOTH
from tests.serp.model.learned import worlds
from tests.serp.model.learned.rolls import from_text
from tests.serp.model.learned.worlds import FLEET, ICE, MILD, PLANE, publish


def bits(model):
    return {name: array.tobytes() for name, array in model.contents().items()}


@pytest.mark.parametrize("text", [PLANE, ICE])
def test_what_belongs_to_another_domain_is_refused_and_changes_nothing(text):
    model = AdaptedModel(from_text(text).model)
    publish(model, np.random.default_rng(1), MILD)
    before = bits(model)
    for other in (from_text(FLEET).model, worlds.shipped("cartpole"), worlds.shipped("cliff")):
        with pytest.raises(RunError, match="another domain"):
            model.restore(AdaptedModel(other).contents())
    assert bits(model) == before
    # Nor may the file have other numbers: steps would be flagged by what another file says.
    written = worlds.shipped("cartpole")
    with pytest.raises(RunError, match="another domain"):
        AdaptedModel(written).restore(
            AdaptedModel(written.replace(theta=1.5 * written.theta)).contents()
        )


def test_each_number_that_is_saved_is_checked():
    model = AdaptedModel(worlds.shipped("soccer"))
    saved, before = model.contents(), bits(model)
    for name, array in saved.items():
        for value in (-1.0, 2.0**45, np.nan):
            if not array.size:
                continue
            whole = array.dtype == np.int64
            forged = {**saved, name: np.full_like(array, np.nan_to_num(value) if whole else value)}
            if whole and value != value:  # zeros
                continue
            try:
                model.restore(forged)
            except RunError:
                continue
            assert not whole and np.isfinite(value), (name, value)
            for part in model.regressions.values():
                assert part.known in (0, part.columns, part.columns + SMOOTH)
                assert np.isfinite(part.linear).all()
        model.restore(saved)
    assert bits(model) == before
    for name in saved:
        with pytest.raises(RunError):
            model.restore({key: array for key, array in saved.items() if key != name})


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
        part.known = part.columns + SMOOTH + 1
    with pytest.raises(ValueError, match="head"):
        part.design_matrix(np.zeros((1, 3)), np.array([2]), np.ones(1))
    with pytest.raises(ValueError, match="inputs"):
        part.design_matrix(np.zeros((1, 2)), np.array([0]), np.ones(1))
    samples, one = RegressionSamples(part), np.ones(1)
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
            samples.choose(first + wrong, whole)
        with pytest.raises(ValueError, match="fluent"):
            step.predicted(first + wrong)
    with pytest.raises(ValueError, match="samples"):
        samples.rows(0, 1)
    with pytest.raises(ValueError, match="samples"):
        samples.restore(1, np.zeros((0, 3)), *2 * (np.zeros((0, 1)),), np.zeros(0, int), one[:0])
    with pytest.raises(ValueError, match="head"):
        samples.restore(1, np.zeros((1, 3)), *2 * (np.zeros((1, 1)),), np.full(1, 2), one)
    written, none = worlds.shipped("cartpole").core, np.zeros((9, 1), np.int64)
    for head, inputs, targets in ((2, [0, 1, 2], [0]), (0, [0, 1], [0]), (0, [0, 1, 9], [0])):
        of = [[(inputs, targets, GroupParameters(part, head))]] + [[]] * (written.actions - 1)
        with pytest.raises(ValueError, match="shape|fluents"):
            Core(written, none[: written.actions] - 1, False, of)
    with pytest.raises(ValueError, match="inputs"):
        GroupParameters(None, 0).outcomes = OutcomeTable(np.array([7]), np.zeros(0, np.int64))
