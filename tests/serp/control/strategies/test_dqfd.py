"""DQfD: demonstrations first; what is imitated is what was demonstrated, and nothing else."""

from __future__ import annotations

from serp.control.strategies.dqfd import Demonstrations
from tests.serp.control.strategies.scene import forecast, guide, learner_acts

STEPS = 7


def after(steps: int) -> Demonstrations:
    strategy = Demonstrations(guide(imitation_steps=STEPS))
    for _ in range(steps):
        strategy.end_unit("step")
        strategy.end_unit("episode")
    return strategy


def test_the_planner_demonstrates_then_the_learner_acts() -> None:
    assert [learner_acts(after(k)) for k in range(12)] == [k >= STEPS for k in range(12)]
    assert [after(k).rho for k in range(12)] == [float(k >= STEPS) for k in range(12)]


def test_only_what_was_demonstrated_is_imitated() -> None:
    planned = 1
    for step in range(12):
        for executed in (0, planned):
            said = after(step).guidance(forecast([0.0, 1.0]), executed, None)
            assert said is not None
            shown = step < STEPS and executed == planned
            assert said.action == (planned if shown else -1)


def test_the_loss_stays_on_for_the_demonstrations_in_memory_with_the_q_filter() -> None:
    strategy = after(100)
    assert strategy.margin_weight == 1.0
    assert strategy.guided is not None
    assert strategy.guided.q_filter
