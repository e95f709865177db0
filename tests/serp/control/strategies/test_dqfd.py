"""DQfD: demonstrations first; what is imitated is what was demonstrated, and nothing else."""

from __future__ import annotations

from serp.control.strategies.dqfd import Demonstrations
from tests.serp.control.scene import guide, learner_acts, told

STEPS = 7


def test_only_what_was_demonstrated_is_imitated_then_the_learner_acts() -> None:
    strategy = Demonstrations(guide(imitation_steps=STEPS))
    for step in range(12):
        assert learner_acts(strategy) == (step >= STEPS)
        assert told(strategy, 1, [0.0, 1.0]).action == (1 if step < STEPS else -1)
        assert told(strategy, 0, [0.0, 1.0]).action == -1  # somebody else's
        # The loss stays on for the demonstrations in memory, with the Q-filter.
        assert strategy.margin_weight == 1.0
        assert strategy.guided.q_filter
        strategy.end_unit("step")
        strategy.end_unit("episode")
