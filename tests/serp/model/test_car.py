"""A car with engine and drag, of processes and events, against numbers computed by hand."""

from __future__ import annotations

from pathlib import Path

from serp.model.loading import load_domain


def test_the_car_drives_as_computed_by_hand() -> None:
    model = load_domain(Path(__file__).parent / "pddl_files" / "car.pddl").model
    state = model.initial_state
    assert state is not None

    def values() -> tuple[float, ...]:
        return tuple(model.values(state)[k] for k in ("distance", "speed", "acceleration"))

    assert not model.step(state, "accelerate").applicable
    # Every rate is taken from the state after the action, before any of them is applied.
    for action, expected in [
        ("start", (0.0, 0.0, 0.0)),
        ("accelerate", (0.0, 1.0, 1.0)),
        ("accelerate", (1.0, 1 + 2 - 0.125, 2.0)),
        ("wait", (1 + 2.875, 2.875 + 2 - 0.359375, 2.0)),
    ]:
        outcome = model.step(state, action)
        assert outcome.applicable and not outcome.terminal and not outcome.unsafe
        state = outcome.state
        assert values() == expected
    assert not model.step(state, "accelerate").applicable
    # distance 3.875 + 4.515625; the speed stays below 6 when braking, and rises above it if not
    finish = model.step(state, "brake")
    assert (finish.reward, finish.unsafe, finish.terminal) == (5.0, False, True)
    assert model.values(finish.state)["distance"] == 8.390625
    state = model.step(state, "wait").state
    assert values() == (8.390625, 4.515625 + 2 - 0.564453125, 2.0)
    broken = model.step(state, "wait")
    assert (broken.reward, broken.unsafe, broken.terminal) == (-5.0, True, True)
    assert model.values(broken.state)["acceleration"] == 0.0
    assert not model.step(broken.state, "start").applicable
