from __future__ import annotations

import contextlib

import numpy as np
import pytest

from serp.errors import RunError
from serp.model.learned.adapted_model import AdaptedModel
from serp.model.learned.residual_features import SMOOTH
from tests.serp.model.learned import worlds
from tests.serp.model.learned.rolls import from_text
from tests.serp.model.learned.worlds import FLEET, ICE, MILD, PLANE, publish


def test_what_is_saved_holds_no_addresses_of_this_process() -> None:
    model = AdaptedModel(worlds.shipped("cartpole"))
    saved = model.buffer.contents()
    program = model.program
    callbacks = [program.native(part) for part in ("step", "flow", "settle")]
    addresses = np.array([callback.address for callback in callbacks], dtype=float)
    assert not any(np.isin(addresses, array).any() for array in saved.values())
    assert np.isin(addresses, model.buffer.array).all()


@pytest.mark.parametrize("text", [PLANE, ICE])
def test_what_belongs_to_another_domain_is_refused_and_changes_nothing(text: str) -> None:
    model = AdaptedModel(from_text(text).model)
    publish(model, np.random.default_rng(1), MILD)
    before = model.buffer.array.tobytes()
    for other in (from_text(FLEET).model, worlds.shipped("cartpole"), worlds.shipped("cliff")):
        with pytest.raises(RunError, match="another domain"):
            model.buffer.restore(AdaptedModel(other).buffer.contents())
    assert model.buffer.array.tobytes() == before
    # Nor may the file have other numbers: steps would be flagged by what another file says.
    written = worlds.shipped("cartpole")
    with pytest.raises(RunError, match="another domain"):
        AdaptedModel(written).buffer.restore(
            AdaptedModel(written.replace(theta=1.5 * written.theta)).buffer.contents()
        )


def test_what_compiled_code_indexes_with_is_no_part_of_what_is_saved() -> None:
    """Where anything lies follows from the domain; of the rest each number is checked."""
    model = AdaptedModel(worlds.shipped("soccer"))
    saved = model.buffer.contents()
    header = model.buffer.array.copy()
    for name, array in saved.items():
        for value in (-1.0, 2.0**45, np.nan):
            if array.dtype == np.bool_ or not array.size:
                continue
            whole = array.dtype == np.int64
            forged = {**saved, name: np.full_like(array, np.nan_to_num(value) if whole else value)}
            with contextlib.suppress(RunError):
                model.buffer.restore(forged)
            for part in model.buffer.regressions.values():
                assert part.known in (0, part.columns, part.columns + SMOOTH), (name, value)
            assert np.isfinite(model.buffer.array).all()
    model.buffer.restore(saved)
    assert model.buffer.array.tobytes() == header.tobytes()
