"""A short run of the corridor."""

import pytest

from serp.runs.run import load_run
from serp.runs.train import plan_and_learn
from tests.serp.sample_tasks import reckless
from tests.serp.ui.pictures.scene import drawn


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """The folder of a run."""
    folder = tmp_path_factory.mktemp("watching")
    # The learner is evaluated, from the first episode on.
    always = {"guide": {"strategy": "mixture"}, "arbiter": {"rho": 1.0}}
    plan_and_learn(drawn(folder), settings=always, episodes=2, out=folder / "run", quiet=True)
    return folder / "run"


@pytest.fixture
def run(recorded, tmp_path):
    """The run; its learner wants to walk into the pit."""
    run = load_run(recorded, drawn(tmp_path))
    reckless(run.agent)
    return run
