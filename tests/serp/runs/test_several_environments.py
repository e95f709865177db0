"""Several environments that are stepped at the same time train as one after another would."""

import os
import signal
from collections import defaultdict

import numpy as np
import pytest

from serp.errors import EnvironmentFailure, SerpError
from serp.runs.train import plan_and_learn
from serp.runs.trainer import Trainer
from serp.settings import resolve
from tests.serp.runs.runs import CHANGES, everything, resume, rows, train
from tests.serp.sample_tasks import CableCut, Corridor, corridor

ENVS = 3


@pytest.fixture
def several(monkeypatch):
    """All runs have several environments, and begin anew soon."""
    monkeypatch.setitem(CHANGES["default"], "training", {"num_envs": ENVS})
    monkeypatch.setattr("serp.runs.trainer._TOGETHER", 20)


@pytest.mark.usefixtures("several")
def test_a_run_that_was_stopped_continues_as_if_it_had_not(tmp_path):
    train(corridor(tmp_path), tmp_path / "whole", env_steps=120)
    with pytest.raises(EnvironmentFailure, match="cable cut") as failure:
        task = corridor(tmp_path, lambda: CableCut(Corridor(), 25))
        train(task, tmp_path / "cut", env_steps=120)
    assert failure.value.__notes__[0].startswith("It happened in environment ")
    resume(corridor(tmp_path), tmp_path / "cut", env_steps=40)
    resume(corridor(tmp_path), tmp_path / "cut", env_steps=120)
    assert everything(tmp_path / "cut") == everything(tmp_path / "whole")
    made = rows(tmp_path / "cut", "decisions")
    metrics = rows(tmp_path / "cut", "metrics")
    assert [int(row["step"]) for row in made] == list(range(len(made)))
    assert int(metrics[-1]["env_steps"]) == len(made) >= 120
    assert [int(row["episode"]) for row in metrics] == list(range(1, len(metrics) + 1))


class Still(Corridor):
    """Without weather, an episode depends on its seed and its actions alone."""

    def step(self, action):
        seen, reward, *rest = super().step(action)
        return seen * [1.0, 0.0], round(reward, 1), *rest


def test_where_nothing_is_learned_every_episode_is_that_of_a_single_environment(
    tmp_path, monkeypatch
):
    monkeypatch.setattr("serp.runs.trainer._TOGETHER", 20)
    episodes = []
    for count in (1, ENVS):
        settings = {
            "training": {"num_envs": count},
            "adaptation": {"mode": "off"},
            "arbiter": {"rho_increment": 0.0},
            "guide": {"strategy": "mixture"},
        }
        out = tmp_path / str(count)
        plan_and_learn(
            corridor(tmp_path, Still), settings=settings, env_steps=100, out=out, quiet=True
        )
        found = defaultdict(list)
        for row in rows(out, "decisions"):
            found[row["episode"]].append(row["executed"])
        episodes.append(found)
    one, several = episodes
    common = min(len(one), len(several))
    assert common > 10
    assert [one[str(k + 1)] for k in range(common)] == [several[str(k + 1)] for k in range(common)]


class Unsound(Corridor):
    """Goes wrong at its third step."""

    def __init__(self, how):
        super().__init__()
        self.how = how
        if how == "cannot be made":
            raise OSError("no such port")

    def step(self, action):
        seen, reward, terminated, truncated, info = super().step(action)
        if self.made == 3 and self.how == "dies":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.made == 3 and self.how == "sends a function":
            info["why"] = lambda: None
        if self.how == "is interrupted":
            os.kill(os.getpid(), signal.SIGINT)
        if self.how == "gives another shape":
            seen = np.zeros(5)
        return seen, reward, terminated, truncated, info


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("dies", "step with action .* failed: the process of environment 1 died"),
        ("sends a function", "what step returned cannot be sent from another process"),
        ("gives another shape", "the observation: .* 5 numbers of shape"),
        ("cannot be made", "make_env failed: OSError: no such port"),
        ("is interrupted", ""),
    ],
)
def test_what_goes_wrong_in_a_process_is_told(tmp_path, how, said):
    """Ctrl-C is sent to every process of a terminal; the environments leave it to the training."""
    first = iter([""])  # the environment of the task itself
    task = corridor(tmp_path, lambda: Unsound(next(first, how)))
    bound = task.bind()
    settings = resolve("default", task.settings, {"training": {"num_envs": 2}})
    if not said:
        with Trainer(bound, settings, 0) as trainer:
            assert [*trainer.run(), *trainer.run()][2:]
        return
    with pytest.raises(SerpError, match=said), Trainer(bound, settings, 0) as trainer:
        list(trainer.run())
