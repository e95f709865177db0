"""The planner prefers actions with few visits, where that is safe."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from serp.agent.agent import exploration_bonus
from serp.model.flags import APPLICABLE, RISKY, TERMINAL, UNDEFINED, UNSAFE
from serp.planning.forecast import SAFE, Bound
from serp.tasks.action_map import ActionForecast
from tests.generated.profile import examples

MIN_VISITS = 3
FLAGS = (
    APPLICABLE, APPLICABLE | TERMINAL, APPLICABLE | UNSAFE, APPLICABLE | RISKY, 0, UNDEFINED,
)  # fmt: skip


@st.composite
def situations(draw):
    """Forecasts whose choice is unsafe only where nothing is predicted safe, and counts."""
    actions = draw(st.integers(1, 5))
    flags = draw(st.lists(st.sampled_from(FLAGS), min_size=actions, max_size=actions))
    risky = UNSAFE | RISKY
    steps = [
        (0 if f & risky else draw(st.sampled_from((1, 2, SAFE)))) if f & APPLICABLE else -1
        for f in flags
    ]
    best = max(range(actions), key=lambda k: (steps[k], k))
    visits = draw(st.lists(st.integers(0, MIN_VISITS + 1), min_size=actions, max_size=actions))
    forecast = ActionForecast(
        best if steps[best] >= 0 else -1, np.arange(actions), np.arange(actions, dtype=float),
        (np.array(steps) != SAFE).astype(float), np.array(steps), np.zeros(actions),
        np.array(flags), 3, Bound.DEPTH, False,
    )  # fmt: skip
    return forecast, visits


@given(situation=situations())
@examples(100)
def test_the_least_visited_of_the_safe_actions_is_preferred(situation):
    planned, visits = situation
    preferred = exploration_bonus(np.array(visits), MIN_VISITS, planned)
    for ours, theirs in zip(preferred[1:], planned[1:], strict=True):
        assert ours is theirs
    applicable = APPLICABLE | UNSAFE | RISKY | UNDEFINED
    safe = [k for k, flags in enumerate(planned.flags) if flags & applicable == APPLICABLE]
    # What is safe for the whole lookahead; where nothing is, what is safe for a step.
    safe = [k for k in safe if planned.safe_steps[k] == SAFE] or safe
    unknown = [k for k in safe if visits[k] < MIN_VISITS]
    expected = min(unknown, key=lambda k: (visits[k], k)) if unknown else planned.choice
    assert preferred.choice == expected
    assert exploration_bonus(np.array(visits), 0, planned) is planned
