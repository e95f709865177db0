from __future__ import annotations

import numpy as np
import pytest

from serp.correction.corrected import CorrectedModel
from serp.errors import RunError
from tests.serp.correction import worlds
from tests.serp.correction.rolls import from_text
from tests.serp.correction.worlds import FLEET, ICE, MILD, PLANE, any_state, publish

NAMES = ["soccer", "cartpole", "cliff", "1"]


def new(name: str) -> CorrectedModel:
    return CorrectedModel(worlds.generated(1) if name == "1" else worlds.shipped(name))


@pytest.mark.parametrize("name", NAMES)
def test_what_was_published_can_be_published_again_elsewhere(name: str) -> None:
    one, other = new(name), new(name)
    publish(one, np.random.default_rng(1), MILD)
    publish(other, np.random.default_rng(2), MILD)
    saved = one.block.contents()
    other.block.restore(saved)
    assert other.block.contents().tobytes() == saved.tobytes()
    rng = np.random.default_rng(3)
    states = np.array([any_state(one, rng) for _ in range(30)])
    for action in range(len(one.actions)):
        expected = one.step(states, action)
        for ours, theirs in zip(other.step(states, action), expected, strict=True):
            assert np.asarray(ours).tobytes() == np.asarray(theirs).tobytes()


def test_what_is_saved_holds_no_addresses_of_this_process() -> None:
    model = new("cartpole")
    saved = model.block.contents()
    program = model._program
    callbacks = (program.native, program.native_flow, program.native_settle)
    addresses = [callback.address for callback in callbacks]
    assert not np.isin(np.array(addresses, dtype=float), saved).any()
    assert np.isin(np.array(addresses, dtype=float), model.block.array).all()


def test_what_is_saved_is_a_copy() -> None:
    model = new("cartpole")
    saved = model.block.contents()
    before = saved.tobytes()
    publish(model, np.random.default_rng(1), MILD)
    assert saved.tobytes() == before


def test_restoring_changes_the_model_where_it_is() -> None:
    """Whoever holds the array, a planner say, sees what was restored."""
    model, other = new("cartpole"), new("cartpole")
    array = model.block.array
    publish(other, np.random.default_rng(1), MILD)
    model.block.restore(other.block.contents())
    assert model.block.array is array and model.data is array
    assert model.block.active


@pytest.mark.parametrize("text", [PLANE, ICE])
def test_what_belongs_to_another_domain_is_refused_and_changes_nothing(text: str) -> None:
    model = CorrectedModel(from_text(text).model)
    publish(model, np.random.default_rng(1), MILD)
    before = model.block.contents().tobytes()
    for other in (from_text(FLEET).model, worlds.shipped("cartpole"), worlds.shipped("cliff")):
        with pytest.raises(RunError, match="another domain"):
            model.block.restore(CorrectedModel(other).block.contents())
    assert model.block.contents().tobytes() == before


def test_what_belongs_to_a_file_with_other_numbers_is_refused() -> None:
    """Else the step would be flagged by what another file says."""
    written = worlds.shipped("cartpole")
    model = CorrectedModel(written)
    before = model.block.contents().tobytes()
    other = CorrectedModel(written.replace(theta=1.5 * written.theta))
    with pytest.raises(RunError, match="another domain"):
        model.block.restore(other.block.contents())
    assert model.block.contents().tobytes() == before
