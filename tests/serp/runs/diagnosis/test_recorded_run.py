import shutil
from pathlib import Path

import numpy as np
import pytest

import serp
from serp.runs.diagnosis.diagnosis import read_recorded
from tests.serp.runs.runs import without_pictures

QUICK = {
    "planner": {"depth": 1},
    "learner": {"members": 1},
}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "made"
    with without_pictures():
        serp.plan_and_learn("cartpole", settings=QUICK, env_steps=120, out=out, quiet=True)
    return out


@pytest.fixture
def copy(made, tmp_path):
    return Path(shutil.copytree(made, tmp_path / "copy"))


def test_a_run_of_a_task_that_is_not_installed_can_be_read(copy):
    config = copy / "config.json"
    config.write_text(config.read_text().replace('"task": "cartpole"', '"task": "juggling"'))
    recorded = read_recorded(copy)
    seen = recorded.adaptation.experience
    assert recorded.env_steps == len(seen) >= 120
    goes_on = ~seen.over[:-1]
    np.testing.assert_array_equal(seen.states[1:][goes_on], seen.next_states[:-1][goes_on])
