import dataclasses

import numpy as np
import pytest

import serp
from serp.errors import TaskError
from serp.runs.diagnosis.diagnosis import read_recorded
from serp.runs.run import load_run
from serp.tasks.registry import load_task
from tests.serp.runs.runs import without_pictures

QUICK = {
    "planner": {"depth": 1},
    "learner": {"members": 1},
}


def test_a_run_of_a_task_that_is_not_installed_can_be_read(tmp_path):
    juggling = dataclasses.replace(load_task("cartpole"), name="juggling")
    with without_pictures():
        serp.plan_and_learn(juggling, settings=QUICK, env_steps=120, out=tmp_path, quiet=True)
    with pytest.raises(TaskError, match="there is no task `juggling`"):
        load_run(tmp_path)
    recorded = read_recorded(tmp_path)
    seen = recorded.adaptation.experience
    assert recorded.env_steps == len(seen) >= 120
    goes_on = ~seen.over[:-1]
    np.testing.assert_array_equal(seen.states[1:][goes_on], seen.next_states[:-1][goes_on])
