"""Going to and fro without gain is noticed, and nothing else is taken for it."""

import pytest

from serp.runs.oscillation import oscillation
from tests.serp.runs.runs import train
from tests.serp.sample_tasks import SMALL, corridor

PLANS = {
    "dithering": lambda state: "right" if state["x"] % 2 == 0 else "left",
    "onward": lambda state: "right",
}


@pytest.mark.parametrize("name", PLANS)
def test_only_a_cycle_of_two_states_is_reported(tmp_path, name):
    own = {"name": name, "depth": 1}
    alone = {"arbiter": {"rho": 0.0, "rho_increment": 0.0}, "guide": {"strategy": "mixture"}}
    settings = {"*": {**SMALL, **alone, "planner": own, "training": {"episode_steps": 20}}}
    task = corridor(tmp_path, planners=PLANS, settings=settings)
    run = train(task, tmp_path / "run", episodes=5)
    told = oscillation(run, run.recording())
    assert (told is not None) == (name == "dithering")
    assert told is None or "with `left` and `right`" in told or "with `right` and `left`" in told
